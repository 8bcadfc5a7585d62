"""The block of `studies.peers.continuum` in FElupe, an optional package: bricks of 27 nodes.

A. Dutzler, FElupe: finite element analysis for continuum mechanics of solid bodies, https://felupe.readthedocs.io.
"""

from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.linalg import splu

from palpate.physics.extras import install, package_version, require_extra
from palpate.physics.materials.hyperelastic import moduli
from palpate.studies.peers import MissingError, continuum
from palpate.studies.peers.continuum import BED, LEVELS, POISSON, YOUNG, ContinuumCurve, Pressure, TissueBlock

INSTALL = install("bench")
POINTS = 8  # Integration points of the pressure per direction of a face


def version() -> str | None:
    """Version of FElupe; None if it is not installed."""
    return package_version("felupe")


def library() -> Any:
    """The module `felupe`. MissingError: it is not installed."""
    with require_extra("FElupe", "bench", MissingError):
        import felupe
    return felupe


def press_block(block: TissueBlock, levels: np.ndarray = LEVELS) -> ContinuumCurve:
    """Press the block with FElupe. MissingError: it is not installed."""
    fem = library()
    axes = block.axes()
    mesh = bricks(fem, axes)
    field, hardness = displacement_field(fem, mesh), block.hardness()
    solids = [
        neo_hooke(fem, displacement_field(fem, fem.Mesh(mesh.points, mesh.cells[hardness == ratio], mesh.cell_type)),
                  YOUNG * float(ratio), POISSON)
        for ratio in np.unique(hardness)
    ]  # fmt: skip
    p, near = mesh.points, 1e-9
    *_, under, top = sides(p, axes)
    unit = on_bricks(p, top, block.pressure, POINTS)
    outer = Outer(field, unit, BED * YOUNG * springs(p, under))
    half = {"middle": fem.Boundary(field[0], mask=p[:, 1] < near, skip=(1, 0, 1))}
    if block.sticks:
        half["stuck"] = fem.Boundary(field[0], mask=continuum.stuck(p, block.place, block.radius), skip=(0, 0, 1))
    x, y = (continuum.halve_cells(a) for a in axes[:2])
    top_nodes = continuum.top_grid(p, axes)
    return continuum.press_mesh(
        lambda force: solve_equilibrium(fem, field, [*solids, outer], half, 0.5 * force),
        levels,
        unit,
        (x, y, top_nodes),
    )


def solve_equilibrium(fem: Any, field: Any, items: list[Any], held: dict[str, Any], force: float) -> np.ndarray:
    """Displacement [m] (N,3) in equilibrium with a force [N] of the last item, which is an `Outer`."""
    items[-1].force = force
    balance(fem, field, items, held)
    return field[0].values


def displacement_field(fem: Any, mesh: Any) -> Any:
    """Displacement field of a mesh of 4-node or 10-node tetrahedra or 27-node bricks."""
    region = {"tetra": fem.RegionTetra, "tetra10": fem.RegionQuadraticTetra}.get(
        mesh.cell_type, fem.RegionTriQuadraticHexahedron
    )
    return fem.FieldContainer([fem.Field(region(mesh), dim=3)])


def neo_hooke(fem: Any, field: Any, young: float, poisson: float) -> Any:
    """A solid with palpate's neo-Hookean law: W = (mu/2) (J^(-2/3) I1 - 3) + (kappa/2) (J - 1)²."""
    shear, bulk = moduli(young, poisson)
    return fem.SolidBody(fem.NeoHooke(mu=shear, bulk=bulk), field)


def balance(
    fem: Any, field: Any, items: list[Any], held: dict[str, Any], solver: Any = None, tol: float = 1e-7, most: int = 30
) -> int:
    """Solve for equilibrium of the items; returns the number of iterations."""
    dof0, dof1 = fem.dof.partition(field, held)
    newton = fem.newtonraphson(
        x0=field, items=items, dof0=dof0, dof1=dof1, ext0=fem.dof.apply(field, held, dof0), verbose=0, tol=tol,
        maxiter=most, solver=solver or _solve,
    )  # fmt: skip
    return int(newton.iterations)


class Item:
    """Interface of FElupe items other than solids."""

    _vector: Callable[..., Any]
    _matrix: Callable[..., Any]

    def __init__(self, field: Any) -> None:
        self.field = field
        self.assemble = SimpleNamespace(vector=self._vector, matrix=self._matrix, multiplier=None)
        self.results = SimpleNamespace(update_statevars=lambda: None)


class Outer(Item):
    """Dead load and elastic foundation."""

    def __init__(self, field: Any, unit: np.ndarray, springs: Any) -> None:
        super().__init__(field)
        self.unit, self.springs, self.force = unit, springs, 0.0

    def _vector(self, field: Any = None, **_: Any) -> csr_matrix:
        u = field[0].values.ravel()
        return csr_matrix((self.springs @ u - self.force * self.unit.ravel()).reshape(-1, 1))

    def _matrix(self, field: Any = None, **_: Any) -> Any:
        return self.springs


def bricks(fem: Any, axes: tuple[np.ndarray, ...]) -> Any:
    """A mesh of 27-node bricks on the grid."""
    grid = fem.Grid(*axes)
    for add in (fem.mesh.add_midpoints_edges, fem.mesh.add_midpoints_faces, fem.mesh.add_midpoints_volumes):
        grid = add(grid)
    return grid


def sides(points: np.ndarray, axes: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Nine-node faces (F,9) of the six sides of a grid of bricks, the top last, with outward normals."""
    found = []
    for axis in range(3):
        for end in (0, -1):
            one, two = [k for k in range(3) if k != axis]
            side = np.flatnonzero(np.abs(points[:, axis] - axes[axis][end]) < 1e-9)
            order = side[np.lexsort((points[side, two].round(9), points[side, one].round(9)))]
            table = order.reshape(2 * len(axes[one]) - 1, 2 * len(axes[two]) - 1)
            if (end == -1) == (axis == 1):  # x cross z points along -y
                table = table[:, ::-1]
            i, j = (2 * np.arange((n - 1) // 2) for n in table.shape)
            patch = table[i[:, None, None, None] + np.arange(3)[:, None], j[:, None, None] + np.arange(3)]
            found.append(patch.reshape(-1, 9))
    return found


def _on_face(points: np.ndarray, faces: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Gauss rule on curved nine-node faces with `count` points per direction: shape functions (q,9), points [m] (F,q,3)
    and outward normals (F,q,3), whose lengths are the weighted areas [m²]."""
    at, weight = np.polynomial.legendre.leggauss(count)
    line = np.stack([0.5 * at * (at - 1), 1 - at**2, 0.5 * at * (at + 1)], axis=1)
    slope = np.stack([at - 0.5, -2 * at, at + 0.5], axis=1)
    value, one, two = (np.einsum("qi,rj->qrij", a, b).reshape(-1, 9)
                       for a, b in ((line, line), (slope, line), (line, slope)))  # fmt: skip
    corner = points[faces]
    normal = np.cross(np.einsum("qa,fai->fqi", one, corner), np.einsum("qa,fai->fqi", two, corner))
    return value, np.einsum("qa,fai->fqi", value, corner), normal * np.outer(weight, weight).ravel()[:, None]


def on_bricks(points: np.ndarray, faces: np.ndarray, pressure: Pressure, count: int) -> np.ndarray:
    """Nodal forces (N,3) along -z, with sum 1, of a pressure on curved nine-node faces (F,9), by `count` points per
    direction."""
    value, places, normal = _on_face(points, faces, count)
    return continuum.downwards(
        points, faces, np.einsum("fq,qa->fa", np.linalg.norm(normal, axis=-1) * pressure(places), value)
    )


def springs(
    points: np.ndarray, faces: np.ndarray, lies: Callable[[np.ndarray], np.ndarray] = lambda normals: np.array(1.0)
) -> csr_matrix:
    """Foundation of unit stiffness per area (3N,3N) under the nine-node faces (F,9) whose normals select them."""
    value, _, normal = _on_face(points, faces, 4)
    area = np.linalg.norm(normal, axis=-1) * lies(normal)
    blocks = np.einsum("fq,qa,qb->fab", area, value, value)
    row, column = np.broadcast_arrays(faces[:, :, None], faces[:, None, :])
    rows, columns = ((3 * one[..., None] + np.arange(3)).ravel() for one in (row, column))
    size = (points.size, points.size)
    return csr_matrix(coo_matrix((np.repeat(blocks.ravel(), 3), (rows, columns)), shape=size))


def _solve(matrix: Any, rhs: Any) -> np.ndarray:
    """Solve by SuperLU with a column ordering for symmetric patterns."""
    order = {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
    return splu(matrix.tocsc(), **order).solve(np.asarray(rhs).ravel())
