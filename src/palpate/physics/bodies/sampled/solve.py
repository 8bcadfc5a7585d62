"""Equilibrium of a sampled body, the minimum of W(q) - p.q over q, by a quasi-Newton method with a warm start.

The approximate inverse H of the tangent is kept between steps. Each accepted step updates it (BFGS: C. G. Broyden, R.
Fletcher, D. Goldfarb, D. F. Shanno, 1970); when the iteration stalls it is recomputed from the tangent. Every step
reduces the energy. The number of evaluations is bounded, and the next call continues from the remaining residual.
"""

from typing import Any

import numpy as np

from palpate.compiler.dot import inner, times
from palpate.compiler.fields import blank_record
from palpate.compiler.kernel import ieee_kernel
from palpate.physics.arrays import Array, Matrix, Record
from palpate.physics.bodies.sampled.energy import forces, tangent

TOLERANCE = 3e-3  # Energy norm of the residual over that of the solution
STALLED = 5  # Evaluations after which the tangent is recomputed
MOST = 14  # Evaluations in a call outside real time
EACH = 2  # Evaluations in a real-time step; the next step continues from the remaining residual

BUDGET = {"evaluations": int, "length": ()}
"""Of a call: maximum number of evaluations; first length of the line search, 1 unless the last call interrupted one."""


def offline_budget() -> Any:
    """The budget of a call that is not in real time."""
    return blank_record(BUDGET, evaluations=MOST, length=1.0)


@ieee_kernel
def invert(K: Matrix, L: Matrix, H: Matrix):
    """Fill H (r,r) with the inverse of K, or of K + shift 1 if K is not positive definite; L is workspace."""
    r = len(K)
    mean = 0.0
    for i in range(r):
        mean += abs(K[i, i]) / r
    shift = 0.0
    # Cholesky factor L of K + shift 1; the shift grows until all pivots are positive
    for _ in range(20):
        good = True
        for j in range(r):
            x = K[j, j] + shift
            for k in range(j):
                x -= L[j, k] * L[j, k]
            if not x > 1e-9 * mean:
                good = False
                break
            L[j, j] = np.sqrt(x)
            for i in range(j + 1, r):
                y = K[i, j]
                for k in range(j):
                    y -= L[i, k] * L[j, k]
                L[i, j] = y / L[j, j]
        if good:
            break
        shift = max(4.0 * shift, 1e-3 * mean)
    # columns of the inverse of L into the upper half of H
    for j in range(r):
        H[j, j] = 1.0 / L[j, j]
        for i in range(j + 1, r):
            y = 0.0
            for k in range(j, i):
                y -= L[i, k] * H[j, k]
            H[j, i] = y / L[i, i]
    # H = inv(L)' inv(L); row i of the upper half of H contains inv(L)[k, i], k >= i
    for i in range(r):
        for j in range(i, r):
            x = 0.0
            for k in range(j, r):
                x += H[i, k] * H[j, k]
            L[j, i] = x
    for i in range(r):
        for j in range(i + 1):
            H[i, j] = H[j, i] = L[i, j]


@ieee_kernel
def at_rest(H: Matrix):
    """Fill H (r,r) with the inverse of the tangent at rest, which is 1."""
    H[:] = 0.0
    for i in range(len(H)):
        H[i, i] = 1.0


@ieee_kernel
def settle(
    points: Record,
    work: Record,
    p: Array,
    q: Array,
    g: Array,
    H: Matrix,
    K: Matrix,
    L: Matrix,
    vectors: Matrix,
    energy: float,
    budget: Record,
):
    """Iterate q (r,) to equilibrium under p (r,). Returns W there, number of evaluations, and whether it converged.

    g (r,) and `energy` are the gradient of W and W at q, before and after; `budget` is a `BUDGET`, of whose evaluations
    at most `STALLED` are without the tangent; H (r,r): inverse of the tangent; K, L (r,r) and vectors (4,r): workspace.
    """
    r, most = len(q), budget.evaluations
    d, trial, slope, change = vectors[0], vectors[1], vectors[2], vectors[3]
    used, recomputed, reset = 0, False, False
    while True:
        # quasi-Newton direction d = H (p - g); along: the slope of W - p.q in it, negative downhill
        work_of_load, along = 0.0, 0.0
        for i in range(r):
            work_of_load += p[i] * q[i]
            trial[i] = p[i] - g[i]
        times(H, trial, d)
        for i in range(r):
            along -= d[i] * trial[i]
        if not (along <= 0.0 or reset):  # H is not positive definite, due to rounding
            reset = True
            at_rest(H)
            continue
        if not -along > TOLERANCE * TOLERANCE * abs(work_of_load):
            return energy, used, True
        if used >= most:
            return energy, used, False
        # updates of H have stalled: recompute it once from the tangent
        if used >= STALLED and not recomputed:
            recomputed = True
            if tangent(points, q, work, K):
                invert(K, L, H)
                continue
        # line search by Armijo's rule; `turned` is the slope at its end
        length, before = budget.length, energy - work_of_load
        budget.length = 1.0
        while True:
            after = 0.0
            for i in range(r):
                trial[i] = q[i] + length * d[i]
                after -= p[i] * trial[i]
            potential = forces(points, trial, work, slope)
            used += 1
            after += potential
            if potential < np.inf:
                turned = 0.0
                for i in range(r):
                    turned += d[i] * (slope[i] - p[i])
                # if rounding hides the change of the energy, use its slope
                if after <= before + 1e-4 * length * along or abs(turned) <= 0.5 * abs(along):
                    break
            shorter = 0.25
            if potential < np.inf:  # the minimum of the parabola through both values and the slope
                shorter = -0.5 * along / max((after - before) / length - along, 1e-300)
                shorter = min(max(shorter, 0.1), 0.5)
            length *= shorter
            if used >= most:
                budget.length = length
                return energy, used, False
        # accept; BFGS update of H by the step d and the change of the gradient, where the curvature is positive
        curve = size = 0.0
        for i in range(r):
            change[i] = slope[i] - g[i]
            d[i] *= length
            curve += d[i] * change[i]
            size += d[i] * d[i]
            q[i], g[i] = trial[i], slope[i]
        energy = potential
        if curve > 1e-12 * size:
            _improve(H, d, change, trial, curve)


@ieee_kernel
def _improve(H: Matrix, s: Array, y: Array, Hy: Array, curve: float):
    """BFGS update of the inverse H (r,r) for the step s (r,) and the change y (r,) of the gradient, curve = s.y > 0;
    Hy (r,) is workspace."""
    r = len(s)
    times(H, y, Hy)
    factor = (1.0 + inner(Hy, y) / curve) / curve
    for i in range(r):
        a, b = factor * s[i], s[i] / curve
        c, row = Hy[i] / curve, H[i]
        for j in range(i + 1):
            row[j] += a * s[j] - (b * Hy[j] + c * s[j])
        for j in range(i):
            H[j, i] = row[j]
