"""Candidates that follow: the cells of the finer surface keep their places on it, and slide over the other one.

As at the start (`candidates`), gap, normal and place on the other surface are means over the vertices of the cell, of
their nearest points, where both organs are. Until the next computation the gap is linear in the motion, with an
error of s²/2 times the relative curvature for a slide s. So a cell is due when it has slid by more than `FINEST`,
`COARSER` of its opening, and, nearer than `NEAR`, `STEEP` of its approach meanwhile: in each step the next ones of all
that are due, of together `VERTICES` vertices. So organs that approach each other from there on keep their cells. A cell
is also due when one organ has turned against the other by `TILTED`.

The nearest point of a vertex is found by descent from the last one. All of the other surface is searched after the
vertex moved there by half its distance d at the last search, and at least `SEARCHED`: another part of the surface is
still d/2 away then, so that it does not touch.

The compliances of a cell are due when its centre has moved by `MOVED` on the other surface, or its normal turned by
`TURNED` on one of them, of a cell that is open by more than `CLOSE` by `FAR` times that: in each step those of the
one that is due most (`between_rows`), so that cells next to each other are behind by about the same.

A viscous body answers to a sudden change of a gap by a spike of the force. So a cell that touches takes what is left of
it with the time constant `EASED`: T/(T + `EASED`) of it in a step T. With the retardation tau of the bodies, the force
changes at once by (T + tau)/(T + `EASED`) of its change at rest, at any T. A change of a gap without a motion is energy
that the contact gives or takes: it is counted (`jumps`).

Where the contact wanders over the finer surface, as where organs roll, the candidates move to other cells of it
(`surface_cells`): in a step the neighbours of the next `SCANNED` candidates are examined, and the free one with the
largest gap between the undeformed organs moves to one of them where that is smaller, by `BETTER`. So the candidates
remain the cells nearest to the other organ. It begins there without force, at rest under the forces of the step. A cell
of the start that is coarse, because it was far from the smallest gap, is left for a fine part of it where its gap
exceeds the smallest one by less than `NEARER` of that at the start, and is still open by `CLOSE`, so that the other
parts get other candidates before they touch.
"""

from typing import Annotated, NamedTuple

import numpy as np

from palpate.compiler.fields import element_type
from palpate.physics.bodies.between_bodies import mean_inverse
from palpate.physics.contact.organs.candidates import Candidates
from palpate.physics.contact.organs.surface_cells import surface_cells
from palpate.physics.geometry.bvh import CELLS, DISCS, POINTS
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.mesh_closest import TRACKED, WAITING, MeshClosestPoint
from palpate.physics.geometry.search.foot import FEET

FINEST, COARSER = 5e-5, 0.2  # [m], [1] slide after which gap and normal of a cell are computed again
NEAR, STEEP = 2e-3, 0.5  # [m]; [1] slide over approach of cells that close: less than 27 degrees
TILTED = 0.02  # [rad]
EASED, LEAST = 9e-3, 1e-8  # [s]; [m] below which a change is taken at once
SEARCHED = 5e-4  # [m]
VERTICES = 16  # of the cells that are computed again in a step
MOVED, TURNED = 1e-4, 0.005  # [m], [rad] after which the compliances of a cell are computed again
CLOSE, FAR = 1e-3, 5.0  # [m], [1] by how much later those of cells are that are farther apart
SCANNED, BETTER = 16, 0.9  # candidates per step; [1] gap at a new cell over that at the last one
NEARER = 0.8  # [1]
TRACKED_TYPE = element_type(TRACKED)


class Track(NamedTuple):
    """The cells of one surface that follow the other one; no cells: they stay.

    fine      0: the cells keep their places on the first surface, 1: on the second
    begins (M+1), vertices, weights [1] (k)  of all cells of their surface, see `surface_cells.SurfaceCells`
    place [m] (M,3), area [m²] (M), parent, child (M), near_at (M+1), near, strips [m²] (e)  also from there
    beyond [m] (m)     the gap of each cell of the start less the smallest one
    cell (m), slot (M)  the cell of each candidate, and the candidate of each cell; -1: none
    facing [1] (k,3)   normals of the vertices
    last (k)           triangle of the other surface with the foot of each vertex, in the order of its tables
    places [1] (k,2)   weights of its second and third corner
    searched [m] (k,3) place of each vertex on the other organ at its last search;  sure [m] (k)  way to the next one
    base, origin [m] (m,3)  from the centre on the other surface to that on the cell's: at the last approach, and
                       when it was computed;  approached [m] (m)  slide in approaches since then
    jumps [m] (m)      change of the gaps without a motion in this step
    pending [m] (m)    changes that are left
    late [1] (m)       by how much the compliances of a cell are due; 1: they are
    inverse [1/m] (m,m)  X between the candidates, on the organ on which they stay (`between_rows`)
    rim (m)            whether a candidate is at the end of the region that has candidates
    points ... star    the other surface, see `bvh.MeshTables`
    tracked, work, foot  workspaces of `mesh_closest.track_mesh`
    """

    fine: int
    begins: Annotated[np.ndarray, "<i8", 1]
    vertices: Annotated[np.ndarray, "<i8", 1]
    weights: Annotated[np.ndarray, "<f8", 1]
    place: Annotated[np.ndarray, "<f8", 2]
    area: Annotated[np.ndarray, "<f8", 1]
    parent: Annotated[np.ndarray, "<i8", 1]
    child: Annotated[np.ndarray, "<i8", 1]
    near_at: Annotated[np.ndarray, "<i8", 1]
    near: Annotated[np.ndarray, "<i8", 1]
    strips: Annotated[np.ndarray, "<f8", 1]
    beyond: Annotated[np.ndarray, "<f8", 1]
    cell: Annotated[np.ndarray, "<i8", 1]
    slot: Annotated[np.ndarray, "<i8", 1]
    facing: Annotated[np.ndarray, "<f8", 2]
    last: Annotated[np.ndarray, "<i8", 1]
    places: Annotated[np.ndarray, "<f8", 2]
    searched: Annotated[np.ndarray, "<f8", 2]
    sure: Annotated[np.ndarray, "<f8", 1]
    base: Annotated[np.ndarray, "<f8", 2]
    origin: Annotated[np.ndarray, "<f8", 2]
    approached: Annotated[np.ndarray, "<f8", 1]
    jumps: Annotated[np.ndarray, "<f8", 1]
    pending: Annotated[np.ndarray, "<f8", 1]
    late: Annotated[np.ndarray, "<f8", 1]
    inverse: Annotated[np.ndarray, "<f8", 2]
    rim: Annotated[np.ndarray, "|u1", 1]
    points: Annotated[np.ndarray, POINTS, 1]
    cells: Annotated[np.ndarray, CELLS, 1]
    discs: Annotated[np.ndarray, DISCS, 1]
    star_at: Annotated[np.ndarray, "<i8", 1]
    star: Annotated[np.ndarray, "<i4", 1]
    tracked: Annotated[np.ndarray, TRACKED_TYPE, 1]
    work: Annotated[np.ndarray, WAITING, 1]
    foot: Annotated[np.ndarray, FEET, 1]


def track(found: Candidates, first: Mesh, second: Mesh, measured: bool) -> Track:
    """The cells at the start; measured: with X, which condensed organs need."""
    count = len(found.gap)
    mesh, other = (second, first) if found.swapped else (first, second)
    search, surface = MeshClosestPoint(other), surface_cells(mesh, found)
    tables, size = search.tables, len(surface.vertices)
    used = surface.begins[count]
    _, _, triangles, distances = search.find(mesh.vertices[surface.vertices[:used]])
    at, last = np.zeros(len(other.triangles), np.int64), np.zeros(size, np.int64)
    at[tables.cells["origin"]] = np.arange(len(tables.cells))
    last[:used] = at[triangles]
    searched, sure = np.zeros((size, 3)), np.zeros(size)
    searched[:used] = mesh.vertices[surface.vertices[:used]]
    sure[:used] = np.maximum(0.5 * np.abs(distances), SEARCHED)
    base = (-1.0 if found.swapped else 1.0) * (found.first.place - found.second.place)
    slot = np.full(len(surface.area), -1)
    slot[:count] = np.arange(count)
    ends = (slot[surface.near] < 0) & (surface.parent[surface.near] < 0)
    rim = np.array([ends[surface.near_at[i] : surface.near_at[i + 1]].any() for i in range(count)], np.uint8)
    inverse = mean_inverse(surface.place[:count], surface.area[:count]) if measured else np.zeros((0, 0))
    approached, jumps, pending, late = (np.zeros(count) for _ in range(4))
    return Track(
        int(found.swapped), *surface, found.gap - found.gap.min(), np.arange(count), slot,
        np.ascontiguousarray(mesh.normals[surface.vertices]), last, np.zeros((size, 2)), searched, sure, base,
        base.copy(), approached, jumps, pending, late, inverse, rim, *tables.arrays, np.zeros(1, TRACKED_TYPE),
        search.scratch()[1], np.zeros(1, FEET),
    )  # fmt: skip
