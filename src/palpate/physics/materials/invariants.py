"""Stress and tangent of laws in the isochoric invariants, from their derivatives by these.

I = J^(-2/3) I1 - 3,    II = J^(-4/3) I2 - 3,    I1 = tr C,    I2 = ((tr C)² - tr C²)/2,    C = F'F

Most functions are inlined into the law, so that the strain and J^(-2/3) are computed once.
"""

import math

import numpy as np

from palpate.compiler.kernel import inlined, kernel
from palpate.physics.arrays import Matrix


@inlined
def cofactor(F: Matrix, G: Matrix):
    """G = det(F) F^-T, the cofactors of F (3,3); returns det F."""
    a, b, c = F[0, 0], F[0, 1], F[0, 2]
    d, e, f = F[1, 0], F[1, 1], F[1, 2]
    g, h, i = F[2, 0], F[2, 1], F[2, 2]
    G[0, 0], G[0, 1], G[0, 2] = e * i - f * h, f * g - d * i, d * h - e * g
    G[1, 0], G[1, 1], G[1, 2] = h * c - i * b, i * a - g * c, g * b - h * a
    G[2, 0], G[2, 1], G[2, 2] = b * f - c * e, c * d - a * f, a * e - b * d
    return a * G[0, 0] + b * G[0, 1] + c * G[0, 2]


@kernel
def volume_tangent(F: Matrix, C: Matrix, dU: float, ddU: float, A: Matrix):
    """Add the tangent of U(J) to A (9,9): U'' C_ij C_kl + U' d2J/dF_ij dF_kl, with the cofactors C of F and
    d2J/dF_ij dF_kl = eps_ikm eps_jln F_mn."""
    for i in range(3):
        k, m = (i + 1) % 3, (i + 2) % 3
        for j in range(3):
            l, n = (j + 1) % 3, (j + 2) % 3
            A[3 * i + j, 3 * k + l] += dU * F[m, n]
            A[3 * k + l, 3 * i + j] += dU * F[m, n]
            A[3 * i + l, 3 * k + j] -= dU * F[m, n]
            A[3 * k + j, 3 * i + l] -= dU * F[m, n]
    for i in range(3):
        for j in range(3):
            for k in range(3):
                for l in range(3):
                    A[3 * i + j, 3 * k + l] += ddU * C[i, j] * C[k, l]


@kernel
def products(F: Matrix, C: Matrix, B: Matrix):
    """Write F'F into C and FF' into B."""
    for i in range(3):
        for j in range(3):
            x = y = 0.0
            for k in range(3):
                x += F[k, i] * F[k, j]
                y += F[i, k] * F[j, k]
            C[i, j], B[i, j] = x, y


@inlined
def strain_squares(F: Matrix):
    """Entries 00, 11, 22, 01, 02, 12 of F'F, and det F, without allocation."""
    c00 = F[0, 0] * F[0, 0] + F[1, 0] * F[1, 0] + F[2, 0] * F[2, 0]
    c11 = F[0, 1] * F[0, 1] + F[1, 1] * F[1, 1] + F[2, 1] * F[2, 1]
    c22 = F[0, 2] * F[0, 2] + F[1, 2] * F[1, 2] + F[2, 2] * F[2, 2]
    c01 = F[0, 0] * F[0, 1] + F[1, 0] * F[1, 1] + F[2, 0] * F[2, 1]
    c02 = F[0, 0] * F[0, 2] + F[1, 0] * F[1, 2] + F[2, 0] * F[2, 2]
    c12 = F[0, 1] * F[0, 2] + F[1, 1] * F[1, 2] + F[2, 1] * F[2, 2]
    J = (
        F[0, 0] * (F[1, 1] * F[2, 2] - F[1, 2] * F[2, 1])
        + F[0, 1] * (F[1, 2] * F[2, 0] - F[1, 0] * F[2, 2])
        + F[0, 2] * (F[1, 0] * F[2, 1] - F[1, 1] * F[2, 0])
    )
    return c00, c11, c22, c01, c02, c12, J


@inlined
def shape_invariants(F: Matrix):
    """J, I = J^(-2/3) I1 - 3 and II = J^(-4/3) I2 - 3 of F (3,3)."""
    c00, c11, c22, c01, c02, c12, J = strain_squares(F)
    i1 = c00 + c11 + c22
    i2 = c00 * c11 + c11 * c22 + c22 * c00 - c01 * c01 - c02 * c02 - c12 * c12
    a1 = math.exp(-math.log(J * J) / 3.0)
    return J, a1 * i1 - 3.0, a1 * a1 * i2 - 3.0


@inlined
def _shape_stress_alone(F: Matrix, w1: float, w2: float, P: Matrix):
    """P of `shape_stress` without its tangent."""
    c00, c11, c22, c01, c02, c12, J = strain_squares(F)
    i1 = c00 + c11 + c22
    i2 = c00 * c11 + c11 * c22 + c22 * c00 - c01 * c01 - c02 * c02 - c12 * c12
    a1 = math.exp(-math.log(J * J) / 3.0)
    a2 = a1 * a1
    along, over = 2.0 * (w1 * a1 + w2 * a2 * i1), -2.0 * w2 * a2
    across = -(2.0 * w1 * a1 * i1 + 4.0 * w2 * a2 * i2) / (3.0 * J)
    cofactor(F, P)
    for i in range(3):
        x, y, z = F[i, 0], F[i, 1], F[i, 2]
        P[i, 0] = along * x + across * P[i, 0] + over * (x * c00 + y * c01 + z * c02)
        P[i, 1] = along * y + across * P[i, 1] + over * (x * c01 + y * c11 + z * c12)
        P[i, 2] = along * z + across * P[i, 2] + over * (x * c02 + y * c12 + z * c22)


@inlined
def shape_stress(F: Matrix, w1: float, w2: float, w11: float, w12: float, w22: float, P: Matrix, A: Matrix):
    """P = dW/dF and A = d2W/dF2 of W(I, II) from its derivatives w1, w2, w11, w12, w22 [Pa] by I and II; no tangent if
    A[0, 0] is NaN."""
    if np.isnan(A[0, 0]):
        _shape_stress_alone(F, w1, w2, P)
    else:
        _shape_stress_and_tangent(F, w1, w2, w11, w12, w22, P, A)


@kernel
def _shape_stress_and_tangent(
    F: Matrix, w1: float, w2: float, w11: float, w12: float, w22: float, P: Matrix, A: Matrix
):
    C, B, G, H = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    D1, D2 = np.empty((3, 3)), np.empty((3, 3))
    J = cofactor(F, G)
    products(F, C, B)
    # C = F'F, B = FF', G = F^-T; i1, i2 invariants of C, isochoric after multiplication with a1, a2
    i1 = C[0, 0] + C[1, 1] + C[2, 2]
    i2 = 0.0
    for i in range(3):
        for j in range(3):
            G[i, j] /= J
            i2 -= 0.5 * C[i, j] * C[i, j]
    i2 += 0.5 * i1 * i1
    a1 = J ** (-2.0 / 3.0)
    a2 = a1 * a1
    # D1, D2: derivatives of the isochoric invariants by F
    for i in range(3):
        for j in range(3):
            x = F[i, 0] * C[0, j] + F[i, 1] * C[1, j] + F[i, 2] * C[2, j]
            H[i, j] = 2.0 * (i1 * F[i, j] - x)
            D1[i, j] = a1 * (2.0 * F[i, j] - (2.0 / 3.0) * i1 * G[i, j])
            D2[i, j] = a2 * (H[i, j] - (4.0 / 3.0) * i2 * G[i, j])
            P[i, j] = w1 * D1[i, j] + w2 * D2[i, j]
    # d1, d2: their second derivatives; A by the chain rule through W(I1, I2)
    for i in range(3):
        for j in range(3):
            for k in range(3):
                for l in range(3):
                    turned = G[i, l] * G[k, j]
                    d1 = -(2.0 / 3.0) * (G[k, l] * D1[i, j] + a1 * (2.0 * F[k, l] * G[i, j] - i1 * turned))
                    d2 = 2.0 * (2.0 * F[k, l] * F[i, j] - F[i, l] * F[k, j])
                    if i == k:
                        d2 -= 2.0 * C[l, j]
                    if j == l:
                        d2 -= 2.0 * B[i, k]
                        if i == k:
                            d1 += 2.0 * a1
                            d2 += 2.0 * i1
                    d2 = a2 * (d2 - (4.0 / 3.0) * (H[k, l] * G[i, j] - i2 * turned)) - (4.0 / 3.0) * G[k, l] * D2[i, j]
                    A[3 * i + j, 3 * k + l] = (
                        w1 * d1
                        + w2 * d2
                        + w11 * D1[i, j] * D1[k, l]
                        + w12 * (D1[i, j] * D2[k, l] + D2[i, j] * D1[k, l])
                        + w22 * D2[i, j] * D2[k, l]
                    )
