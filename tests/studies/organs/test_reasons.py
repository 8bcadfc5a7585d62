"""When a touch is outside the range of the models, so that it must print a note."""

import numpy as np
import pytest

from palpate.studies.organs.notes import reasons

THIN = 10e-3  # [m] thickness of a plate


class PressOfAPlate(dict):
    """A press on a plate to a depth [m], without the mesh of a surface: its two faces are nearest alternately."""

    other = None

    def __init__(self, depth, leaps):
        way = np.concatenate([np.linspace(0.0, depth, 200), np.linspace(depth, 0.0, 200)])
        place = np.stack([0.0 * way, 0.0 * way, THIN - way], axis=1)
        foot = self.closest(place)[0] if leaps else place * [1.0, 1.0, 0.0] + [0.0, 0.0, THIN]
        self.ticks = lambda seconds: round(1000 * seconds)
        super().__init__({"finger.position": place, "contact.foot": foot, "contact.force": np.full(len(way), 1.0)})

    @staticmethod
    def closest(place):
        upper = (place[:, 2:] > 0.5 * THIN).astype(float)
        nearest = place * [1.0, 1.0, 0.0] + [0.0, 0.0, THIN] * upper
        normal = [0.0, 0.0, 1.0] * (2.0 * upper - 1.0)
        return nearest, normal, None, -np.abs(place[:, 2] - nearest[:, 2])


@pytest.mark.parametrize(
    ("deeper", "leaps", "expected"),
    [(-0.1e-3, False, []), (0.04e-3, False, []), (0.06e-3, False, ["jump"]), (0.06e-3, True, ["jump"])]
    + [(2e-3, False, ["jump"]), (0.04e-3, True, ["jump"])],
)  # fmt: skip
def test_a_finger_is_beyond_the_middle_where_the_other_side_is_nearer_by_the_hysteresis(deeper, leaps, expected):
    """A foot that keeps the side where the finger entered keeps it until the other one is nearer by 0.1 mm."""
    press = PressOfAPlate(0.5 * THIN + deeper, leaps)
    assert reasons(press, None, known=["thickness", "patch"]) == expected
