"""Ogden with any number of terms: rubber and soft tissue in the principal stretches.

    W = sum_k (2 mu_k/alpha_k²) (l1^alpha_k + l2^alpha_k + l3^alpha_k - 3),    U = (kappa/2) (J - 1)²

with l = J^(-1/3) times a principal stretch. The shear modulus at rest is sum_k mu_k, for any exponents. To convert from
other conventions with the same alpha: for (mu/alpha) sum (l^alpha - 1) use mu alpha/2, for (c/alpha²) sum (l^alpha - 1)
use c/2.

R. W. Ogden, Proc. R. Soc. Lond. A 326 (1972) 565-584; S. Budday et al., Acta Biomater. 48 (2017) 319-340 for the form.
"""

import numpy as np

from palpate.compiler.kernel import kernel
from palpate.physics.materials.hyperelastic import Material, MaterialError, of_rest, wants_mixed
from palpate.physics.materials.principal import principal_squares, principal_stress

EXAMPLE = (0.4, 8e3, 4.7, 2e3, -3.0)


@kernel(pointer=True)
def strain_energy(F, J, p, P, A):
    c, N = principal_squares(F)
    e = 0.5 * np.log(c)
    e -= np.sum(e) / 3.0
    W, tau, curve = 0.0, np.zeros(3), np.zeros((3, 3))
    for k in range(1, len(p), 2):
        mu, alpha = p[k], p[k + 1]
        x = np.exp(alpha * e)
        mean = np.sum(x) / 3.0
        W += 6.0 * mu / (alpha * alpha) * (mean - 1.0)
        for a in range(3):
            tau[a] += 2.0 * mu / alpha * (x[a] - mean)
            curve[a, a] += 2.0 * mu * x[a]
            for b in range(3):
                curve[a, b] += 2.0 * mu / 3.0 * (mean - x[a] - x[b])
    principal_stress(F, c, N, tau, curve, P, A)
    return W, 0.5 * p[0] * (J - 1.0) ** 2, p[0] * (J - 1.0), p[0]


def ogden(poisson: float, *terms: float) -> Material:
    """Poisson's ratio at small strain, then mu [Pa] and alpha [1] of each term; kappa from sum mu and the ratio.
    MaterialError: no pairs, an alpha of 0, sum mu not positive, a ratio outside (-1, 0.5)."""
    mu, alpha = np.array(terms[::2], float), np.array(terms[1::2], float)
    if not len(terms) or len(terms) % 2 or not np.isfinite(terms).all() or (alpha == 0.0).any():
        raise MaterialError(f"Ogden terms {terms}: expected pairs of mu [Pa] and alpha, alpha not 0")
    shear, bulk = of_rest("Ogden", float(mu.sum()), poisson)
    return Material(strain_energy, (bulk, *map(float, terms)), mixed=wants_mixed(shear, bulk))
