"""The clock of the launcher on another machine: its zero, its rate, and late orders."""

import random

import pytest

from palpate.engine import clock
from palpate.launch.run.work.far_clock import STEP, FarClock

MS, SECOND, DAY = 1_000_000, 1_000_000_000, 86_400_000_000_000


class Machines:
    """Two machines: `ahead` [ns] and `fast` [1] of the clock that is tested."""

    def __init__(self, monkeypatch, ahead: int, fast: float, seed: int = 1) -> None:
        self.ahead, self.fast, self.time, self.random = ahead, fast, 5 * SECOND, random.Random(seed)
        self.clock = FarClock()
        monkeypatch.setattr(clock, "now", self.here)

    def here(self) -> int:
        return self.time + self.ahead + int(self.time * self.fast)

    def order(self, delay: int) -> None:
        sent, self.time = self.time, self.time + delay
        self.clock.hear(sent)
        self.time = sent

    def beats(self, origin: int, seconds: float) -> list[float]:
        """Errors of the origin [ns] after each heartbeat, and the origin."""
        errors = []
        for _ in range(round(2 * seconds)):
            self.time += SECOND // 2
            self.order(self.random.randint(100_000, 12 * MS))
            before, origin = origin, self.clock.corrected(origin)
            assert abs(origin - before) <= STEP
            errors.append(origin - (5 * SECOND + self.ahead + int(self.time * self.fast)))
        return errors


@pytest.mark.parametrize("ahead", [0, 10 * DAY, -SECOND])
def test_the_zeros_of_two_clocks_may_differ_by_days(monkeypatch, ahead):
    machines = Machines(monkeypatch, ahead, 0.0)
    machines.order(30 * MS)
    machines.order(200_000)
    machines.order(4 * MS)
    assert machines.clock.begin(5 * SECOND) == 5 * SECOND + ahead + 200_000


@pytest.mark.parametrize("fast", [1e-4, -1e-4, 0.0])
def test_a_clock_of_another_rate_is_followed_for_an_hour_without_losing_a_tick(monkeypatch, fast):
    """Without corrections 0.36 s after an hour, which is 360 ticks at 1 kHz."""
    machines = Machines(monkeypatch, DAY, fast)
    machines.order(MS)
    errors = machines.beats(machines.clock.begin(5 * SECOND), 3600)
    # the smallest of 8 delays, of which a fast clock takes one of up to 4 s ago
    assert min(errors) > -0.5 * MS and max(errors) < 8 * MS
    assert abs(sum(errors) / len(errors)) < 3 * MS


def test_a_first_order_that_was_late_is_corrected(monkeypatch):
    machines = Machines(monkeypatch, DAY, 0.0)
    machines.order(20 * MS)
    errors = machines.beats(machines.clock.begin(5 * SECOND), 120)
    assert errors[0] > 10 * MS and all(0 < error < 6 * MS for error in errors[-40:])
