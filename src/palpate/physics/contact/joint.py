"""Several fingertips on one body, solved simultaneously: each responds to the others within the same step.

The response of the body at contact i is its terminal law L_i; the coupling O gives the effect of the other forces:

    L_i(s2_i) = f_i + sum_j O_ij f_j  (j != i),   f_i = F1_i(e_i - s2_i),   f_i >= 0

with F1_i the fingertip's law (`physics.contact.series`). For a linear body of compliance C, O_ij = C_ij/C_ii; only then
may O be negative: a negative sum shifts s_free. f is the fixed point of f_i = phi_i(sum_j O_ij f_j), phi_i one scalar
solve, decreasing with slope -t_i, 0 <= t_i < 1. Newton's matrix is I + t O, regular for positive definite C. Where a
Newton step does not reduce the residual, one Gauss-Seidel sweep replaces it, which converges for symmetric positive
definite C (as the projected one does: O. Mangasarian, J. Optim. Theory Appl. 22 (1977) 465-485). Both together may
cycle where fingers nearly coincide and one of them leaves; after `CYCLES` of these sweeps there are twice as many
as before each time, until they find who is in contact.
"""

import numpy as np

from palpate.compiler.exact import solve_in_place
from palpate.compiler.kernel import ieee_kernel
from palpate.physics.arrays import Array, Matrix
from palpate.physics.contact.series import balance

EXACT = 1e-13  # [1] Convergence tolerance: change of the forces over their sum
MOST_STEPS = 60
CYCLES, MOST_SWEEPS = 16, 64


@ieee_kernel
def _one(i: int, others: float, approach: Array, dt: Array, before: Array, finger: Array, laws: Matrix, out: Matrix):
    """phi_i: solve contact i under the effect `others` [N] of the other forces; fills row i of `out`, returns t_i."""
    k, n, c, free, previous = laws[i]
    if others < 0.0:  # the others push the body towards the finger, such as from the opposite side of an organ
        free += others / k if n == 1.0 else 0.0
        others = 0.0
    f, s1, s2, yields = balance(approach[i], dt[i], before[i], finger, k, n, c, free, previous, others)
    out[i, 0], out[i, 1], out[i, 2] = f, s1, s2
    return yields if 0.0 <= yields <= 1.0 else 1.0


@ieee_kernel
def effect_of_others(i: int, coupling: Matrix, force: Array):
    """sum_j O_ij f_j (j != i) [N], the effect of the other forces at contact i."""
    total = 0.0
    for j in range(len(force)):
        if j != i:
            total += coupling[i, j] * force[j]
    return total


@ieee_kernel
def joint_step(
    approach: Array,
    dt: float,
    before: Array,
    finger: Array,
    laws: Matrix,
    coupling: Matrix,
    force: Array,
    out: Matrix,
):
    """One step of k fingertips on one body: the fixed point f of the equations above. As `joint_steps`, with a step of
    the same length for all.

    dt [s]  T > 0; infinite gives the static split
    """
    joint_steps(approach, np.full(len(approach), dt), before, finger, laws, coupling, force, out)


@ieee_kernel
def joint_steps(
    approach: Array,
    dt: Array,
    before: Array,
    finger: Array,
    laws: Matrix,
    coupling: Matrix,
    force: Array,
    out: Matrix,
):
    """One step of k fingertips on one body: the fixed point f of the equations above.

    approach  [m] (k)    e of each at the end of the step
    dt        [s] (k)    T > 0 of each; infinite gives the static split
    before    [m] (k)    compression of each fingertip before the step
    finger    (5)        law and damping of all, see `series.kernel_form`
    laws      (k,5)      terminal laws: K, n, c, s_free, s_prev
    coupling  [1] (k,k)  O; its diagonal is not read
    force     [N] (k)    initial guess; overwritten
    out       (k,3)      filled with f [N], s1 [m] and s2 [m] of each
    """
    count = len(approach)
    matrix, miss, best = np.zeros((count, count)), np.zeros(count), force.copy()
    least, failed = np.inf, 0
    for _ in range(MOST_STEPS):
        worst = total = 0.0
        for i in range(count):
            yields = _one(i, effect_of_others(i, coupling, force), approach, dt, before, finger, laws, out)
            for j in range(count):
                matrix[i, j] = 1.0 if i == j else yields * coupling[i, j]
            miss[i] = out[i, 0] - force[i]
            worst, total = max(worst, abs(miss[i])), total + out[i, 0]
        if worst <= EXACT * total:
            return
        if worst < least:
            least = worst
            for i in range(count):
                best[i] = force[i]
            if solve_in_place(matrix.reshape(1, count, count), miss.reshape(1, count, 1)):
                for i in range(count):
                    force[i] = max(force[i] + miss[i], 0.0)
                continue
        for i in range(count):
            force[i] = best[i]
        failed += 1
        for _ in range(min(2 ** max(failed - CYCLES, 0), MOST_SWEEPS)):
            for i in range(count):
                _one(i, effect_of_others(i, coupling, force), approach, dt, before, finger, laws, out)
                force[i] = out[i, 0]
        least = np.inf
