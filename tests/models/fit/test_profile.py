"""Profile intervals against the projection of the region within the level, found on a grid."""

import math

import numpy as np
import pytest
from pytest import approx

from palpate.models.fit.tissue.profile import include_profiles, linear_interval
from palpate.models.fit.tissue.rigs import Parameter

STEPS = 20001  # of a search


class Surface:
    """A sum of squares over two unknowns; the search goes downhill from where it begins."""

    def __init__(self, squares, low, high):
        self.squares, self.bounds = squares, (np.array(low, float), np.array(high, float))
        self.parameters = tuple(
            Parameter(name, "1", 0.0, a, b, False) for name, a, b in zip("xy", low, high, strict=True)
        )

    def solve(self, x, fixed):
        low, high = self.bounds
        line = np.tile(np.array(x, float)[:, None], STEPS)
        line[1 - fixed] = np.linspace(low[1 - fixed], high[1 - fixed], STEPS)
        squares = self.squares(*line)
        k = int(np.argmin(np.abs(line[1 - fixed] - x[1 - fixed])))
        rise = np.diff(squares) > 0.0
        up, down = np.flatnonzero(rise[k:]), np.flatnonzero(~rise[:k])
        k = k + int(up[0]) if len(up) and up[0] else STEPS - 1 if not len(up) else int(down[-1]) + 1 if len(down) else 0
        return line[:, k], float(squares[k])

    def projection(self, level):
        """Least and greatest x and y within the level."""
        x, y = (np.linspace(a, b, 801) for a, b in zip(*self.bounds, strict=True))
        inside = np.concatenate([self.squares(part[:, None], y) for part in np.array_split(x, 90)]) <= level
        return [(side[within].min(), side[within].max()) for side, within in
                ((x, inside.any(axis=1)), (y, inside.any(axis=0)))]  # fmt: skip


def intervals(surface, minima, level, width=0.05):
    out = [linear_interval(surface, minima[0], i, width) for i in range(2)]
    found = [(np.array(x, float), float(surface.squares(*np.array(x, float)))) for x in minima]
    include_profiles(surface, found, width * np.eye(2), np.full(2, level), out)
    return out


def test_the_time_of_a_term_whose_share_may_be_zero_is_not_determined():
    """y = share exp(-rate t) with a share of 0.1 and noise that does not exclude 0."""
    t = np.linspace(0.0, 3.0, 40)
    y = 0.1 * np.exp(-1.2 * t)

    def squares(s, r):
        return 0.05 + np.sum((s[..., None] * np.exp(-r[..., None] * t) - y) ** 2, axis=-1)

    surface = Surface(squares, (0.0, 0.0), (1.0, 4.0))
    share, rate = intervals(surface, [(0.1, 1.2)], 0.2)
    assert (rate.low, rate.high) == (0.0, 4.0) and share.low == 0.0
    assert all(map(math.isnan, rate.profile)) and math.isnan(share.profile[0])
    (low, high), (slowest, fastest) = surface.projection(0.2)
    assert share.high == approx(high, abs=2e-3) and low == 0.0 and (slowest, fastest) == (0.0, 4.0)
    share, rate = intervals(surface, [(0.1, 1.2)], 0.053)  # less noise: both are determined
    (low, high), (slowest, fastest) = surface.projection(0.053)
    assert share.profile == approx((low, high), abs=2e-3) and low > 0.0
    assert rate.profile == approx((slowest, fastest), abs=6e-3) and fastest < 4.0


@pytest.mark.parametrize("second", [(0.1, 1.0), (1.3, 1.0), (0.4, 0.6)])
def test_an_interval_covers_all_valleys_within_the_level(second):
    """Also that of a minimum which lies within the interval of the first one, and reaches beyond it."""

    def squares(x, y):
        one = 0.1 + (x - 0.4) ** 2 / 0.02 + (y - 0.5) ** 2 / 0.0002
        two = 0.2 + (x - second[0]) ** 2 / 0.1 + (y - second[1]) ** 2 / 0.0002
        return np.minimum(one, two)

    surface = Surface(squares, (-1.0, 0.0), (2.0, 1.5))
    for found, (low, high) in zip(intervals(surface, [(0.4, 0.5), second], 1.0), surface.projection(1.0), strict=True):
        assert found.profile == approx((low, high), abs=6e-3)


def test_a_search_that_was_lost_in_another_valley_does_not_end_the_interval():
    """The first trial lies far outside, from where the search descends into a valley above the level. The profile of
    Prony terms was then followed in that valley, and ended next to the minimum."""

    def squares(x, y):
        return np.minimum(0.1 + 4.0 * (x - 0.5) ** 2 + 40.0 * (y - 0.5 * x) ** 2, 5.0 + (y - 1.2) ** 2)

    surface = Surface(squares, (-1.0, -1.0), (2.0, 1.5))
    out = [linear_interval(surface, (0.5, 0.25), i, 0.9) for i in range(2)]
    toward = np.array([[0.9, 0.0], [0.9, 0.9]])
    include_profiles(surface, [(np.array([0.5, 0.25]), 0.1)], toward, np.full(2, 1.0), out)
    for found, (low, high) in zip(out, surface.projection(1.0), strict=True):
        assert found.profile == approx((low, high), abs=6e-3)
