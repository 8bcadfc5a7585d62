"""A load near another modulus, where C - H of `true_patch` is not smooth at the scale of the patch.

Near a nodule or under a capsule C and H are applied to the narrowed load

    gamma = g - w b (g - h),    b = (R_w² - R²)/(R_w² - R_h²)

R_w is the radius of g on the coarse surface, R_h that of h, the load times (1 - r²/R²)^8. With w = 1 gamma has the true
second moment on the coarse surface. w decreases from 1 at the mean distance `WITHIN` R of the patch from the other
modulus to 0 at `BEYOND` R.
"""

from palpate.compiler.kernel import kernel
from palpate.compiler.memory import stack_zeros
from palpate.physics.arrays import Indices, Matrix, Record, Vector3
from palpate.physics.bodies.patch import patch_radius, share_of

WITHIN, BEYOND = 0.5, 2.0  # [1] Distances from another modulus over R between which w decreases from 1 to 0
MOST_NARROWED = 3.0  # [1] Upper limit of b, for patches that are much narrower than the hat functions


@kernel
def narrow_load(
    model: Record,
    patch: Indices,
    pull: Matrix,
    normal: Vector3,
    total: float,
    order: Indices,
    touched: int,
    measure: Matrix,
    radius: float,
):
    """Fill the second column of `measure` (V,3), whose first contains g, with gamma. False if both are equal.

    model  a `CondensedModel`;  patch, pull  the load (k,3) on the fine vertices;  radius [m] R
    order (>= touched) coarse vertices of the patch
    """
    apart = model.true.apart
    if len(apart) == 0:
        return False
    # w from the patch's mean distance to the other modulus
    away, x = 0.0, stack_zeros((3,))
    for k in range(touched):
        v = order[k]
        away += measure[v, 0] * apart[v]
        measure[v, 1] = 0.0
    at = min(max((away / radius - WITHIN) / (BEYOND - WITHIN), 0.0), 1.0)
    near = 1.0 - at * at * (3.0 - 2.0 * at)
    if near <= 0.0:
        return False
    # h: the load times (1 - r²/R²)^8 about its centre, normalised
    for k in range(len(patch)):
        share = abs(share_of(k, pull, normal, total))
        for i in range(3):
            x[i] += share * model.fine[patch[k], i]
    whole = 0.0
    for k in range(len(patch)):
        p = patch[k]
        d0, d1, d2 = model.fine[p, 0] - x[0], model.fine[p, 1] - x[1], model.fine[p, 2] - x[2]
        inside = max(1.0 - (d0 * d0 + d1 * d1 + d2 * d2) / (radius * radius), 0.0)
        square = inside * inside
        share = abs(share_of(k, pull, normal, total)) * (square * square * (square * square))
        whole += share
        for a in range(3):
            measure[model.corners[p, a], 1] += share * model.weights[p, a]
    if not whole > 0.0:
        return False
    for k in range(touched):
        measure[order[k], 1] /= whole
    # b from the radii, and gamma
    wide = patch_radius(model.vertices, model.moments, order, touched, measure) ** 2
    drawn = patch_radius(model.vertices, model.moments, order, touched, measure[:, 1:]) ** 2
    by = (wide - radius * radius) / max(wide - drawn, 0.25 * radius * radius)
    by = near * min(max(by, 0.0), MOST_NARROWED)
    for k in range(touched):
        v = order[k]
        measure[v, 1] = measure[v, 0] - by * (measure[v, 0] - measure[v, 1])
    return True
