"""Demiray's exponential law, the isotropic form of Fung's: soft tissue that stiffens steeply.

    W = (mu/(2 b)) (exp(b I) - 1),    U = (kappa/2) (J - 1)²,    I = J^(-2/3) I1 - 3

mu is the shear modulus at rest; b -> 0 is the neo-Hooke law.

H. Demiray, J. Biomech. 5 (1972) 309-311; Y. C. Fung, Am. J. Physiol. 213 (1967) 1532-1544.
"""

import math

import numpy as np

from palpate.compiler.kernel import kernel
from palpate.physics.materials.hyperelastic import Material, MaterialError, moduli, rubberlike, wants_mixed
from palpate.physics.materials.invariants import shape_invariants, shape_stress

EXAMPLE = (1e4, 0.4, 2.0)


@kernel(pointer=True)
def strain_energy(F, J, p, P, A):
    mu, kappa, b = p[0], p[1], p[2]
    _, i1, _ = shape_invariants(F)
    w1 = 0.5 * mu * math.exp(min(b * i1, 600.0))  # bounds a trial step of a solver, which then rejects it
    shape_stress(F, w1, 0.0, b * w1, 0.0, 0.0, P, A)
    return (w1 - 0.5 * mu) / b, 0.5 * kappa * (J - 1.0) ** 2, kappa * (J - 1.0), kappa


def demiray(young: float, poisson: float, b: float) -> Material:
    """mu and kappa from Young's modulus [Pa] > 0 and Poisson's ratio [1] in (-1, 0.5) at small strain; b [1] > 0.
    MaterialError: see `moduli`; a modulus above that of any rubber; b not positive."""
    if not (np.isfinite(b) and b > 0):
        raise MaterialError(f"Demiray, b {b}: expected a positive number; 0 is `neo_hooke`")
    constants = moduli(young, poisson)
    rubberlike("Demiray", young)
    return Material(strain_energy, (*constants, float(b)), mixed=wants_mixed(*constants))
