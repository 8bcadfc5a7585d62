"""Which fidelity the clock allows: less after each step that came too late, more again after a time without one.

A body reads no clock. That it takes too long shows in the time between its steps: on the real clock a tick that was
missed makes it longer, and a recording has the same times, so that a replay takes the same fidelities.
"""

from __future__ import annotations

import math

PROBATION = 1.0
"""[s] without a late step after which one more is allowed."""


class Deadline:
    """The finest of several fidelities, 0 the cheapest, that may be used.

    count     of them
    deadline  [s] > 0, longest time between two steps that is not too late; inf: none is
    """

    def __init__(self, count: int, deadline: float = math.inf) -> None:
        self._last, self.deadline = count - 1, deadline
        self.finest = self._last
        self._kept = 0.0

    def step(self, dt: float, used: int, settled: bool) -> None:
        """The time [s] since the last step, and the fidelity that was used for it. Where that was late, one less is
        allowed, once in each switch: `settled` tells that none is under way."""
        if dt > self.deadline:
            self._kept = 0.0
            if settled:
                self.finest = max(min(used, self.finest) - 1, 0)
            return
        self._kept += dt
        if self._kept >= PROBATION and self.finest < self._last:
            self.finest += 1
            self._kept = 0.0
