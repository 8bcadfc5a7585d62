"""Mooney-Rivlin with five terms: rubber and skin that stiffen with strain.

    W = c10 I + c01 II + c20 I² + c11 I II + c02 II²,    U = (J - 1)²/d1

with I = J^(-2/3) I1 - 3 and II = J^(-4/3) I2 - 3.
"""

import numpy as np

from palpate.compiler.kernel import kernel
from palpate.physics.materials.hyperelastic import Material, MaterialError, rubberlike, wants_mixed
from palpate.physics.materials.invariants import shape_invariants, shape_stress

EXAMPLE = (2430.0, 5420.0, 239000.0, 262000.0, 74700.0, 13.3e-6)


@kernel(pointer=True)
def strain_energy(F, J, p, P, A):
    c10, c01, c20, c11, c02, d1 = p[0], p[1], p[2], p[3], p[4], p[5]
    _, x, y = shape_invariants(F)
    shape_stress(
        F, c10 + 2.0 * c20 * x + c11 * y, c01 + c11 * x + 2.0 * c02 * y, 2.0 * c20, c11, 2.0 * c02, P, A
    )  # fmt: skip
    shape = c10 * x + c01 * y + c20 * x * x + c11 * x * y + c02 * y * y
    return shape, (J - 1.0) ** 2 / d1, 2.0 * (J - 1.0) / d1, 2.0 / d1


def mooney_rivlin(c10: float, c01: float, c20: float, c11: float, c02: float, d1: float) -> Material:
    """c.. [Pa], d1 [1/Pa] > 0. Moduli at small strain: shear 2 (c10 + c01), bulk 2/d1. MaterialError: a shear or bulk
    modulus that is not positive; Young's modulus above that of any rubber."""
    constants = tuple(map(float, (c10, c01, c20, c11, c02, d1)))
    shear = 2.0 * (constants[0] + constants[1])
    if not all(np.isfinite(constants)) or shear <= 0 or d1 <= 0:
        raise MaterialError(f"Mooney-Rivlin constants {constants}: expected c10 + c01 > 0 [Pa] and d1 > 0 [1/Pa]")
    rubberlike("Mooney-Rivlin", 9.0 * shear / (3.0 + 0.5 * shear * d1))
    return Material(strain_energy, constants, mixed=wants_mixed(shear, 2.0 / constants[5]))
