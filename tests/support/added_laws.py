"""Laws that palpate does not have, for tests that add one: the text of one file each."""

DAHL = '''\
"""Dahl friction (P. R. Dahl, Aerospace Corp. TOR-0158(3107-18)-1, 1968) over the normal force."""

import math
from typing import Annotated, NamedTuple

from palpate.compiler.kernel import kernel


@kernel
def dahl(law, z, v, load, dt, path):
    """dz/dt = v - |v| z/limit, backward Euler."""
    limit = law.mu / law.bristle_stiffness
    x = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]) * dt / limit
    z = ((z[0] + v[0] * dt) / (1 + x), (z[1] + v[1] * dt) / (1 + x), (z[2] + v[2] * dt) / (1 + x))
    k = load * law.bristle_stiffness
    return z, (k * z[0], k * z[1], k * z[2]), x < 0.5


class Dahl(NamedTuple):
    """Dahl friction."""

    mu: Annotated[float, "1", "> 0"] = 0.5
    bristle_stiffness: Annotated[float, "1/m", "> 0"] = 3000.0

    advance = dahl
'''

GENT = '''\
"""Gent: chains of limited length.

    W = -(mu m/2) ln(1 - I/m),    U = (kappa/2) (J - 1)²,    I = J^(-2/3) I1 - 3

A. N. Gent, Rubber Chem. Technol. 69 (1996) 59-61.
"""

import numba
import numpy as np

from palpate.physics.materials.hyperelastic import Material, moduli
from palpate.physics.materials.invariants import shape_invariants, shape_stress

EXAMPLE = (1e4, 0.4, 2.0)


@numba.njit
def strain_energy(F, J, p, P, A):
    shear, bulk, limit = p[0], p[1], p[2]
    _, i, _ = shape_invariants(F)
    left = 1.0 - i / limit
    shape_stress(F, 0.5 * shear / left, 0.0, 0.5 * shear / (limit * left**2), 0.0, 0.0, P, A)
    return -0.5 * shear * limit * np.log(left), 0.5 * bulk * (J - 1.0) ** 2, bulk * (J - 1.0), bulk


def gent(young, poisson, limit):
    """mu and kappa from Young's modulus [Pa] and Poisson's ratio; m [1] the greatest I."""
    return Material(strain_energy, (*moduli(young, poisson), limit))
'''
