"""The strain energy of a body in a few modes, summed over a few of its elements with weights of their own.

    W(q) = sum_e w_e W_e(Phi_e q) + 1/2 q.S q + B(q),    w_e > 0

Phi_e (30,r) are the modes at the nodes of element e, a quadratic tetrahedron; S the springs that the body stands on; B
a barrier: zero up to the size |q| that the modes were made for, rising without bound towards twice that size. All
forces derive from W, so that the sampled body is as elastic as the full one. C. Farhat, P. Avery, T. Chapman,
J. Cortial, Int. J. Numer. Methods Eng. 98 (2014) 625-662 (energy-conserving sampling and weighting).

Elements are those of `fe.elements`: energy at four points, U at the mean volume ratio where `mixed`.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from palpate.physics.strain_energy import hencky, mooney_rivlin, neo_hooke

LAWS = ("neo_hooke", "mooney_rivlin", "hencky")
"""Names of the laws of `physics.strain_energy` that elements may have, by number."""
ROOM = 3.0
"""Squared size of q at which the barrier is infinite, less 1, over the squared size at which it begins."""


class Elements(NamedTuple):
    """Sampled elements and their modes; modulus 1 Pa.

    modes      [m]     (30E,r) displacement of node a in direction i of element e at row 30e + 3a + i
    slopes     [1/m]   (E,4,10,3) gradients of the shape functions
    weights    [m³]    (E,4) of the points, with the element's own weight
    kinds      [1]     (E,) numbers in `LAWS`
    constants  [Pa..]  (E,6) parameters of the law, padded with 0
    mixed      [1]     (E,) bool
    springs    [J]     (r,r)
    limit      [1]     |q|² at which the barrier begins
    """

    modes: np.ndarray
    slopes: np.ndarray
    weights: np.ndarray
    kinds: np.ndarray
    constants: np.ndarray
    mixed: np.ndarray
    springs: np.ndarray
    limit: float


class Scratch(NamedTuple):
    """Memory that the kernels work in."""

    u: np.ndarray
    f: np.ndarray
    F: np.ndarray
    C: np.ndarray
    J: np.ndarray
    P: np.ndarray
    A: np.ndarray
    K: np.ndarray
    T: np.ndarray
    V: np.ndarray
    R: np.ndarray
    Q: np.ndarray


def scratch(elements: Elements) -> Scratch:
    """Memory for these elements."""
    rows, r = elements.modes.shape
    return Scratch(
        np.zeros(rows), np.zeros(rows), np.zeros((4, 3, 3)), np.zeros((4, 3, 3)), np.zeros(4), np.zeros((3, 3)),
        np.zeros((9, 9)), np.zeros((30, 30)), np.zeros((30, 9)), np.zeros(30), np.zeros((30, r)), np.zeros((r, r)),
    )  # fmt: skip


@numba.njit(cache=True, error_model="numpy")
def _law(kind, F, J, p, P, A):
    if kind == 0:
        return neo_hooke(F, J, p, P, A)
    if kind == 1:
        return mooney_rivlin(F, J, p, P, A)
    return hencky(F, J, p, P, A)


@numba.njit(cache=True, error_model="numpy")
def _deform(slope, weight, u, F, C, J):
    """F, its cofactors and determinants at the points of an element; its mean volume ratio, 0 where one is inverted."""
    volume = mean = 0.0
    for q in range(4):
        for i in range(3):
            x, y, z = 0.0, 0.0, 0.0
            for a in range(10):
                d = u[3 * a + i]
                x += d * slope[q, a, 0]
                y += d * slope[q, a, 1]
                z += d * slope[q, a, 2]
            F[q, i, 0], F[q, i, 1], F[q, i, 2] = x, y, z
            F[q, i, i] += 1.0
        for i in range(3):
            i1, i2 = (i + 1) % 3, (i + 2) % 3
            for j in range(3):
                j1, j2 = (j + 1) % 3, (j + 2) % 3
                C[q, i, j] = F[q, i1, j1] * F[q, i2, j2] - F[q, i1, j2] * F[q, i2, j1]
        J[q] = F[q, 0, 0] * C[q, 0, 0] + F[q, 0, 1] * C[q, 0, 1] + F[q, 0, 2] * C[q, 0, 2]
        if not J[q] > 0.0:
            return 0.0
        volume += weight[q]
        mean += weight[q] * J[q]
    return mean / volume


@numba.njit(cache=True, error_model="numpy")
def barrier(square, limit):
    """B(q) and its first two derivatives by |q|²."""
    t = (square / limit - 1.0) / ROOM
    if not t > 0.0:
        return 0.0, 0.0, 0.0
    if not t < 1.0:
        return np.inf, np.inf, np.inf
    return (
        -ROOM * limit * (np.log(1.0 - t) + t),
        1.0 / (1.0 - t) - 1.0,
        1.0 / ((1.0 - t) ** 2 * ROOM * limit),
    )


@numba.njit(cache=True, error_model="numpy")
def forces(elements, q, work, g):
    """W(q) [J], and its gradient [J] (r,) into `g`; infinite where an element is inverted or q is out of bounds."""
    u, f, F, C, J, P, A = work.u, work.f, work.F, work.C, work.J, work.P, work.A
    total, pull, _ = barrier(np.dot(q, q), elements.limit)
    if not total < np.inf:
        return np.inf
    np.dot(elements.modes, q, u)
    for e in range(len(elements.kinds)):
        at = 30 * e
        slope, weight = elements.slopes[e], elements.weights[e]
        mean = _deform(slope, weight, u[at : at + 30], F, C, J)
        if not mean > 0.0:
            return np.inf
        for k in range(30):
            f[at + k] = 0.0
        for s in range(4):
            A[0, 0] = np.nan
            w = weight[s]
            ratio = mean if elements.mixed[e] else J[s]
            W, U, dU, _ = _law(elements.kinds[e], F[s], ratio, elements.constants[e], P, A)
            total += w * (W + U)
            for i in range(3):
                x = w * (P[i, 0] + dU * C[s, i, 0])
                y = w * (P[i, 1] + dU * C[s, i, 1])
                z = w * (P[i, 2] + dU * C[s, i, 2])
                for a in range(10):
                    f[at + 3 * a + i] += x * slope[s, a, 0] + y * slope[s, a, 1] + z * slope[s, a, 2]
    np.dot(f, elements.modes, g)
    for i in range(len(q)):
        along = 0.0
        for j in range(len(q)):
            along += elements.springs[i, j] * q[j]
        total += 0.5 * q[i] * along
        g[i] += along + 2.0 * pull * q[i]
    return total


@numba.njit(cache=True, error_model="numpy")
def tangent(elements, q, work, hessian):
    """d²W/dq² [J] (r,r) into `hessian`; whether no element is inverted."""
    u, F, C, J, P, A, K, T, V = work.u, work.F, work.C, work.J, work.P, work.A, work.K, work.T, work.V
    _, pull, curve = barrier(np.dot(q, q), elements.limit)
    if not pull < np.inf:
        return False
    for i in range(len(q)):
        for j in range(len(q)):
            hessian[i, j] = elements.springs[i, j] + 4.0 * curve * q[i] * q[j]
        hessian[i, i] += 2.0 * pull
    np.dot(elements.modes, q, u)
    for e in range(len(elements.kinds)):
        at = 30 * e
        slope, weight, mixed = elements.slopes[e], elements.weights[e], elements.mixed[e]
        mean = _deform(slope, weight, u[at : at + 30], F, C, J)
        if not mean > 0.0:
            return False
        K[:] = 0.0
        V[:] = 0.0
        volume = last = 0.0
        for s in range(4):
            A[0, 0] = 0.0
            w = weight[s]
            volume += w
            _, _, dU, ddU = _law(elements.kinds[e], F[s], mean if mixed else J[s], elements.constants[e], P, A)
            last = ddU
            _volume_part(A, F[s], C[s], dU, 0.0 if mixed else ddU)
            for a in range(10):
                for i in range(3):
                    row = 3 * a + i
                    for j in range(3):
                        V[row] += w * C[s, i, j] * slope[s, a, j]
                    for m in range(9):
                        x = 0.0
                        for j in range(3):
                            x += slope[s, a, j] * A[3 * i + j, m]
                        T[row, m] = w * x
            for row in range(30):
                for b in range(10):
                    for k in range(3):
                        x = 0.0
                        for j in range(3):
                            x += T[row, 3 * k + j] * slope[s, b, j]
                        K[row, 3 * b + k] += x
        if mixed:
            for i in range(30):
                for j in range(30):
                    K[i, j] += last / volume * V[i] * V[j]
        own = elements.modes[at : at + 30]
        np.dot(K, own, work.R)
        np.dot(own.T, work.R, work.Q)
        hessian += work.Q
    return True


@numba.njit(cache=True, error_model="numpy")
def _volume_part(A, F, C, dU, ddU):
    """Add the tangent of U(J): ddU C C' and dU times the second derivative of J, eps_ikm eps_jln F_mn."""
    for i in range(3):
        k, m = (i + 1) % 3, (i + 2) % 3
        for j in range(3):
            l, n = (j + 1) % 3, (j + 2) % 3
            A[3 * i + j, 3 * k + l] += dU * F[m, n]
            A[3 * k + l, 3 * i + j] += dU * F[m, n]
            A[3 * i + l, 3 * k + j] -= dU * F[m, n]
            A[3 * k + j, 3 * i + l] -= dU * F[m, n]
    if ddU == 0.0:
        return
    for i in range(3):
        for j in range(3):
            for k in range(3):
                for l in range(3):
                    A[3 * i + j, 3 * k + l] += ddU * C[i, j] * C[k, l]
