"""Processor time of contact.Coupled, of two and of three organs on foundations that hit each other, over that of a
product of a matrix of 100 rows with a vector by numpy: python benchmarks/stacks.py

Called from Python, median by the number of candidates that touch.
"""

import time

import numpy as np

from palpate.nodes.base.compiled import Records
from palpate.studies.organ_stacks import Row, ball, body

TICKS = 150
BANDS = ((1, 20), (20, 45), (45, 80), (80, 130))  # candidates that touch


class Timed(Records):
    """Keeps the time [s] of each call, and how many candidates touch after it."""

    def compute(self, messages, dt):
        begun = time.thread_time_ns()
        super().compute(messages, dt)
        self.node.times.append((1e-9 * (time.thread_time_ns() - begun), self.node._held["active.tally"][0]["active"]))


def measure(count: int) -> np.ndarray:
    """Times and candidates (n,2) of a row of `count` balls."""
    bodies = [body(ball(42.2e-3 * k)) for k in reversed(range(count))]
    row = Row(bodies, [{"mass": 0.1, "stiffness": 100.0, "damping": 3.0}] * count)
    row.moving()[0].own["motion"]["speed"] = (0.0, 0.0, -0.8)
    row.run(1)
    for each in row.contacts:
        each.times, each._records.__class__ = [], Timed
    row.run(TICKS)
    return np.array([pair for each in row.contacts for pair in each.times])


def main() -> None:
    matrix, vector, peer = np.ones((100, 100)), np.ones(100), []
    for _ in range(2000):
        begun = time.thread_time_ns()
        matrix @ vector
        peer.append(1e-9 * (time.thread_time_ns() - begun))
    for count in (2, 3):
        seconds, active = measure(count).T
        for low, high in BANDS:
            inside = (active >= low) & (active < high)
            if inside.any():
                tick = np.median(seconds[inside])
                print(
                    f"{count} organs, {low} to {high - 1} candidates touch: {1e6 * tick:.0f} us, "
                    f"{tick / np.median(peer):.1f} products by numpy"
                )


if __name__ == "__main__":
    main()
