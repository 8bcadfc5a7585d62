"""The terminal law of a body under a finger, with other bodies that touch it (`physics.contact.organs.between`).

The body's law L (`terminal`) is valid for the force f of the finger alone. The held forces F_j of the bodies that touch
it act on the finger's patch by the coupling O_j of the body, L(s) = f + X, X = sum_j O_j F_j; and they respond to a
change of f by dF_j, which lifts the patch by y_j df. With the force f_0 for which F_j was solved,

    s(f) = L^-1(f + X) - y (f - f_0),    y = sum_j y_j

The law that is sent has the indentation and the tangent of s at f_0 and, at f = 0, its value. For n = 1 it is exact.

Several fingers on the body (`physics.contact.joint`) have a matrix y_ij and couple through the neighbours as well:

    s_i(f) = L_i^-1(f_i + X_i + sum_j O_ij f_j) - sum_j y_ij (f_j - f_0j)

With the tangent compliance c_i of L_i this is the joint law with the compliance c_i - y_ii, the free indentation raised
by sum_j y_ij f_0j, and the coupling O'_ij = (c_i O_ij - y_ij)/(c_i - y_ii); exact for n = 1.
"""

import numpy as np

from palpate.compiler.kernel import ieee_kernel
from palpate.physics.arrays import Array, Matrix
from palpate.physics.contact.terminal import LEAST_FORCE, LEAST_FREE, fit_terminal, indentation, terminal_force

STIFFEST = 0.95
"""[1] Most of the body's compliance that its neighbours take away: for a rigid neighbour under the finger the forces of
this step and the response of the last one differ."""


@ieee_kernel
def backed_law(
    stiffness: float,
    exponent: float,
    damping: float,
    free: float,
    previous: float,
    others: float,
    yields: float,
    pressing: float,
    dt: float,
):
    """K, n, c, s_free and s_prev of the law with the neighbours.

    stiffness ... previous  of the body alone
    others [N]  X;  yields [m/N] y >= 0;  pressing [N] f_0 >= 0;  dt [s] the step of the law
    """
    if others == 0.0 and yields == 0.0:
        return stiffness, exponent, damping, free, previous
    if exponent == 1.0 and damping == 0.0:
        compliance = 1.0 / stiffness
        by = min(yields, STIFFEST * compliance)
        free = max(free + others * compliance + by * pressing, LEAST_FREE)
        return 1.0 / (compliance - by), 1.0, 0.0, free, previous
    # the others push the body towards the finger where X < 0: then the law begins where f + X does
    force = max(pressing, LEAST_FORCE)
    base = indentation(max(others, 0.0), dt, stiffness, exponent, damping, free, previous)
    s = indentation(max(force + others, LEAST_FORCE), dt, stiffness, exponent, damping, free, previous)
    tangent = terminal_force(s, dt, stiffness, exponent, damping, free, previous)[1]
    by = min(yields, STIFFEST / tangent)
    base, s = max(base + by * pressing, LEAST_FREE), s - by * (force - pressing)
    k, n = fit_terminal(base, s, 1.0 / (1.0 / tangent - by), force)
    return k, n, 0.0, base, previous


@ieee_kernel
def backed_laws(laws: Matrix, coupling: Matrix, others: Array, yields: Matrix, pressing: Array, dt: float):
    """Change the laws (k,5) and couplings O [1] (k,k) of k fingers on a body into those with its neighbours.

    others [N] (k)  X;  yields [m/N] (k,k) y, which is limited to `STIFFEST` of the body's compliance
    pressing [N] (k)  f_0 >= 0;  dt [s] the step of the laws
    """
    count = len(laws)
    compliance, limit = np.zeros(count), np.zeros(count)
    for i in range(count):
        k, n, c, free, previous = laws[i]
        compliance[i] = 1.0 / k
        if n != 1.0 or c != 0.0:
            s = indentation(max(pressing[i] + others[i], LEAST_FORCE), dt, k, n, c, free, previous)
            compliance[i] = 1.0 / terminal_force(s, dt, k, n, c, free, previous)[1]
        most = STIFFEST * compliance[i]
        limit[i] = np.sqrt(most / yields[i, i]) if yields[i, i] > most else 1.0
    for i in range(count):
        k, n, c, free, previous = laws[i]
        by = yields[i, i] * limit[i] * limit[i]
        k, n, c, free, previous = backed_law(k, n, c, free, previous, others[i], by, pressing[i], dt)
        for j in range(count):
            if j != i:
                shared = yields[i, j] * limit[i] * limit[j]
                free += shared * pressing[j]
                coupling[i, j] = (compliance[i] * coupling[i, j] - shared) / (compliance[i] - by)
        laws[i, 0], laws[i, 1], laws[i, 2], laws[i, 3], laws[i, 4] = k, n, c, max(free, LEAST_FREE), previous
