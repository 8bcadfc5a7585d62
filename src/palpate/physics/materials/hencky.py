"""Hencky: linear elasticity in the logarithmic strain, ln U of F = R U.

    W = mu |dev ln U|²,    U = (kappa/2) (ln J)²

Unlike the St. Venant-Kirchhoff law it does not soften in compression. H. Hencky, Z. Tech. Phys. 9 (1928) 215-220.
"""

import numpy as np

from palpate.compiler.kernel import kernel
from palpate.physics.materials.hyperelastic import Material, moduli, wants_mixed
from palpate.physics.materials.invariants import cofactor, strain_squares
from palpate.physics.materials.principal import principal_axes, principal_squares, principal_stress

EXAMPLE = (1e4, 0.3)


@kernel
def log_stretch(F, C, N, E):
    """The logarithmic strain ln U of F = R U [1] (3,3), into E (3,3); C and N (3,3) are scratch.

    For moderate strain, tr Y < 0.12 (stretches of 0.7 to 1.4), by a series, exact to 1e-13:

        ln U = atanh Z = Z (1 + Y/3 + Y²/5 + ...),    Z = (C - 1)(C + 1)^-1,    Y = Z²,    C = F'F

    The Cayley-Hamilton theorem reduces the powers of Y to 1, Y and Y². For larger strain by the eigenvectors of C.
    """
    c00, c11, c22, c01, c02, c12, _ = strain_squares(F)
    b00, b11, b22 = c00 + 1.0, c11 + 1.0, c22 + 1.0
    # Z = (C - 1)(C + 1)^-1 = 1 - 2 (C + 1)^-1, by the cofactors of C + 1; then Y = Z²
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
        # the invariants of Y: trace, sum of the principal minors, determinant
        m00, m11, m22 = y11 * y22 - y12 * y12, y00 * y22 - y02 * y02, y00 * y11 - y01 * y01
        second = m00 + m11 + m22
        third = y00 * m00 + y01 * (y02 * y12 - y01 * y22) + y02 * (y01 * y12 - y02 * y11)
        a, b, c = 1.0 / 25.0, 0.0, 0.0
        # Horner's scheme on the series: p <- 1/(2k + 1) + Y p, with Y³ = first Y² - second Y + third
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
    principal_axes(C, N)
    e0, e1, e2 = 0.5 * np.log(C[0, 0]), 0.5 * np.log(C[1, 1]), 0.5 * np.log(C[2, 2])
    for i in range(3):
        for j in range(3):
            E[i, j] = e0 * N[i, 0] * N[j, 0] + e1 * N[i, 1] * N[j, 1] + e2 * N[i, 2] * N[j, 2]


@kernel
def _stress_alone(F, J, p, P, A):
    """`strain_energy` without the tangent; A is scratch. As ln U commutes with C, P = F 2 mu dev(ln U) C^-1 equals
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


@kernel(pointer=True)
def strain_energy(F, J, p, P, A):
    if np.isnan(A[0, 0]):
        return _stress_alone(F, J, p, P, A)
    shear, bulk = p[0], p[1]
    c, N = principal_squares(F)
    e = 0.5 * np.log(c)
    e -= np.sum(e) / 3.0
    principal_stress(F, c, N, 2.0 * shear * e, 2.0 * shear * (np.eye(3) - 1.0 / 3.0), P, A)
    log = np.log(J)
    return shear * np.sum(e * e), 0.5 * bulk * log * log, bulk * log / J, bulk * (1.0 - log) / (J * J)


def hencky(young: float, poisson: float) -> Material:
    """mu and kappa from Young's modulus [Pa] > 0 and Poisson's ratio [1] in (-1, 0.5) at small strain. MaterialError:
    see `moduli`."""
    constants = moduli(young, poisson)
    return Material(strain_energy, constants, mixed=wants_mixed(*constants))
