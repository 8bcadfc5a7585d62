"""Sparsity pattern of a tangent, and Newton's direction: the symmetric part is factored, the unsymmetric part is solved
by GMRES.

The factor in single precision, which takes half the time and memory, preconditions conjugate gradients with the tangent
in double precision. It is reused in later iterations of the same load step if the tangent has changed little. A tangent
that cannot be factored, or not well enough, in single precision is factored in double precision.

Conjugate gradients stop when a new factorisation is faster, by the observed rate of convergence. As the preconditioner
is slightly nonlinear in single precision, directions are made conjugate by the change of the residual (E. Polak,
G. Ribiere, 1969).
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from scipy.sparse import bsr_array, csr_array, sparray
from scipy.sparse.linalg import LinearOperator, gmres

from palpate.models.fe.sparse.cholesky import Cholesky, NotPositive

ENOUGH = 1e-4  # [1] Relative residual of the linear system; Newton's iteration converges by this factor per iteration
SKEW = 1e-3  # [1] The same, of the preconditioned system, for a tangent with an unsymmetric part
KEPT = 8  # Maximum number of iterations with an old factor; a new factorisation takes about the same time
FRESH = 20  # Maximum number of iterations with a new factor; if more are required, single precision is insufficient
SEEN = 3  # Number of iterations after which the rate of convergence predicts their total number


Linear = Callable[[np.ndarray], np.ndarray]  # A linear map of displacements or forces


@dataclass(frozen=True)
class Pattern:
    """Block rows and columns of the nodes that elements couple.

    indptr (N+1,), indices (B,)  as in a BSR matrix of 3 by 3 blocks, columns sorted
    """

    indptr: np.ndarray
    indices: np.ndarray

    def where(self, elements: np.ndarray) -> np.ndarray:
        """Index of the block of each pair of nodes of each element (E,k,k); arbitrary if a node is -1. ValueError: a
        pair that the pattern does not couple."""
        count = len(self.indptr) - 1
        keys = np.repeat(np.arange(count), np.diff(self.indptr)) * count + self.indices
        a, b = elements[:, :, None], elements[:, None, :]
        wanted = np.where((a >= 0) & (b >= 0), a * count + b, keys[0])
        places = np.searchsorted(keys, wanted)
        if (keys[np.minimum(places, len(keys) - 1)] != wanted).any():
            raise ValueError("nodes that the pattern does not couple")
        return places

    def matrix(self, data: np.ndarray) -> bsr_array:
        """The sparse matrix with these blocks (B,3,3)."""
        size = 3 * (len(self.indptr) - 1)
        return bsr_array((data, self.indices, self.indptr), shape=(size, size))


def pattern(count: int, elements: np.ndarray) -> Pattern:
    """Pattern of `count` nodes coupled by elements (E,k), padded with -1."""
    clique, place = np.nonzero(elements >= 0)
    node = elements[clique, place]
    ones = np.ones(len(node) + count, dtype=np.int32)
    single = len(elements) + np.arange(count)  # each node is coupled to itself, also without elements
    members = (np.concatenate([clique, single]), np.concatenate([node, np.arange(count)]))
    incidence = csr_array((ones, members), shape=(len(elements) + count, count))
    coupled = csr_array(incidence.T @ incidence)
    coupled.sort_indices()
    return Pattern(coupled.indptr.astype(np.int32), coupled.indices.astype(np.int32))


def join_cliques(parts: Sequence[np.ndarray]) -> np.ndarray:
    """All cliques of several arrays (C,k) of nodes, padded with -1 to the widest."""
    width = max(part.shape[1] for part in parts)
    return np.concatenate([np.pad(part, ((0, 0), (0, width - part.shape[1])), constant_values=-1) for part in parts])


class UnheldError(ArithmeticError):
    """A tangent that is not positive definite after any reasonable shift."""


def descend(
    matrix: sparray, rhs: np.ndarray, start: np.ndarray, solve: Linear, tolerance: float, most: int
) -> tuple[np.ndarray, bool]:
    """Preconditioned conjugate gradients: solution (n,) of a symmetric positive definite system, and whether its
    residual is below `tolerance` [1] of rhs (n,). False if more than `most` iterations are predicted, or if the matrix
    or the preconditioner is not positive; the solution is then the current iterate.

    start  (n,) initial guess
    solve  the preconditioner: approximate solution for a residual (n,)
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
    cliques  (C,k) nodes that are coupled, padded with -1
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

    @property
    def factored(self) -> Cholesky:
        """The factor in use."""
        return self._factor

    def forget(self) -> None:
        """Discard the factor, so that a resumed run takes the same steps."""
        self._kept, self._hard = False, False

    def stiffness(self, data: np.ndarray) -> np.ndarray:
        """Mean stiffness of each node [N/m] (N,) from the blocks (B,3,3)."""
        return np.trace(data[self.diagonal], axis1=1, axis2=2) / 3.0

    def direction(self, data: np.ndarray, rhs: np.ndarray, skew: Linear) -> np.ndarray:
        """Change of displacement [m] (N,3) for forces [N] (N,3), with the relative residual `ENOUGH`; `skew` is the
        product of a change with the unsymmetric part, which is not in the blocks (B,3,3). UnheldError: a tangent that
        is singular or far from positive."""
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
        """Change of displacement (3N,) for forces (3N,) with the symmetric tangent without its fixed rows."""
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
        self._shift_diagonal(matrix)
        return self._double.solve(rhs)

    def factor(self, data: np.ndarray) -> None:
        """Factor the tangent for `solve`, in double precision, shifted until it is positive definite. UnheldError: it
        is singular or far from positive."""
        matrix = data.copy()
        self.hold(matrix)
        self._shift_diagonal(matrix)

    def _shift_diagonal(self, matrix: np.ndarray) -> None:
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
        """Displacements (3N,) or (3N,k) for forces of the same shape, with the last factor."""
        return self._factor.solve(rhs)

    def hold(self, data: np.ndarray) -> None:
        """Set the fixed rows and columns of the blocks to zero except for the diagonal."""
        indptr, indices, fixed = self.pattern.indptr, self.pattern.indices, self.fixed
        row = np.repeat(np.arange(len(indptr) - 1), np.diff(indptr))
        kept = np.einsum("nii->ni", data[self.diagonal]).copy()
        kept[kept <= 0.0] = 1.0
        free = ~fixed
        touched = np.flatnonzero(fixed[row].any(axis=1) | fixed[indices].any(axis=1))
        data[touched] *= free[row[touched], :, None] & free[indices[touched], None, :]
        node, axis = np.nonzero(fixed)
        data[self.diagonal[node], axis, axis] = kept[node, axis]
