"""Coulomb friction with a viscoelastic stick."""

import math
from typing import Annotated, NamedTuple

from palpate.compiler.kernel import kernel


@kernel(error_model="numpy")
def coulomb(law, z, v, load, dt, path):
    """Return mapping. The trial force of a spring k [N/m] with a damper d [N s/m] in parallel, at the deflection
    z + v T, is projected radially onto the disc of friction:

        f* = k (z + v T) + d v,    f = f* min(1, mu f_n/|f*|),    z+ = (f + d z/T)/(k + d/T)

    The force never exceeds mu f_n and equals it in a slide, whatever d is. Exact for a straight path, without chatter,
    and passive for any T, load and d: with p = v T - (z+ - z) the slip, f.p = (|f*|/|f| - 1) |f|²/(k + d/T) >= 0, and
    f.(z+ - z) = k z+.(z+ - z) + d |z+ - z|²/T is at least the increase of k |z|²/2.
    """
    k, d = law.stiffness, law.damping
    x, y, w = z[0] + v[0] * dt, z[1] + v[1] * dt, z[2] + v[2] * dt
    if d == 0.0:
        length = math.sqrt(x * x + y * y + w * w)
        limit = law.mu * load / k
        stick = length <= limit
        scale = 1.0 if stick else limit / length
        k *= scale
        return (x * scale, y * scale, w * scale), (k * x, k * y, k * w), stick
    fx, fy, fw = k * x + d * v[0], k * y + d * v[1], k * w + d * v[2]
    pull, limit = math.sqrt(fx * fx + fy * fy + fw * fw), law.mu * load
    if pull <= limit:
        return (x, y, w), (fx, fy, fw), True
    scale, both, rate = limit / pull, k + d / dt, d / dt
    fx, fy, fw = fx * scale, fy * scale, fw * scale
    back = (fx + rate * z[0]) / both, (fy + rate * z[1]) / both, (fw + rate * z[2]) / both
    return back, (fx, fy, fw), False


@kernel
def spring_energy(law, z, load):
    """Energy k |z|²/2 [J] stored in the spring at the deflection z [m] (3)."""
    return 0.5 * law.stiffness * (z[0] * z[0] + z[1] * z[1] + z[2] * z[2])


def stick(law, load: float) -> tuple[float, float]:  # type: ignore[no-untyped-def]
    """Spring [N/m] and damper [N s/m] of the stick under a normal force [N]."""
    return law.stiffness, law.damping


class Coulomb(NamedTuple):
    """Coulomb friction with a viscoelastic stick: a spring and damper that slip at mu times the normal force.

    The contact sticks while the motion only stretches the spring; it does not stick when apart. An undamped spring
    (`damping: 0`) oscillates against a lightly held device that reports its position late.
    """

    mu: Annotated[float, "1", ">= 0"] = 0.5
    stiffness: Annotated[float, "N/m", "> 0"] = 500.0
    damping: Annotated[float, "N s/m", ">= 0"] = 1.5

    advance, stored, stick = coulomb, spring_energy, stick  # type: ignore[misc]
