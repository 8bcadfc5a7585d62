"""After an outage of a device that moves, the pose follows it at a bounded speed, and no force jumps.

`answers` is the clock of `drivers.exchange.Exchange`: a device that answers once per millisecond, pauses, and answers
again. The graph asks it once per tick, and gets the extrapolated sample with its age.
"""

import random

import msgspec
import numpy as np
import pytest

from palpate.drivers.guard import HORIZON, DeviceSample, ahead
from palpate.launch.testing import FakeBus
from palpate.messages import DeviceState, Force, Pose, Surface
from palpate.nodes.collision import Nurbs
from palpate.nodes.contact import Series
from palpate.nodes.device.hardware import state
from palpate.nodes.kinematics import Cartesian, FalconStatics
from palpate.physics.device.catch_up import LAG, LARGEST, NEAR
from palpate.physics.device.falcon import HOME

MS = 1_000_000
T = 1e-3
TICKS = 1600
PAUSE_AT = 300  # [ticks]
BEFORE = PAUSE_AT - 20
SEARCHED, SHORT = 60, 12
LARGE = 2.0  # [N]
STIFFNESS, RETARDATION = 257.0, 0.02  # [N/m], [s] of the kidney
TOP = 0.105  # [m] of the kidney


def motion(speed: float, direction, start) -> np.ndarray:
    """Positions [m] (t,3) of a hand at constant speed along a direction, there and back, that ends at rest."""
    t = T * np.arange(TICKS)
    begun = np.clip(t - T * (PAUSE_AT - 50), 0.0, None)
    way = speed * np.where(begun < 0.4, begun, np.clip(0.8 - begun, 0.0, None))
    return np.asarray(start) + np.outer(way, direction)


def answers(places: np.ndarray, pause: int) -> list[DeviceState]:
    """Messages of the device at each tick; it is silent in `pause` ticks from `PAUSE_AT` on."""
    given, last, velocity = [], 0, np.zeros(3)
    for tick, place in enumerate(places):
        if not PAUSE_AT <= tick < PAUSE_AT + pause:
            velocity = (place - places[last]) / (T * (tick - last)) if tick > last else np.zeros(3)
            last = tick
        sample = DeviceSample(last * MS, position=tuple(places[last].tolist()))
        message = state(ahead(sample, ((), tuple(velocity.tolist())), tick * MS))
        given.append(type(message)(**{name: getattr(message, name) for name in ("position", "homed", "delayed")},
                                   tick=tick, time=tick * MS))  # fmt: skip
    return given


def poses(given: list[DeviceState], **settings):
    bus = FakeBus(Cartesian(**settings))
    return [bus.publish(message)[0] for message in given], bus


def forces(given) -> np.ndarray:
    """Contact force [N] (t) of these poses on a kidney, a Kelvin-Voigt body."""
    collision, contact = FakeBus(Nurbs(surface="kidney", position=(0.0, 0.0, 0.084))), FakeBus(Series())
    indentation, found, step = 0.0, [], T
    for tick, pose in enumerate(given):
        contact.hold("body", Surface(
            nodes=np.zeros(0, "<i4"), displacement=np.zeros((0, 3)), stiffness=STIFFNESS * (1.0 + RETARDATION / step),
            exponent=1.0, damping=0.0, rest_indentation=indentation * RETARDATION / (RETARDATION + step),
            previous_indentation=indentation, step=step, relaxation=RETARDATION, tick=tick, time=tick * MS,
        ))  # fmt: skip
        (near,) = collision.publish(pose)
        (touch,) = contact.publish(near)
        found.append(touch.force)
        indentation += (touch.force / STIFFNESS - indentation) * step / (RETARDATION + step)
    return np.array(found)


def drawn(seed: int):
    """Pause [ticks], and the motion of a hand that presses, slides or lifts."""
    draw = random.Random(seed)
    pause, speed = draw.choice([20, 30, 50, 100, 200, 350, 500]), draw.uniform(0.02, 0.5)
    kind = draw.choice(["press", "slide", "lift", "any"])
    direction = {"press": (0.0, 0.0, -1.0), "slide": (1.0, 0.3, 0.0), "lift": (0.0, 0.0, 1.0)}.get(
        kind, tuple(draw.gauss(0.0, 1.0) for _ in range(3))
    )
    direction = np.array(direction) / np.linalg.norm(direction)
    depth = min(speed * 0.4, 0.02) if kind == "press" else 0.0
    scale = depth / (speed * 0.4) if depth else min(1.0, 0.03 / (speed * 0.4))
    return pause, motion(speed * scale, direction, (0.0, 0.0, TOP + 0.002))


LONG = [pytest.param(seed, marks=pytest.mark.long) for seed in range(SHORT, SEARCHED)]


@pytest.mark.parametrize("seed", [*range(SHORT), *LONG])
def test_after_an_outage_neither_pose_nor_force_jumps_and_both_arrive(seed):
    pause, places = drawn(seed)
    given = answers(places, pause)
    seen, bus = poses(given)
    where = np.array([pose.position for pose in seen])
    without, _ = poses(answers(places, 0))
    fastest = float(np.linalg.norm(np.diff(places, axis=0), axis=1).max()) / T
    moved = np.linalg.norm(np.diff(where, axis=0), axis=1)
    assert moved.max() <= (bus.node.catch_up + fastest + LARGEST * T) * T + 2.0 * NEAR, "the pose jumps"
    assert np.abs(where[-1] - places[-1]).max() <= NEAR, "it never arrives"
    smooth, touched = forces(without), forces(seen)
    step = STIFFNESS * (1.0 + RETARDATION / T) * T * T * LARGEST  # of a body whose speed changes by LARGEST in a tick
    usual, jumps = (float(np.abs(np.diff(force[BEFORE:])).max()) for force in (smooth, touched))
    assert jumps <= usual + step + STIFFNESS * bus.node.catch_up * T
    assert abs(touched[-1] - smooth[-1]) < 0.01


def test_the_same_outage_without_age_and_without_following_makes_the_force_jump():
    """The bound from the other side: the device repeats its last place as a new one, and the pose takes the next."""
    worst = 0.0
    for seed in range(SHORT):
        pause, places = drawn(seed)
        repeated = [msgspec.structs.replace(message, delayed=msgspec.UNSET) for message in answers(places, pause)]
        worst = max(worst, float(np.abs(np.diff(forces(poses(repeated, catch_up=1e9)[0])[BEFORE:])).max()))
    assert worst > LARGE


@pytest.mark.parametrize("pause", [0, 3, 5])
def test_without_an_outage_the_pose_is_that_of_the_kinematics_alone(pause):
    """A pause up to the extrapolated time changes nothing but the extrapolated places."""
    assert pause <= HORIZON / T
    _, places = drawn(1)
    given = answers(places, pause)
    (seen, _), (free, _) = poses(given), poses(given, catch_up=1e9)
    assert [pose.position for pose in seen] == [pose.position for pose in free]
    assert [pose.velocity for pose in seen] == [pose.velocity for pose in free]
    assert not FakeBus(Cartesian()).node.notes()


@pytest.mark.parametrize("seed", range(SHORT))
def test_after_an_outage_the_pose_has_the_vector_to_the_device(seed):
    """The place that the device has sent; none before the outage and after the pose has arrived."""
    pause, places = drawn(seed)
    given = answers(places, pause)
    seen, _ = poses(given, origin=(0.01, -0.02, 0.03))
    follows = [tick for tick, pose in enumerate(seen) if len(pose.behind)]
    assert all(tick >= PAUSE_AT for tick in follows) and len(follows) < TICKS - PAUSE_AT
    for tick in follows:
        device = np.add(given[tick].position, (0.01, -0.02, 0.03))
        np.testing.assert_allclose(np.add(seen[tick].position, seen[tick].behind), device, atol=1e-12)
    if float(np.linalg.norm(places[PAUSE_AT + pause] - places[PAUSE_AT - 1])) > 0.01:
        assert follows


def test_the_motors_of_a_falcon_get_the_torques_of_its_place_while_the_pose_follows_it():
    rng = np.random.default_rng(4)
    for _ in range(20):
        place, force = HOME + rng.uniform(-0.02, 0.02, 3), tuple(rng.uniform(-2.0, 2.0, 3))
        behind = rng.uniform(-0.01, 0.01, 3)
        wanted = Force(force=force, state="contact", energy=0.0)
        at, then = (
            FakeBus(FalconStatics(), pose=pose).publish(wanted)[0]
            for pose in (
                Pose(position=tuple(place), velocity=(0.0, 0.0, 0.0), dt=T),
                Pose(position=tuple(place - behind), velocity=(0.0, 0.0, 0.0), dt=T, behind=behind),
            )
        )
        np.testing.assert_allclose(then.torques, at.torques, rtol=1e-9)


def test_the_outage_is_reported_once():
    _, bus = poses(answers(drawn(0)[1], 200))
    assert [note.count("after an outage of the device") for note in bus.node.notes()] == [1] and not bus.node.notes()


def test_a_faster_setting_arrives_earlier():
    places = np.full((TICKS, 3), 0.1)
    places[PAUSE_AT:, 2] = 0.14  # [m] where the hand rests after the outage
    given, arrived = answers(places, 100), []
    for speed in (0.1, 0.3, 1.0):
        seen, _ = poses(given, catch_up=speed)
        away = 0.14 - np.array([pose.position[2] for pose in seen])
        arrived.append(T * (np.flatnonzero(away > 1e-4).max() - PAUSE_AT - 100))
    assert arrived[2] < arrived[1] < arrived[0]
    assert all(
        0.04 / speed < time < 0.04 / speed + 8.0 * LAG for speed, time in zip((0.1, 0.3, 1.0), arrived, strict=True)
    )


def test_the_age_of_a_silent_device_increases_beyond_the_extrapolation():
    sample = DeviceSample(0, position=(0.0, 0.0, 0.0))
    ages = [state(ahead(sample, ((), ()), k * MS)).delayed or 0 for k in range(0, 30, 5)]
    assert ages == [0, 0, 5 * MS, 10 * MS, 15 * MS, 20 * MS]
