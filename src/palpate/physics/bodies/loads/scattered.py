"""Compliance under a load that is not one patch, as on both rims of a groove.

`true_patch` corrects a load that the hats of the coarse surface widen by what a half-space has under one biweight patch
of the same second moment. A load on two rims has the second moment of a patch that is as wide as both, and the
compliance of two narrow ones: over a groove of 8 mm that form is 40 % too stiff. And next to free walls C - H is not
smooth at the scale of the load, as near a nodule. Both are corrected from the load g on the coarse vertices and its
mean over the hats,

    W_uv = integral of phi_u phi_v over that of phi_v    (columns sum to 1),

which widens it once more, by as much as the hats have done:

    c_R = (1 - nu²)/pi (2/(g.T g)² - 1/((W g).T (W g))²)^½    c^-2 is linear in the second moment, exact for one patch
    gamma ~ x g/W x,  x = g g/W g                             in place of g in C and H

gamma is the second step of the deconvolution of g by W of R. Gold (ANL-6984, 1964): positive, on the vertices of g, and
zero with g, so that a vertex that the load reaches adds to it continuously. (2 g - W g, limited to the vertices of g,
is nearer to full elements, and made the force jump by 0.2 N when a vertex was reached.) Next to another modulus, where
g is narrowed as well, it is the first step x. The form is used with the weight w of a load that is scattered. Its
compactness is the area of a uniform pressure with the same force and the same integral of its square, over that of a
biweight patch of its second moment,

    q = (sum of g_j²/A_j)^-1 / (5 pi R²/9),

1 for a biweight and a Hertzian patch, 0.93 for Wendland's, at least 0.99 on the shipped organs, 0.8, 0.6 and 0.3 in the
middle of grooves of 2, 4 and 8 mm. w falls from 1 at q = `SCATTERED` to 0 at `COMPACT`.

Under the same loads linear elements have 652, 573 and 606 N/m where this has 691, 622 and 663 N/m, and one patch 715,
707 and 850 N/m (block of the zoo, grooves of 2, 4 and 8 mm, R = 8 mm; `benchmarks/pad_on_groove.py --same-load`).
"""

from typing import Annotated, NamedTuple

import numpy as np

from palpate.compiler.kernel import kernel
from palpate.physics.arrays import Array, Indices, Matrix, Record, Vector3
from palpate.physics.bodies.patch import MEAN, compactness
from palpate.physics.geometry.mesh import Mesh

COMPACT, SCATTERED = 0.9, 0.75  # [1] compactness between which w rises from 0 to 1
LEAST = 0.1  # [1] lower limit of c_R^-2 over that of g
ROWS = 32  # of a table that are widened at a time
TINY = 1e-12  # [1] share that cannot be divided by


class Means(NamedTuple):
    """W of a coarse surface, by columns; without rows nothing is widened."""

    near: Annotated[np.ndarray, "<i4", 2]  # [1] (V,k) v and its neighbours, padded with v
    shares: Annotated[np.ndarray, "<f8", 2]  # [1] (V,k) W_uv of these u
    table: Annotated[np.ndarray, "<f8", 2]  # [1/m] (V,V) W' T W: W g has four times as many pairs of vertices as g


def no_means() -> Means:
    """No means: no load counts as scattered."""
    return Means(np.zeros((0, 0), np.int32), np.zeros((0, 0)), np.zeros((0, 0)))


def hat_means(mesh: Mesh, table: np.ndarray) -> Means:
    """W of a surface: the integral of two hats over a triangle is 1/12 of its area, of the square of one 1/6. `table`:
    T [1/m] (V,V)."""
    size, triangles = len(mesh.vertices), mesh.triangles.astype(np.int64)
    area = 0.5 * np.linalg.norm(mesh.face_vectors, axis=1)
    column, row = np.repeat(triangles, 3, axis=1).ravel(), np.tile(triangles, 3).ravel()
    both, where = np.unique(column * size + row, return_inverse=True)
    shares = np.bincount(where, np.repeat(area / 12.0, 9) * np.where(column == row, 2.0, 1.0))
    column, row = both // size, both % size
    first = np.searchsorted(column, np.arange(size + 1))
    slot = np.arange(len(both)) - first[column]
    near = np.repeat(np.arange(size, dtype=np.int32)[:, None], max(slot.max(initial=0) + 1, 1), axis=1)
    part = np.zeros(near.shape)
    near[column, slot], part[column, slot] = row, shares
    total = part.sum(axis=1)
    part /= np.where(total > 0.0, total, 1.0)[:, None]
    once = np.ascontiguousarray(_widen_rows(near, part, table).T)
    return Means(near, part, np.ascontiguousarray(_widen_rows(near, part, once).T))


def _widen_rows(near: np.ndarray, shares: np.ndarray, table: np.ndarray) -> np.ndarray:
    """W' times a table (V,V), some rows at a time, as many as stay in the cache of the processor."""
    found = np.zeros(table.shape)
    for first in range(0, len(table), ROWS):
        rows = slice(first, first + ROWS)
        for slot in range(near.shape[1]):
            found[rows] += shares[rows, slot, None] * table[near[rows, slot]]
    return found


@kernel
def _widen(means: Means, order: Indices, touched: int, measure: Matrix):
    """Fill the second column of `measure` with W x of the first step x, at the vertices of g."""
    for k in range(touched):
        measure[order[k], 1] = 0.0
    for k in range(touched):
        v = order[k]
        x = measure[v, 0] * measure[v, 0] / max(measure[v, 2], TINY)
        for s in range(means.near.shape[1]):
            u = means.near[v, s]
            if measure[u, 0] > 0.0:
                measure[u, 1] += means.shares[v, s] * x


@kernel
def _sharper(row: Array, once: bool):
    """The sharpened share of a vertex, without a common factor, from g, W x and W g; after one step if `once`."""
    x = row[0] * row[0] / max(row[2], TINY)
    return x if once else x * row[0] / max(row[1], TINY)


@kernel
def sharpen_load(
    model: Record,
    patch: Indices,
    pull: Matrix,
    normal: Vector3,
    total: float,
    order: Indices,
    touched: int,
    measure: Matrix,
    narrowed: bool,
    radius: float,
    narrow: float,
):
    """Blend the second column of `measure` (V,3) with gamma if the load is scattered. Returns w, with which the second
    column is to be used if it is above 0, and (W g).T (W g) [1/m].

    model  a `CondensedModel`;  patch, pull  the load (k,3) on the fine vertices;  total [N] its normal force
    order  (>= touched) coarse vertices of the load
    measure  g in its first column, a load of `narrow_load` in its second one if `narrowed`, its third is overwritten
    radius [m], narrow [1]  see `load_radius`
    """
    means = model.true.means
    if len(means.near) == 0:
        return 0.0, 0.0
    compact = compactness(patch, pull, normal, total, model.true.least, radius)
    at = min(max((COMPACT - compact) / (COMPACT - SCATTERED), 0.0), 1.0)
    weight = at * at * (3.0 - 2.0 * at) * max(1.0 - narrow, 0.0)
    if weight == 0.0:
        return 0.0, 0.0
    near, shares = means.near, means.shares
    # W g at the vertices of g, and its product with T
    for k in range(touched):
        v = order[k]
        for s in range(near.shape[1]):
            measure[near[v, s], 2] = 0.0
    wider = 0.0
    for k in range(touched):
        v = order[k]
        share = measure[v, 0]
        for s in range(near.shape[1]):
            measure[near[v, s], 2] += shares[v, s] * share
        row = 0.5 * share * means.table[v, v]
        for m in range(k):
            row += measure[order[m], 0] * means.table[v, order[m]]
        wider += 2.0 * share * row
    if not narrowed:
        _widen(means, order, touched, measure)
    whole = 0.0
    for k in range(touched):
        whole += _sharper(measure[order[k]], narrowed)
    for k in range(touched):
        v = order[k]
        before = measure[v, 1] if narrowed else measure[v, 0]
        measure[v, 1] = before + weight * (_sharper(measure[v], narrowed) / max(whole, TINY) - before)
    return weight, wider


@kernel
def acting_radius(radius: float, weight: float, hats: float, wider: float):
    """Radius [m] of the patch that has c_R, blended with that of the load by w, from g.T g and `wider` [1/m] of
    `sharpen_load`."""
    if not (weight > 0.0 and hats > 0.0 and wider > 0.0):
        return radius
    square = max(2.0 / (hats * hats) - 1.0 / (wider * wider), LEAST / (hats * hats))
    return radius + weight * (MEAN * np.sqrt(square) - radius)
