"""The invariant `side` on a ball, whose nearest points are known."""

import numpy as np
import pytest

from palpate.studies.organs.bounds.side import side

BALL, STEP = 20e-3, 1e-3  # [m], [s]


class Inside:
    """A finger that enters a ball to 3 mm from its centre, turns about that, so that the nearest point moves at 140
    mm/s, and then presses in and out at one place for a time [s]; in its last quarter the normal is off [rad]."""

    step, nodes = STEP, {"collision": {"hysteresis": 1e-4}}

    def __init__(self, time, off):
        enter, press = (
            np.linspace(0.026, 0.003, 50),
            3e-3 * (2.0 - np.cos(2.0 * np.pi * 2.5 * np.arange(0.0, time, STEP))),
        )
        away = np.concatenate([enter, np.full(500, 0.003), press])
        turn = np.concatenate([np.zeros(50), np.arange(500), np.full(len(press), 500)]) * 0.1085e-3 / BALL
        n = np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=1)
        wrong = n.copy()
        wrong[-(len(press) // 4) :] = np.array([np.cos(turn[-1] + off), np.sin(turn[-1] + off), 0.0])
        self.values = {
            "finger.position": away[:, None] * n, "collision.foot": BALL * n, "collision.gap": away - BALL,
            "collision.approach": np.maximum(4e-3 + BALL - away, 0.0), "contact.normal": wrong,
            "contact.force": np.ones(len(away)),
        }  # fmt: skip

    def __getitem__(self, name):
        return self.values[name]

    def ticks(self, seconds):
        return max(1, round(seconds / self.step))

    def closest(self, points):
        far = np.linalg.norm(points, axis=1)
        n = points / far[:, None]
        return BALL * n, n, np.zeros(len(points), int), far - BALL


@pytest.mark.parametrize("time", [0.4, 3.2])
def test_a_wrong_normal_is_found_after_a_fast_turn_near_the_centre(time):
    """While the nearest point moves fast the normal may be behind; a foot that has arrived and rests does not count as
    one that still waits."""
    assert side(Inside(time, 0.0)).score < 1.0
    assert side(Inside(time, 0.5)).score > 1.0 and side(Inside(time, 1.3)).score > 3.0
