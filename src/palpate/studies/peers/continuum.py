"""The continuum that the bodies on a slab approximate: a load of fixed shape presses a block of neo-Hookean tissue.

    div P(F) = 0,    p(r) = 3 f/(pi R²) (1 - r²/R²)²,   r < R,    u_x = u_y = 0 under the patch

The block is that of `surface: plane`: 0.1 m square, 40 mm thick, on an elastic foundation, with free sides. The patch
sticks to the finger, which does not move sideways, or slides freely. By symmetry only the half y >= 0 is meshed; the
centre of the patch is at y = 0. The result is a static curve, with the shape of the top at each force. Its indentation
s is the mean of -u_z weighted with p, so f ds is the work done on the block.

Two independent solvers compute the references: `fe.Solver` on quadratic tetrahedra, and FElupe on bricks of 27 nodes
(`studies.peers.felupe`). They share this description; each builds its load, foundation and elements from the grid.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from palpate.models.fe.contact.protocol import ElasticFoundation
from palpate.models.fe.element import faces as face_rule
from palpate.models.fe.element.mesh import TetMesh, bricks, grid, quadratic
from palpate.models.fe.meshing.organ import SLAB
from palpate.models.fe.solve.solver import Settings, Solver
from palpate.physics.materials.neo_hooke import neo_hooke

SIDE = 0.1  # [m] Side of the block: that of `surface: plane`
YOUNG, POISSON, BED = 19e3, 0.45, 50.0
"""Young's modulus [Pa], Poisson's ratio [1], foundation stiffness per area over Young's modulus [1/m]: those of
deformation.ReducedFE."""
RADIUS = 8e-3  # [m] Radius of the patch: that of spread.Kernel
LEVELS = np.array([0.03, 0.1, 0.2, 0.35, 0.5, 0.7, 0.9, 1.1, 1.3])  # [N] Forces at which a curve is known
LIGHT = np.array([0.02, 0.05, 0.08, 0.12, 0.16, 0.2, 0.25])
"""[N] Forces for a patch that slides freely: under larger loads the surface escapes sideways."""
NODULE_DEPTH, NODULE_RADIUS, NODULE_RATIO = 6e-3, 4e-3, 10.0
"""The nodule, a ball: depth of its centre [m], radius [m], its modulus over that of the tissue [1]."""
GROWTH = 1.45  # [1] Growth factor of the cells from the patch to the border
CUTS = 6  # Subdivisions of each side of a triangle for the integration of the pressure
SHARES = 8  # Number of moduli, from tissue to nodule, for cells that the surface of the nodule cuts
Pressure = Callable[[np.ndarray], np.ndarray]  # At points [m] (...,3)
Top = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Lines x and y [m] of the grid of the top, and the nodes (len(x),len(y)) on them."""
STEPS = Settings(tolerance=1e-7, step=1.0, largest=1.0, least=1e-3)


@dataclass(frozen=True)
class TissueBlock:
    """Position of the patch on the block, and mesh density.

    place   x coordinate of the centre of the patch [m]
    cells   cells across the radius of the patch
    nodule  whether the block has the nodule below (0, 0)
    radius  [m] radius of the patch;  poisson  [1] Poisson's ratio of the tissue
    sticks  whether the surface under the patch is fixed tangentially
    """

    place: float = 0.0
    cells: int = 4
    nodule: bool = False
    radius: float = RADIUS
    poisson: float = POISSON
    sticks: bool = True

    def axes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Coordinates [m] of the grid planes, finest under the patch and around the nodule."""
        size = self.radius / self.cells
        low, high, below = self.place - self.radius, self.place + self.radius, 0.6 * self.radius
        if self.nodule:
            low, high = min(low, -NODULE_RADIUS), max(high, NODULE_RADIUS)
            below = NODULE_DEPTH + NODULE_RADIUS
        x = grade_axis(-SIDE / 2, low, high, SIDE / 2, size)
        y = grade_axis(0.0, 0.0, self.radius, SIDE / 2, size)
        z = grade_axis(-SLAB, -below, 0.0, 0.0, size)
        return x, y, z

    def pressure(self, points: np.ndarray) -> np.ndarray:
        """Pressure of the patch, up to a factor, at points [m] (...,3) of the surface."""
        q = np.minimum(((points[..., 0] - self.place) ** 2 + points[..., 1] ** 2) / self.radius**2, 1.0)
        return (1.0 - q) ** 2

    def hardness(self) -> np.ndarray:
        """Modulus of each cell over that of the tissue, x fastest: the volume average, rounded to `SHARES` steps."""
        x, y, z = self.axes()
        count = (len(x) - 1, len(y) - 1, len(z) - 1)
        if not self.nodule:
            return np.ones(count[0] * count[1] * count[2])
        at = (np.arange(6) + 0.5) / 6
        px, py, pz = ((a[:-1, None] + np.diff(a)[:, None] * at).ravel() for a in (x, y, z))
        away = px[:, None, None] ** 2 + py[None, :, None] ** 2 + (pz[None, None, :] + NODULE_DEPTH) ** 2
        inside = (away < NODULE_RADIUS**2).reshape(count[0], 6, count[1], 6, count[2], 6).mean(axis=(1, 3, 5))
        share = np.round(SHARES * inside) / SHARES
        return (1.0 + (NODULE_RATIO - 1.0) * share).transpose(2, 1, 0).ravel()


@dataclass(frozen=True)
class ContinuumCurve:
    """Static curve of a solver.

    force, indentation  [N], [m] (L,);  work [J] (L,) done on the block
    x, y                [m] grid lines of the top;  shape [m] (L,len(x),len(y)) depth of the top on them
    unknowns            number of unknowns;  seconds [s] (L,) of each load step
    """

    force: np.ndarray
    indentation: np.ndarray
    work: np.ndarray
    x: np.ndarray
    y: np.ndarray
    shape: np.ndarray
    unknowns: int
    seconds: np.ndarray


@dataclass(frozen=True)
class Tetrahedra:
    """The block as a mesh of quadratic tetrahedra, with load and supports.

    mesh    the mesh; its regions have the moduli `ratios` (R,), relative to that of the tissue
    unit    [1] (N,3) nodal forces of a unit force on the half patch
    fixed   (N,3) bool, fixed displacements;  under (F,6) faces on the foundation
    top     grid lines [m] of the top, and the nodes (len(x),len(y)) on them
    """

    mesh: TetMesh
    ratios: np.ndarray
    unit: np.ndarray
    fixed: np.ndarray
    under: np.ndarray
    top: np.ndarray
    x: np.ndarray
    y: np.ndarray

    def areas(self) -> np.ndarray:
        """Areas [m²] (F,) of the faces on the foundation, which are plane."""
        corner = self.mesh.points[self.under[:, :3]]
        sides = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        return 0.5 * np.linalg.norm(sides, axis=1)


def tetrahedra(block: TissueBlock) -> Tetrahedra:
    axes = block.axes()
    points, cells = grid(*axes)
    corners = bricks(points, cells)
    ratios, region = np.unique(np.repeat(block.hardness(), 6), return_inverse=True)
    mesh = quadratic(points, corners, region.astype(np.int64))
    p, near = mesh.points, 1e-9
    corner_z = p[mesh.faces[:, :3], 2]
    top = mesh.faces[(corner_z > -near).all(axis=1)]
    under = mesh.faces[(corner_z < near - SLAB).all(axis=1)]
    fixed = np.zeros(p.shape, dtype=bool)
    fixed[p[:, 1] < near, 1] = True
    if block.sticks:
        fixed[stuck(p, block.place, block.radius), :2] = True
    x, y = (halve_cells(a) for a in axes[:2])
    unit = on_triangles(p, top, block.pressure)
    return Tetrahedra(mesh, ratios, unit, fixed, under, top_grid(p, axes), x, y)


def press_block(block: TissueBlock, levels: np.ndarray = LEVELS) -> ContinuumCurve:
    """Press the block with `fe.Solver`."""
    cut = tetrahedra(block)
    materials = {k: neo_hooke(YOUNG * float(h), block.poisson) for k, h in enumerate(cut.ratios)}
    bed = ElasticFoundation(cut.under, BED * YOUNG)
    body = Solver(cut.mesh, materials, cut.fixed, loads=lambda f: 0.5 * f * cut.unit, contacts=[bed], settings=STEPS)
    return press_mesh(lambda force: solve_displacement(body, force), levels, cut.unit, (cut.x, cut.y, cut.top))


def solve_displacement(body: Solver, load: float) -> np.ndarray:
    """Displacement [m] (N,3) of a body under a load."""
    body.advance(load)
    return body.displacement


def press_mesh(reach: Callable[[float], np.ndarray], levels: np.ndarray, unit: np.ndarray, top: Top) -> ContinuumCurve:
    """The curve of a solver.

    reach  solves for a force [N] and returns the displacement [m] (N,3)
    unit   [1] (N,3) nodal forces of a unit force
    """
    depth, shape, seconds = [], [], []
    for level in levels.tolist():
        begun = time.perf_counter()
        u = reach(level)
        seconds.append(time.perf_counter() - begun)
        depth.append(float(np.sum(unit * u)))
        shape.append(-u[top[2], 2])
    return curve(levels, depth, shape, top, unit.size, seconds)


def curve(
    levels: np.ndarray, depth: list[float], shape: list[np.ndarray], top: Top, unknowns: int, seconds: list[float]
) -> ContinuumCurve:
    """A curve with the work done, integrated by a spline through rest and all levels."""
    s, f = np.append(0.0, depth), np.append(0.0, levels)
    work = CubicSpline(s, f).antiderivative()(s)[1:]
    return ContinuumCurve(levels, s[1:], work, *top[:2], np.array(shape), unknowns, np.array(seconds))


def stuck(points: np.ndarray, place: float, radius: float = RADIUS) -> np.ndarray:
    """Nodes of the top under the patch (N,) bool."""
    away = np.hypot(points[:, 0] - place, points[:, 1])
    return (points[:, 2] > -1e-9) & (away < radius * (1.0 - 1e-9))


def on_triangles(points: np.ndarray, faces: np.ndarray, pressure: Pressure) -> np.ndarray:
    """Nodal forces (N,3) along -z, with sum 1, of a pressure on six-node faces (F,6), straight or curved."""
    step, rule = 1.0 / CUTS, face_rule.POINTS
    upright = [np.array((i, j)) + rule for i in range(CUTS) for j in range(CUTS - i)]
    turned = [np.array((i + 1, j + 1)) - rule for i in range(CUTS - 1) for j in range(CUTS - 1 - i)]
    at = step * np.concatenate(upright + turned)
    weight = np.tile(face_rule.WEIGHTS, CUTS**2) * step**2
    value, gradient = face_rule.shape(at)
    tangents = np.einsum("fai,qak->fqik", points[faces], gradient)
    area = np.linalg.norm(np.cross(tangents[..., 0], tangents[..., 1]), axis=-1) * weight
    there = pressure(np.einsum("qa,fai->fqi", value, points[faces]))
    return downwards(points, faces, np.einsum("fq,qa->fa", area * there, value))


def downwards(points: np.ndarray, faces: np.ndarray, nodal: np.ndarray) -> np.ndarray:
    """Assemble the nodal forces of faces to forces (N,3) along -z with sum 1."""
    pull = np.zeros(points.shape)
    np.add.at(pull[:, 2], faces, -nodal)
    return pull / -pull.sum()


def top_grid(points: np.ndarray, axes: tuple[np.ndarray, ...]) -> np.ndarray:
    """Nodes of the top (2nx-1,2ny-1) in the order of its grid lines."""
    top = np.flatnonzero(points[:, 2] > -1e-9)
    order = top[np.lexsort((points[top, 1].round(9), points[top, 0].round(9)))]
    return order.reshape(2 * len(axes[0]) - 1, 2 * len(axes[1]) - 1)


def halve_cells(axis: np.ndarray) -> np.ndarray:
    return np.sort(np.concatenate([axis, 0.5 * (axis[1:] + axis[:-1])]))


def grade_axis(low: float, begin: float, end: float, high: float, size: float) -> np.ndarray:
    """Grid lines [m] from low to high: cells of about `size` between begin and end, growing cells outside."""
    middle = np.linspace(begin, end, max(2, round((end - begin) / size) + 1))
    return np.concatenate([begin - _out(begin - low, size)[::-1], middle, end + _out(high - end, size)])


def _out(length: float, size: float) -> np.ndarray:
    """Distances [m] of the ends of growing cells that fill a length."""
    if length < 1e-9:
        return np.zeros(0)
    steps = [size * GROWTH]
    while sum(steps) < length:
        steps.append(steps[-1] * GROWTH)
    if len(steps) > 1 and sum(steps) - length > 0.5 * steps[-1]:
        steps.pop()
    return np.cumsum(steps) * length / sum(steps)
