"""LuGre friction (Canudas de Wit, Olsson, Astrom & Lischinsky, IEEE Trans. Autom. Control 40, 1995, 419-425) over the
normal force, vectors in the tangent plane, v = |v|:

    dz/dt = v - sigma0 v z/g(v),    g(v) = mu_c + (mu_s - mu_c) e^{-(v/v_s)²}
    f_t   = f_n (sigma0 z + sigma1 dz/dt + sigma2 v)

z [m] bristle deflection; sigma0, sigma1, sigma2 are `bristle_stiffness`, `bristle_damping` and `viscous`.
"""

import math
from typing import Annotated, Literal, NamedTuple

from palpate.compiler.kernel import kernel


@kernel(error_model="numpy")
def stribeck(speed, mu_slide, mu_static, fall):
    """g(v) = mu_c + (mu_s - mu_c) e^{-(v/v_s)²} [1], the steady coefficient of friction at a speed v [m/s]."""
    ratio = speed / fall
    return mu_slide + (mu_static - mu_slide) * math.exp(-ratio * ratio)


@kernel(error_model="numpy")
def force(law, before, after, v, load, dt):
    """f_n (sigma0 z + sigma1 (z+ - z)/T + sigma2 v) [N] (3)."""
    s0, s1, s2 = load * law.bristle_stiffness, load * law.bristle_damping / dt, load * law.viscous
    return (
        s0 * after[0] + s1 * (after[0] - before[0]) + s2 * v[0],
        s0 * after[1] + s1 * (after[1] - before[1]) + s2 * v[1],
        s0 * after[2] + s1 * (after[2] - before[2]) + s2 * v[2],
    )


@kernel(error_model="numpy")
def lugre(law, z, v, load, dt, path):
    """z+ = z e^{-aT} + v T phi(aT),  phi(x) = (1 - e^{-x})/x,  a = sigma0 v/g: exact at constant velocity.

    z+ is a weighted mean of z and the steady z, so |z| <= mu_s/sigma0 + `play` for any v and T. `update` selects
    backward Euler instead. In aT the path [m] of the dragged point replaces v T (bristle.py).

    The contact sticks while less than half of the motion is plastic slip: sigma0 z.v/|v| < g(v)/2, or v = 0.
    """
    speed = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    g = stribeck(speed, law.mu_slide, law.mu_static, law.stribeck)
    x = law.bristle_stiffness * path / g
    if law.update == 0:
        keep = math.exp(-x)
        gain = dt * (1.0 - 0.5 * x if x < 1e-5 else -math.expm1(-x) / x)
    else:
        keep = 1.0 / (1.0 + x)
        gain = dt * keep
    u = (z[0] * keep + v[0] * gain, z[1] * keep + v[1] * gain, z[2] * keep + v[2] * gain)
    along = law.bristle_stiffness * (u[0] * v[0] + u[1] * v[1] + u[2] * v[2])
    return u, force(law, z, u, v, load, dt), speed == 0.0 or along < 0.5 * g * speed


@kernel
def bristle_energy(law, z, load):
    """Energy f_n sigma0 |z|²/2 [J] stored in the bristles at the deflection z [m] (3) and the load f_n [N]."""
    return 0.5 * load * law.bristle_stiffness * (z[0] * z[0] + z[1] * z[1] + z[2] * z[2])


def stick(law, load: float) -> tuple[float, float]:  # type: ignore[no-untyped-def]
    """Spring f_n sigma0 [N/m] and damper f_n (sigma1 + sigma2) [N s/m] of the stick under a normal force f_n [N]."""
    return load * law.bristle_stiffness, load * (law.bristle_damping + law.viscous)


def passive_viscous(mu_slide: float, mu_static: float, bristle_damping: float) -> float:
    """sigma1 (mu_s - mu_c)/mu_c [s/m], the least sigma2 at which LuGre friction under constant load is passive
    (Barabanov & Ortega, IEEE Trans. Autom. Control 45, 2000, 675-686)."""
    return bristle_damping * (mu_static - mu_slide) / mu_slide


def active(law) -> str:
    """A warning about settings of a LuGre law that generate energy under constant load; "" for a passive law."""
    least = passive_viscous(law.mu_slide, law.mu_static, law.bristle_damping)
    if law.viscous >= least * (1.0 - 1e-9):
        return ""
    return (
        f"friction: viscous {law.viscous:g} s/m lets the law generate energy; it is passive from {least:.3g} s/m on "
        "(bristle_damping (mu_static - mu_slide)/mu_slide)"
    )


class LuGre(NamedTuple):
    """LuGre friction: presliding, Stribeck effect and viscous friction, proportional to the normal force.

    The contact sticks while less than half of the finger's motion is plastic slip; it does not stick when apart. Below
    viscous = bristle_damping (mu_static - mu_slide)/mu_slide the law can generate energy. Under an oscillating load
    below static friction it creeps; friction.ElastoPlastic does not.
    """

    mu_slide: Annotated[float, "1", "> 0"] = 0.5
    mu_static: Annotated[float, "1", "> 0"] = 0.7
    stribeck: Annotated[float, "m/s", "> 0"] = 0.02
    bristle_stiffness: Annotated[float, "1/m", "> 0"] = 3000.0
    bristle_damping: Annotated[float, "s/m", ">= 0"] = 1.0
    viscous: Annotated[float, "s/m", ">= 0"] = 0.4
    update: Annotated[Literal["exponential", "euler"], "1"] = "exponential"
    rescale: Annotated[bool, "1"] = True  # the bristles shrink where a rising load would otherwise generate energy
    play: Annotated[float, "m", ">= 0"] = 0.0  # smaller motion does not relax the bristles; use half an encoder count

    advance, stored, stick, caution = lugre, bristle_energy, stick, active  # type: ignore[misc]
