"""The active set of contact points after a Newton step, found within the step with the factored tangent.

Newton's step takes it that the points that carry pressure go on to do so. With gap g, its change b.v in the step v,
multiplier l and penalty e, the step ends with s = l - e (g + b.v). Where s is negative though the point was taken to
carry, or positive though it was not, the traction is wrong by d = max(-s, 0) or max(s, 0). The step that is right is

    K v = -r + sum w b d(v),      w the area of a point,

piecewise linear, and as large as the number of points that switch. It is solved by Newton's method on these, which ends
when their set stays as it is.
M. Hintermueller, K. Ito, K. Kunisch, SIAM J. Optim. 13 (2002) 865-888; W. W. Hager, SIAM Rev. 31 (1989) 221-239.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array, vstack

ROUNDS = 12
"""Sets of points that are tried in a step."""
MOST = 400
"""Points that may switch in a step; beyond, Newton's step stands as it is."""


SINGULAR = 1e12
"""[1] Condition from which on the points that would part are what holds the body."""


class Switching(NamedTuple):
    """Points of frictionless contact about a state.

    rows     [1] (P,3N)  change of the gap for one of the displacements
    level    [Pa] (P,)   multiplier less penalty times gap; a point carries pressure where it is positive
    penalty  [Pa/m] (P,)
    area     [m²] (P,)
    """

    rows: csr_array
    level: np.ndarray
    penalty: np.ndarray
    area: np.ndarray


def joined(parts: list[Switching]) -> Switching:
    """The points of several contacts."""
    rows = csr_array(vstack([p.rows for p in parts], format="csr"))
    return Switching(rows, *(np.concatenate([p[k] for p in parts]) for k in (1, 2, 3)))


def switched(
    points: Switching, step: np.ndarray, solve: Callable[[np.ndarray], np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Newton's step [m] (3N,) with the active set at its end, and the tractions [Pa] (P,) there.

    step   [m] (3N,) as Newton's method gives it, no point switching
    solve  displacements [m] (3N,k) for forces [N] of that shape, by the tangent that made the step
    """
    rows, level, penalty, area = points
    sign = np.where(level > 0.0, -1.0, 1.0)
    start = level - penalty * (rows @ step)
    answers, change, end = _Answers(rows, area, solve), step, start
    wrong = np.flatnonzero(sign * start > 0.0)
    for _ in range(ROUNDS):
        if not len(wrong) or not answers.fetch(wrong):
            break
        moved, opened = answers.of(wrong)
        small = np.eye(len(wrong)) + penalty[wrong, None] * opened[wrong] * sign[wrong]
        if np.linalg.cond(small) > SINGULAR:
            break
        part = sign[wrong] * np.linalg.solve(small, start[wrong])
        change, end = step + moved @ part, start - penalty * (opened @ part)
        after = np.flatnonzero(sign * end > 0.0)
        if np.array_equal(after, wrong):
            break
        wrong = after
    return change, np.maximum(end, 0.0)


class _Answers:
    """What unit tractions at points move [m/Pa] (3N,k), and by how much they open the points [m/Pa] (P,k)."""

    def __init__(self, rows: csr_array, area: np.ndarray, solve: Callable[[np.ndarray], np.ndarray]) -> None:
        self._rows, self._area, self._solve = rows, area, solve
        self._column = np.full(len(area), -1)
        self._moved, self._opened = np.zeros((rows.shape[1], 0)), np.zeros((len(area), 0))

    def fetch(self, wanted: np.ndarray) -> bool:
        """Solve for those of these points that are new; False where that would be too many."""
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

    def of(self, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Displacements and openings for unit tractions at these points."""
        at = self._column[wanted]
        return self._moved[:, at], self._opened[:, at]
