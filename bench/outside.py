"""The block of `bench.continuum` by FElupe, which a user may have installed: bricks of 27 nodes.

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

from palpate.bench.continuum import (
    BED,
    LEVELS,
    POISSON,
    SIDE,
    YOUNG,
    Block,
    Curve,
    curve,
    halved,
    patch_pressure,
    stuck,
)
from palpate.bench.errors import MissingError
from palpate.models.fe.meshing.organ import SLAB
from palpate.physics.materials.hyperelastic import moduli

INSTALL = 'pip install "palpate[bench]"'


def version() -> str | None:
    """Of FElupe; None where it is not installed."""
    try:
        import felupe
    except ImportError:
        return None
    return str(felupe.__version__)


def press(
    block: Block, levels: np.ndarray = LEVELS, young: float = YOUNG, report: Callable[[float], None] = lambda done: None
) -> Curve:
    """Press the block with FElupe.

    MissingError: it is not installed.
    """
    try:
        import felupe as fem
    except ImportError:
        raise MissingError(f"FElupe is not installed. Install it: {INSTALL}") from None
    axes = block.axes()
    mesh = bricks(fem, axes)
    field = fem.FieldContainer([fem.Field(fem.RegionTriQuadraticHexahedron(mesh), dim=3)])
    shear, bulk = moduli(young, POISSON)
    hardness = block.hardness()
    solids = []
    for ratio in np.unique(hardness):
        part = fem.Mesh(mesh.points, mesh.cells[hardness == ratio], mesh.cell_type)
        own = fem.FieldContainer([fem.Field(fem.RegionTriQuadraticHexahedron(part), dim=3)])
        solids.append(fem.SolidBody(fem.NeoHooke(mu=shear * float(ratio), bulk=bulk * float(ratio)), own))
    p, near = mesh.points, 1e-9
    unit = _load(p, axes, block.place)
    springs = BED * young * _bed(p, axes)
    outer = Outer(field, unit, springs)
    half = {
        "middle": fem.Boundary(field[0], mask=p[:, 1] < near, skip=(1, 0, 1)),
        "stuck": fem.Boundary(field[0], mask=stuck(p, block.place), skip=(0, 0, 1)),
    }
    x, y = (halved(a) for a in axes[:2])
    at = _top(p, x, y)
    depth, shape, seconds = [], [], []
    for k, level in enumerate(levels):
        outer.force = 0.5 * float(level)
        seconds.append(solved(fem, field, [*solids, outer], half))
        u = field[0].values
        depth.append(float(np.sum(unit * u)))
        shape.append(-u[at, 2])
        report((k + 1) / len(levels))
    return curve(levels, depth, shape, x, y, p.size, seconds)


def solved(fem: Any, field: Any, items: list[Any], held: dict[str, Any]) -> float:
    """Have the field balance these items, and the seconds that it took."""
    begun = time.perf_counter()
    dof0, dof1 = fem.dof.partition(field, held)
    fem.newtonraphson(
        x0=field, items=items, dof0=dof0, dof1=dof1, ext0=fem.dof.apply(field, held, dof0), verbose=0, tol=1e-7,
        maxiter=30, solver=_solve,
    )  # fmt: skip
    return time.perf_counter() - begun


class Outer:
    """An item for FElupe: dead load and bed."""

    def __init__(self, field: Any, unit: np.ndarray, springs: Any) -> None:
        self.field, self.unit, self.springs, self.force = field, unit, springs, 0.0
        self.assemble = SimpleNamespace(vector=self._vector, matrix=self._matrix, multiplier=None)
        self.results = SimpleNamespace(update_statevars=lambda: None)

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
