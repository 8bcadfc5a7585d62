"""The block of `accuracy.continuum` by FElupe, which a user may have installed: bricks of 27 nodes.

A. Dutzler, FElupe: finite element analysis for continuum mechanics of solid bodies, https://felupe.readthedocs.io.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix, kron
from scipy.spatial import KDTree

from palpate.models.fe.meshing.organ import SLAB
from palpate.physics.extras import install, missing
from palpate.physics.materials.hyperelastic import moduli
from palpate.studies.accuracy.continuum import (
    BED,
    LEVELS,
    POISSON,
    SIDE,
    YOUNG,
    Block,
    ContinuumCurve,
    curve,
    halved,
    patch_pressure,
    stuck,
)
from palpate.studies.accuracy.errors import MissingError

INSTALL = install("bench")


def version() -> str | None:
    """Of FElupe; None where it is not installed."""
    try:
        import felupe
    except ImportError:
        return None
    return str(felupe.__version__)


def library() -> Any:
    """Its module. MissingError: it is not installed."""
    try:
        import felupe
    except ImportError as error:
        raise MissingError(missing("FElupe", error.name, "bench")) from None
    return felupe


def press(
    block: Block, levels: np.ndarray = LEVELS, young: float = YOUNG, report: Callable[[float], None] = lambda done: None
) -> ContinuumCurve:
    """Press the block with FElupe.

    MissingError: it is not installed.
    """
    fem = library()
    axes = block.axes()
    mesh = bricks(fem, axes)
    field, hardness = displaced(fem, mesh), block.hardness()
    solids = [
        neo_hooke(fem, displaced(fem, fem.Mesh(mesh.points, mesh.cells[hardness == ratio], mesh.cell_type)),
                  young * float(ratio), POISSON)
        for ratio in np.unique(hardness)
    ]  # fmt: skip
    p, near = mesh.points, 1e-9
    unit = _load(p, axes, block.place)
    springs = BED * young * _bed(p, axes)
    outer = Outer(field, unit, springs)
    half = {"middle": fem.Boundary(field[0], mask=p[:, 1] < near, skip=(1, 0, 1))}
    if block.sticks:
        half["stuck"] = fem.Boundary(field[0], mask=stuck(p, block.place), skip=(0, 0, 1))
    x, y = (halved(a) for a in axes[:2])
    at = _top(p, x, y)
    depth, shape, seconds = [], [], []
    for k, level in enumerate(levels):
        outer.force = 0.5 * float(level)
        begun = time.perf_counter()
        balance(fem, field, [*solids, outer], half)
        seconds.append(time.perf_counter() - begun)
        u = field[0].values
        depth.append(float(np.sum(unit * u)))
        shape.append(-u[at, 2])
        report((k + 1) / len(levels))
    return curve(levels, depth, shape, x, y, p.size, seconds)


def displaced(fem: Any, mesh: Any) -> Any:
    """The displacement field of a mesh of tetrahedra of four or ten nodes, or bricks of 27."""
    region = {"tetra": fem.RegionTetra, "tetra10": fem.RegionQuadraticTetra}.get(
        mesh.cell_type, fem.RegionTriQuadraticHexahedron
    )
    return fem.FieldContainer([fem.Field(region(mesh), dim=3)])


def neo_hooke(fem: Any, field: Any, young: float, poisson: float) -> Any:
    """A solid of our law: W = (mu/2) (J^(-2/3) I1 - 3) + (kappa/2) (J - 1)²."""
    shear, bulk = moduli(young, poisson)
    return fem.SolidBody(fem.NeoHooke(mu=shear, bulk=bulk), field)


def balance(
    fem: Any, field: Any, items: list[Any], held: dict[str, Any], solver: Any = None, tol: float = 1e-7, most: int = 30
) -> int:
    """Have the field balance these items; the iterations that it took."""
    dof0, dof1 = fem.dof.partition(field, held)
    newton = fem.newtonraphson(
        x0=field, items=items, dof0=dof0, dof1=dof1, ext0=fem.dof.apply(field, held, dof0), verbose=0, tol=tol,
        maxiter=most, solver=solver or _solve,
    )  # fmt: skip
    return int(newton.iterations)


class Item:
    """What FElupe takes beside solids: has `_vector` and `_matrix`."""

    def __init__(self, field: Any) -> None:
        self.field = field
        self.assemble = SimpleNamespace(vector=self._vector, matrix=self._matrix, multiplier=None)
        self.results = SimpleNamespace(update_statevars=lambda: None)

    def _vector(self, field: Any = None, **_: Any) -> csr_matrix:
        raise NotImplementedError

    def _matrix(self, field: Any = None, **_: Any) -> csr_matrix:
        raise NotImplementedError


class Outer(Item):
    """Dead load and bed."""

    def __init__(self, field: Any, unit: np.ndarray, springs: Any) -> None:
        super().__init__(field)
        self.unit, self.springs, self.force = unit, springs, 0.0

    def _vector(self, field: Any = None, **_: Any) -> csr_matrix:
        u = field[0].values.ravel()
        return csr_matrix((self.springs @ u - self.force * self.unit.ravel()).reshape(-1, 1))

    def _matrix(self, field: Any = None, **_: Any) -> Any:
        return self.springs


def bricks(fem: Any, axes: tuple[np.ndarray, ...]) -> Any:
    """A mesh of bricks of 27 nodes on the grid."""
    grid = fem.Grid(*axes)
    for add in (fem.mesh.add_midpoints_edges, fem.mesh.add_midpoints_faces, fem.mesh.add_midpoints_volumes):
        grid = add(grid)
    return grid


def _quadratic_rule(axis: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of quadratic cells on a line: points [m] (c,q), weights [m] (c,q), shape functions (q,3)."""
    at, weight = np.polynomial.legendre.leggauss(8)
    size = np.diff(axis)[:, None]
    value = np.stack([0.5 * at * (at - 1), 1 - at**2, 0.5 * at * (at + 1)], axis=1)
    return axis[:-1, None] + size * (at + 1) / 2, size / 2 * weight, value


def _lines(axis: np.ndarray) -> np.ndarray:
    """Nodes (c,3) of each quadratic cell on a line."""
    places: np.ndarray = 2 * np.arange(len(axis) - 1)[:, None] + np.arange(3)
    return places


def _load(points: np.ndarray, axes: tuple[np.ndarray, ...], place: float) -> np.ndarray:
    """Consistent nodal forces (N,3) downwards that share a unit force, by tensor products of quadratics on the top."""
    (x, wx, nx), (y, wy, ny) = (_quadratic_rule(a) for a in axes[:2])
    pressure = patch_pressure(x[:, None, :, None], y[None, :, None, :], place)
    nodal = np.einsum("cdqr,cq,dr,qi,rj->cidj", pressure, wx, wy, nx, ny, optimize=True)
    on_top = np.zeros((2 * len(axes[0]) - 1, 2 * len(axes[1]) - 1))
    rows, columns = _lines(axes[0]), _lines(axes[1])
    np.add.at(on_top, (rows[:, :, None, None], columns[None, None]), nodal)
    forces = np.zeros(points.shape)
    forces[_top(points, halved(axes[0]), halved(axes[1])), 2] = -on_top / on_top.sum()
    return forces


def _bed(points: np.ndarray, axes: tuple[np.ndarray, ...]) -> csr_matrix:
    """Springs of unit stiffness per area under the block (3N,3N)."""
    mass = []
    for axis in axes[:2]:
        _, weight, value = _quadratic_rule(axis)
        blocks = np.einsum("cq,qi,qj->cij", weight, value, value)
        row, column = np.broadcast_arrays(_lines(axis)[:, :, None], _lines(axis)[:, None, :])
        mass.append(coo_matrix((blocks.ravel(), (row.ravel(), column.ravel()))))
    plane = coo_matrix(kron(*mass))
    x, y = (halved(a) for a in axes[:2])
    own = _top(points, x, y, -SLAB).ravel()
    rows, columns = ([3 * own[i] + k for k in range(3)] for i in (plane.row, plane.col))
    size = (points.size, points.size)
    return csr_matrix((np.tile(plane.data, 3), (np.concatenate(rows), np.concatenate(columns))), shape=size)


def _top(points: np.ndarray, x: np.ndarray, y: np.ndarray, height: float = 0.0) -> np.ndarray:
    """Nodes (len(x),len(y)) at these lines."""
    at = np.stack([*np.meshgrid(x, y, indexing="ij"), np.full((len(x), len(y)), height)], axis=-1)
    away, nearest = KDTree(points).query(at.reshape(-1, 3))
    assert away.max() < 1e-7 * SIDE
    return np.asarray(nearest).reshape(len(x), len(y))


def _solve(matrix: Any, rhs: Any) -> np.ndarray:
    """SuperLU with an order for symmetric patterns."""
    from scipy.sparse.linalg import splu

    solution: np.ndarray = splu(
        matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    ).solve(np.asarray(rhs).ravel())
    return solution
