"""Coulomb friction with an elastic stick."""

import math
from typing import Annotated, NamedTuple

from palpate.compiler.kernel import kernel


@kernel(error_model="numpy")
def coulomb(law, z, v, load, dt, path):
    """Return mapping: the trial deflection z + v T of a spring k [N/m] is projected radially onto |k z| <= mu f_n.
    Exact for a straight path, without chatter, and passive for any T and load: the spring never gains energy."""
    x, y, w = z[0] + v[0] * dt, z[1] + v[1] * dt, z[2] + v[2] * dt
    length = math.sqrt(x * x + y * y + w * w)
    limit = law.mu * load / law.stiffness
    stick = length <= limit
    scale = 1.0 if stick else limit / length
    k = law.stiffness * scale
    return (x * scale, y * scale, w * scale), (k * x, k * y, k * w), stick


@kernel
def energy(law, z, load):
    """Energy k |z|²/2 [J] stored in the spring at the deflection z [m] (3)."""
    return 0.5 * law.stiffness * (z[0] * z[0] + z[1] * z[1] + z[2] * z[2])


class Coulomb(NamedTuple):
    """Coulomb friction with an elastic stick: a spring that slips at mu times the normal force.

    The contact sticks while the motion only stretches the spring; it does not stick when apart.
    """

    mu: Annotated[float, "1", ">= 0"] = 0.5
    stiffness: Annotated[float, "N/m", "> 0"] = 1500.0

    advance, stored = coulomb, energy  # type: ignore[misc]
