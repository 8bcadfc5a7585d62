"""Static curve of a site on the shipped kidney under the load of `peers.continuum`, by two solvers.

The kidney is the image of a cube, by way of the ball from which its shape is made (`physics.geometry.kidney`), so a
grid of the cube, graded towards the site, is a mesh of the kidney. An elastic foundation supports it in all directions
where its normal points down (z below `DOWN`). The patch presses along the normal of the site; the surface under it does
not move sideways. The radius of the patch is a distance in space.

`fe.Solver` uses quadratic tetrahedra on the grid, FElupe bricks of 27 nodes; each computes its load and foundation.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from palpate.models.fe.contact.protocol import ElasticFoundation
from palpate.models.fe.element import faces as face_rule
from palpate.models.fe.element.jacobian import find_inverted
from palpate.models.fe.element.mesh import FOLDED, TetMesh, bricks, edge_nodes, grid
from palpate.models.fe.solve.solver import Solver
from palpate.models.fe.sparse.tangent import Pattern
from palpate.physics.geometry.kidney import LENGTH, THICKNESS, WIDTH, shape
from palpate.physics.materials.neo_hooke import neo_hooke
from palpate.studies.peers import continuum, felupe
from palpate.studies.peers.continuum import BED, CUTS, POISSON, RADIUS, STEPS, YOUNG, ContinuumCurve, press_mesh

LEVELS = np.array([0.1, 0.3, 0.6, 1.0])  # [N] Forces at which a curve is known
DOWN = -0.5  # [1] As of `fe.meshing.organ`
NO_TOP = (np.zeros(0), np.zeros(0), np.zeros((0, 0), np.int64))
"""These curves have no shape."""
FAR = 0.5  # [1] The path ends at this share of the half side of the cube


@dataclass(frozen=True)
class Kidney:
    """A site on the kidney and its mesh density.

    place  [m] along the path on its top, from its middle towards the upper pole
    cells  cells across the radius of the patch
    """

    place: float = 0.0
    cells: int = 2


@lru_cache(maxsize=1)
def _fit() -> tuple[np.ndarray, np.ndarray]:
    """Scale [m] and offset [m] (3) that map the shape to the centred kidney."""
    phi, theta = np.meshgrid(np.linspace(0.0, 2 * np.pi, 721), np.linspace(0.0, np.pi, 721))
    all_round = shape(np.stack([-np.cos(theta), np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi)], axis=-1))
    low, high = all_round.min(axis=(0, 1)), all_round.max(axis=(0, 1))
    scale = np.array([LENGTH, WIDTH, THICKNESS]) / (high - low)
    return scale, -scale * (low + high) / 2


def inside(cube: np.ndarray) -> np.ndarray:
    """Points [m] (...,3) of the kidney for points (...,3) of the cube -1 ... 1, whose side z = 1 is the top."""
    square = cube**2
    a, b, c = np.moveaxis(square, -1, 0)
    rest = np.stack([1 - b / 2 - c / 2 + b * c / 3, 1 - a / 2 - c / 2 + a * c / 3, 1 - a / 2 - b / 2 + a * b / 3], -1)
    scale, offset = _fit()
    return scale * shape(cube * np.sqrt(rest)) + offset


@lru_cache(maxsize=1)
def path() -> tuple[np.ndarray, np.ndarray]:
    """Cube coordinate x and arc length [m] from the middle, along the middle line of the top."""
    x = np.linspace(-FAR, FAR, 4001)
    arc = _arc_length(np.stack([x, 0 * x, 0 * x + 1], axis=-1))
    return x, arc - arc[len(arc) // 2]


def _arc_length(cube: np.ndarray) -> np.ndarray:
    """Length [m] along the image of a polyline (n,3) in the cube."""
    return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(inside(cube), axis=0), axis=1)))


def along(place: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Foot points [m], outward normals and path directions (n,3) at positions [m] (n,) along the path."""
    x = np.interp(place, *path()[::-1])
    h, at = 1e-5, np.stack([x, 0 * x, 0 * x + 1], axis=-1)
    ahead, aside = ((inside(at + step) - inside(at - step)) / (2 * h) for step in ((h, 0, 0), (0, h, 0)))
    normal = np.cross(ahead, aside)
    return inside(at), _unit(normal), _unit(ahead)


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


@dataclass(frozen=True)
class SiteFrame:
    """Coordinates with the site at the origin and its normal along z; the rows of turn (3,3) are the axes."""

    foot: np.ndarray
    turn: np.ndarray

    def points(self, cube: np.ndarray) -> np.ndarray:
        """Points [m] (n,3) of the kidney for points of the cube."""
        return (inside(cube) - self.foot) @ self.turn.T

    def down(self, normals: np.ndarray) -> np.ndarray:
        """Whether normals (...,3) of any length point down at the foundation."""
        return normals @ self.turn[:, 2] < DOWN * np.linalg.norm(normals, axis=-1)


def cut(block: Kidney) -> tuple[SiteFrame, list[np.ndarray]]:
    """The frame of a site, and the planes of the grid in the cube, finest under the patch."""
    foot, normal, ahead = (v[0] for v in along(np.array([block.place])))
    frame = SiteFrame(foot, np.stack([ahead, np.cross(normal, ahead), normal]))
    size, middle = RADIUS / block.cells, float(np.interp(block.place, *path()[::-1]))
    axes = []
    for axis, (low, high) in enumerate(((-RADIUS, RADIUS), (-RADIUS, RADIUS), (-0.6 * RADIUS, 0.0))):
        t = np.linspace(-1.0, 1.0, 4001)
        line = np.tile([middle, 0.0, 1.0], (len(t), 1))
        line[:, axis] = t
        arc = _arc_length(line)
        arc -= np.interp((middle, 0.0, 1.0)[axis], t, arc)
        axes.append(np.interp(continuum.grade_axis(arc[0], low, high, arc[-1], size), arc, t))
    return frame, axes


def press_kidney(block: Kidney, levels: np.ndarray = LEVELS) -> ContinuumCurve:
    """Press the kidney with `fe.Solver`.

    Where two sides of the cube meet, the surface of the kidney is smooth, so curved tetrahedra would be inverted there;
    these keep straight edges.
    """
    # Mesh: quadratic tetrahedra, with straight edges where a curved one would be inverted.
    frame, axes = cut(block)
    corner_points, cells = grid(*axes)
    elements, edges = edge_nodes(len(corner_points), bricks(corner_points, cells))
    cube = np.concatenate([corner_points, corner_points[edges].mean(axis=1)])
    placed = frame.points(cube)
    while len(wrong := find_inverted(placed, elements, FOLDED)):
        bent = np.unique(elements[wrong, 4:])
        straight = placed[edges[bent - len(corner_points)]].mean(axis=1)
        if np.array_equal(placed[bent], straight):
            break
        placed[bent] = straight
    # Load, supports and the part of the surface on the foundation.
    mesh = TetMesh(placed, elements)
    p, on_top = mesh.points, cube[:, 2] > 1.0 - 1e-9
    unit = continuum.on_triangles(p, mesh.faces[on_top[mesh.faces].all(axis=1)], pressure)
    fixed = np.zeros(p.shape, dtype=bool)
    fixed[on_top & (np.linalg.norm(p, axis=1) < RADIUS * (1.0 - 1e-9)), :2] = True
    share = frame.down(face_rule.normals(p, mesh.faces))
    bed = _PartBed(mesh.faces[share.any(axis=1)], BED * YOUNG, share[share.any(axis=1)])
    tissue = {0: neo_hooke(YOUNG, POISSON)}
    body = Solver(mesh, tissue, fixed, loads=lambda f: f * unit, contacts=[bed], settings=STEPS)
    return press_mesh(lambda force: continuum.solve_displacement(body, force), levels, unit, NO_TOP)


class _PartBed(ElasticFoundation):
    """A foundation under those integration points (F,6) of its faces that it supports."""

    def __init__(self, faces: np.ndarray, stiffness: float, share: np.ndarray) -> None:
        super().__init__(faces, stiffness)
        self._share = share

    def bind(self, points: np.ndarray, pattern: Pattern, stiffness: np.ndarray) -> None:
        area = self._share * face_rule.areas(points, self.faces)
        self._block = self.stiffness * np.einsum("fq,qa,qb->fab", area, face_rule.VALUES, face_rule.VALUES)
        self.couple(pattern)


def pressure(points: np.ndarray) -> np.ndarray:
    """Pressure of the patch at points [m] (...,3) of a frame, up to a factor."""
    q = np.minimum((points**2).sum(axis=-1) / RADIUS**2, 1.0)
    return (1.0 - q) ** 2


def press_kidney_felupe(block: Kidney, levels: np.ndarray = LEVELS) -> ContinuumCurve:
    """Press the kidney with FElupe. MissingError: it is not installed."""
    fem = felupe.library()
    frame, axes = cut(block)
    mesh = felupe.bricks(fem, tuple(axes))
    cube = np.array(mesh.points)
    mesh.points[:] = p = frame.points(cube)
    sides = felupe.sides(cube, axes)
    unit = felupe.on_bricks(p, sides[-1], pressure, 2 * CUTS)
    springs = BED * YOUNG * felupe.springs(p, np.concatenate(sides), frame.down)
    field = felupe.displacement_field(fem, mesh)
    items = [felupe.neo_hooke(fem, field, YOUNG, POISSON), felupe.Outer(field, unit, springs)]
    under = (cube[:, 2] > 1.0 - 1e-9) & (np.linalg.norm(p, axis=1) < RADIUS * (1.0 - 1e-9))
    held = {"stuck": fem.Boundary(field[0], mask=under, skip=(0, 0, 1))}
    return press_mesh(lambda force: felupe.solve_equilibrium(fem, field, items, held, force), levels, unit, NO_TOP)
