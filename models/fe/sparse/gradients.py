"""Conjugate gradients, preconditioned by a factor of lower precision, or of a tangent that was a little earlier.

Each iteration takes one product with the matrix and one solution by the factor. It ends as soon as it goes too slowly
to be worth its time: to factor anew is then cheaper. In single precision the factor is not quite the same map each
time, so directions are made conjugate by the change of the residual (E. Polak, G. Ribiere, 1969).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.sparse import sparray

SEEN = 3
"""Iterations after which the rate is trusted to foretell how many more there will be."""


def descend(
    matrix: sparray,
    rhs: np.ndarray,
    start: np.ndarray,
    solve: Callable[[np.ndarray], np.ndarray],
    tolerance: float,
    most: int,
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
