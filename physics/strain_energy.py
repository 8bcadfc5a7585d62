"""Strain energies of soft materials, each one compiled function: stress and, where it is wanted, tangent.

A law splits its energy into a part that sees shape and a part that sees volume,

    Psi(F) = W(F) + U(J),    W(a F) = W(F) for any number a,

so that the mixed element can take one mean volume ratio for a whole element. As a function it is

    law(F, J, p, P, A) -> (W, U, U', U'')

F  [1]  (3,3)  deformation gradient        P [Pa] (3,3)  gets dW/dF, first Piola-Kirchhoff
J  [1]  ()     volume ratio                A [Pa] (9,9)  gets d2W/dF2, row 3i + j for F[i, j]; NaN at A[0, 0] says
p       (n,)   the parameters of the material               that nobody wants it: it is memory to work in then

compiled with `numba.njit`; without tangent no law takes memory. `fe.materials` gives them their constants.
"""

from __future__ import annotations

import numba
import numpy as np


@numba.njit(cache=True)
def cofactor(F, G):
    """Write the cofactors of F (3,3) into G; returns det F."""
    for i in range(3):
        i1, i2 = (i + 1) % 3, (i + 2) % 3
        for j in range(3):
            j1, j2 = (j + 1) % 3, (j + 2) % 3
            G[i, j] = F[i1, j1] * F[i2, j2] - F[i1, j2] * F[i2, j1]
    return F[0, 0] * G[0, 0] + F[0, 1] * G[0, 1] + F[0, 2] * G[0, 2]


@numba.njit(cache=True)
def products(F, C, B):
    """Write F'F into C and FF' into B."""
    for i in range(3):
        for j in range(3):
            x = y = 0.0
            for k in range(3):
                x += F[k, i] * F[k, j]
                y += F[i, k] * F[j, k]
            C[i, j], B[i, j] = x, y


@numba.njit(cache=True)
def _squares(F):
    """Entries 00, 11, 22, 01, 02, 12 of F'F, and det F; no memory is taken."""
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


@numba.njit(cache=True)
def shape_invariants(F):
    """J and the isochoric invariants less 3: J, J^(-2/3) I1 - 3, J^(-4/3) I2 - 3."""
    c00, c11, c22, c01, c02, c12, J = _squares(F)
    i1 = c00 + c11 + c22
    i2 = c00 * c11 + c11 * c22 + c22 * c00 - c01 * c01 - c02 * c02 - c12 * c12
    a1 = 1.0 / np.cbrt(J * J)
    return J, a1 * i1 - 3.0, a1 * a1 * i2 - 3.0


@numba.njit(cache=True)
def _shape_stress_alone(F, w1, w2, P):
    """P of `shape_stress` without its tangent."""
    c00, c11, c22, c01, c02, c12, J = _squares(F)
    i1 = c00 + c11 + c22
    i2 = c00 * c11 + c11 * c22 + c22 * c00 - c01 * c01 - c02 * c02 - c12 * c12
    a1 = 1.0 / np.cbrt(J * J)
    a2 = a1 * a1
    along, over = 2.0 * (w1 * a1 + w2 * a2 * i1), -2.0 * w2 * a2
    across = -(2.0 * w1 * a1 * i1 + 4.0 * w2 * a2 * i2) / (3.0 * J)
    cofactor(F, P)
    for i in range(3):
        x, y, z = F[i, 0], F[i, 1], F[i, 2]
        P[i, 0] = along * x + across * P[i, 0] + over * (x * c00 + y * c01 + z * c02)
        P[i, 1] = along * y + across * P[i, 1] + over * (x * c01 + y * c11 + z * c12)
        P[i, 2] = along * z + across * P[i, 2] + over * (x * c02 + y * c12 + z * c22)


@numba.njit(inline="always")
def shape_stress(F, w1, w2, w11, w12, w22, P, A):
    """Stress and tangent of an energy W(I, II) in the isochoric invariants, from its first and second derivatives; no
    tangent where it is not wanted."""
    if np.isnan(A[0, 0]):
        _shape_stress_alone(F, w1, w2, P)
    else:
        _shape_stress_and_tangent(F, w1, w2, w11, w12, w22, P, A)


@numba.njit(cache=True)
def _shape_stress_and_tangent(F, w1, w2, w11, w12, w22, P, A):
    C, B, G, H = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    D1, D2 = np.empty((3, 3)), np.empty((3, 3))
    J = cofactor(F, G)
    products(F, C, B)
    i1 = C[0, 0] + C[1, 1] + C[2, 2]
    i2 = 0.0
    for i in range(3):
        for j in range(3):
            G[i, j] /= J
            i2 -= 0.5 * C[i, j] * C[i, j]
    i2 += 0.5 * i1 * i1
    a1 = J ** (-2.0 / 3.0)
    a2 = a1 * a1
    for i in range(3):
        for j in range(3):
            x = F[i, 0] * C[0, j] + F[i, 1] * C[1, j] + F[i, 2] * C[2, j]
            H[i, j] = 2.0 * (i1 * F[i, j] - x)
            D1[i, j] = a1 * (2.0 * F[i, j] - (2.0 / 3.0) * i1 * G[i, j])
            D2[i, j] = a2 * (H[i, j] - (4.0 / 3.0) * i2 * G[i, j])
            P[i, j] = w1 * D1[i, j] + w2 * D2[i, j]
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


@numba.njit(cache=True)
def neo_hooke(F, J, p, P, A):
    _, i1, _ = shape_invariants(F)
    shape_stress(F, 0.5 * p[0], 0.0, 0.0, 0.0, 0.0, P, A)
    return 0.5 * p[0] * i1, 0.5 * p[1] * (J - 1.0) ** 2, p[1] * (J - 1.0), p[1]


@numba.njit(cache=True)
def mooney_rivlin(F, J, p, P, A):
    c10, c01, c20, c11, c02, d1 = p[0], p[1], p[2], p[3], p[4], p[5]
    _, x, y = shape_invariants(F)
    shape_stress(
        F, c10 + 2.0 * c20 * x + c11 * y, c01 + c11 * x + 2.0 * c02 * y, 2.0 * c20, c11, 2.0 * c02, P, A
    )  # fmt: skip
    shape = c10 * x + c01 * y + c20 * x * x + c11 * x * y + c02 * y * y
    return shape, (J - 1.0) ** 2 / d1, 2.0 * (J - 1.0) / d1, 2.0 / d1


@numba.njit(cache=True)
def _principal(C, N):
    """Turn C (3,3) into its diagonal form, eigenvectors as the columns of N, by Jacobi's rotations."""
    for i in range(3):
        for j in range(3):
            N[i, j] = 1.0 if i == j else 0.0
    for _ in range(12):
        off = abs(C[0, 1]) + abs(C[0, 2]) + abs(C[1, 2])
        if not off > 1e-10 * (C[0, 0] + C[1, 1] + C[2, 2]):
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


@numba.njit(cache=True)
def log_stretch(F, C, N, E):
    """ln U of F = R U into E (3,3); C and N (3,3) are memory.

    ln U = atanh Z = Z (1 + Y/3 + Y²/5 + ...), Z = (C - 1)(C + 1)^-1, Y = Z², C = F'F: where strains are moderate,
    tr Y < 0.12 (stretches of 0.7 to 1.4), to 1e-13. The powers of Y are taken by its own characteristic equation, so
    that the series is one of three numbers. Beyond, by the eigenvectors of C.
    """
    c00, c11, c22, c01, c02, c12, _ = _squares(F)
    b00, b11, b22 = c00 + 1.0, c11 + 1.0, c22 + 1.0
    i00, i11, i22 = b11 * b22 - c12 * c12, b00 * b22 - c02 * c02, b00 * b11 - c01 * c01
    i01, i02, i12 = c02 * c12 - c01 * b22, c01 * c12 - c02 * b11, c01 * c02 - c12 * b00
    over = -2.0 / (b00 * i00 + c01 * i01 + c02 * i02)
    z00, z11, z22 = 1.0 + over * i00, 1.0 + over * i11, 1.0 + over * i22
    z01, z02, z12 = over * i01, over * i02, over * i12
    y00 = z00 * z00 + z01 * z01 + z02 * z02
    y11 = z01 * z01 + z11 * z11 + z12 * z12
    y22 = z02 * z02 + z12 * z12 + z22 * z22
    first = y00 + y11 + y22
    if first < 0.12:
        y01 = z00 * z01 + z01 * z11 + z02 * z12
        y02 = z00 * z02 + z01 * z12 + z02 * z22
        y12 = z01 * z02 + z11 * z12 + z12 * z22
        m00, m11, m22 = y11 * y22 - y12 * y12, y00 * y22 - y02 * y02, y00 * y11 - y01 * y01
        second = m00 + m11 + m22
        third = y00 * m00 + y01 * (y02 * y12 - y01 * y22) + y02 * (y01 * y12 - y02 * y11)
        a, b, c = 1.0 / 25.0, 0.0, 0.0
        for k in range(12):
            a, b, c = 1.0 / (23.0 - 2.0 * k) + c * third, a - c * second, b + c * first
        # p = a + b Y + c Y²
        p00 = a + b * y00 + c * (y00 * y00 + y01 * y01 + y02 * y02)
        p11 = a + b * y11 + c * (y01 * y01 + y11 * y11 + y12 * y12)
        p22 = a + b * y22 + c * (y02 * y02 + y12 * y12 + y22 * y22)
        p01 = b * y01 + c * (y00 * y01 + y01 * y11 + y02 * y12)
        p02 = b * y02 + c * (y00 * y02 + y01 * y12 + y02 * y22)
        p12 = b * y12 + c * (y01 * y02 + y11 * y12 + y12 * y22)
        E[0, 0] = z00 * p00 + z01 * p01 + z02 * p02
        E[1, 1] = z01 * p01 + z11 * p11 + z12 * p12
        E[2, 2] = z02 * p02 + z12 * p12 + z22 * p22
        E[0, 1] = E[1, 0] = z00 * p01 + z01 * p11 + z02 * p12
        E[0, 2] = E[2, 0] = z00 * p02 + z01 * p12 + z02 * p22
        E[1, 2] = E[2, 1] = z01 * p02 + z11 * p12 + z12 * p22
        return
    C[0, 0], C[1, 1], C[2, 2] = c00, c11, c22
    C[0, 1] = C[1, 0] = c01
    C[0, 2] = C[2, 0] = c02
    C[1, 2] = C[2, 1] = c12
    _principal(C, N)
    e0, e1, e2 = 0.5 * np.log(C[0, 0]), 0.5 * np.log(C[1, 1]), 0.5 * np.log(C[2, 2])
    for i in range(3):
        for j in range(3):
            E[i, j] = e0 * N[i, 0] * N[j, 0] + e1 * N[i, 1] * N[j, 1] + e2 * N[i, 2] * N[j, 2]


@numba.njit(cache=True)
def _hencky_alone(F, J, p, P, A):
    """`hencky` without its tangent: A lends the memory. As ln U commutes with C, P = F 2 mu dev(ln U) C^-1 is
    2 mu F^-T dev(ln U)."""
    shear, bulk = p[0], p[1]
    E = A[6:9, 0:3]
    log_stretch(F, A[0:3, 0:3], A[3:6, 0:3], E)
    mean = (E[0, 0] + E[1, 1] + E[2, 2]) / 3.0
    E[0, 0] -= mean
    E[1, 1] -= mean
    E[2, 2] -= mean
    factor, size = 2.0 * shear / cofactor(F, P), 0.0
    for i in range(3):
        x, y, z = factor * P[i, 0], factor * P[i, 1], factor * P[i, 2]
        for j in range(3):
            P[i, j] = x * E[0, j] + y * E[1, j] + z * E[2, j]
            size += E[i, j] * E[i, j]
    log = np.log(J)
    return shear * size, 0.5 * bulk * log * log, bulk * log / J, bulk * (1.0 - log) / (J * J)


@numba.njit(cache=True)
def hencky(F, J, p, P, A):
    if np.isnan(A[0, 0]):
        return _hencky_alone(F, J, p, P, A)
    return _hencky_and_tangent(F, J, p, P, A)


@numba.njit(cache=True)
def _hencky_and_tangent(F, J, p, P, A):
    shear, bulk = p[0], p[1]
    c, N = np.linalg.eigh(F.T @ F)
    e = 0.5 * np.log(c)
    e -= np.sum(e) / 3.0
    tau = 2.0 * shear * e
    S = tau / c
    M = F @ N  # rows i, columns in the principal frame
    spread = np.zeros((3, 3))
    for a in range(3):
        for b in range(3):
            if a != b:
                gap = c[b] - c[a]
                if abs(gap) > 1e-7 * (c[a] + c[b]):
                    spread[a, b] = (S[b] - S[a]) / gap
                else:
                    spread[a, b] = (shear - 0.5 * (tau[a] + tau[b])) / (c[a] * c[b])
    full = N @ np.diag(S) @ N.T
    P[:] = F @ full
    for i in range(3):
        for j in range(3):
            for k in range(3):
                for l in range(3):
                    total = full[j, l] if i == k else 0.0
                    for a in range(3):
                        for b in range(3):
                            curve = 2.0 * shear * ((1.0 if a == b else 0.0) - 1.0 / 3.0)
                            if a == b:
                                curve -= 2.0 * tau[a]
                            total += curve / (c[a] * c[b]) * M[i, a] * N[j, a] * M[k, b] * N[l, b]
                            if a != b:
                                total += spread[a, b] * M[i, a] * N[j, b] * (M[k, a] * N[l, b] + M[k, b] * N[l, a])
                    A[3 * i + j, 3 * k + l] = total
    log = np.log(J)
    return shear * np.sum(e * e), 0.5 * bulk * log * log, bulk * log / J, bulk * (1.0 - log) / (J * J)


@numba.njit(cache=True)
def linear(F, J, p, P, A):
    shear, bulk = p[0], p[1]
    third = (F[0, 0] + F[1, 1] + F[2, 2] - 3.0) / 3.0
    A[:] = 0.0
    total = 0.0
    for i in range(3):
        for j in range(3):
            e = 0.5 * (F[i, j] + F[j, i])
            if i == j:
                e -= 1.0 + third
                for k in range(3):
                    A[4 * i, 4 * k] -= 2.0 * shear / 3.0
            P[i, j] = 2.0 * shear * e
            total += shear * e * e
            A[3 * i + j, 3 * i + j] += shear
            A[3 * i + j, 3 * j + i] += shear
    return total, 0.5 * bulk * (J - 1.0) ** 2, bulk * (J - 1.0), bulk
