"""The reference: two solids of neo-Hookean tissue on elastic foundations, by `fe.Solver` and `fe.Pair`, a quarter.

    div P(F) = 0,    t_n = -p <= 0,  g >= 0,  p g = 0 on the deformed surfaces,    t = K (d - u) on the foundations

without friction, d the displacement of the foundation, zero for the lower solid. Augmented Lagrangian, quadratic
tetrahedra, finite displacement: nothing in common with `physics.contact.organs`.
"""

import time
from dataclasses import dataclass

import numpy as np

from palpate.models.fe.contact.pair import Pair
from palpate.models.fe.contact.protocol import ContactPair, ElasticFoundation
from palpate.models.fe.element import faces as face_rule
from palpate.models.fe.element.jacobian import find_inverted
from palpate.models.fe.element.mesh import FOLDED, TetMesh, bricks, edge_nodes, grid
from palpate.models.fe.progress import Report, unheard
from palpate.models.fe.solve.solver import ConvergenceError, Settings, Solver
from palpate.models.fe.sparse.tangent import Pattern
from palpate.physics.materials.neo_hooke import neo_hooke
from palpate.studies.meeting.solids import DOWN, SOLIDS, TURN, Meeting, Solid
from palpate.studies.peers.continuum import BED, POISSON, YOUNG, grade_axis

STEPS = Settings(tolerance=1e-6, step=0.1, largest=0.2, least=2e-3)
GAP = 1e-5  # [m] At the start
TOP = 1.0 - 1e-9  # [1] z of the cube above which a node is on the top
NEAR = 1.15  # [1] Radius of the fine part of the mesh over that of the contact


@dataclass(frozen=True)
class FullCurve:
    """Force [N] and area of contact [m²] (L,) at closings [m] (L,) of the foundations, less the gap at the start, up to
    the last one at which the mesh has an equilibrium; number of unknowns, and processor time [s]."""

    closing: np.ndarray
    force: np.ndarray
    area: np.ndarray
    unknowns: int
    seconds: float


@dataclass(frozen=True)
class _Part:
    """The quarter of a solid: points [m] (N,3), points of the cube, quadratic elements."""

    points: np.ndarray
    cube: np.ndarray
    elements: np.ndarray


def _quarter(solid: Solid, size: float, near: float) -> _Part:
    """A mesh with cells of `size` [m] within `near` [m] of the origin."""
    axes, t = [], np.linspace(0.0, 1.0, 2001)
    for axis in range(3):
        line = np.zeros((len(t), 3))
        line[:, 2] = 1.0
        line[:, axis] = t if axis < 2 else 1.0 - 2.0 * t
        arc = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(solid.place(line), axis=0), axis=1)))
        reach = min(near, arc[-1]) if axis < 2 else min(0.5 * near, arc[-1])
        planes = np.interp(grade_axis(0.0, 0.0, reach, arc[-1], size), arc, line[:, axis])
        axes.append(planes if axis < 2 else planes[::-1])
    corners, cells = grid(*axes)
    elements, edges = edge_nodes(len(corners), bricks(corners, cells))
    cube = np.concatenate([corners, corners[edges].mean(axis=1)])
    points = solid.place(cube)
    while len(wrong := find_inverted(points, elements, FOLDED)):  # where two sides of the cube meet on a smooth surface
        bent = np.unique(elements[wrong, 4:])
        straight = points[edges[bent - len(corners)]].mean(axis=1)
        if np.array_equal(points[bent], straight):
            break
        points[bent] = straight
    return _Part(points, cube, elements)


class _Foundation(ElasticFoundation):
    """A foundation under those integration points (F,6) of its faces that it supports; it moves by `closing` times the
    load along -z."""

    def __init__(self, faces: np.ndarray, stiffness: float, share: np.ndarray, closing: float) -> None:
        super().__init__(faces, stiffness)
        self._share, self._closing = share, closing

    def bind(self, points: np.ndarray, pattern: Pattern, stiffness: np.ndarray) -> None:
        area = self._share * face_rule.areas(points, self.faces)
        self._block = self.stiffness * np.einsum("fq,qa,qb->fab", area, face_rule.VALUES, face_rule.VALUES)
        self.couple(pattern)

    def add(self, displacement: np.ndarray, load: float, tangent: bool, force: np.ndarray, data: np.ndarray) -> None:
        moved = displacement + (0.0, 0.0, load * self._closing)
        super().add(moved, load, tangent, force, data)


def solve(meeting: Meeting, cells: int = 3, report: Report = unheard) -> FullCurve:
    """The curve of a meeting, on a mesh with `cells` cells across the largest radius of contact."""
    wide, farthest = meeting.widest, float(meeting.closings[-1])
    near = NEAR * wide
    parts = [_quarter(SOLIDS[name], wide / cells, near) for name in (meeting.upper, meeting.lower)]
    # The upper solid is turned upside down, above the lower one.
    upper = parts[0].points @ TURN.T + (0.0, 0.0, GAP)
    split = len(upper)
    points = np.concatenate([upper, parts[1].points])
    mesh = TetMesh(points, np.concatenate([parts[0].elements, parts[1].elements + split]))
    cube = np.concatenate([parts[0].cube @ np.abs(TURN).T, parts[1].cube])
    fixed = np.zeros(points.shape, dtype=bool)
    fixed[:, :2] = np.abs(cube[:, :2]) < 1e-12
    # Foundations, and the surfaces that may touch.
    faces, above = mesh.faces, np.all(mesh.faces < split, axis=1, keepdims=True)[:, 0]
    inside = fixed[faces].all(axis=1)[:, :2].any(axis=1)  # on the planes of symmetry
    normals = face_rule.normals(points, faces)
    upright = normals[..., 2] / np.linalg.norm(normals, axis=-1)
    contacts: list[ContactPair] = []
    for part, sign, moved in ((above, -1.0, farthest + GAP), (~above, 1.0, 0.0)):
        share = (sign * upright < DOWN) & ~inside[:, None]
        held = part & share.any(axis=1)
        contacts.append(_Foundation(faces[held], BED * YOUNG, share[held], moved))
    middle = np.linalg.norm(points[faces[:, :3]].mean(axis=1), axis=1)
    facing = np.where(above[:, None], -upright, upright) > 0.0
    top: np.ndarray = facing.all(axis=1) & (cube[faces, 2] > TOP).all(axis=1)
    touch = Pair(faces[top & above & (middle < 1.6 * near)], faces[top & ~above & (middle < 2.2 * near)])
    body = Solver(mesh, {0: neo_hooke(YOUNG, POISSON)}, fixed, contacts=[*contacts, touch], settings=STEPS)
    begun, force, area = time.process_time(), list[float](), list[float]()
    for closing in meeting.closings.tolist():
        try:
            body.advance((closing + GAP) / (farthest + GAP), report)
        except ConvergenceError:
            break
        force.append(4.0 * abs(float(touch.force[2])))
        area.append(4.0 * touch.contact_area(body.displacement))
    closings = meeting.closings[: len(force)]
    return FullCurve(closings, np.array(force), np.array(area), points.size, time.process_time() - begun)
