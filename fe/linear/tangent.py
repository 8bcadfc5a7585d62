"""Newton's direction: the symmetric tangent is factored, its unsymmetric part is left to GMRES."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.sparse.linalg import LinearOperator, gmres

from palpate.fe.linear.cholesky import Cholesky, NotPositive
from palpate.fe.linear.pattern import Pattern, pattern


class UnheldError(ArithmeticError):
    """A tangent that no reasonable shift makes positive definite."""


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
        self._factor = Cholesky(points, self.pattern.indptr, self.pattern.indices)

    def stiffness(self, data: np.ndarray) -> np.ndarray:
        """Mean stiffness of each node [N/m] (N,) from the blocks (B,3,3)."""
        mean: np.ndarray = np.trace(data[self.diagonal], axis1=1, axis2=2) / 3.0
        return mean

    def product(self, data: np.ndarray, change: np.ndarray) -> np.ndarray:
        """Forces [N] (N,3) of the blocks (B,3,3) for a change (N,3) of displacement."""
        forces: np.ndarray = (self.pattern.matrix(data) @ change.ravel()).reshape(-1, 3)
        return forces

    def direction(self, data: np.ndarray, rhs: np.ndarray, skew: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """Change of displacement [m] (N,3) for forces [N] (N,3); `skew` is the product of a change with what the blocks
        (B,3,3) leave out of the tangent.

        UnheldError: a tangent that is singular or far from positive.
        """
        self.factor(data)
        first = self._factor.solve(rhs.ravel())
        if not skew(first.reshape(-1, 3)).any():
            return first.reshape(-1, 3)

        def whole(x: np.ndarray) -> np.ndarray:
            product: np.ndarray = x + self._factor.solve(skew(x.reshape(-1, 3)).ravel())
            return product

        operator = LinearOperator((len(first), len(first)), matvec=whole, dtype=np.float64)
        solution, _ = gmres(operator, first, rtol=1e-3, maxiter=1, restart=20)
        return np.asarray(solution).reshape(-1, 3)

    def factor(self, data: np.ndarray) -> None:
        """Factor the tangent; one that is not positive definite is shifted until it is."""
        matrix = data.copy()
        self.hold(matrix)
        mean = float(self.stiffness(matrix).mean())
        shift = 0.0
        for _ in range(12):
            try:
                self._factor.factor(matrix)
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
