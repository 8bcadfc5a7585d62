"""Contact force after a sample that came late: the sample after it comes soon, and later ones as usual."""

import math

import numpy as np

from palpate.launch.testing import FakeBus
from palpate.messages import Proximity, Surface
from palpate.nodes.contact import Series

MS = 1_000_000
STIFFNESS, RETARDATION = 257.0, 0.02  # [N/m], [s]


def body(tick: int, time: int, step: float, indentation: float) -> Surface:
    """A Kelvin-Voigt body after a step [s]."""
    return Surface(
        nodes=np.zeros(0, "<i4"), displacement=np.zeros((0, 3)), stiffness=STIFFNESS * (1.0 + RETARDATION / step),
        exponent=1.0, damping=0.0, rest_indentation=indentation * RETARDATION / (RETARDATION + step),
        previous_indentation=indentation, step=step, relaxation=RETARDATION, tick=tick, time=time,
    )  # fmt: skip


def forces(late: int) -> np.ndarray:
    """Forces [N] of a finger that slows down to a halt and returns, the sample of tick 5 `late` [ns] late."""
    bus, sent, indentation, before = FakeBus(Series(), body=body(-1, -MS, 1e-3, 0.0)), [], 0.0, -MS
    for tick in range(120):
        time = tick * MS + (late if tick == 5 else 0)
        step, before = (time - before) * 1e-9, time
        depth = 6e-3 * math.sin(math.pi * time * 1e-9 / 0.12)
        near = Proximity(
            foot=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0), coordinates=(0.0, 0.0), element=0, gap=3e-3,
            approach=depth, slip=(0.0, 0.0, 0.0), tick=tick, time=time,
        )  # fmt: skip
        (contact,) = bus.publish(near)
        sent.append(contact.force)
        indentation += (contact.force / STIFFNESS - indentation) * step / (RETARDATION + step)
        bus.hold("body", body(tick, time, step, indentation))
    return np.array(sent)


def test_the_step_after_a_late_one_does_not_make_the_usual_ones_gaps():
    """The step of 0.3 ms after the late sample counted as the usual one, so that each later step had a gap. Where the
    finger slowed down, the body answered as if at rest: on the real clock up to 11.7 N in place of 3.2 N."""
    late, now = forces(700_000), forces(0)
    assert now.max() > 0.5
    assert np.abs(late - now)[10:].max() < 0.01 * now.max()
    assert np.abs(np.diff(late[10:])).max() < 1.1 * np.abs(np.diff(now[10:])).max()
