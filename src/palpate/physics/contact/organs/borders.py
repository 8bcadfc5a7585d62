"""Area of the contact of two surfaces, with its edge between the centres of the candidates' cells.

A sum of the areas of the cells that touch changes by whole cells. Cells i and j border along a line of the length b_ij;
their centres are l_ij apart. Where i touches with the force p_i and j is free with the gap w_j, the overlap that p_i
alone closes and the gap vary along the line of centres, and the edge is where a linear function through both is zero,

    t = s_i/(s_i + w_j),    s_i = C_ii p_i,    C the compliance at rest of both bodies

as a share of l_ij from the centre of i: exactly on a foundation of springs; on a half-space, where the overlap grows
with the square root of the distance from the edge and the gap with its power 3/2, within 10 % of l_ij. The triangle
between the border and the centre of j, of the area b_ij l_ij/4, touches up to the edge, or that of i is free from it:

    A = sum A_i + sum sign(e) (1 - (1 - |e|)²) b_ij l_ij/4,    e = 2 t - 1

The area is continuous: where p_i = 0 the cell i contributes the same as where w_i = 0. Hertz's contact of half-spaces:
within 5 % from 7 cells on, 3 % from 40 on (`tests/physics/contact/test_borders.py`); a sum of cells has 25 and 10 %.
Range: forces that vary slowly against the retardation of the bodies; else the error of the edge is at most half a cell.

b_ij is that of the lines between the centres of the mesh's triangles, the dual edges, whose vectors are the edges times
half the sum of the opposite cotangents (U. Pinkall, K. Polthier, Exp. Math. 2 (1993) 15-36), turned by 90 degrees.
"""

from typing import NamedTuple

import numpy as np

from palpate.compiler.exact import einsum
from palpate.compiler.kernel import ieee_kernel
from palpate.physics.arrays import Array, Indices
from palpate.physics.contact.organs.between import Pair
from palpate.physics.geometry.mesh import Mesh


class Borders(NamedTuple):
    """Borders of cells: the two cells (k,2), and b l/4 [m²] (k)."""

    cells: np.ndarray
    area: np.ndarray


def borders(mesh: Mesh, cell: np.ndarray, centres: np.ndarray, area: np.ndarray) -> Borders:
    """The borders of cells with centres [m] (m,3) and areas [m²] (m); `cell` (V) is that of each vertex, -1: none.

    The triangles of a cell have at most its area, so that its part is never negative."""
    triangles, at = mesh.triangles.astype(np.int64), mesh.vertices
    used = (cell[triangles] >= 0).all(axis=1)
    triangles = triangles[used]
    ends, vectors = [], []
    for k in range(3):
        a, b, c = (triangles[:, (k + i) % 3] for i in range(3))
        one, other = at[a] - at[c], at[b] - at[c]
        twice = np.sqrt(np.sum(np.square(np.cross(one, other)), axis=1))
        cotangent = einsum("ij,ij->i", one, other) / np.maximum(twice, 1e-300)
        crossing = (cell[a] != cell[b]) & (twice > 0.0)
        pair = np.stack([cell[a], cell[b]], axis=1)[crossing]
        along = (0.5 * cotangent[:, None] * (at[b] - at[a]))[crossing]
        turned = pair[:, 0] > pair[:, 1]
        ends.append(np.where(turned[:, None], pair[:, ::-1], pair))
        vectors.append(np.where(turned[:, None], -along, along))
    cells, index = np.unique(np.concatenate(ends), axis=0, return_inverse=True)
    every = np.concatenate(vectors)
    dual = np.stack([np.bincount(index.ravel(), every[:, i], minlength=len(cells)) for i in range(3)], axis=1)
    apart = centres[cells[:, 1]] - centres[cells[:, 0]]
    square = np.sum(np.square(dual), axis=1) * np.sum(np.square(apart), axis=1)
    part = 0.25 * np.sqrt(square)
    whole = sum(np.bincount(cells[:, i], part, minlength=len(area)) for i in range(2))
    most = np.minimum(1.0, area / np.maximum(whole, 1e-300))
    return Borders(cells.astype(np.int64), part * np.minimum(most[cells[:, 0]], most[cells[:, 1]]))


@ieee_kernel
def contact_area(pair: Pair, area: Array, cells: Indices, shares: Array):
    """The area of contact A [m²] after a step; area [m²] (m) of the candidates, `Borders` as arrays."""
    force, total = pair.active.force, 0.0
    for k in range(pair.active.tally[0].active):
        i = pair.active.order[k]
        total += area[i] if force[i] > 0.0 else 0.0
    for k in range(len(cells)):
        i, j = cells[k, 0], cells[k, 1]
        if (force[i] > 0.0) == (force[j] > 0.0):
            continue
        if force[j] > 0.0:
            i, j = j, i
        overlap, gap = (pair.first[i, i] + pair.second[i, i]) * force[i], max(pair.opening[j], 0.0)
        past = 2.0 * overlap / max(overlap + gap, 1e-300) - 1.0  # two rigid organs: 0 / 0
        rest = 1.0 - abs(past)
        part = (1.0 - rest * rest) * shares[k]
        total += part if past > 0.0 else -part
    return total
