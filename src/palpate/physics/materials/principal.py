"""Stress and tangent of laws in the principal stretches, from the Kirchhoff stresses and their derivatives."""

import numpy as np

from palpate.compiler.kernel import kernel
from palpate.physics.arrays import Array, Matrix


@kernel
def principal_axes(C: Matrix, N: Matrix):
    """Diagonalise the symmetric C (3,3) in place by Jacobi rotations; its eigenvectors are the columns of N (3,3)."""
    for i in range(3):
        for j in range(3):
            N[i, j] = 1.0 if i == j else 0.0
    for _ in range(12):
        off = abs(C[0, 1]) + abs(C[0, 2]) + abs(C[1, 2])
        if not off > 1e-17 * (C[0, 0] + C[1, 1] + C[2, 2]):  # tight, because bone is stiff
            return
        for p in range(2):
            for q in range(p + 1, 3):
                if C[p, q] == 0.0:
                    continue
                ratio = (C[q, q] - C[p, p]) / (2.0 * C[p, q])
                t = np.copysign(1.0, ratio) / (abs(ratio) + np.sqrt(ratio * ratio + 1.0))
                c = 1.0 / np.sqrt(t * t + 1.0)
                s = t * c
                for k in range(3):
                    x, y = C[k, p], C[k, q]
                    C[k, p], C[k, q] = c * x - s * y, s * x + c * y
                for k in range(3):
                    x, y = C[p, k], C[q, k]
                    C[p, k], C[q, k] = c * x - s * y, s * x + c * y
                    x, y = N[k, p], N[k, q]
                    N[k, p], N[k, q] = c * x - s * y, s * x + c * y
                C[p, q] = C[q, p] = 0.0


@kernel
def principal_squares(F: Matrix):
    """Squares of the principal stretches of F (3,3), and the principal directions as columns (3,3)."""
    C, N, c = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(3)
    for i in range(3):
        for j in range(3):
            C[i, j] = F[0, i] * F[0, j] + F[1, i] * F[1, j] + F[2, i] * F[2, j]
    principal_axes(C, N)
    for i in range(3):
        c[i] = C[i, i]
    return c, N


@kernel
def principal_stress(F: Matrix, c: Array, N: Matrix, tau: Array, curve: Matrix, P: Matrix, A: Matrix):
    """P = dW/dF and A = d2W/dF2 of an energy in the logarithms of the principal stretches.

    c      [1]  (3,)   eigenvalues of F'F, squares of the stretches; N (3,3) its eigenvectors, in columns
    tau    [Pa] (3,)   principal Kirchhoff stresses dW/d(ln stretch)
    curve  [Pa] (3,3)  their derivatives by the three logarithms
    P, A               as in `hyperelastic`; NaN at A[0, 0]: no tangent

    R. W. Ogden, Non-Linear Elastic Deformations (1984), 6.1.4.
    """
    S = tau / c  # second Piola-Kirchhoff, in the principal frame
    M, full = np.zeros((3, 3)), np.zeros((3, 3))  # F N, rows i, columns in the principal frame; N S N'
    for i in range(3):
        for j in range(3):
            for k in range(3):
                M[i, j] += F[i, k] * N[k, j]
                full[i, j] += N[i, k] * S[k] * N[j, k]
    for i in range(3):
        for j in range(3):
            P[i, j] = F[i, 0] * full[0, j] + F[i, 1] * full[1, j] + F[i, 2] * full[2, j]
    if np.isnan(A[0, 0]):
        return
    spread = np.zeros((3, 3))  # (S_b - S_a)/(c_b - c_a), its limit where two stretches are equal
    for a in range(3):
        for b in range(3):
            if a != b:
                gap = c[b] - c[a]
                if abs(gap) > 1e-7 * (c[a] + c[b]):
                    spread[a, b] = (S[b] - S[a]) / gap
                else:
                    spread[a, b] = 0.5 * (curve[b, b] - curve[a, b] - tau[a] - tau[b]) / (c[a] * c[b])
    for i in range(3):
        for j in range(3):
            for k in range(3):
                for l in range(3):
                    total = full[j, l] if i == k else 0.0
                    for a in range(3):
                        for b in range(3):
                            slope = curve[a, b] - (2.0 * tau[a] if a == b else 0.0)
                            total += slope / (c[a] * c[b]) * M[i, a] * N[j, a] * M[k, b] * N[l, b]
                            if a != b:
                                total += spread[a, b] * M[i, a] * N[j, b] * (M[k, a] * N[l, b] + M[k, b] * N[l, a])
                    A[3 * i + j, 3 * k + l] = total
