"""A place on the shipped kidney, pressed by the load of `accuracy.continuum`: the static curve there, by two solvers.

The kidney is the image of a cube, through the ball that its shape is made from (`physics.geometry.kidney`), so that a
grid of the cube, graded towards the place, is a mesh of it. It lies on a bed of springs where its normal looks down
(z below `DOWN`), in all directions. The patch presses along the normal of its place; the surface under it does not move
sideways. Its radius is a distance in space, as in spread.Kernel.

`fe.Solver` takes quadratic tetrahedra on the grid, FElupe bricks of 27 nodes; each makes its own load and bed.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix

from palpate.models.fe.contact.bed import ElasticFoundation
from palpate.models.fe.element import faces as face_rule
from palpate.models.fe.element.jacobian import inverted
from palpate.models.fe.element.mesh import FOLDED, TetMesh, bricks, edge_nodes, grid
from palpate.models.fe.solve.solver import Solver
from palpate.models.fe.sparse.pattern import Pattern
from palpate.physics.geometry.kidney import LENGTH, THICKNESS, WIDTH, shape
from palpate.physics.materials.neo_hooke import neo_hooke
from palpate.studies.accuracy.continuum import BED, POISSON, RADIUS, STEPS, YOUNG, ContinuumCurve, curve, graded
from palpate.studies.peers import felupe

LEVELS = np.array([0.1, 0.3, 0.6, 1.0])
"""[N] Forces at which a curve is known."""
DOWN = -0.5
"""[1] As of `fe.meshing.organ`."""
FAR = 0.5
"""[1] Share of the cube's half side up to which the path is told."""
CUTS = 6
"""Parts into which a triangle's sides are cut, or points a direction on a brick, to integrate the pressure."""


@dataclass(frozen=True)
class Kidney:
    """Where the kidney is pressed and how finely it is cut.

    place  [m] along the path on its top, from its middle towards the upper pole
    cells  cells across the patch's radius
    """

    place: float = 0.0
    cells: int = 2


@lru_cache(maxsize=1)
def _fit() -> tuple[np.ndarray, np.ndarray]:
    """Scale [m] and offset [m] (3) that give the shape the size of the kidney, centred."""
    phi, theta = np.meshgrid(np.linspace(0.0, 2 * np.pi, 721), np.linspace(0.0, np.pi, 721))
    all_round = shape(np.stack([-np.cos(theta), np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi)], axis=-1))
    low, high = all_round.min(axis=(0, 1)), all_round.max(axis=(0, 1))
    scale = np.array([LENGTH, WIDTH, THICKNESS]) / (high - low)
    return scale, -scale * (low + high) / 2


def inside(cube: np.ndarray) -> np.ndarray:
    """Points [m] (...,3) of the kidney, of points of the cube -1 ... 1 (...,3); the side z = 1 is its top."""
    square = cube**2
    a, b, c = np.moveaxis(square, -1, 0)
    rest = np.stack([1 - b / 2 - c / 2 + b * c / 3, 1 - a / 2 - c / 2 + a * c / 3, 1 - a / 2 - b / 2 + a * b / 3], -1)
    scale, offset = _fit()
    points: np.ndarray = scale * shape(cube * np.sqrt(rest)) + offset
    return points


@lru_cache(maxsize=1)
def _path() -> tuple[np.ndarray, np.ndarray]:
    """Cube coordinate x, and the way [m] along the path from its middle, of the top's middle line."""
    x = np.linspace(-FAR, FAR, 4001)
    points = inside(np.stack([x, 0 * x, 0 * x + 1], axis=-1))
    way = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    return x, way - way[len(way) // 2]


def along(place: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Foot points [m], outward normals and directions of the path (n,3) at places [m] (n,) along it."""
    x = np.interp(place, *_path()[::-1])
    h, at = 1e-5, np.stack([x, 0 * x, 0 * x + 1], axis=-1)
    ahead, aside = ((inside(at + step) - inside(at - step)) / (2 * h) for step in ((h, 0, 0), (0, h, 0)))
    normal = np.cross(ahead, aside)
    return inside(at), _unit(normal), _unit(ahead)


def _unit(vectors: np.ndarray) -> np.ndarray:
    longer: np.ndarray = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return longer


@dataclass(frozen=True)
class _Frame:
    """The kidney with its place at the origin and the normal there along z; turn (3,3) has the axes as rows."""

    foot: np.ndarray
    turn: np.ndarray

    def points(self, cube: np.ndarray) -> np.ndarray:
        """Points [m] (n,3) of points of the cube."""
        placed: np.ndarray = (inside(cube) - self.foot) @ self.turn.T
        return placed

    def down(self, normals: np.ndarray) -> np.ndarray:
        """Which normals (...,3), of any length, look down at the bed."""
        low: np.ndarray = normals @ self.turn[:, 2] < DOWN * np.linalg.norm(normals, axis=-1)
        return low


def _cut(block: Kidney) -> tuple[_Frame, list[np.ndarray]]:
    """The frame of a place, and the grid's planes in the cube, finest under the patch."""
    foot, normal, ahead = (v[0] for v in along(np.array([block.place])))
    frame = _Frame(foot, np.stack([ahead, np.cross(normal, ahead), normal]))
    size, middle = RADIUS / block.cells, float(np.interp(block.place, *_path()[::-1]))
    axes = []
    for axis, (low, high) in enumerate(((-RADIUS, RADIUS), (-RADIUS, RADIUS), (-0.6 * RADIUS, 0.0))):
        t = np.linspace(-1.0, 1.0, 4001)
        line = np.tile([middle, 0.0, 1.0], (len(t), 1))
        line[:, axis] = t
        way = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(inside(line), axis=0), axis=1)))
        way -= np.interp((middle, 0.0, 1.0)[axis], t, way)
        axes.append(np.interp(graded(way[0], low, high, way[-1], size), way, t))
    return frame, axes


def press(block: Kidney, levels: np.ndarray = LEVELS) -> ContinuumCurve:
    """Press the kidney with `fe.Solver`. The curve has no shape.

    Two sides of the cube are one smooth side where they meet, so that curved tetrahedra there would cross: those keep
    straight edges.
    """
    frame, axes = _cut(block)
    corner_points, cells = grid(*axes)
    elements, edges = edge_nodes(len(corner_points), bricks(corner_points, cells))
    cube = np.concatenate([corner_points, corner_points[edges].mean(axis=1)])
    placed = frame.points(cube)
    while len(wrong := inverted(placed, elements, FOLDED)):
        bent = np.unique(elements[wrong, 4:])
        straight = placed[edges[bent - len(corner_points)]].mean(axis=1)
        if np.array_equal(placed[bent], straight):
            break
        placed[bent] = straight
    mesh = TetMesh(placed, elements)
    p, on_top = mesh.points, cube[:, 2] > 1.0 - 1e-9
    unit = _on_triangles(p, mesh.faces[on_top[mesh.faces].all(axis=1)])
    fixed = np.zeros(p.shape, dtype=bool)
    fixed[on_top & (np.linalg.norm(p, axis=1) < RADIUS * (1.0 - 1e-9)), :2] = True
    share = frame.down(face_rule.normals(p, mesh.faces))
    bed = _PartBed(mesh.faces[share.any(axis=1)], BED * YOUNG, share[share.any(axis=1)])
    tissue = {0: neo_hooke(YOUNG, POISSON)}
    body = Solver(mesh, tissue, fixed, loads=lambda f: f * unit, contacts=[bed], settings=STEPS)
    depth, seconds = [], []
    for level in levels:
        begun = time.perf_counter()
        body.advance(float(level))
        seconds.append(time.perf_counter() - begun)
        depth.append(float(np.sum(unit * body.displacement)))
    return _shapeless(levels, depth, p.size, seconds)


def _shapeless(levels: np.ndarray, depth: list[float], unknowns: int, seconds: list[float]) -> ContinuumCurve:
    return curve(levels, depth, [np.zeros((0, 0))] * len(levels), np.zeros(0), np.zeros(0), unknowns, seconds)


class _PartBed(ElasticFoundation):
    """A bed under those points of integration (F,6) of its faces that lie on it."""

    def __init__(self, faces: np.ndarray, stiffness: float, share: np.ndarray) -> None:
        super().__init__(faces, stiffness)
        self._share = share

    def bind(self, points: np.ndarray, pattern: Pattern, stiffness: np.ndarray) -> None:
        """Make the springs for a mesh."""
        area = self._share * face_rule.areas(points, self.faces)
        self._block = self.stiffness * np.einsum("fq,qa,qb->fab", area, face_rule.VALUES, face_rule.VALUES)
        self.couple(pattern)


def _pressure(points: np.ndarray) -> np.ndarray:
    """At points [m] (...,3) of a frame; its scale does not matter."""
    q = np.minimum((points**2).sum(axis=-1) / RADIUS**2, 1.0)
    pressure: np.ndarray = (1.0 - q) ** 2
    return pressure


def _on_triangles(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Nodal forces (N,3) along -z that sum to one, of the pressure on curved faces of six nodes (F,6)."""
    step, rule = 1.0 / CUTS, face_rule.POINTS
    upright = [np.array((i, j)) + rule for i in range(CUTS) for j in range(CUTS - i)]
    turned = [np.array((i + 1, j + 1)) - rule for i in range(CUTS - 1) for j in range(CUTS - 1 - i)]
    at = step * np.concatenate(upright + turned)
    weight = np.tile(face_rule.WEIGHTS, CUTS**2) * step**2
    value, gradient = face_rule.shape(at)
    tangents = np.einsum("fai,qak->fqik", points[faces], gradient)
    area = np.linalg.norm(np.cross(tangents[..., 0], tangents[..., 1]), axis=-1) * weight
    pressure = _pressure(np.einsum("qa,fai->fqi", value, points[faces]))
    return _downwards(points, faces, np.einsum("fq,qa->fa", area * pressure, value))


def _downwards(points: np.ndarray, faces: np.ndarray, nodal: np.ndarray) -> np.ndarray:
    pull = np.zeros(points.shape)
    np.add.at(pull[:, 2], faces, -nodal)
    return pull / -pull.sum()


def press_felupe(block: Kidney, levels: np.ndarray = LEVELS) -> ContinuumCurve:
    """Press the kidney with FElupe. The curve has no shape.

    MissingError: it is not installed.
    """
    fem = felupe.library()
    frame, axes = _cut(block)
    mesh = felupe.bricks(fem, tuple(axes))
    cube = np.array(mesh.points)
    mesh.points[:] = p = frame.points(cube)
    sides = _sides(cube, axes)
    unit = _on_bricks(p, sides[-1])
    springs = BED * YOUNG * _bed(p, np.concatenate(sides), frame)
    field = felupe.displaced(fem, mesh)
    solid, outer = felupe.neo_hooke(fem, field, YOUNG, POISSON), felupe.Outer(field, unit, springs)
    under = (cube[:, 2] > 1.0 - 1e-9) & (np.linalg.norm(p, axis=1) < RADIUS * (1.0 - 1e-9))
    held = {"stuck": fem.Boundary(field[0], mask=under, skip=(0, 0, 1))}
    depth, seconds = [], []
    for level in levels:
        outer.force = float(level)
        begun = time.perf_counter()
        felupe.balance(fem, field, [solid, outer], held)
        seconds.append(time.perf_counter() - begun)
        depth.append(float(np.sum(unit * field[0].values)))
    return _shapeless(levels, depth, p.size, seconds)


def _sides(cube: np.ndarray, axes: list[np.ndarray]) -> list[np.ndarray]:
    """Faces of nine nodes (F,9), of the cube's six sides; the last is its top. Normals look out."""
    found = []
    for axis in range(3):
        for end in (-1.0, 1.0):
            one, two = [k for k in range(3) if k != axis]
            own = np.flatnonzero(np.abs(cube[:, axis] - end) < 1e-9)
            order = own[np.lexsort((cube[own, two].round(9), cube[own, one].round(9)))]
            table = order.reshape(2 * len(axes[one]) - 1, 2 * len(axes[two]) - 1)
            if (end > 0) == (axis == 1):  # x cross z looks along -y
                table = table[:, ::-1]
            i, j = (2 * np.arange((n - 1) // 2) for n in table.shape)
            patch = table[i[:, None, None, None] + np.arange(3)[:, None], j[:, None, None] + np.arange(3)]
            found.append(patch.reshape(-1, 9))
    return found


def _on_face(points: np.ndarray, faces: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of curved faces of nine nodes, at `count` points a direction: shape functions (q,9), points [m] (F,q,3), and
    outward normals (F,q,3) as long as the point's area [m²]."""
    at, weight = np.polynomial.legendre.leggauss(count)
    line = np.stack([0.5 * at * (at - 1), 1 - at**2, 0.5 * at * (at + 1)], axis=1)
    slope = np.stack([at - 0.5, -2 * at, at + 0.5], axis=1)
    value, one, two = (np.einsum("qi,rj->qrij", a, b).reshape(-1, 9)
                       for a, b in ((line, line), (slope, line), (line, slope)))  # fmt: skip
    corner = points[faces]
    normal = np.cross(np.einsum("qa,fai->fqi", one, corner), np.einsum("qa,fai->fqi", two, corner))
    return value, np.einsum("qa,fai->fqi", value, corner), normal * np.outer(weight, weight).ravel()[:, None]


def _on_bricks(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Nodal forces (N,3) along -z that sum to one, of the pressure on curved faces of nine nodes (F,9)."""
    value, own, normal = _on_face(points, faces, 2 * CUTS)
    return _downwards(points, faces, np.einsum("fq,qa->fa", np.linalg.norm(normal, axis=-1) * _pressure(own), value))


def _bed(points: np.ndarray, faces: np.ndarray, frame: _Frame) -> csr_matrix:
    """Springs of unit stiffness per area (3N,3N) where the normal looks down."""
    value, _, normal = _on_face(points, faces, 4)
    area = np.linalg.norm(normal, axis=-1) * frame.down(normal)
    blocks = np.einsum("fq,qa,qb->fab", area, value, value)
    row, column = np.broadcast_arrays(faces[:, :, None], faces[:, None, :])
    rows, columns = ((3 * one[..., None] + np.arange(3)).ravel() for one in (row, column))
    size = (points.size, points.size)
    return csr_matrix(coo_matrix((np.repeat(blocks.ravel(), 3), (rows, columns)), shape=size))
