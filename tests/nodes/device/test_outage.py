"""The controller after an outage: its force comes in over the ramp, and gives the hand little energy."""

from itertools import pairwise

import msgspec
import numpy as np
import pytest
from pytest import approx

from palpate.messages import Contact, Pose
from palpate.nodes.controller import Haptic
from palpate.physics.device.grip import grip_step

T = 1e-3
SIDES = ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.6, 0.0, -0.8))


def contact(force: float, approach: float, whole: bool = True, normal=(0.0, 0.0, 1.0)) -> Contact:
    made = Contact(
        foot=(0, 0, 0),
        normal=normal,
        force=force,
        compression=approach,
        indentation=0.0,
        compression_rate=0.0,
        indentation_rate=0.0,
    )
    return msgspec.structs.replace(made, tick=1, used=(1, 0 if whole else -1))


POSE = Pose(position=(0, 0, -2e-3), velocity=(0, 0, 0), dt=T)
LACKING = (contact(0.0, 2e-3, whole=False), POSE)


def after(
    outage: list[tuple[Contact | None, Pose | None]], before: int = 300, dt: float = T, **settings
) -> list[float]:
    """Size of the force [N] from the first whole input after an outage on, under 8 N before and after it."""
    node = Haptic(**settings)
    node.start()
    for _ in range(before):
        node.step(contact(8.0, 2e-3), None, POSE, dt=T)
    for given in outage:
        node.step(given[0], None, given[1], dt=T)
    answers = [node.step(contact(8.0, 2e-3), None, POSE, dt=dt if k == 0 else T) for k in range(300)]
    return [float(np.linalg.norm(answer.force)) for answer in answers]


@pytest.mark.parametrize(
    "outage",
    [[(None, POSE)], [(contact(8.0, 2e-3), None)] * 20, [LACKING] * 20, [LACKING]],
    ids=["contact", "pose", "tissue", "one"],
)
@pytest.mark.parametrize("ramp", [0.02, 0.1])
def test_the_force_rises_no_faster_than_its_limit_over_the_ramp(outage, ramp):
    sizes = after(outage, ramp=ramp, passivity=False)
    rises = [b - a for a, b in pairwise([0.0, *sizes])]
    assert max(rises) <= 9.0 / ramp * T * (1 + 1e-9)
    assert sizes[int(0.5 * ramp / T) - 1] == approx(4.0)
    assert sizes[round(ramp / T) :] == approx([8.0] * (300 - round(ramp / T)))


def test_a_pause_in_which_the_device_has_let_go_is_an_outage():
    assert after([], dt=0.008, passivity=False)[0] == 8.0
    assert after([], dt=0.012, passivity=False)[0] == approx(8.0 * 0.012 / 0.1)


def test_slow_steps_are_no_outage():
    node = Haptic(passivity=False)
    node.start()
    assert [node.step(contact(8.0, 2e-3), None, POSE, dt=0.05).force[2] for _ in range(5)] == [8.0] * 5


def test_what_was_never_there_is_no_outage():
    """The first contact of a run has no tissue yet; that of a graph without one never has."""
    node = Haptic(passivity=False)
    node.start()
    assert node.step(*LACKING[:1], None, POSE, dt=T).force == (0.0, 0.0, 0.0)
    assert node.step(contact(4.0, 2e-3), None, POSE, dt=T).force[2] == 4.0
    alone = Haptic(passivity=False)
    alone.start()
    assert alone.step(contact(4.0, 2e-3, whole=False), None, POSE, dt=T).force[2] == 4.0


@pytest.mark.parametrize("hand", [(500.0, 10.0, 6e-3), (200.0, 20.0, 6e-3), (500.0, 2.0, 6e-3)])
@pytest.mark.parametrize("normal", SIDES)
def test_the_hand_gains_little_by_an_outage(normal, hand):
    """It holds a grip in a wall, sinks in while the force is gone, and is pushed out again when it is back."""
    ramped, at_once = (gained(normal, ramp, *hand) for ramp in (0.1, 0.0))
    assert 0.0 <= ramped < 0.3 * at_once


def gained(normal, ramp: float, stiffness: float, damping: float, depth: float) -> float:
    """Most energy [J] that the display has given after an outage of 30 ms at 500 N/m, counted by the way of the
    grip and not by the controller's own observer."""
    node, n = Haptic(ramp=ramp, resolution=0.0), np.array(normal)
    node.start()
    position, velocity, force = np.zeros(3), np.zeros(3), np.zeros(3)
    given, most = 0.0, 0.0
    for k in range(1800):
        moved, velocity = grip_step(position, velocity, force, T, 0.2, 0.2, stiffness, damping, tuple(-depth * n))
        given = given + float(force @ (moved - position)) if k > 1030 else 0.0
        most, position = max(most, given), moved
        lacks, e = 1000 <= k < 1030, max(-float(moved @ n), 0.0)
        touch = contact(0.0 if lacks else 500.0 * e, e, not lacks, normal)
        pose = Pose(position=tuple(moved), velocity=tuple(velocity), dt=T)
        force = np.array(node.step(touch, None, pose, dt=T).force)
    return most
