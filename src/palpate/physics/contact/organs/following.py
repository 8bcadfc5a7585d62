"""Candidates that follow: the cells of the finer surface keep their places on it, and slide over the other one.

As at the start (`candidates`), gap, normal and place on the other surface are means over the vertices of the cell, of
their nearest points, where both organs are. Until the next computation the gap is linear in the motion, with an
error of s²/2 times the relative curvature for a slide s. So a cell is due when it has slid by more than `FINEST`,
`COARSER` of its opening, and, nearer than `NEAR`, `STEEP` of its approach meanwhile: in each step the next ones of all
that are due, of together `VERTICES` vertices. So organs that approach each other from there on keep their cells. A cell
is also due when one organ has turned against the other by `TILTED`.

The compliances of a cell are due when its centre has moved by `MOVED` on the other surface, or its normal turned by
`TURNED` on one of them, of a cell that is open by more than `CLOSE` by `FAR` times that: in each step those of the
one that is due most (`between_rows`), so that cells next to each other are behind by about the same.

A viscous body answers to a sudden change of a gap by a spike of the force. So a cell that touches takes `EASE` of what
is left of it in each step. A change of a gap without a motion is energy that the contact gives or takes: it is counted
(`jumps`).
"""

from typing import Annotated, NamedTuple

import numpy as np

from palpate.compiler.fields import element_type
from palpate.physics.contact.organs.candidates import Candidates
from palpate.physics.geometry.bvh import CELLS, DISCS, POINTS
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.mesh_closest import TRACKED, MeshClosestPoint
from palpate.physics.geometry.search.foot import FEET

FINEST, COARSER = 5e-5, 0.2  # [m], [1] slide after which gap and normal of a cell are computed again
NEAR, STEEP = 2e-3, 0.5  # [m]; [1] slide over approach of cells that close: less than 27 degrees
TILTED = 0.02  # [rad]
EASE, LEAST = 0.1, 1e-8  # [1]; [m] below which a change is taken at once
VERTICES = 16  # of the cells that are computed again in a step
MOVED, TURNED = 1e-4, 0.005  # [m], [rad] after which the compliances of a cell are computed again
CLOSE, FAR = 1e-3, 5.0  # [m], [1] by how much later those of cells are that are farther apart
TRACKED_TYPE = element_type(TRACKED)


class Track(NamedTuple):
    """The cells of one surface that follow the other one; no cells: they stay.

    fine      0: the cells keep their places on the first surface, 1: on the second
    begins (m+1), vertices, weights [1] (k)  of the cells on their surface, see `candidates.Shares`
    facing [1] (k,3)   normals of the vertices
    last (k)           triangle of the other surface with the foot of each vertex, in the order of its tables
    places [1] (k,2)   weights of its second and third corner
    base, origin [m] (m,3)  from the centre on the other surface to that on the cell's: at the last approach, and
                       when it was computed;  approached [m] (m)  slide in approaches since then
    jumps [m] (m)      change of the gaps without a motion in this step
    pending [m] (m)    changes that are left
    late [1] (m)       by how much the compliances of a cell are due; 1: they are
    rim (m)            whether a cell is at the end of the region that has cells
    points ... star    the other surface, see `bvh.MeshTables`
    tracked, work, foot  workspaces of `mesh_closest.track_mesh`
    """

    fine: int
    begins: Annotated[np.ndarray, "<i8", 1]
    vertices: Annotated[np.ndarray, "<i8", 1]
    weights: Annotated[np.ndarray, "<f8", 1]
    facing: Annotated[np.ndarray, "<f8", 2]
    last: Annotated[np.ndarray, "<i8", 1]
    places: Annotated[np.ndarray, "<f8", 2]
    base: Annotated[np.ndarray, "<f8", 2]
    origin: Annotated[np.ndarray, "<f8", 2]
    approached: Annotated[np.ndarray, "<f8", 1]
    jumps: Annotated[np.ndarray, "<f8", 1]
    pending: Annotated[np.ndarray, "<f8", 1]
    late: Annotated[np.ndarray, "<f8", 1]
    rim: Annotated[np.ndarray, "|u1", 1]
    points: Annotated[np.ndarray, POINTS, 1]
    cells: Annotated[np.ndarray, CELLS, 1]
    discs: Annotated[np.ndarray, DISCS, 1]
    star_at: Annotated[np.ndarray, "<i8", 1]
    star: Annotated[np.ndarray, "<i4", 1]
    tracked: Annotated[np.ndarray, TRACKED_TYPE, 1]
    work: Annotated[np.ndarray, "<i8", 1]
    foot: Annotated[np.ndarray, FEET, 1]


def track(found: Candidates, first: Mesh, second: Mesh) -> Track:
    """The cells at the start."""
    count = len(found.gap)
    mesh, other = (second, first) if found.swapped else (first, second)
    own = found.second if found.swapped else found.first
    search = MeshClosestPoint(other)
    tables = search.tables
    triangles = search.find(mesh.vertices[own.vertices])[2]
    at = np.zeros(len(other.triangles), np.int64)
    at[tables.cells["origin"]] = np.arange(len(tables.cells))
    base = (-1.0 if found.swapped else 1.0) * (found.first.place - found.second.place)
    work = search.scratch()[1]
    size = len(own.vertices)
    return Track(
        int(found.swapped), np.searchsorted(own.cells, np.arange(count + 1)).astype(np.int64), own.vertices,
        own.weights, np.ascontiguousarray(mesh.normals[own.vertices]), at[triangles], np.zeros((size, 2)),
        base, base.copy(), np.zeros(count), np.zeros(count), np.zeros(count), np.zeros(count),
        _rim(mesh, own.vertices, own.cells, count), *tables.arrays,
        np.zeros(1, TRACKED_TYPE), work, np.zeros(1, FEET),
    )  # fmt: skip


def _rim(mesh: Mesh, vertices: np.ndarray, cells: np.ndarray, count: int) -> np.ndarray:
    """Cells with a vertex next to one without a cell."""
    cell = np.full(len(mesh.vertices), -1)
    cell[vertices] = cells
    across = (cell[mesh.triangles] < 0).any(axis=1)
    rim, met = np.zeros(count, np.uint8), cell[mesh.triangles[across]].ravel()
    rim[met[met >= 0]] = 1
    return rim
