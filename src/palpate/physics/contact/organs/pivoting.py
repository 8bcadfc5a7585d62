"""Linear complementarity with a bounded number of changes per call, for contact that lasts over many time steps.

    w = g + W p,    p >= 0,    w >= 0,    p_i w_i = 0

W symmetric and positive definite. A set S of active candidates determines p: W_SS p_S = -g_S, and p = 0 elsewhere. A
candidate violates the conditions if it is active and pulls, p_i < 0, or is free and overlaps, w_i < 0.

Block principal pivoting (J. Judice, F. Pires, Comput. Oper. Res. 21 (1994) 587-596): all violating candidates change
sides together while their number falls; after `PATIENCE` rounds without progress only the last one does (K. Murty's
rule, which ends after a finite number of changes for every W of this kind). The set of the last call is the start of
the next, so that a steady contact needs one round. The factor W_SS = U'U is kept between calls and changed by one row
and column per change: O(n²) instead of O(n³) (G. H. Golub, C. F. Van Loan, Matrix Computations, 2013, 6.5).

After `most` changes the call ends, and the next one continues; the violations are counted. If active candidates that
pull are left, the forces are those of the last call, improved (`_relax`), so that the contact neither pulls nor does
work on the bodies; else they are those of the active candidates.
"""

from typing import Annotated, NamedTuple

import numpy as np

from palpate.compiler.dot import inner
from palpate.compiler.fields import element_type
from palpate.compiler.kernel import ieee_kernel, kernel
from palpate.physics.arrays import Array, Matrix

PATIENCE = 3  # rounds without progress before single changes
ROUNDS = 64  # most rounds of a call: those with changes are limited by `most`
LEAST_PIVOT = 1e-10  # [1] share of a candidate's compliance that must be independent of the active ones
SWEEPS = 20  # of `_relax`
EXACT = 1e-12  # [1] of the largest |g|: overlap below which a free candidate does not violate


TALLY = {"active": int, "left": int, "changes": int, "rounds": int}
"""Number of active candidates; after a call: violations that are left, changes and rounds."""
TALLY_TYPE = element_type(TALLY)


class ActiveSet(NamedTuple):
    """The active candidates of m, and the factor of their matrix.

    order  (m)    the active candidates in the order of the factor
    place  (m)    index of a candidate in `order`, -1: free
    tally  (1)    `TALLY`
    factor (m,m)  U, upper triangular
    force  (m)    p
    room   (4,m)  workspace
    changing (m)  workspace: candidates that violate
    """

    order: Annotated[np.ndarray, "<i8", 1]
    place: Annotated[np.ndarray, "<i8", 1]
    tally: Annotated[np.ndarray, TALLY_TYPE, 1]
    factor: Annotated[np.ndarray, "<f8", 2]
    force: Annotated[np.ndarray, "<f8", 1]
    room: Annotated[np.ndarray, "<f8", 2]
    changing: Annotated[np.ndarray, "<i8", 1]


def active_set(count: int) -> ActiveSet:
    """No active candidate of `count`."""
    return ActiveSet(
        np.zeros(count, np.int64), np.full(count, -1), np.zeros(1, TALLY_TYPE), np.zeros((count, count)),
        np.zeros(count), np.zeros((4, count)), np.zeros(count, np.int64),
    )  # fmt: skip


@kernel
def add_rows(matrix: Matrix, active: ActiveSet, scale: float, out: Array):
    """Add the matrix (m,n) times `scale` times the forces of the active candidates to `out` (n); four rows at a time,
    so that `out` is read and written once for them."""
    order, force, count = active.order, active.force, active.tally[0].active
    whole = count - count % 4
    for k in range(0, whole, 4):
        g, h, i, j = order[k], order[k + 1], order[k + 2], order[k + 3]
        one, two, three, four = matrix[g], matrix[h], matrix[i], matrix[j]
        p, q, r, s = scale * force[g], scale * force[h], scale * force[i], scale * force[j]
        for n in range(len(out)):
            out[n] = (((out[n] + p * one[n]) + q * two[n]) + r * three[n]) + s * four[n]
    for k in range(whole, count):
        row, value = matrix[order[k]], scale * force[order[k]]
        for n in range(len(out)):
            out[n] += value * row[n]


@kernel
def solve_lower(active: ActiveSet, right: Array, count: int):
    """Replace `right` (count), in the order of the factor, by the solution x of U'x = right, so that x.x =
    right.W_SS^-1 right."""
    factor = active.factor
    for k in range(count):
        row, value = factor[k], right[k] / factor[k, k]
        right[k] = value
        for j in range(k + 1, count):
            right[j] -= row[j] * value


@kernel
def solve_active(active: ActiveSet, right: Array, count: int):
    """Replace `right` (count), in the order of the factor, by the solution x of W_SS x = right."""
    factor = active.factor
    solve_lower(active, right, count)
    for k in range(count - 1, -1, -1):
        right[k] = (right[k] - inner(factor[k][k + 1 : count], right[k + 1 : count])) / factor[k, k]


@kernel
def admit(matrix: Matrix, active: ActiveSet, candidate: int):
    """Activate a candidate. False: its row depends on those of the active ones, and nothing changes."""
    order, factor, count, column = active.order, active.factor, active.tally[0].active, active.room[2]
    row = matrix[candidate]
    for k in range(count):
        column[k] = row[order[k]]
    square = row[candidate]
    for k in range(count):
        value = column[k] / factor[k, k]
        column[k] = value
        square -= value * value
        for j in range(k + 1, count):
            column[j] -= factor[k, j] * value
    if not square > LEAST_PIVOT * row[candidate]:
        return False
    for k in range(count):
        factor[k, count] = column[k]
    factor[count, count] = np.sqrt(square)
    order[count], active.place[candidate] = candidate, count
    active.tally[0].active = count + 1
    return True


@kernel
def release(active: ActiveSet, candidate: int):
    """Make an active candidate free."""
    order, factor, place, last = active.order, active.factor, active.place, active.tally[0].active - 1
    at = place[candidate]
    for k in range(at, last):
        order[k] = order[k + 1]
        place[order[k]] = k
    for k in range(last + 1):
        for j in range(at, last):
            factor[k, j] = factor[k, j + 1]
    # Givens rotations restore the triangle below the diagonal
    for k in range(at, last):
        upper, lower = factor[k], factor[k + 1]
        size = np.sqrt(upper[k] * upper[k] + lower[k] * lower[k])
        c, s = upper[k] / size, lower[k] / size
        for j in range(k, last):
            above, below = upper[j], lower[j]
            upper[j] = c * above + s * below
            lower[j] = c * below - s * above
    place[candidate] = -1
    active.force[candidate] = 0.0
    active.tally[0].active = last


@kernel
def refactor(matrix: Matrix, active: ActiveSet):
    """Compute the factor of the same active candidates again, for a changed matrix. Dependent ones become free."""
    count = active.tally[0].active
    for k in range(count):
        active.changing[k] = active.order[k]
        active.place[active.order[k]] = -1
    active.tally[0].active = 0
    for k in range(count):
        if not admit(matrix, active, active.changing[k]):
            active.force[active.changing[k]] = 0.0


@kernel
def _balance(matrix: Matrix, gap: Array, active: ActiveSet, slack: Array):
    """Fill the force of the active candidates, and `slack`, w, of all."""
    order, count, right = active.order, active.tally[0].active, active.room[0]
    for k in range(count):
        right[k] = -gap[order[k]]
    solve_active(active, right, count)
    for k in range(count):
        active.force[order[k]] = right[k]
    slack[:] = gap
    add_rows(matrix, active, 1.0, slack)


@kernel
def _violations(active: ActiveSet, slack: Array, least: float):
    """List the violating candidates in `changing`; returns their number."""
    found = 0
    for i in range(len(slack)):
        if (active.force[i] < 0.0) if active.place[i] >= 0 else (slack[i] < -least):
            active.changing[found] = i
            found += 1
    return found


@kernel
def _pulls(active: ActiveSet):
    """Whether an active candidate pulls."""
    least = 0.0
    for k in range(active.tally[0].active):
        least = min(least, active.force[active.order[k]])
    return least < 0.0


@kernel
def _worst_first(active: ActiveSet, slack: Array, found: int, wanted: int):
    """Move the `wanted` worst of the listed candidates to the front: first those that pull, then the deepest."""
    listed = active.changing
    for k in range(min(wanted, found)):
        worst, most = k, -np.inf
        for j in range(k, found):
            i = listed[j]
            bad = np.inf if active.place[i] >= 0 else -slack[i]
            if bad > most:
                worst, most = j, bad
        listed[k], listed[worst] = listed[worst], listed[k]


@kernel
def _relax(matrix: Matrix, gap: Array, active: ActiveSet, before: Array):
    """Improve the forces of the active candidates by projected Gauss-Seidel sweeps from those before, for a call that
    did not end: without those that pull the others are too large, by far where W is nearly singular, as of rigid
    bodies. Each sweep lowers p.W p/2 + g.p, so that the answer is no worse than the forces before.

    before [N] (m) >= 0
    """
    order, count, force = active.order, active.tally[0].active, active.force
    for k in range(count):
        force[order[k]] = before[order[k]]
    for _ in range(SWEEPS):
        for k in range(count):
            i = order[k]
            row, slack = matrix[i], gap[i]
            for j in range(count):
                slack += row[order[j]] * force[order[j]]
            force[i] = max(force[i] - slack / row[i], 0.0)


@ieee_kernel
def complement(matrix: Matrix, gap: Array, active: ActiveSet, most: int):
    """Solve for the forces p >= 0 in `active.force`, from the active candidates of the last call and their forces.
    Returns the number of violations that are left; 0: solved.

    matrix [m/N] (m,m)  W, whose part of the active candidates is in the factor (`refactor` after a change)
    gap    [m] (m)      g
    most                changes of sides in this call, > 0
    """
    slack, last, largest = active.room[1], active.room[3], 0.0
    for i in range(len(gap)):
        largest, last[i] = max(largest, abs(gap[i])), active.force[i]
    least, fewest, patience, changes, rounds = EXACT * largest, len(gap) + 1, PATIENCE, 0, 0
    while True:
        rounds += 1
        _balance(matrix, gap, active, slack)
        found = _violations(active, slack, least)
        if found == 0 or changes >= most or rounds >= ROUNDS:
            break
        if found < fewest:
            fewest, patience = found, PATIENCE
        else:
            patience -= 1
        if patience < 0:
            active.changing[0] = active.changing[found - 1]
            wanted = 1
        else:
            wanted = min(found, most - changes)
            if wanted < found:
                _worst_first(active, slack, found, wanted)
        before = changes
        for k in range(wanted):
            i = active.changing[k]
            if active.place[i] >= 0:
                release(active, i)
                changes += 1
            elif admit(matrix, active, i):
                changes += 1
        if changes == before:
            break
    if _pulls(active):
        _relax(matrix, gap, active, last)
    tally = active.tally[0]
    tally.left, tally.changes, tally.rounds = found, changes, rounds
    return found
