"""Active set of contact points after a Newton step, determined within the step with the factored tangent.

Newton's method assumes a constant active set. With gap g, its change b.v in the step v, multiplier l and penalty e, the
step ends with s = l - e (g + b.v). If s is negative at an active point or positive at an inactive one, the traction has
the error d = max(-s, 0) or max(s, 0). The corrected step solves

    K v = -r + sum w b d(v),      w the area of a point,

which is piecewise linear, by Newton's method on the points that switch. Full steps may cycle between sets. Therefore
each step ends where the energy with the derivative K v + r - sum w b d(v) is minimal: it is convex if K without the
active points is positive, and then no set repeats.
M. Hintermueller, K. Ito, K. Kunisch, SIAM J. Optim. 13 (2002) 865-888; W. W. Hager, SIAM Rev. 31 (1989) 221-239.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq
from scipy.sparse import csr_array, vstack

ROUNDS = 30  # Maximum number of active sets in a step; the last one is used
MOST = 400  # Maximum number of points that switch in a step; with more, Newton's step is not corrected
SINGULAR = 1e12  # [1] Condition number above which the points that would open are the only support of the body


class Switching(NamedTuple):
    """Points of frictionless contact about a state."""

    rows: csr_array  # [1] (P,3N) derivative of the gap by the displacements
    level: np.ndarray  # [Pa] (P,) multiplier minus penalty times gap, positive at active points
    penalty: np.ndarray  # [Pa/m] (P,)
    area: np.ndarray  # [m²] (P,)


def join_parts(parts: list[Switching]) -> Switching:
    rows = csr_array(vstack([p.rows for p in parts], format="csr"))
    return Switching(rows, *(np.concatenate([p[k] for p in parts]) for k in (1, 2, 3)))


def switch_points(
    points: Switching, step: np.ndarray, solve: Callable[[np.ndarray], np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Newton's step [m] (3N,) with the active set at its end, and the tractions [Pa] (P,) there.

    step   [m] (3N,) of Newton's method with a constant active set
    solve  displacements [m] (3N,k) for forces [N] of the same shape, with the tangent of the step
    """
    rows, level, penalty, area = points
    sign = np.where(level > 0.0, -1.0, 1.0)
    start = level - penalty * (rows @ step)
    answers = _Answers(rows, area, solve)
    part, opened = np.zeros_like(level), np.zeros_like(level)
    wrong = np.flatnonzero(sign * start > 0.0)
    for _ in range(ROUNDS):
        if not answers.fetch(wrong):
            break
        opening = answers.open_columns(wrong)
        small = np.eye(len(wrong)) + penalty[wrong, None] * opening[wrong] * sign[wrong]
        if len(wrong) and np.linalg.cond(small) > SINGULAR:
            break
        goal = np.zeros_like(part)
        goal[wrong] = sign[wrong] * np.linalg.solve(small, start[wrong])
        more, wider = goal - part, opening @ goal[wrong] - opened
        length = _length(part, more, wider, points, sign, start - penalty * opened)
        part, opened = part + length * more, opened + length * wider
        after = np.flatnonzero(sign * (start - penalty * opened) > 0.0)
        if length == 0.0 or (length == 1.0 and np.array_equal(after, wrong)):
            break
        wrong = after
    return step + answers.displacement_under(part), np.maximum(start - penalty * opened, 0.0)


def _length(
    part: np.ndarray, more: np.ndarray, wider: np.ndarray, points: Switching, sign: np.ndarray, end: np.ndarray
) -> float:
    """Length [1] of the step from the tractions d = `part` by `more` [Pa] (P,), which opens the points by `wider` [m]
    (P,): the minimum of the energy, at most 1; 0 if the energy does not decrease.

    sign, end  (P,): a point is in the wrong set if sign * end > 0, with its s [Pa] at the start
    """

    def slope(length: float) -> float:
        wanted = np.maximum(sign * (end - length * points.penalty * wider), 0.0)
        return float(np.sum(points.area * wider * (part + length * more - wanted)))

    first = slope(0.0)
    if not first < 0.0:
        return 0.0
    if slope(1.0) <= 1e-9 * abs(first):
        return 1.0
    return float(brentq(slope, 0.0, 1.0, xtol=1e-9))


class _Answers:
    """Displacements [m/Pa] (3N,k) and openings of the points [m/Pa] (P,k) due to unit tractions at points, cached."""

    def __init__(self, rows: csr_array, area: np.ndarray, solve: Callable[[np.ndarray], np.ndarray]) -> None:
        self._rows, self._area, self._solve = rows, area, solve
        self._column = np.full(len(area), -1)
        self._moved, self._opened = np.zeros((rows.shape[1], 0)), np.zeros((len(area), 0))

    def fetch(self, wanted: np.ndarray) -> bool:
        """Solve for the points that are not cached; False if there would be too many."""
        new = wanted[self._column[wanted] < 0]
        count = self._moved.shape[1]
        if count + len(new) > MOST:
            return False
        if len(new):
            more = self._solve((self._rows[new].T * self._area[new]).toarray())
            self._moved = np.hstack([self._moved, more])
            self._opened = np.hstack([self._opened, self._rows @ more])
            self._column[new] = count + np.arange(len(new))
        return True

    def open_columns(self, wanted: np.ndarray) -> np.ndarray:
        return self._opened[:, self._column[wanted]]

    def displacement_under(self, traction: np.ndarray) -> np.ndarray:
        """Displacements [m] (3N,) for tractions [Pa] (P,), which are zero at points that are not cached."""
        cached = np.flatnonzero(self._column >= 0)
        return self._moved[:, self._column[cached]] @ traction[cached]
