"""The kinematics nodes: pose from joint angles, bad samples, torques from a force."""

import numpy as np
import pytest
from falcon_arrays import force as force_of
from falcon_arrays import inverse
from pytest import approx

from palpate.launch.testing import FakeBus
from palpate.messages import DeviceState, Force, MessageError, Pose
from palpate.nodes.kinematics import Cartesian, FalconKinematics, FalconStatics
from palpate.physics.device.falcon import FALCON, HOME

ENCODERS = pytest.mark.parametrize("encoder", [False, True], ids=["exact", "encoder"])
"""Exact angles must be followed exactly, quantized angles of a Falcon within counts."""
STARTS, MOVES = 5.0, 1.75
"""[counts] Largest error of the observer during a jump of the speed, and after 0.1 s at constant speed."""


def device(point, encoder=False, **given) -> DeviceState:
    angles, reach = inverse(point)
    assert reach
    if encoder:
        angles = np.round(angles / FALCON.count) * FALCON.count
    return DeviceState(joints=angles[:, 0], **given)


def tracker(encoder=False, **settings) -> FakeBus:
    return FakeBus(FalconKinematics(**settings) if encoder else FalconKinematics(resolution=0.0, **settings))


def poses(points, bus=None, encoder=False) -> list[Pose]:
    return (bus or tracker(encoder)).publish(*[device(p, encoder) for p in points])


def off(pose, point) -> float:
    """Largest distance [counts] of the pose from the point, over the legs."""
    return np.abs(inverse(pose.position)[0] - inverse(point)[0]).max() / FALCON.count


def glide(count: int, speed: float = 0.1) -> np.ndarray:
    """Points [m] (count, 3) along x at a constant speed, 1 ms apart."""
    points = np.tile((-0.01, 0.005, 0.11), (count, 1))
    points[:, 0] += speed * 1e-3 * np.arange(count)
    return points


def test_position_and_velocity_follow_the_grip():
    points = glide(30)
    motion = poses(points)
    for point, pose in zip(points, motion, strict=True):
        assert pose.position == approx(point, abs=1e-9)
    assert motion[0].velocity == (0.0, 0.0, 0.0) and motion[0].dt == 0.0
    assert motion[-1].velocity == approx((0.1, 0.0, 0.0), abs=1e-6) and motion[-1].dt == approx(1e-3)


@pytest.mark.parametrize("speed", [0.1, -0.04])
def test_an_encoder_is_followed_within_its_counts(speed):
    points = glide(200, speed)
    motion = poses(points, encoder=True)
    apart = np.array([off(pose, point) for pose, point in zip(motion, points, strict=True)])
    assert motion[0].velocity == (0.0, 0.0, 0.0) and motion[0].dt == 0.0
    assert apart.max() < STARTS and apart[100:].max() < MOVES
    velocity = np.array([pose.velocity for pose in motion[100:]])
    assert np.abs(velocity - (speed, 0.0, 0.0)).max() < 0.1 * abs(speed)
    path = np.array([pose.position for pose in motion])
    ways = np.array([np.multiply(pose.velocity, pose.dt) for pose in motion[1:]])
    assert path[0] + np.cumsum(ways, axis=0) == approx(path[1:], abs=1e-12), "velocity integrates to position"


def test_the_origin_places_the_device_in_the_world():
    (pose,) = poses([HOME], FakeBus(FalconKinematics(origin=(0.1, -0.2, 0.3))))
    assert pose.position == approx((0.1, -0.2, 0.41))


@ENCODERS
@pytest.mark.parametrize("leg", [0, 1, 2])
@pytest.mark.parametrize("sign", [1, -1])
def test_an_encoder_glitch_is_rejected(leg, sign, encoder):
    """All later values are bit-equal to those after a lost sample."""
    points = glide(160)
    states = [device(p, encoder) for p in points]
    bad = list(states[120].joints)
    bad[leg] += sign * 1000 * FALCON.count
    motion = tracker(encoder).publish(*states[:120], DeviceState(joints=bad), *states[121:])
    assert motion[120].position == motion[119].position and motion[120].dt == 0.0
    assert motion[120].velocity == motion[119].velocity
    lost = tracker(encoder)
    before = lost.publish(*states[:120])
    lost.drop(1)
    after = lost.publish(*states[120:])
    assert [(p.position, p.velocity, p.dt) for p in motion if p.dt or p is motion[0]] == [
        (p.position, p.velocity, p.dt) for p in before + after
    ]
    assert motion[121].dt == approx(2e-3)
    apart = max(off(pose, point) for pose, point in zip(motion[121:], points[121:], strict=True))
    speeds = [np.linalg.norm(p.velocity) for p in motion[110:]]
    if encoder:
        assert apart < MOVES and max(speeds) < 0.11
    else:
        assert apart < 1e-6 and max(speeds) == approx(0.1, abs=1e-6)


def test_a_real_jump_is_accepted_after_four_samples_and_followed():
    there = np.tile((0.03, 0.0, 0.12), (600, 1))
    motion = poses([*glide(20), *there])
    assert [f.position == motion[19].position for f in motion[20:25]] == [True, True, True, True, False]
    assert motion[23].velocity == (0.0, 0.0, 0.0)
    assert max(np.linalg.norm(f.velocity) for f in motion[23:]) < 1.01 * FalconKinematics.catch_up
    assert motion[-1].position == approx(there[0], abs=1e-9) and motion[-1].velocity == approx((0, 0, 0), abs=1e-6)


def test_inconsistent_samples_are_never_accepted():
    rng = np.random.default_rng(0)
    wild = rng.uniform((-0.05, -0.05, 0.09), (0.05, 0.05, 0.14), (60, 3))
    keep = [wild[0]]
    for p in wild[1:]:
        if np.linalg.norm(p - keep[-1]) > 0.02 and np.linalg.norm(p - glide(20)[-1]) > 5 * 1e-3 * (len(keep) + 1):
            keep.append(p)
    motion = poses([*glide(20), *keep[1:7]])
    assert len({f.position for f in motion[19:]}) == 1


@ENCODERS
def test_a_fast_hand_is_not_a_glitch(encoder):
    """From rest to 4 m/s within one sample: no sample is rejected. The observer cannot follow the speed at once."""
    motion = poses(glide(8, speed=4.0), encoder=encoder)
    assert [pose.dt for pose in motion[1:]] == approx([1e-3] * 7)
    assert motion[-1].velocity[0] == approx(4.0, rel=0.1 if encoder else 1e-6)


def test_angles_without_a_position_do_not_change_the_pose():
    impossible = DeviceState(joints=(-1.5, 1.5, 3.0))
    bus = FakeBus(FalconKinematics())
    (first,) = bus.publish(impossible)
    assert first.position == approx(HOME)
    before = poses(glide(20), bus)[-1]
    for pose in bus.publish(*[impossible] * 5):
        assert pose.position == before.position and np.all(np.isfinite(pose.velocity))


@ENCODERS
def test_doubled_reordered_and_late_samples_are_not_differentiated(encoder):
    near = 0.01 if encoder else 1e-6  # [m/s] from the hand's 0.1
    bus = tracker(encoder)
    points = glide(160)
    poses(points[:120], bus, encoder)
    bus.twice()
    one, two = bus.publish(device(points[120], encoder))
    assert two.dt == one.dt == approx(1e-3) and two.velocity == one.velocity == approx((0.1, 0, 0), abs=near)
    assert two.position == one.position
    bus.swap()
    newer, older = bus.publish(device(points[121], encoder), device(points[122], encoder))
    assert off(newer, points[122]) < (MOVES if encoder else 1e-6) and older.position == newer.position
    assert older.velocity == newer.velocity == approx((0.1, 0, 0), abs=near)
    bus.late(0.5e-3)
    motion = bus.publish(*[device(p, encoder) for p in points[123:]])
    assert motion[0].dt == approx(1.5e-3) and motion[1].dt == approx(0.5e-3)
    speeds = [np.linalg.norm(f.velocity) for f in motion]
    # By these stamps the hand was slow, then fast; this applies to differences of exact positions, not to the observer.
    assert max(speeds) < 0.11 if encoder else speeds == approx([0.1 / 1.5, 0.2] + [0.1] * 35, abs=1e-6)


@ENCODERS
def test_lost_samples_are_bridged_by_their_stamps(encoder):
    bus = tracker(encoder)
    points = glide(160)
    poses(points[:120], bus, encoder)
    bus.drop(3)
    motion = bus.publish(*[device(p, encoder) for p in points[120:]])
    assert motion[0].dt == approx(4e-3)
    assert all(f.velocity == approx((0.1, 0, 0), abs=0.01 if encoder else 1e-6) for f in motion)


def test_a_device_that_is_not_homed_holds_the_last_pose_and_restarts():
    bus = FakeBus(FalconKinematics())
    before = poses(glide(20), bus)[-1]
    (lost,) = bus.publish(device((0.03, 0.02, 0.12), homed=False))
    assert lost.position == before.position and lost.velocity == (0.0, 0.0, 0.0) and lost.dt == 0.0
    again = poses([(0.03, 0.02, 0.12)] * 600, bus)
    assert again[0].position == before.position and again[0].velocity == (0.0, 0.0, 0.0)
    assert max(np.linalg.norm(f.velocity) for f in again) < 1.01 * FalconKinematics.catch_up
    assert again[-1].position == approx((0.03, 0.02, 0.12)) and again[-1].velocity == approx((0, 0, 0), abs=1e-9)


def test_an_unsuitable_device_is_an_error_with_the_right_node():
    with pytest.raises(MessageError, match=r"found 0 angles, expected 3 .*kinematics\.Cartesian"):
        FakeBus(FalconKinematics()).publish(DeviceState(position=(0, 0, 0)))
    with pytest.raises(MessageError, match=r"found 0 numbers, expected 3 .*kinematics\.Falcon"):
        FakeBus(Cartesian()).publish(DeviceState(joints=(0, 0, 0)))


def test_a_device_that_reports_a_position_gets_the_same_filter():
    points = glide(30)
    bus = FakeBus(Cartesian(origin=(0.0, 0.0, 1.0)))
    motion = bus.publish(*[DeviceState(position=p) for p in points])
    assert motion[-1].position == approx(points[-1] + (0, 0, 1.0))
    assert motion[-1].velocity == approx((0.1, 0, 0), abs=1e-9)


def test_a_position_that_is_not_finite_is_ignored():
    bus = FakeBus(Cartesian())
    for bad in (float("nan"), float("inf")):
        (pose,) = bus.publish(DeviceState(position=(bad, 0.0, 0.0)))
        assert pose.position == (0.0, 0.0, 0.0)


def pushed(force, position, **settings) -> np.ndarray:
    node = FakeBus(FalconStatics(**settings), pose=Pose(position=position, velocity=(0, 0, 0), dt=1e-3))
    return np.array(node.publish(Force(force=force, state="contact", energy=0.0))[0].torques)


def test_torques_give_the_force_at_the_pose():
    wish = np.array([0.5, -0.3, 2.0])
    for origin in [(0.0, 0.0, 0.0), (0.2, 0.1, -0.05)]:
        inside = np.array((0.01, -0.02, 0.12))
        torques = pushed(wish, inside + origin, origin=origin)
        assert force_of(torques, inside)[0] == approx(wish, abs=1e-12)


def test_a_limited_force_keeps_its_direction():
    wish = np.array([20.0, -10.0, 40.0])
    torques = pushed(wish, HOME)
    assert np.abs(torques).max() == approx(FALCON.limit, rel=1e-12)
    force = force_of(torques, HOME)[0]
    assert force / np.linalg.norm(force) == approx(wish / np.linalg.norm(wish), abs=1e-9)


def test_the_torque_is_zero_without_a_force_or_at_an_impossible_position():
    assert np.all(pushed((1, 1, 1), (0, 0, 9.0)) == 0.0)
    bus = FakeBus(FalconStatics(), pose=Pose(position=HOME, velocity=(0, 0, 0), dt=1e-3))
    assert bus.run()[0].torques == (0.0, 0.0, 0.0)
