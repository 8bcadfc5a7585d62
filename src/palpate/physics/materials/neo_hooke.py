"""Neo-Hooke: the ideal rubber.

W = (mu/2) I,    U = (kappa/2) (J - 1)²,    I = J^(-2/3) I1 - 3
"""

from palpate.compiler.kernel import kernel
from palpate.physics.materials.hyperelastic import Material, moduli, rubberlike, wants_mixed
from palpate.physics.materials.invariants import shape_invariants, shape_stress

EXAMPLE = (1e4, 0.3)


@kernel(pointer=True)
def strain_energy(F, J, p, P, A):
    _, i1, _ = shape_invariants(F)
    shape_stress(F, 0.5 * p[0], 0.0, 0.0, 0.0, 0.0, P, A)
    return 0.5 * p[0] * i1, 0.5 * p[1] * (J - 1.0) ** 2, p[1] * (J - 1.0), p[1]


def neo_hooke(young: float, poisson: float) -> Material:
    """mu and kappa from Young's modulus [Pa] > 0 and Poisson's ratio [1] in (-1, 0.5) at small strain. MaterialError:
    see `moduli`; a modulus above that of any rubber."""
    constants = moduli(young, poisson)
    rubberlike("neo-Hooke", young)
    return Material(strain_energy, constants, mixed=wants_mixed(*constants))
