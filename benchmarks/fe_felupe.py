"""The problems of fe_problems.py with FElupe, with its contact at nodes or a contact at integration points of faces."""

from __future__ import annotations

import importlib.metadata
import os
import time
from typing import Any

import numpy as np
from fe_problems import POISSON, YOUNG, FEProblem
from scipy.sparse import csr_matrix

from palpate.models.fe.element import faces as rule
from palpate.studies.peers import MissingError
from palpate.studies.peers import felupe as peer


class FacePlane(peer.Item):
    """Contact of faces (F,6) with a rigid plane by a penalty [Pa/m] at six integration points per face."""

    def __init__(self, field: Any, problem: FEProblem) -> None:
        super().__init__(field)
        self.faces, self.floor = problem.skin, problem.floor
        self.penalty = problem.penalty
        self.points = field.region.mesh.points
        self.area = rule.areas(self.points, self.faces)
        self.value, _ = rule.shape(rule.POINTS)

    def _gap(self) -> np.ndarray:
        height: np.ndarray = (self.points + self.field[0].values)[self.faces][..., 2] @ self.value.T - self.floor
        return height

    def _vector(self, field: Any = None, **_: Any) -> csr_matrix:
        push = self.area * self.penalty * np.maximum(-self._gap(), 0.0)
        force = np.zeros(self.points.shape)
        np.add.at(force[:, 2], self.faces, -push @ self.value)
        return csr_matrix(force.reshape(-1, 1))

    def _matrix(self, field: Any = None, **_: Any) -> csr_matrix:
        stiff = self.penalty * np.where(self._gap() < 0.0, self.area, 0.0)
        block = np.einsum("fq,qa,qb->fab", stiff, self.value, self.value)
        row, column = np.broadcast_arrays(self.faces[:, :, None], self.faces[:, None, :])
        size = (self.points.size, self.points.size)
        return csr_matrix((block.ravel(), (3 * row.ravel() + 2, 3 * column.ravel() + 2)), shape=size)


def felupe(problem: FEProblem, faces: bool = False, cholmod: bool = False) -> dict[str, object] | None:
    """Force, times and iterations of FElupe; None if it is not installed.

    faces    contact at integration points of faces instead of FElupe's contact at nodes
    cholmod  CHOLMOD instead of PARDISO or SuperLU
    """
    try:
        fem = peer.library()
        name, spsolve = _cholmod() if cholmod else _direct()
    except (ImportError, MissingError):
        return None
    # body and contact
    begun, used = time.perf_counter(), time.process_time()
    mesh, count = problem.mesh, len(problem.mesh.points)
    points = np.concatenate([mesh.points, [[0.0, 0.0, problem.floor]]])  # the last point carries the plane
    field = peer.displacement_field(fem, fem.Mesh(points, mesh.elements, "tetra10"))
    items = [peer.neo_hooke(fem, field, YOUNG, POISSON)]
    if faces and len(problem.skin):
        items.append(FacePlane(field, problem))
    elif len(problem.skin):
        nodes = np.unique(problem.skin)
        normal = np.array([0.0, 0.0, 1.0])
        items.append(fem.ContactRigidPlane(field, nodes, count, normal, multiplier=problem.penalty * problem.share))
    # boundary conditions: fixed directions, and the driven nodes
    held = np.concatenate([problem.fixed, [[True] * 3]])
    move = np.concatenate([problem.driven, [False]])
    held[move, 2] = False
    bounds = {
        f"held{k}": fem.Boundary(field[0], mask=held[:, k], skip=tuple(int(k != i) for i in range(3))) for k in range(3)
    }
    bounds["move"] = fem.Boundary(field[0], mask=move, skip=(1, 1, 0))
    # load steps by Newton's method
    iterations = 0
    for step in range(1, problem.steps + 1):
        bounds["move"].update(-problem.travel * step / problem.steps)
        iterations += peer.balance(fem, field, items, bounds, lambda a, b: spsolve(a.tocsr(), b), tol=1e-6, most=40)
    reaction = items[0].assemble.vector(field).toarray().reshape(-1, 3)
    return {
        "solver": f"FElupe, {name}, contact of faces" if faces else f"FElupe, {name}",
        "force": float(reaction[move, 2].sum()),
        "CPU s": time.process_time() - used,
        "clock s": time.perf_counter() - begun,
        "iterations": iterations,
        "penetration/travel": -float((points + field[0].values)[np.unique(problem.skin), 2].min() - problem.floor)
        / problem.travel
        if len(problem.skin)
        else None,
    }


def _cholmod():
    """CHOLMOD; matrices of the same pattern share one symbolic analysis."""
    from sksparse.cholmod import analyze

    kept: dict[str, Any] = {}

    def solve(matrix: Any, rhs: Any) -> np.ndarray:
        matrix = matrix.tocsc()
        if "factor" not in kept or kept["size"] != matrix.nnz:
            kept.update(factor=analyze(matrix), size=matrix.nnz)
        kept["factor"].cholesky_inplace(matrix)
        solution: np.ndarray = kept["factor"](np.asarray(rhs).ravel())
        return solution

    return "CHOLMOD", solve


def _direct():
    """PARDISO if it is installed, else SuperLU.

    pypardiso only searches its environment for MKL, so `PYPARDISO_MKL_RT` points it to MKL in another one.
    """
    try:
        if "PYPARDISO_MKL_RT" not in os.environ:
            parts = importlib.metadata.files("mkl") or []
            libraries = [str(p.locate().resolve()) for p in parts if "mkl_rt" in p.name and p.locate().exists()]
            os.environ.update({"PYPARDISO_MKL_RT": libraries[0]} if libraries else {})
        from pypardiso import spsolve

        return "PARDISO", spsolve
    except ImportError:
        from scipy.sparse.linalg import spsolve

        return "SuperLU", spsolve
