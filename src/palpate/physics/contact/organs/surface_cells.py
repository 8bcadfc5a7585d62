"""Cells of a whole surface, of which the candidates of a contact are those near the other organ.

Where organs roll on each other, the contact wanders over the finer surface. So all vertices of it belong to fine cells:
each to the nearest of a set of centres, whose spacing gives them the mean area of those cells of the start
(`candidates`) whose gap is below the median. The cells of the start that are larger by `LARGER` are divided: they are
the parents of fine cells, and a candidate leaves its parent for them before the contact arrives there.

Vertices with opposite normals, as on a thin lobe, belong to different cells: a turn of the normal counts as a way,

    |x - y|² + h² |n_x - n_y|²,    h the spacing of the centres
"""

from typing import NamedTuple

import numpy as np

from palpate.physics.contact.organs.borders import Borders, borders
from palpate.physics.contact.organs.candidates import Candidates, shares_of
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.nearest import nearest, tree_of

SCATTER = 1.4  # [1] area per centre over the square of their least distance, of centres chosen in any order
LARGER = 1.5  # [1] area of a cell that is divided over that of fine cells


class SurfaceCells(NamedTuple):
    """The m cells of a contact at the start, then fine cells: M in all.

    begins (M+1), vertices, weights [1] (k)  as of `candidates.Shares`
    place [m] (M,3), area [m²] (M)
    parent (M)   the cell of the start of which it is a part, -1: none
    child (M)    its first fine cell, -1: it is not divided
    near_at (M+1), near, strips [m²] (e)     the neighbours of each cell, and the areas of `borders.Borders`
    """

    begins: np.ndarray
    vertices: np.ndarray
    weights: np.ndarray
    place: np.ndarray
    area: np.ndarray
    parent: np.ndarray
    child: np.ndarray
    near_at: np.ndarray
    near: np.ndarray
    strips: np.ndarray


def surface_cells(mesh: Mesh, found: Candidates) -> SurfaceCells:
    """All cells of the surface on which the candidates stay."""
    own, count = found.second if found.swapped else found.first, len(found.gap)
    first = np.full(len(mesh.vertices), -1)  # cell of the start of each vertex
    first[own.vertices] = own.cells
    fine_area = float(found.area[found.gap <= np.median(found.gap)].mean())
    divided = np.append(found.area > LARGER * fine_area, True)  # the last one: outside
    fine = np.flatnonzero(divided[first] & (mesh.areas > 0.0))
    spacing = float(np.sqrt(fine_area / SCATTER))
    # parents 1 m apart
    points = np.concatenate([mesh.vertices[fine], spacing * mesh.normals[fine], first[fine, None]], axis=1)
    centres = _centres(points, spacing)
    part = nearest(tree_of(points[centres]), points)[1][:, 0] if len(centres) else np.zeros(0, np.int64)
    parent = first[fine[centres]]
    # parents with one part are not divided
    used = (np.bincount(parent + 1, minlength=count + 1)[parent + 1] > 1) | (parent < 0)
    number = np.where(used, np.cumsum(used) - 1, -1)[part]
    fine, part, parent = fine[number >= 0], number[number >= 0], parent[used]
    total, areas = int(used.sum()), mesh.areas[fine]
    area = np.bincount(part, areas, minlength=total).astype(float)
    rest = shares_of(part, fine, areas / area[part], mesh, total)
    last = first.copy()
    last[fine] = count + part
    place, area = np.concatenate([own.place, rest.place]), np.concatenate([found.area, area])
    parent = np.concatenate([np.full(count, -1), parent])
    child = np.full(count + total, -1)
    child[parent[::-1][parent[::-1] >= 0]] = np.flatnonzero(parent >= 0)[::-1]
    near_at, near, strips = _neighbours(mesh, found, first, last, place, area, parent)
    sizes = np.bincount(np.concatenate([own.cells, count + rest.cells]), minlength=len(area))
    return SurfaceCells(
        _begins(sizes), np.concatenate([own.vertices, rest.vertices]), np.concatenate([own.weights, rest.weights]),
        place, area, parent, child, near_at, near, strips,
    )  # fmt: skip


def _centres(points: np.ndarray, spacing: float) -> np.ndarray:
    """Indices of points (n,d) in this order, each without others chosen before it within the spacing."""
    free, chosen = np.ones(len(points), bool), []
    around = tree_of(points).query_ball_point(points, 1.001 * spacing) if len(points) else []
    for k, near in enumerate(around):
        if free[k]:
            chosen.append(k)
            near = np.array(near)  # the last bit of scipy's distances depends on the processor
            free[near[np.sum(np.square(points[near] - points[k]), axis=1) < spacing * spacing]] = False
    return np.array(chosen, np.int64)


def _neighbours(
    mesh: Mesh, found: Candidates, first: np.ndarray, last: np.ndarray, place: np.ndarray, area: np.ndarray,
    parent: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """`near_at`, `near` and `strips` of `SurfaceCells`; first, last (V)  cell of each vertex if all cells of the start
    are used, and if all divided ones are left. Those between cells of the start are unchanged; that of a parent with a
    fine cell is the sum over its parts."""
    met = borders(mesh, np.where(first >= 0, first, last), place, area)
    outside = (met.cells >= len(found.gap)).any(axis=1)
    whole = Borders(np.concatenate([found.borders.cells, met.cells[outside]]),
                    np.concatenate([found.borders.area, met.area[outside]]))  # fmt: skip
    parts = borders(mesh, last, place, area)
    parts = Borders(*(each[(parent[parts.cells] >= 0).any(axis=1)] for each in parts))
    cells, strips = [whole.cells, parts.cells], [whole.area, parts.area]
    over = parent[parts.cells]
    for side in range(2):  # with the parent in place of its part, of two different parents
        mixed = (over[:, side] >= 0) & (over[:, 0] != over[:, 1]) & (over[:, 1 - side] >= 0)
        cells.append(np.stack([over[mixed, side], parts.cells[mixed, 1 - side]], axis=1))
        strips.append(parts.area[mixed])
    pairs, strip = np.concatenate(cells), np.concatenate(strips)
    both, index = np.unique(np.concatenate([pairs, pairs[:, ::-1]]), axis=0, return_inverse=True)
    return (
        _begins(np.bincount(both[:, 0], minlength=len(area))), both[:, 1].copy(),
        np.bincount(index.ravel(), np.tile(strip, 2), minlength=len(both)),
    )  # fmt: skip


def _begins(sizes: np.ndarray) -> np.ndarray:
    return np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
