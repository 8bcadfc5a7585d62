"""Linear elasticity in the small strain e = sym F - 1, for small displacements only: rotations cause strain.

W = mu |dev e|²,    U = (kappa/2) (tr e)²
"""

from palpate.compiler.kernel import kernel
from palpate.physics.materials.hyperelastic import Material, moduli, wants_mixed

EXAMPLE = (1e4, 0.3)


@kernel(pointer=True)
def strain_energy(F, J, p, P, A):
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


def linear(young: float, poisson: float) -> Material:
    """mu and kappa from Young's modulus [Pa] > 0 and Poisson's ratio [1] in (-1, 0.5). MaterialError: see `moduli`."""
    constants = moduli(young, poisson)
    return Material(strain_energy, constants, mixed=wants_mixed(*constants), small=True)
