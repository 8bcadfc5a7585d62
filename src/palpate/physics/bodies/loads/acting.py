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
    alone: bool,
):
    """R [m] of a load, how much narrower it is than the mesh resolves [1], whether it is near another modulus; w [1] of
    `scattered`, and the mean [1/m] for its `acting_radius`.

    model  a `CondensedModel`;  patch, pull  the load (k,3) on the fine vertices;  total [N] its normal force
    order  (>= touched) coarse vertices of the load
    measure  (V,3) g in its first column; its second one is filled with gamma near another modulus or with w > 0
    alone  whether a load may count as scattered: those of other organs do not
    """
    radius, narrow = load_radius(model.fine, patch, pull, normal, total, model.true.least)
    narrowed = narrow_load(model, patch, pull, normal, total, order, touched, measure, radius)
    if not alone:
        return radius, narrow, narrowed, 0.0, 0.0
    scattered, wider = sharpen_load(
        model, patch, pull, normal, total, order, touched, measure, narrowed, radius, narrow
    )
    return radius, narrow, narrowed, scattered, wider
