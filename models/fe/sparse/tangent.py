"""Newton's direction: the symmetric tangent is factored, its unsymmetric part is left to GMRES.

The factor is in single precision, which takes half the time and memory, and conjugate gradients on the tangent itself
make up for it. They make up as well for a factor of an earlier iteration of the same load step, where the tangent has
changed little. What single precision cannot factor, or not well enough, is factored in double.

Conjugate gradients end as soon as they go too slowly to be worth their time: to factor anew is then cheaper. In single
precision the factor is not quite the same map each time, so directions are made conjugate by the change of the residual
(E. Polak, G. Ribiere, 1969).
"""

from collections.abc import Callable
from contextlib import suppress

import numpy as np
from scipy.sparse import bsr_array, sparray
from scipy.sparse.linalg import LinearOperator, gmres

from palpate.models.fe.sparse.cholesky import Cholesky, NotPositive
from palpate.models.fe.sparse.pattern import Pattern, pattern

ENOUGH = 1e-4
"""[1] Residual of the linear system that a direction leaves: Newton's iteration converges by as much each time."""
SKEW = 1e-3  # [1] The same where the tangent has an unsymmetric part, of the system multiplied by the factor's inverse
KEPT = 8
"""Conjugate gradients that a factor of an earlier iteration is worth; to factor anew takes as long as about so many."""
FRESH = 20  # Conjugate gradients with a factor of this iteration; where more were needed single precision is not enough


SEEN = 3  # Conjugate gradients after which the rate is trusted to foretell how many more there will be


Linear = Callable[[np.ndarray], np.ndarray]  # A linear map of displacements or forces


class UnheldError(ArithmeticError):
    """A tangent that no reasonable shift makes positive definite."""


def descend(
    matrix: sparray, rhs: np.ndarray, start: np.ndarray, solve: Linear, tolerance: float, most: int
) -> tuple[np.ndarray, bool]:
    """Solution (n,) of a symmetric positive definite system, and whether its residual is below `tolerance` [1] of rhs
    (n,). It is not where that takes more than `most` iterations, by the rate of the first ones, or where the matrix or
    the preconditioner is not positive; the solution is then the best so far.

    start  (n,) where to begin
    solve  the preconditioner: about the solution for a residual (n,)
    """
    x = start
    r = rhs - matrix @ x if x.any() else rhs.copy()
    goal, first = tolerance * float(np.linalg.norm(rhs)), float(np.linalg.norm(r))
    left = first
    if left <= goal:
        return x, True
    z = solve(r)
    p, along = z, float(r @ z)
    for k in range(1, most + 1):
        moved = matrix @ p
        curve = float(p @ moved)
        if not (curve > 0.0 and along > 0.0):
            return x, False
        length = along / curve
        x, after = x + length * p, r - length * moved
        left = float(np.linalg.norm(after))
        if left <= goal:
            return x, True
        if k >= SEEN and not k * np.log(first / goal) <= most * np.log(max(first / left, 1.0)):
            return x, False
        z = solve(after)
        bend = float(z @ (after - r)) / along
        r, along = after, float(after @ z)
        p = z + bend * p
    return x, False


class Tangent:
    """Pattern, elimination tree and factor of the tangent of a body.

    points   [m] (N,3)
    cliques  (C,k) nodes that are coupled, -1 fills up
    fixed    (N,3) bool, displacement components that are prescribed
    """

    def __init__(self, points: np.ndarray, cliques: np.ndarray, fixed: np.ndarray) -> None:
        self.fixed = fixed
        self.pattern: Pattern = pattern(len(points), cliques)
        self.diagonal = self.pattern.where(np.arange(len(points))[:, None])[:, 0, 0]
        self._double = Cholesky(points, self.pattern.indptr, self.pattern.indices)
        self._single = self._double.alike(single=True)
        self._factor = self._double  # The one in use
        self.forget()

    def forget(self) -> None:
        """Keep nothing of what was factored for the next direction: so a run that is resumed takes the same steps."""
        self._kept, self._hard = False, False

    def stiffness(self, data: np.ndarray) -> np.ndarray:
        """Mean stiffness of each node [N/m] (N,) from the blocks (B,3,3)."""
        return np.trace(data[self.diagonal], axis1=1, axis2=2) / 3.0

    def direction(self, data: np.ndarray, rhs: np.ndarray, skew: Linear) -> np.ndarray:
        """Change of displacement [m] (N,3) for forces [N] (N,3), to `ENOUGH` of them; `skew` is the product of a change
        with what the blocks (B,3,3) leave out of the tangent. UnheldError: a tangent that is singular or far from
        positive."""
        matrix = data.copy()
        self.hold(matrix)
        forces, product = rhs.ravel(), self.pattern.matrix(matrix)
        first = self._symmetric(matrix, product, forces)
        if not skew(first.reshape(-1, 3)).any():
            return first.reshape(-1, 3)

        def whole(x: np.ndarray) -> np.ndarray:
            return self._factor.solve(product @ x + skew(x.reshape(-1, 3)).ravel())

        operator = LinearOperator((len(first), len(first)), matvec=whole, dtype=np.float64)
        solution, _ = gmres(operator, self._factor.solve(forces), rtol=SKEW, maxiter=1, restart=20)
        return np.asarray(solution).reshape(-1, 3)

    def _symmetric(self, matrix: np.ndarray, product: bsr_array, rhs: np.ndarray) -> np.ndarray:
        """Change of displacement (3N,) for forces (3N,) by the symmetric tangent, whose blocks have no fixed rows."""
        x = np.zeros_like(rhs)
        if self._kept:
            x, done = descend(product, rhs, x, self._single.solve, ENOUGH, KEPT)
            if done:
                return x
        if not self._hard:
            self._factor = self._single
            with suppress(NotPositive):
                self._single.factor(matrix)
                x, self._kept = descend(product, rhs, x, self._single.solve, ENOUGH, FRESH)
                if self._kept:
                    return x
            self._kept, self._hard = False, True
        self._shifted(matrix)
        return self._double.solve(rhs)

    def factor(self, data: np.ndarray) -> None:
        """Factor the tangent, in double precision, for `solve`, shifted until it is positive definite. UnheldError: it
        is singular or far from positive."""
        matrix = data.copy()
        self.hold(matrix)
        self._shifted(matrix)

    def _shifted(self, matrix: np.ndarray) -> None:
        self._factor, self._kept = self._double, False
        mean = float(self.stiffness(matrix).mean())
        shift = 0.0
        for _ in range(12):
            try:
                self._double.factor(matrix)
                return
            except NotPositive:
                more = max(10.0 * shift, 1e-4 * mean) - shift
                matrix[self.diagonal] += more * np.eye(3)
                shift += more
        raise UnheldError("the tangent is not positive definite; is the body supported against rigid motion?")

    def solve(self, rhs: np.ndarray) -> np.ndarray:
        """Displacements (3N,) or (3N,k) for forces of that shape, by the last factor."""
        return self._factor.solve(rhs)

    def hold(self, data: np.ndarray) -> None:
        """Take the fixed rows and columns out of the blocks; their diagonal keeps its size."""
        indptr, indices, fixed = self.pattern.indptr, self.pattern.indices, self.fixed
        row = np.repeat(np.arange(len(indptr) - 1), np.diff(indptr))
        kept = np.einsum("nii->ni", data[self.diagonal]).copy()
        kept[kept <= 0.0] = 1.0
        free = ~fixed
        touched = np.flatnonzero(fixed[row].any(axis=1) | fixed[indices].any(axis=1))
        data[touched] *= free[row[touched], :, None] & free[indices[touched], None, :]
        node, axis = np.nonzero(fixed)
        data[self.diagonal[node], axis, axis] = kept[node, axis]
