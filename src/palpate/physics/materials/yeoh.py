"""Yeoh: rubber and soft tissue, a polynomial in the first invariant.

    W = c1 I + c2 I² + c3 I³,    U = (kappa/2) (J - 1)²,    I = J^(-2/3) I1 - 3

The shear modulus at rest is 2 c1.

O. H. Yeoh, Rubber Chem. Technol. 66 (1993) 754-771.
"""

import numpy as np

from palpate.compiler.kernel import kernel
from palpate.physics.materials.hyperelastic import Material, MaterialError, of_rest, wants_mixed
from palpate.physics.materials.invariants import shape_invariants, shape_stress

EXAMPLE = (0.4, 5e3, 1.2e3, 150.0)


@kernel(pointer=True)
def strain_energy(F, J, p, P, A):
    kappa, c1, c2, c3 = p[0], p[1], p[2], p[3]
    _, x, _ = shape_invariants(F)
    shape_stress(F, c1 + x * (2.0 * c2 + 3.0 * c3 * x), 0.0, 2.0 * c2 + 6.0 * c3 * x, 0.0, 0.0, P, A)
    return x * (c1 + x * (c2 + c3 * x)), 0.5 * kappa * (J - 1.0) ** 2, kappa * (J - 1.0), kappa


def yeoh(poisson: float, c1: float, c2: float = 0.0, c3: float = 0.0) -> Material:
    """Poisson's ratio at small strain, c1 > 0, c2, c3 [Pa]; kappa from 2 c1 and the ratio. MaterialError: c1 that is
    not positive, a ratio outside (-1, 0.5), a modulus above that of any rubber."""
    if not np.isfinite([c1, c2, c3]).all():
        raise MaterialError(f"Yeoh constants {(c1, c2, c3)}: expected finite numbers [Pa]")
    shear, bulk = of_rest("Yeoh", 2.0 * c1, poisson)
    return Material(strain_energy, (bulk, float(c1), float(c2), float(c3)), mixed=wants_mixed(shear, bulk))
