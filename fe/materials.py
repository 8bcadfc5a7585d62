"""Material laws of soft layers: strain energy, stress and tangent, each law one compiled function.

A law splits its energy into a part that sees shape and a part that sees volume,

    Psi(F) = W(F) + U(J),    W(a F) = W(F) for any number a,

so that the mixed element can take one mean volume ratio for a whole element. As a function it is

    law(F, J, p, P, A) -> (W, U, U', U'')

F  [1]  (3,3)  deformation gradient        P [Pa] (3,3)  gets dW/dF, first Piola-Kirchhoff
J  [1]  ()     volume ratio                A [Pa] (9,9)  gets d2W/dF2, row 3i + j for F[i, j]; NaN at
                                               A[0, 0] says that nobody wants it
p       (n,)   the parameters of the material

compiled with `numba.njit`. A law in the invariants of the isochoric strain needs its derivatives only: see
`mooney_rivlin`, which calls `shape_invariants` and `shape_stress`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numba
import numpy as np

Law = Callable[..., tuple[float, float, float, float]]


RUBBER = 1e9
"""[Pa] Young's modulus above which no solid is rubber-like: ten times that of the hardest rubber."""


class MaterialError(ValueError):
    """Constants that no stable material has; says which, what was found and what is expected."""


@dataclass(frozen=True)
class Material:
    """A law with its constants.

    law         compiled function, see the head of this file
    parameters  its constants
    mixed       one mean volume ratio for each element (no locking near incompressibility)
    small       small strain: J = 1 + div u, for laws that are linear in the displacement
    """

    law: Law
    parameters: tuple[float, ...]
    mixed: bool = False
    small: bool = False


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
def shape_invariants(F):
    """J and the isochoric invariants less 3: J, J^(-2/3) I1 - 3, J^(-4/3) I2 - 3."""
    C, B = np.empty((3, 3)), np.empty((3, 3))
    J = cofactor(F, C)
    products(F, C, B)
    i1 = C[0, 0] + C[1, 1] + C[2, 2]
    i2 = 0.5 * (i1 * i1 - np.sum(C * C))
    return J, J ** (-2.0 / 3.0) * i1 - 3.0, J ** (-4.0 / 3.0) * i2 - 3.0


@numba.njit(cache=True)
def shape_stress(F, w1, w2, w11, w12, w22, P, A):
    """Stress and tangent of an energy W(I, II) in the isochoric invariants, from its first and second derivatives; no
    tangent where it is not wanted."""
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
    if np.isnan(A[0, 0]):
        return
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
def _neo_hooke(F, J, p, P, A):
    _, i1, _ = shape_invariants(F)
    shape_stress(F, 0.5 * p[0], 0.0, 0.0, 0.0, 0.0, P, A)
    return 0.5 * p[0] * i1, 0.5 * p[1] * (J - 1.0) ** 2, p[1] * (J - 1.0), p[1]


@numba.njit(cache=True)
def _mooney_rivlin(F, J, p, P, A):
    c10, c01, c20, c11, c02, d1 = p[0], p[1], p[2], p[3], p[4], p[5]
    _, x, y = shape_invariants(F)
    shape_stress(
        F, c10 + 2.0 * c20 * x + c11 * y, c01 + c11 * x + 2.0 * c02 * y, 2.0 * c20, c11, 2.0 * c02, P, A
    )  # fmt: skip
    shape = c10 * x + c01 * y + c20 * x * x + c11 * x * y + c02 * y * y
    return shape, (J - 1.0) ** 2 / d1, 2.0 * (J - 1.0) / d1, 2.0 / d1


@numba.njit(cache=True)
def _hencky(F, J, p, P, A):
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
def _linear(F, J, p, P, A):
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


def neo_hooke(young: float, poisson: float) -> Material:
    """W = (mu/2) (J^(-2/3) I1 - 3), U = (kappa/2) (J - 1)².

    young [Pa] > 0, poisson [1] in (-1, 0.5): of the small-strain limit. The mixed element is used from 0.45 on.

    MaterialError: see `moduli`; a modulus above `RUBBER`.
    """
    found = moduli(young, poisson)
    _rubberlike("neo-Hooke", young)
    return Material(_neo_hooke, found, mixed=poisson >= 0.45)


def hencky(young: float, poisson: float) -> Material:
    """W = mu |dev ln U|², U = (kappa/2) (ln J)²: linear elasticity in the logarithmic strain, which stays stiff in
    compression, where the St. Venant-Kirchhoff law softens.

    young [Pa] > 0, poisson [1] in (-1, 0.5). H. Hencky, Z. Tech. Phys. 9 (1928) 215-220.
    """
    return Material(_hencky, moduli(young, poisson), mixed=poisson >= 0.45)


def linear(young: float, poisson: float) -> Material:
    """Small-strain linear elasticity; for small displacements only (a rotation strains it).

    young [Pa] > 0, poisson [1] in (-1, 0.5).
    """
    return Material(_linear, moduli(young, poisson), mixed=poisson >= 0.45, small=True)


def mooney_rivlin(c10: float, c01: float, c20: float, c11: float, c02: float, d1: float) -> Material:
    """W = c10 I + c01 II + c20 I² + c11 I II + c02 II², U = (J - 1)²/d1, with I = J^(-2/3) I1 - 3,
    II = J^(-4/3) I2 - 3.

    c.. [Pa], d1 [1/Pa] > 0. Small-strain moduli: shear 2 (c10 + c01), bulk 2/d1.

    MaterialError: a shear or bulk modulus that is not positive; Young's modulus above `RUBBER`.
    """
    found = tuple(map(float, (c10, c01, c20, c11, c02, d1)))
    shear = 2.0 * (found[0] + found[1])
    if not all(np.isfinite(found)) or shear <= 0 or d1 <= 0:
        raise MaterialError(f"Mooney-Rivlin constants {found}: expected c10 + c01 > 0 [Pa] and d1 > 0 [1/Pa]")
    _rubberlike("Mooney-Rivlin", 9.0 * shear / (3.0 + 0.5 * shear * d1))
    return Material(_mooney_rivlin, found, mixed=2.0 / d1 > 9.0 * shear)


def _rubberlike(law: str, young: float) -> None:
    if young > RUBBER:
        raise MaterialError(
            f"{law}, Young's modulus {young:.4g} Pa: no rubber-like solid has more than {RUBBER:g} Pa. Moduli are in "
            f"pascals ({young:.4g} Pa is {1e-3 * young:.4g} kPa); for bone, metal or glass take `hencky`"
        )


def moduli(young: float, poisson: float) -> tuple[float, float]:
    """Shear and bulk modulus [Pa] of Young's modulus [Pa] and Poisson's ratio.

    MaterialError: a modulus that is not positive, or a ratio outside (-1, 0.5).
    """
    if not (np.isfinite(young) and young > 0):
        raise MaterialError(f"Young's modulus {young} Pa: expected a positive number")
    if not -1.0 < poisson < 0.5:
        raise MaterialError(
            f"Poisson's ratio {poisson}: expected a number above -1 and below 0.5; for an incompressible "
            "material take 0.499 with the mixed element"
        )
    return young / (2.0 * (1.0 + poisson)), young / (3.0 * (1.0 - 2.0 * poisson))
