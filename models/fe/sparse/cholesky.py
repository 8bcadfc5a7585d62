"""Multifrontal sparse Cholesky factorisation of a matrix of 3 by 3 blocks, with scipy's BLAS and LAPACK.

The dense fronts of the elimination tree (`fe.sparse.ordering`) are factored by LAPACK, so that nearly all time is spent
in matrix products. The symbolic analysis is done once per mesh.

I. S. Duff, J. K. Reid, ACM Trans. Math. Softw. 9 (1983) 302-325; J. W. H. Liu, SIAM Rev. 34 (1992) 82-109.
"""

from __future__ import annotations

from copy import copy
from typing import Any

import numpy as np
from numba import types
from numba.extending import get_cython_function_address

from palpate.models.fe.sparse.ordering import Tree, dissect
from palpate.physics.kernel import kernel

_LETTERS = np.frombuffer(b"LRTN", dtype=np.uint8)


class NotPositive(ArithmeticError):
    """The matrix has a pivot that is not positive, in the block row `node`."""

    def __init__(self, node: int) -> None:
        super().__init__(f"the matrix is not positive definite at node {node}")
        self.node = node


class _Routine(types.WrapperAddressProtocol):
    """A Fortran routine of scipy's BLAS or LAPACK; all its arguments are addresses."""

    def __init__(self, module: str, name: str, arguments: int) -> None:
        self.address = get_cython_function_address(f"scipy.linalg.cython_{module}", name)
        self.arguments = arguments

    def __wrapper_address__(self) -> int:
        return self.address

    def signature(self) -> Any:
        return types.void(*[types.uintp] * self.arguments)


class Cholesky:
    """Factor of a symmetric positive definite block matrix.

    points    [m] (N,3)  positions of the nodes, for the elimination order
    indptr, indices      the block pattern, both halves, as in a BSR matrix
    single               factor in single precision, with half the memory and time, as a preconditioner
    """

    def __init__(self, points: np.ndarray, indptr: np.ndarray, indices: np.ndarray, single: bool = False) -> None:
        self.tree = tree = dissect(points, indptr, indices)
        self._pivots = np.diff(tree.first)
        self._rows = self._pivots + np.diff(tree.start)
        self._panel = np.concatenate([[0], np.cumsum(9 * self._rows * self._pivots)])
        self._children = np.bincount(tree.parent[tree.parent >= 0], minlength=len(tree.parent))
        self._relative = _relative(tree)
        # of each front: numbers of pivots and rows (nodes), start of its boundary, start of its panel
        self._fronts = self._pivots, self._rows, tree.start, self._panel
        self._blocks = _destinations(tree, indptr, indices)
        self._stack = _stack(tree, self._children)
        self._set(single)

    def _set(self, single: bool) -> None:
        self.dtype = np.dtype(np.float32 if single else np.float64)
        letter = "s" if single else "d"
        self._potrf = _Routine("lapack", letter + "potrf", 5)
        self._trsm = _Routine("blas", letter + "trsm", 11)
        self._syrk = _Routine("blas", letter + "syrk", 10)
        self._gemm = _Routine("blas", letter + "gemm", 13)
        # arguments of BLAS by address: letters, 1 and -1, and memory for sizes
        self._words = _LETTERS, np.array([1.0, -1.0], dtype=self.dtype), np.zeros(4, dtype=np.int32)
        self._factor: np.ndarray | None = None

    def alike(self, single: bool) -> Cholesky:
        """Another one for the same pattern, with the same tree, in this precision."""
        made = copy(self)
        made._set(single)
        return made

    def factor(self, data: np.ndarray) -> None:
        """Factor the matrix with these blocks (B,3,3). NotPositive: it is not positive definite, or contains NaN."""
        if self._factor is None:
            self._factor = np.empty(int(self._panel[-1]), dtype=self.dtype)
            largest = int(3 * self._rows.max())
            self._front = np.empty(largest * largest, dtype=self.dtype)
            self._updates = np.empty(self._stack, dtype=self.dtype)
        bad = _factor(
            self._potrf, self._trsm, self._syrk, self._fronts, (self._children, self._relative), self._blocks,
            np.ascontiguousarray(data), self._factor, self._front, self._updates, self._words,
        )  # fmt: skip
        if bad >= 0:
            raise NotPositive(int(self.tree.order[bad]))

    def solve(self, rhs: np.ndarray) -> np.ndarray:
        """Solution for right sides (3N,) or (3N,m) with the latest factor."""
        many = rhs.reshape(len(self.tree.order), 3, -1)
        x = np.ascontiguousarray(many[self.tree.order], dtype=self.dtype).reshape(-1, many.shape[2])
        largest = int(3 * self._rows.max())
        work = np.empty(largest * x.shape[1], dtype=self.dtype)
        _solve(
            self._trsm, self._gemm, self._fronts, self.tree.first, self.tree.boundary, self._factor, x, work,
            self._words,
        )  # fmt: skip
        solution = np.empty((len(self.tree.order), 3, x.shape[1]))
        solution[self.tree.order] = x.reshape(-1, 3, x.shape[1])
        return solution.reshape(rhs.shape)

    def front(self, t: int) -> tuple[np.ndarray, np.ndarray]:
        """L11 (p,p), whose upper part is arbitrary, and L21 (u,p) of a front."""
        if self._factor is None:
            raise ValueError("the matrix is not factored")
        rows, pivots = 3 * int(self._rows[t]), 3 * int(self._pivots[t])
        panel = self._factor[self._panel[t] : self._panel[t] + rows * pivots].reshape(pivots, rows).T
        return panel[:pivots], panel[pivots:]

    def relative(self, t: int) -> np.ndarray:
        """Index of each boundary node of a front in the front of its parent."""
        return np.asarray(self._relative[self.tree.start[t] : self.tree.start[t + 1]])

    def work(self) -> np.ndarray:
        """Number of entries of each front's factor, a measure of its work."""
        return np.diff(self._panel)


def _relative(tree: Tree) -> np.ndarray:
    """Index of each boundary node in the front of the parent."""
    places = np.zeros(len(tree.boundary), dtype=np.int64)
    for t, up in enumerate(tree.parent):
        mine = tree.boundary[tree.start[t] : tree.start[t + 1]]
        if up < 0 or len(mine) == 0:
            continue
        low, high = tree.first[up], tree.first[up + 1]
        far = np.searchsorted(tree.boundary[tree.start[up] : tree.start[up + 1]], mine)
        places[tree.start[t] : tree.start[t + 1]] = np.where(mine < high, mine - low, high - low + far)
    return places


def _destinations(tree: Tree, indptr: np.ndarray, indices: np.ndarray) -> tuple[np.ndarray, ...]:
    """The blocks of each front's pivot columns, and their row and column in the front."""
    place = np.empty(len(tree.order), dtype=np.int64)
    place[tree.order] = np.arange(len(tree.order))
    i, j = place[np.repeat(np.arange(len(indptr) - 1), np.diff(indptr))], place[indices]
    lower = np.flatnonzero(i >= j)
    i, j = i[lower], j[lower]
    front = np.searchsorted(tree.first, j, side="right") - 1
    sort = np.argsort(front, kind="stable")
    which, i, j, front = lower[sort], i[sort], j[sort], front[sort]
    begin = np.searchsorted(front, np.arange(len(tree.parent) + 1))
    row = i - tree.first[front]
    for t in range(len(tree.parent)):
        part = slice(begin[t], begin[t + 1])
        far = i[part] >= tree.first[t + 1]
        boundary = tree.boundary[tree.start[t] : tree.start[t + 1]]
        spot = np.searchsorted(boundary, i[part][far])
        if (spot >= len(boundary)).any() or (boundary[np.minimum(spot, len(boundary) - 1)] != i[part][far]).any():
            raise ValueError("the pattern couples nodes that no element shares")
        row[part][far] = tree.first[t + 1] - tree.first[t] + spot
    return which, begin, row, j - tree.first[front]


def _stack(tree: Tree, children: np.ndarray) -> int:
    """Largest size of the stack of update matrices, in numbers."""
    sizes = (3 * np.diff(tree.start)) ** 2
    waiting: list[int] = []
    most = 1
    for t, size in enumerate(sizes):
        if children[t]:
            del waiting[-children[t] :]
        waiting.append(int(size))
        most = max(most, sum(waiting))
    return most


@kernel
def _factor(potrf, trsm, syrk, fronts, children_of, blocks, data, factor, front, updates, words):
    """Factor all fronts; returns -1, or the elimination position of the first pivot that is not positive."""
    pivots, rows, start, panel = fronts
    children, relative = children_of
    which, begin, row, column = blocks
    letter, scale, size = words
    # arrays that BLAS reads by address are arguments: those allocated here could be freed before the last call
    low, right, transposed, plain = (
        letter.ctypes.data, letter[1:].ctypes.data, letter[2:].ctypes.data, letter[3:].ctypes.data
    )  # fmt: skip
    n_at, p_at, u_at, info = size.ctypes.data, size[1:].ctypes.data, size[2:].ctypes.data, size[3:].ctypes.data
    plus, minus = scale.ctypes.data, scale[1:].ctypes.data
    waiting = np.zeros(len(pivots), dtype=np.int64)
    depth, top, done = 0, 0, 0
    # Multifrontal Cholesky (Duff, Reid 1983), fronts in postorder; a front is column-major, n rows, p of them pivots
    for t in range(len(pivots)):
        n, p = 3 * rows[t], 3 * pivots[t]
        u = n - p
        front[: n * n] = 0.0
        # assemble the blocks of the matrix
        for b in range(begin[t], begin[t + 1]):
            block = data[which[b]]
            for j in range(3):
                at = (3 * column[b] + j) * n + 3 * row[b]
                for i in range(3):
                    front[at + i] += block[i, j]
        # extend-add of the children's update matrices, from the top of the stack `updates`
        for _ in range(children[t]):
            depth -= 1
            child = waiting[depth]
            count = rows[child] - pivots[child]
            top -= 9 * count * count
            spot = start[child]
            for a in range(count):
                for j in range(3):
                    to = (3 * relative[spot + a] + j) * n
                    source = top + (3 * a + j) * 3 * count
                    for b in range(a, count):
                        at = to + 3 * relative[spot + b]
                        for i in range(3):
                            front[at + i] += updates[source + 3 * b + i]
        size[0], size[1], size[2] = n, p, u
        # dense: L11 by potrf, L21 by trsm, the update matrix S = A22 - L21 L21' by syrk
        if p > 0:
            potrf(low, p_at, front.ctypes.data, n_at, info)
            if size[3] != 0:
                return done + (size[3] - 1) // 3
        if u > 0:
            below = front[p:].ctypes.data
            corner = front[p * n + p :].ctypes.data
            trsm(right, low, transposed, plain, u_at, p_at, plus, front.ctypes.data, n_at, below, n_at)
            syrk(low, plain, u_at, p_at, minus, below, n_at, plus, corner, n_at)
            # push S onto the stack for the parent
            for j in range(u):
                for i in range(j, u):
                    updates[top + j * u + i] = front[(p + j) * n + p + i]
                for i in range(max(0, j - 2), j):  # the upper part of a diagonal block is added but not used
                    updates[top + j * u + i] = 0.0
        top += u * u
        waiting[depth] = t
        depth += 1
        column_panel = factor[panel[t] : panel[t] + n * p]
        for k in range(n * p):
            column_panel[k] = front[k]
        done += pivots[t]
    return -1


@kernel
def _solve(trsm, gemm, fronts, first, boundary, factor, x, work, words):
    """Solve in place: x (3N,m) contains the right sides, then the solution, in the order of elimination."""
    pivots, rows, start, panel = fronts
    letter, scale, size = words
    low, transposed, plain = letter.ctypes.data, letter[2:].ctypes.data, letter[3:].ctypes.data
    n_at, p_at, u_at, m_at = size.ctypes.data, size[1:].ctypes.data, size[2:].ctypes.data, size[3:].ctypes.data
    plus, minus = scale.ctypes.data, scale[1:].ctypes.data
    many = x.shape[1]
    size[3] = many
    # forward substitution L y = b from the leaves to the root, then backward substitution L' x = y
    for sweep in range(2):
        for step in range(len(pivots)):
            t = step if sweep == 0 else len(pivots) - 1 - step
            n, p = 3 * rows[t], 3 * pivots[t]
            if p == 0:
                continue
            u = n - p
            size[0], size[1], size[2] = n, p, u
            # gather the rows of the front: pivots, then boundary
            for k in range(many):
                for i in range(p):
                    work[k * n + i] = x[3 * first[t] + i, k]
                for b in range(u // 3):
                    at = 3 * boundary[start[t] + b]
                    for i in range(3):
                        work[k * n + p + 3 * b + i] = x[at + i, k] if sweep else 0.0
            panel_at = factor[panel[t] :].ctypes.data
            below = factor[panel[t] + p :].ctypes.data
            head, tail = work.ctypes.data, work[p:].ctypes.data
            if sweep == 0:
                trsm(low, low, plain, plain, p_at, m_at, plus, panel_at, n_at, head, n_at)
                if u > 0:
                    gemm(plain, plain, u_at, m_at, p_at, minus, below, n_at, head, n_at, plus, tail, n_at)
            else:
                if u > 0:
                    gemm(transposed, plain, p_at, m_at, u_at, minus, below, n_at, tail, n_at, plus, head, n_at)
                trsm(low, low, transposed, plain, p_at, m_at, plus, panel_at, n_at, head, n_at)
            # scatter the pivots, and in the forward sweep the contributions to the boundary
            for k in range(many):
                for i in range(p):
                    x[3 * first[t] + i, k] = work[k * n + i]
                if sweep == 0:
                    for b in range(u // 3):
                        at = 3 * boundary[start[t] + b]
                        for i in range(3):
                            x[at + i, k] += work[k * n + p + 3 * b + i]
