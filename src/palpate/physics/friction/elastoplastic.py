"""Elasto-plastic friction: LuGre with bristles that deflect elastically, without slip, below a fraction of their limit.

    dz/dt = v - alpha(z, v) sigma0 v z/g(v)        v = |v|, r = sigma0 |z|/g(v)
    alpha = 0 for r <= share or z.v <= 0,  (1 - cos(pi (r - share)/(1 - share)))/2 up to r = 1,  1 beyond

P. Dupont, V. Hayward, B. Armstrong, F. Altpeter, "Single state elastoplastic friction models", IEEE Trans. Autom.
Control 47 (2002) 787-792. With LuGre's bound on sigma2 it is passive.
"""

import math
from typing import Annotated, NamedTuple

from palpate.compiler.kernel import kernel
from palpate.physics.friction.lugre import active, bristle_energy, force, stick, stribeck


@kernel(error_model="numpy")
def slipping(r, share):
    """alpha(r) [1], the fraction of the motion that is plastic slip, at the relative deflection r [1]."""
    return 0.0 if r <= share else 1.0 if r >= 1.0 else 0.5 - 0.5 * math.cos(math.pi * (r - share) / (1.0 - share))


@kernel(error_model="numpy")
def elastoplastic(law, z, v, load, dt, path):
    """Backward Euler, z+ = (z + v h)/(1 + alpha(z+) sigma0 v h/g), in up to 40 substeps h in which the finger moves by
    at most 1/20 of the bristles' limit; |z| <= mu_s/sigma0 for any v and T. The root is found by bisection: the right
    side decreases with |z+|. The contact sticks while at most half of the motion is plastic slip."""
    speed = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    g = stribeck(speed, law.mu_slide, law.mu_static, law.stribeck)
    parts = int(min(max(math.ceil(20.0 * law.bristle_stiffness * speed * dt / g), 1.0), 40.0))
    h, x = dt / parts, law.bristle_stiffness * speed * dt / parts / g
    u, alpha = z, 0.0
    for _ in range(parts):
        u = (u[0] + v[0] * h, u[1] + v[1] * h, u[2] + v[2] * h)
        trial = law.bristle_stiffness / g * math.sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
        low, high, alpha = trial / (1.0 + x), trial, 0.0
        if u[0] * v[0] + u[1] * v[1] + u[2] * v[2] > 0.0 and trial > law.elastic:
            for _ in range(40):
                middle = 0.5 * (low + high)
                low, high = (
                    (low, middle) if middle * (1.0 + slipping(middle, law.elastic) * x) > trial else (middle, high)
                )
            alpha = slipping(high, law.elastic)
        scale = 1.0 / (1.0 + alpha * x)
        u = (u[0] * scale, u[1] * scale, u[2] * scale)
    return u, force(law, z, u, v, load, dt), alpha <= 0.5


class ElastoPlastic(NamedTuple):
    """LuGre friction without creep: no slip below the fraction `elastic` of static friction."""

    mu_slide: Annotated[float, "1", "> 0"] = 0.5
    mu_static: Annotated[float, "1", "> 0"] = 0.7
    stribeck: Annotated[float, "m/s", "> 0"] = 0.02
    bristle_stiffness: Annotated[float, "1/m", "> 0"] = 3000.0
    bristle_damping: Annotated[float, "s/m", ">= 0"] = 1.0
    viscous: Annotated[float, "s/m", ">= 0"] = 0.4
    elastic: Annotated[float, "1", ">= 0", "< 1"] = 0.9
    rescale: Annotated[bool, "1"] = True  # the bristles shrink where a rising load would otherwise generate energy

    advance, stored, stick, caution = elastoplastic, bristle_energy, stick, active  # type: ignore[misc]
