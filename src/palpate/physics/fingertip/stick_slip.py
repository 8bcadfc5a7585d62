"""Stick and slip of coupled nodes with given normal forces: one convex minimisation per step.

In a step node i slips by w_i (2) over the plate, with friction of at most t_i = mu f_n,i. With the stiffness A of skin
and beams in the step and the force r that would act if all nodes stuck, w minimises

    Phi(w) = 1/2 w^T A w - r^T w + sum_i t_i |w_i|

(Tresca friction). A is positive definite, so the minimum is unique. q_i = r_i - (A w)_i is the force of node i on the
plate; the node sticks where |q_i| < t_i.

Method (truncated nonsmooth Newton, Gräser & Kornhuber 2009, on one level): block Gauss-Seidel with the exact solution
of each 2 x 2 problem identifies the slipping nodes; a Newton step on those, where Phi is smooth, removes the slowly
converging error; a line search ensures descent. Warm-started, it converges in one to three iterations.
"""

import math
from typing import NamedTuple

import numpy as np

from palpate.compiler.kernel import kernel
from palpate.physics.arrays import Array, Matrix


class Blocks(NamedTuple):
    """A symmetric positive definite matrix [N/m] of 2 x 2 blocks, row by row."""

    rows: np.ndarray  # [1] (N+1) start of each node's row
    columns: np.ndarray  # [1] (Z) node of each block
    diagonal: np.ndarray  # [1] (N) index of each node's diagonal block
    values: np.ndarray  # [N/m] (Z,2,2) the blocks
    band: int  # [1] () largest |i - j| of coupled nodes


class Workspace(NamedTuple):
    """Workspace of `stick_slip` for N nodes: place, nodes (N) int, upper (2N, 2 band + 2), step (2N)."""

    place: np.ndarray
    nodes: np.ndarray
    upper: np.ndarray
    step: np.ndarray


def workspace(count: int, band: int) -> Workspace:
    """The workspace for `count` nodes."""
    place, nodes = np.zeros((2, count), dtype=np.int64)
    return Workspace(place, nodes, np.zeros((2 * count, 2 * band + 2)), np.zeros(2 * count))


@kernel
def node_slip(a: float, b: float, d: float, x: float, y: float, limit: float):
    """Slip (2) of one node: the minimum of 1/2 w^T [[a, b], [b, d]] w - (x, y) w + limit |w|. Units as above.

    With w = s (cos, sin), (A + limit/s) w = r is one equation for s > 0. In the eigenvectors of A it is solved by
    Newton's method on 1/|.| - 1/s, which is nearly linear (as for a trust region), bracketed by two bounds.
    """
    size = math.hypot(x, y)
    if size <= limit:
        return 0.0, 0.0
    mean, half = 0.5 * (a + d), 0.5 * (a - d)
    radius = math.hypot(half, b)
    high, low = mean + radius, mean - radius
    if limit == 0.0:
        det = a * d - b * b
        return (d * x - b * y) / det, (a * y - b * x) / det
    if radius <= 1e-14 * mean:
        s = (size - limit) / mean
        return x / (mean + limit / s), y / (mean + limit / s)
    # components of r along the eigenvectors
    angle = 0.5 * math.atan2(b, half)
    c, n = math.cos(angle), math.sin(angle)
    p, q = c * x + n * y, c * y - n * x
    # Newton's method on s; a step out of the bracket is replaced by a bisection
    lower, upper = (size - limit) / high, (size - limit) / low
    s = lower
    for _ in range(60):
        f, g = p / (high * s + limit), q / (low * s + limit)
        norm = math.hypot(f, g)
        if norm > 1.0:
            lower = s
        else:
            upper = s
        slope = (f * f * high / (high * s + limit) + g * g * low / (low * s + limit)) / (norm * norm)
        new = s + (norm - 1.0) / slope
        if not lower <= new <= upper:
            new = 0.5 * (lower + upper)
        if abs(new - s) <= 1e-14 * new:
            s = new
            break
        s = new
    f, g = s * p / (high * s + limit), s * q / (low * s + limit)
    return c * f - n * g, n * f + c * g


@kernel
def _sweep(matrix: Blocks, force: Matrix, limit: Array, slip: Matrix):
    """One block Gauss-Seidel sweep over all nodes, in place."""
    rows, columns, values = matrix.rows, matrix.columns, matrix.values
    for i in range(limit.shape[0]):
        x, y = force[i, 0], force[i, 1]
        for s in range(rows[i], rows[i + 1]):
            j = columns[s]
            if j != i:
                x -= values[s, 0, 0] * slip[j, 0] + values[s, 0, 1] * slip[j, 1]
                y -= values[s, 1, 0] * slip[j, 0] + values[s, 1, 1] * slip[j, 1]
        k = matrix.diagonal[i]
        slip[i, 0], slip[i, 1] = node_slip(values[k, 0, 0], values[k, 0, 1], values[k, 1, 1], x, y, limit[i])


@kernel
def _plate_force(matrix: Blocks, force: Matrix, limit: Array, slip: Matrix, out: Matrix):
    """q = r - A w into `out` [N] (N,2); returns the largest violation of the friction law [N]."""
    rows, columns, values = matrix.rows, matrix.columns, matrix.values
    worst = 0.0
    for i in range(limit.shape[0]):
        x, y = force[i, 0], force[i, 1]
        for s in range(rows[i], rows[i + 1]):
            j = columns[s]
            x -= values[s, 0, 0] * slip[j, 0] + values[s, 0, 1] * slip[j, 1]
            y -= values[s, 1, 0] * slip[j, 0] + values[s, 1, 1] * slip[j, 1]
        out[i, 0], out[i, 1] = x, y
        size = math.hypot(slip[i, 0], slip[i, 1])
        if size == 0.0:
            worst = max(worst, math.hypot(x, y) - limit[i])
        else:
            worst = max(worst, math.hypot(x - limit[i] * slip[i, 0] / size, y - limit[i] * slip[i, 1] / size))
    return worst


@kernel
def solve_band(upper: Matrix, right: Array, size: int, width: int):
    """Solve a symmetric positive definite band system in place by Gaussian elimination; the solution is in `right`.

    upper  (n, width + 1)  upper[i, k] = A[i, i + k]; destroyed       right (n)
    """
    for i in range(size):
        last = min(width, size - 1 - i)
        pivot = upper[i, 0]
        for m in range(1, last + 1):
            factor = upper[i, m] / pivot
            if factor != 0.0:
                row = i + m
                for k in range(last - m + 1):
                    upper[row, k] -= factor * upper[i, m + k]
                right[row] -= factor * right[i]
    for i in range(size - 1, -1, -1):
        value = right[i]
        for m in range(1, min(width, size - 1 - i) + 1):
            value -= upper[i, m] * right[i + m]
        right[i] = value / upper[i, 0]


@kernel
def _newton(matrix: Blocks, limit: Array, slip: Matrix, plate: Matrix, work: Workspace):
    """One damped Newton step on the slipping nodes; False if it does not reduce Phi."""
    rows, columns, values = matrix.rows, matrix.columns, matrix.values
    place, nodes, upper, step = work.place, work.nodes, work.upper, work.step
    count = 0
    # index the slipping nodes
    for i in range(limit.shape[0]):
        slips = slip[i, 0] != 0.0 or slip[i, 1] != 0.0
        place[i] = count if slips else -1
        if slips:
            nodes[count] = i
            count += 1
    if count == 0:
        return False
    width = 2 * matrix.band + 1
    gain = 0.0
    # upper band of the Hessian of Phi: K, plus limit/|w| in the direction across the slip of each node
    for n in range(count):
        i = nodes[n]
        upper[2 * n : 2 * n + 2, : width + 1] = 0.0
        for s in range(rows[i], rows[i + 1]):
            m = place[columns[s]]
            if m > n:
                k = 2 * (m - n)
                upper[2 * n, k], upper[2 * n, k + 1] = values[s, 0, 0], values[s, 0, 1]
                upper[2 * n + 1, k - 1], upper[2 * n + 1, k] = values[s, 1, 0], values[s, 1, 1]
            elif m == n:
                size = math.hypot(slip[i, 0], slip[i, 1])
                c, d = slip[i, 0] / size, slip[i, 1] / size
                bend = limit[i] / size
                upper[2 * n, 0] = values[s, 0, 0] + bend * d * d
                upper[2 * n, 1] = values[s, 0, 1] - bend * c * d
                upper[2 * n + 1, 0] = values[s, 1, 1] + bend * c * c
                step[2 * n], step[2 * n + 1] = plate[i, 0] - limit[i] * c, plate[i, 1] - limit[i] * d
    solve_band(upper, step, 2 * count, width)
    # coefficients of the quadratic part of Phi along the step
    linear = bent = 0.0
    for n in range(count):
        i = nodes[n]
        linear -= plate[i, 0] * step[2 * n] + plate[i, 1] * step[2 * n + 1]
        for s in range(rows[i], rows[i + 1]):
            m = place[columns[s]]
            if m >= 0:
                x = values[s, 0, 0] * step[2 * m] + values[s, 0, 1] * step[2 * m + 1]
                y = values[s, 1, 0] * step[2 * m] + values[s, 1, 1] * step[2 * m + 1]
                bent += step[2 * n] * x + step[2 * n + 1] * y
    # backtracking by halves until Phi decreases
    part = 1.0
    for _ in range(12):
        gain = part * linear + 0.5 * part * part * bent
        for n in range(count):
            i = nodes[n]
            x, y = slip[i, 0] + part * step[2 * n], slip[i, 1] + part * step[2 * n + 1]
            gain += limit[i] * (math.hypot(x, y) - math.hypot(slip[i, 0], slip[i, 1]))
        if gain < 0.0:
            for n in range(count):
                i = nodes[n]
                slip[i, 0] += part * step[2 * n]
                slip[i, 1] += part * step[2 * n + 1]
            return True
        part *= 0.5
    return False


@kernel
def stick_slip(
    matrix: Blocks,
    force: Matrix,
    limit: Array,
    slip: Matrix,
    plate: Matrix,
    work: Workspace,
    tolerance: float,
    most: int,
):
    """Minimise Phi(w): overwrites `slip` (initial guess, then the solution w) and `plate` (the force q on the plate).

    Returns the iterations, and the residual: the largest violation of the friction law over the largest limit.

    matrix     A as `Blocks`                                 work  as `Workspace`
    force      [N] (N,2)  r: on the plate if all nodes stick limit [N] (N)  mu f_n >= 0
    slip       [m] (N,2)                                     plate [N] (N,2)
    tolerance  [1]  relative residual to stop at             most  maximum number of iterations
    """
    scale = 0.0
    for i in range(limit.shape[0]):
        scale = max(scale, limit[i])
    if scale == 0.0:
        for i in range(limit.shape[0]):
            scale = max(scale, abs(force[i, 0]), abs(force[i, 1]))
    residual = 0.0
    for turn in range(1, most + 1):
        _sweep(matrix, force, limit, slip)
        residual = _plate_force(matrix, force, limit, slip, plate)
        if residual <= tolerance * scale:
            return turn, residual / scale if scale > 0.0 else 0.0
        if turn < most:
            _newton(matrix, limit, slip, plate, work)
    return most, residual / scale
