"""Coulomb friction of a penalty contact at one point: return map and tangent."""

import numpy as np

from palpate.physics.kernel import kernel


@kernel
def cut_to_cone(q, normal, most, shear):
    """Coulomb's return map: removes the normal part of the trial traction q [Pa] (3) and fills `shear` [Pa] (3), q
    scaled to at most the length `most` [Pa]. Returns the scale, the length of q [Pa], and whether the point slips."""
    along = normal[0] * q[0] + normal[1] * q[1] + normal[2] * q[2]
    for i in range(3):
        q[i] -= along * normal[i]
    length = np.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2])
    slips = length > most
    cut = most / length if slips else 1.0
    for i in range(3):
        shear[i] = cut * q[i]
    return cut, length, slips


@kernel
def add_tangent(penalty, normal, q, cut, length, slips, block):
    """Add the tangent [Pa/m] of both tractions to `block` (3,3): penalty n x n, plus cut penalty (1 - n x n), minus
    q x q/|q|² in slip, for friction; cut = 0: no friction."""
    for i in range(3):
        for j in range(3):
            square = normal[i] * normal[j]
            block[i, j] += penalty * square
            if cut > 0.0:
                part = (1.0 if i == j else 0.0) - square
                if slips:
                    part -= q[i] * q[j] / (length * length)
                block[i, j] += penalty * cut * part
