"""Material laws of soft layers: strain energy, stress and tangent, each law one compiled function.

A law is a function of the form that `physics.strain_energy` describes, `law(F, J, p, P, A) -> (W, U, U', U'')`,
compiled with `numba.njit`. A law in the invariants of the isochoric strain needs its derivatives only: see
`mooney_rivlin`, which calls `shape_invariants` and `shape_stress`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from palpate.physics import strain_energy

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


def neo_hooke(young: float, poisson: float) -> Material:
    """W = (mu/2) (J^(-2/3) I1 - 3), U = (kappa/2) (J - 1)².

    young [Pa] > 0, poisson [1] in (-1, 0.5): of the small-strain limit. The mixed element is used from 0.45 on.

    MaterialError: see `moduli`; a modulus above `RUBBER`.
    """
    found = moduli(young, poisson)
    _rubberlike("neo-Hooke", young)
    return Material(strain_energy.neo_hooke, found, mixed=poisson >= 0.45)


def hencky(young: float, poisson: float) -> Material:
    """W = mu |dev ln U|², U = (kappa/2) (ln J)²: linear elasticity in the logarithmic strain, which stays stiff in
    compression, where the St. Venant-Kirchhoff law softens.

    young [Pa] > 0, poisson [1] in (-1, 0.5). H. Hencky, Z. Tech. Phys. 9 (1928) 215-220.
    """
    return Material(strain_energy.hencky, moduli(young, poisson), mixed=poisson >= 0.45)


def linear(young: float, poisson: float) -> Material:
    """Small-strain linear elasticity; for small displacements only (a rotation strains it).

    young [Pa] > 0, poisson [1] in (-1, 0.5).
    """
    return Material(strain_energy.linear, moduli(young, poisson), mixed=poisson >= 0.45, small=True)


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
    return Material(strain_energy.mooney_rivlin, found, mixed=2.0 / d1 > 9.0 * shear)


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
