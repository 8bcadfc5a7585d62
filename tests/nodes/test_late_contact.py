"""Contact force after a sample that came late: the sample after it comes soon, and later ones as usual."""

import math

import numpy as np
import pytest

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


def without_body(depths, gone):
    """Forces [N] of a finger at each depth [m], a tick of 1 ms each, without a body in the ticks `gone`."""
    node, sent, indentation = Series(), [], 0.0
    node.start()
    for tick, depth in enumerate(depths):
        near = Proximity(
            foot=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0), coordinates=(0.0, 0.0), element=0, gap=4e-3 - depth,
            approach=max(depth, 0.0), separation=max(-depth, 0.0), slip=(0.0, 0.0, 0.0), tick=tick, time=tick * MS,
        )  # fmt: skip
        there = None if tick in gone else body(tick - 1, (tick - 1) * MS, 1e-3, indentation)
        contact = node.step(near, there, dt=1e-3)
        sent.append(contact.force)
        indentation += (contact.force / STIFFNESS - indentation) * 1e-3 / (RETARDATION + 1e-3)
    return np.array(sent)


@pytest.mark.parametrize("speed", [0.05, 0.5])
def test_no_contact_begins_with_a_body_that_is_missing(speed):
    """A finger that touched the tissue long after its node had died felt it for 16 ms, up to 0.12 N at 0.5 m/s."""
    reach, begin = 4e-3, 60
    depths = np.clip(speed * 1e-3 * (np.arange(400) - begin), -3e-3, reach)
    missing = range(20, 250)
    force = without_body(depths, missing)
    assert not force[:250].any()
    assert force[-1] == pytest.approx(without_body(depths, ())[-1], rel=0.02)
    assert np.diff(force).max() < 0.05, "what it presses returns slowly"


def test_a_contact_whose_body_goes_missing_ends_within_16_ms_without_a_jump():
    depths = np.minimum(1e-4 * np.arange(200), 4e-3)
    force = without_body(depths, range(100, 200))
    assert force[99] > 0.4 and not force[116:].any()
    assert np.diff(force[99:]).max() < 1e-6
