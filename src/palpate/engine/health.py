"""Counters and durations of each node of a worker, without allocation in the steady state."""

from __future__ import annotations

from bisect import bisect_left
from itertools import accumulate

import msgspec
import numpy as np

from palpate import messages

_BITS = 48  # up to 2^48 ns, three days
BINS = 8 * (_BITS + 2)
TOTAL, LONGEST = BINS, BINS + 1  # places in `Histogram.words`


class Histogram:
    """Histogram of durations with eight bins per octave, interpolated within a bin: quantiles within 12 %, within 1 %
    for smooth distributions."""

    __slots__ = ("_view", "words")

    def __init__(self) -> None:
        self.words = np.zeros(BINS + 2, np.int64)
        """The bins, the total and the longest duration [ns]; compiled code writes here too (`launch.run.hop.tick`)."""
        self._view: memoryview = self.words.data  # single numbers: twice as fast as the array

    def add(self, nanoseconds: int, count: int = 1) -> None:
        """Count a duration [ns] `count` times."""
        view = self._view
        view[TOTAL] += nanoseconds * count
        if nanoseconds > view[LONGEST]:
            view[LONGEST] = nanoseconds
        # The bit length gives the octave, the bits after the first one the bin within it: no logarithm, no array.
        bits = nanoseconds.bit_length()
        view[8 * bits + (nanoseconds >> bits - 4) if bits > 3 else 0] += count

    def merge(self, other: Histogram) -> None:
        """Count the durations of another one."""
        longest = max(self.longest, other.longest)
        self.words += other.words
        self.words[LONGEST] = longest

    @property
    def total(self) -> int:
        """Sum of the durations [ns]."""
        return self._view[TOTAL]

    @property
    def longest(self) -> int:
        """The longest duration [ns]."""
        return self._view[LONGEST]

    @property
    def count(self) -> int:
        """Number of durations."""
        return int(self.words[:BINS].sum())

    def report(self) -> dict[str, float]:
        """Mean, quantiles and longest duration [s]."""
        bins = self.words[: 8 * (self.longest.bit_length() + 2)].tolist()
        total = list(accumulate(bins))
        count = total[-1]
        durations = {"mean": self.total * 1e-9 / count if count else 0.0}
        for name, q in (("p50", 0.5), ("p99", 0.99), ("p999", 0.999)):
            place = bisect_left(total, q * count)
            bits, eighth = divmod(place - 8, 8)
            share = 1.0 - (total[place] - q * count) / bins[place] if count else 0.0
            durations[name] = min(2.0 ** (bits - 1) * (1.0 + (eighth + share) / 8.0), self.longest) * 1e-9
        durations["longest"] = self.longest * 1e-9
        return durations


class HealthCounters:
    """Counters of one node.

    step     durations of the step itself
    age      real clock: from the time of the tick to the output, which for the last node is the latency of the force
             path; simulated clock: for the paced node, the duration of a whole tick
    late     ticks left out by the clock because a whole period had passed
    overdue  real clock: outputs sent after the next tick had begun
    lost     driving messages that were skipped or did not arrive within the period
    held     inputs older than the tick requires
    absent   those of them that were optional and too old to be used, so that the step ran without them
    asleep   steps at which the node was at rest and its last output was sent again
    counted  steps that were not timed one by one
    """

    __slots__ = ("absent", "age", "asleep", "counted", "held", "late", "lost", "overdue", "state", "step", "tick")

    def __init__(self) -> None:
        self.step, self.age = Histogram(), Histogram()
        self.late = self.lost = self.held = self.absent = self.asleep = self.overdue = self.counted = 0
        self.tick = -1
        self.state = "ready"

    def report(self, forces: dict[str, float] | None = None) -> Counters:
        """The counters for transmission, with the forces of the node's last output."""
        return Counters(
            self.tick, self.step.count + self.counted + self.asleep, self.late, self.lost, self.held, self.asleep,
            self.state, self.step.report(), self.age.report(), forces or {}, self.overdue, self.absent,
        )  # fmt: skip


class Counters(msgspec.Struct, frozen=True):
    """Report of the counters: step and age with mean, quantiles and longest [s], forces [N] by `stream.field`."""

    tick: int
    steps: int
    late: int
    lost: int
    held: int
    asleep: int
    state: str
    step: dict[str, float]
    age: dict[str, float]
    forces: dict[str, float] = {}
    overdue: int = 0
    absent: int = 0


def message(node: str, time: int, since: int, counters: Counters) -> messages.Health:
    """The report as a message to observers. `time` [ns] on the graph's clock; `since`: first tick of its worker."""
    return messages.Health(
        tick=counters.tick, time=time, source=node, since=since, steps=counters.steps, late=counters.late,
        lost=counters.lost, held=counters.held, asleep=counters.asleep, state=counters.state,
        median=counters.step["p50"], p99=counters.step["p99"], longest=counters.step["longest"],
        age=counters.age["p50"],
    )  # fmt: skip
