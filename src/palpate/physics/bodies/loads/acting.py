"""The patch as which a load acts on a condensed body."""

from palpate.compiler.kernel import kernel
from palpate.physics.arrays import Indices, Matrix, Record, Vector3
from palpate.physics.bodies.loads.narrowed import narrow_load
from palpate.physics.bodies.loads.scattered import sharpen_load
from palpate.physics.bodies.patch import load_radius


@kernel
def acting_patch(
    model: Record,
    patch: Indices,
    pull: Matrix,
    normal: Vector3,
    total: float,
    order: Indices,
    touched: int,
    measure: Matrix,
    hats: float,
    alone: bool,
):
    """R [m] of a load, that of the patch with its compliance [m], how much narrower it is than the mesh resolves [1],
    whether it is near another modulus, and w [1] of `scattered`.

    model  a `CondensedModel`;  patch, pull  the load (k,3) on the fine vertices;  total [N] its normal force
    order  (V) coarse vertices of the load, `touched` of them; others are overwritten
    measure  (V,3) g in its first column; its second one is filled with gamma near another modulus or with w > 0
    hats [1/m]  g.T g;  alone  whether a load may count as scattered: those of other organs do not
    """
    radius, narrow = load_radius(model.fine, patch, pull, normal, total, model.true.least)
    narrowed = narrow_load(model, patch, pull, normal, total, order, touched, measure, radius)
    if not alone:
        return radius, radius, narrow, narrowed, 0.0
    acts, scattered = sharpen_load(
        model, patch, pull, normal, total, order, touched, measure, narrowed, hats, radius, narrow
    )
    return radius, acts, narrow, narrowed, scattered
