"""Range of bodies of springs, which are fitted to a solid under a patch of radius R, and its notes.

Depth: up to s = 1.5 R, the range of `large_displacement`, the force of a neo-Hookean solid of nu = 0.45 is proportional
to the indentation within 2 %. Beyond, no solid was computed.

Speed: a spring has no memory of the place. Under a patch that slides at the speed v over a Kelvin-Voigt half-space with
the retardation time tau, a constant force f indents at rest by c f, and in the steady slide, where the load of the time
a tau ago lies v tau a behind, by

    s = c f integral_0^inf exp(-a) r(q a) da,    q = v tau/R

r(x/R) [1] is the mean of the displacement over the patch by a load on an equal patch at the distance x, over that at 0
(`true_patch.depth_profile`). At a given indentation springs therefore send a force that is too small by 1 - s/(c f):
8 % at q = 0.25, 20 % at 0.5, 30 % at 0.75, 37 % at 1. In series with a fingertip the error is smaller.
"""

import math

from palpate.compiler.kernel import ieee_kernel
from palpate.compiler.memory import stack_zeros
from palpate.physics.arrays import Array, Indices, Matrix, Vector3
from palpate.physics.bodies.large_displacement import DEEPEST
from palpate.physics.bodies.patch import share_of

FAST = 0.25  # [1] q above which a slide is reported
LAG = ((0.25, 0.08), (0.5, 0.20), (1.0, 0.37))  # [1] q, and how much too small the force is
DEEP_NOTE, FAST_NOTE = 1, 2  # bits


@ieee_kernel
def too_deep(depth: float, vertices: Matrix, nodes: Indices, forces: Matrix, normal: Vector3, total: float):
    """Whether an indentation [m] exceeds 1.5 radii of a load [N] (k,3) with the normal force `total` [N] on vertices
    [m] (V,3): twice the rms distance of the normal force from its centre."""
    if not total > 0.0:
        return False
    centre, square = stack_zeros((3,)), 0.0
    for k in range(len(nodes)):
        share = share_of(k, forces, normal, total)
        for i in range(3):
            centre[i] += share * vertices[nodes[k], i]
    for k in range(len(nodes)):
        share = share_of(k, forces, normal, total)
        for i in range(3):
            square += share * (vertices[nodes[k], i] - centre[i]) ** 2
    return depth > DEEPEST * 2.0 * math.sqrt(max(square, 0.0))


@ieee_kernel
def too_fast(foot: Array, trail: Array, retardation: float, radius: float, dt: float):
    """Whether a loaded foot [m] (3) is more than `FAST` R ahead of the mean place of its load in the last tau [s], that
    is v tau in a steady slide. Updates this place, `trail` [m] (3), by backward Euler; NaN: a new contact."""
    square, share = 0.0, dt / (dt + retardation)
    for i in range(3):
        if not abs(trail[i]) < math.inf:
            trail[i] = foot[i]
        trail[i] += share * (foot[i] - trail[i])
        square += (foot[i] - trail[i]) ** 2
    return square > (FAST * radius) ** 2


def deep_note(radius: float | None = None) -> str:
    """Explains an indentation beyond the range; radius [m] of the patch, None: not known."""
    limit = "" if radius is None else f" of {1e3 * DEEPEST * radius:.3g} mm"
    return (
        f"the indentation exceeds the range of its law{limit}, {DEEPEST:g} radii of the patch. There a solid becomes "
        "stiffer, and the force may be 20 % too small; deformation.ReducedFE extrapolates too"
    )


def fast_note(retardation: float, radius: float) -> str:
    """Explains a slide beyond the range, with retardation tau > 0 [s] and radius R [m] of the patch."""
    mm = 1e3 * radius / retardation
    errors = ", ".join(f"{100 * error:.0f} % at {q * mm:.3g} mm/s" for q, error in LAG)
    return (
        f"the finger slides faster than {FAST * mm:.3g} mm/s. Springs have no memory of the place, and a solid with "
        f"this retardation is stiffer there: the force is too small, by at most {errors}"
    )
