"""Strain energy of a body in a reduced basis, by empirical cubature over a subset of its integration points.

    W(q) = sum_p w_p [W + U](F_p) + 1/2 q.S q + B(q),    F_p = 1 + G_p q,    w_p > 0

G_p (9,r) are the gradients of the modes at point p, S the stiffness of the elastic foundation, B a barrier: zero up to
the size |q| of the snapshots, infinite at twice that size. The volume ratio is evaluated at each point.
J. A. Hernandez, M. A. Caicedo, A. Ferrer, Comput. Methods Appl. Mech. Eng. 313 (2017) 687-722.
"""

from typing import Annotated, NamedTuple

import numpy as np

from palpate.compiler.dot import add_products, inner, left_times, times
from palpate.compiler.kernel import ieee_kernel
from palpate.physics.arrays import Array, Matrix
from palpate.physics.materials.compiled import call_law
from palpate.physics.materials.invariants import cofactor, volume_tangent

ROOM = 3.0  # |q|² at which the barrier is infinite over that at which it begins, minus 1
NEAR = 64  # Number of points that are processed together, so that their modes remain in the cache


class Points(NamedTuple):
    """Sampled points and their modes; modulus 1 Pa.

    modes      [1]     (9P,r) du_i/dX_j of each mode at row 9p + 3i + j of point p; products with them have the
                       precision of this array: single for speed, when forces are the energy's gradient to about 1e-7
    """

    modes: Annotated[np.ndarray, "<f4", 2]
    weights: Annotated[np.ndarray, "<f8", 1]  # [m³] (P,)
    kinds: Annotated[np.ndarray, "<i8", 1]  # [1] (P,) index in `laws` of each point
    constants: Annotated[np.ndarray, "<f8", 2]  # [Pa..] (P,n) parameters of the law, padded with 0
    springs: Annotated[np.ndarray, "<f8", 2]  # [J] (r,r)
    limit: float  # [1] |q|² at which the barrier begins
    laws: Annotated[np.ndarray, "<i8", 1]  # [1] (L,) addresses of the laws in this process, see `hyperelastic.place_of`


class SampledWorkspace(NamedTuple):
    """Workspace of the kernels; x, D, f, g in the precision of the modes."""

    x: Annotated[np.ndarray, "<f4", 1]
    D: Annotated[np.ndarray, "<f4", 1]
    f: Annotated[np.ndarray, "<f4", 1]
    g: Annotated[np.ndarray, "<f4", 1]
    F: Annotated[np.ndarray, "<f8", 2]
    C: Annotated[np.ndarray, "<f8", 2]
    P: Annotated[np.ndarray, "<f8", 2]
    A: Annotated[np.ndarray, "<f8", 2]
    M: Annotated[np.ndarray, "<f8", 2]
    T: Annotated[np.ndarray, "<f8", 2]


def scratch(points: Points) -> SampledWorkspace:
    rows, r = points.modes.shape
    x, D, f, g = (np.zeros(size, dtype=points.modes.dtype) for size in (r, rows, rows, r))
    return SampledWorkspace(
        x, D, f, g, np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((9, 9)), np.zeros((9 * NEAR, r)),
        np.zeros((9 * NEAR, r)),
    )  # fmt: skip


@ieee_kernel
def _deform(D: Array, at: int, F: Matrix, C: Matrix):
    """Fill F of a point from its displacement gradient D[at : at + 9], and its cofactors C; returns det F."""
    for i in range(3):
        for j in range(3):
            F[i, j] = D[at + 3 * i + j]
        F[i, i] += 1.0
    return cofactor(F, C)


@ieee_kernel
def barrier(square: float, limit: float):
    """B(q) [J] at `square` = |q|², zero up to `limit`, and its first two derivatives by |q|²."""
    t = (square / limit - 1.0) / ROOM
    if not t > 0.0:
        return 0.0, 0.0, 0.0
    if not t < 1.0:
        return np.inf, np.inf, np.inf
    return (-ROOM * limit * (np.log(1.0 - t) + t), 1.0 / (1.0 - t) - 1.0, 1.0 / ((1.0 - t) ** 2 * ROOM * limit))


@ieee_kernel
def forces(points: Points, q: Array, work: SampledWorkspace, g: Array):
    """Fill `g` (r,) with the gradient of W(q) [J]. Returns W, inf if a point is inverted or q is out of bounds."""
    D, f, F, C, P, A = work.D, work.f, work.F, work.C, work.P, work.A
    total, pull, _ = barrier(inner(q, q), points.limit)
    if not total < np.inf:
        return np.inf
    for i in range(len(q)):
        work.x[i] = q[i]
        g[i] = 0.0
    # blocks of points: displacement gradients of the modes, stresses, and their work on the modes
    for start in range(0, len(points.kinds), NEAR):
        end = min(start + NEAR, len(points.kinds))
        modes = points.modes[9 * start : 9 * end]
        times(modes, work.x, D[9 * start : 9 * end])
        for p in range(start, end):
            at = 9 * p
            J = _deform(D, at, F, C)
            if not J > 0.0:
                return np.inf
            A[0, 0] = np.nan
            w = points.weights[p]
            law = points.laws[points.kinds[p]]
            W, U, dU, _ = call_law(law, F, J, points.constants[p], P, A)
            total += w * (W + U)
            for i in range(3):
                for j in range(3):
                    f[at + 3 * i + j] = w * (P[i, j] + dU * C[i, j])
        left_times(f[9 * start : 9 * end], modes, work.g)
        g += work.g
    # elastic foundation, and the barrier
    for i in range(len(q)):
        along = 0.0
        for j in range(len(q)):
            along += points.springs[i, j] * q[j]
        total += 0.5 * q[i] * along
        g[i] += along + 2.0 * pull * q[i]
    return total


@ieee_kernel
def tangent(points: Points, q: Array, work: SampledWorkspace, hessian: Matrix):
    """Fill `hessian` (r,r) with d²W/dq² [J]. Returns False if a point is inverted or q is out of bounds."""
    D, F, C, P, A, M, T = work.D, work.F, work.C, work.P, work.A, work.M, work.T
    _, pull, curve = barrier(inner(q, q), points.limit)
    if not pull < np.inf:
        return False
    for i in range(len(q)):
        work.x[i] = q[i]
    times(points.modes, work.x, D)
    for i in range(len(q)):
        for j in range(len(q)):
            hessian[i, j] = points.springs[i, j] + 4.0 * curve * q[i] * q[j]
        hessian[i, i] += 2.0 * pull
    for start in range(0, len(points.kinds), NEAR):
        end = min(start + NEAR, len(points.kinds))
        rows = 9 * (end - start)
        for i in range(rows):
            for j in range(len(q)):
                M[i, j] = points.modes[9 * start + i, j]
        for p in range(start, end):
            at = 9 * p
            J = _deform(D, at, F, C)
            if not J > 0.0:
                return False
            A[0, 0] = 0.0
            law = points.laws[points.kinds[p]]
            _, _, dU, ddU = call_law(law, F, J, points.constants[p], P, A)
            volume_tangent(F, C, dU, ddU, A)
            A *= points.weights[p]
            at = 9 * (p - start)
            T[at : at + 9] = 0.0
            add_products(A, M[at : at + 9], T[at : at + 9])  # A is symmetric
        add_products(M[:rows], T[:rows], hessian)
    return True
