"""Grip and load force: two opposed fingers in closed form, any number by the pseudo-inverse of the grasp matrix."""

import numpy as np
import pytest
from pytest import approx
from scipy.spatial.transform import Rotation

from palpate.launch.testing import FakeBus
from palpate.messages import Load
from palpate.nodes.contact.grip import Grip
from palpate.physics.contact.grip import grip_force, internal_forces

TURNED = Rotation.from_rotvec([0.4, -1.1, 2.3]).as_matrix()
FRAMES = {"identity": np.eye(3), "rotated": TURNED, "mirrored": np.diag([1.0, -1.0, 1.0]) @ TURNED}


def load(foot, normal, force, frame=FRAMES["identity"]):
    forces = np.array([0.3, 0.7])[:, None] * np.asarray(force, float)
    foot, normal = (tuple((frame @ np.asarray(v, float)).tolist()) for v in (foot, normal))
    return Load(nodes=np.array([3, 8], np.int32), forces=forces @ frame.T, foot=foot, normal=normal)


def held(*loads, **settings):
    (answer,) = FakeBus(Grip(**settings)).publish(list(loads))
    return answer


def started():
    grip = Grip()
    grip.start()
    return grip


def projected(points, forces):
    """f - G^+ G f, with the grasp matrix written out."""
    grasp = np.hstack([np.vstack([np.eye(3), np.cross(p, np.eye(3)).T]) for p in points])
    f = forces.ravel()
    return (f - np.linalg.pinv(grasp) @ (grasp @ f)).reshape(-1, 3)


@pytest.mark.parametrize("frame", FRAMES.values(), ids=FRAMES)
def test_two_opposed_fingers_lift_with_grip_and_load(frame):
    squeeze, lift, mu = 2.0, 0.6, 0.5
    answer = held(
        load([0, -0.03, 0], [0, -1, 0], [0, squeeze, lift], frame),
        load([0, 0.03, 0], [0, 1, 0], [0, -squeeze, lift], frame),
        mu_static=mu,
    )
    assert answer.grip == approx(squeeze) and answer.load == approx(2 * lift)
    assert answer.ratio == approx(lift / squeeze)
    assert answer.normal == approx((squeeze,) * 2) and answer.tangential == approx((lift,) * 2)
    assert answer.margin == approx((squeeze - lift / mu,) * 2)


def test_slip_begins_at_the_coefficient_of_friction():
    mu, squeeze = 0.7, 1.3
    at = [load([0, s * 0.02, 0], [0, s, 0], [mu * squeeze, -s * squeeze, 0]) for s in (-1, 1)]
    answer = held(*at, mu_static=mu)
    assert answer.ratio == approx(mu) and answer.margin == approx((0.0, 0.0), abs=1e-12)


def test_the_weaker_finger_has_the_grip_minus_half_of_the_difference():
    answer = held(load([-0.02, 0, 0], [-1, 0, 0], [3, 0, 0]), load([0.02, 0, 0], [1, 0, 0], [-1, 0, 0]))
    assert answer.grip == approx(2.0) and answer.load == approx(0.0, abs=1e-15)
    assert answer.normal == approx((3.0, 1.0))


def test_parallel_fingers_have_no_grip_and_a_negative_one_when_moved_apart():
    down = [load([x, 0, 0], [0, 0, 1], [0, 0, -1.5]) for x in (-0.01, 0.01)]
    assert held(*down).grip == approx(0.0, abs=1e-12)
    apart = [load([x, 0, 0], [0, 0, 1], [0.4 * np.sign(x), 0, -1.5]) for x in (-0.01, 0.01)]
    answer = held(*apart)
    assert answer.grip == approx(-0.4) and answer.ratio == 0.0 and answer.load == approx(0.0, abs=1e-15)


def test_a_finger_without_contact_or_message_is_ignored():
    pair = [load([0, s * 0.02, 0], [0, s, 0], [0.1, -s, 0.2]) for s in (-1, 1)]
    idle = Load(nodes=np.zeros(0, np.int32), forces=np.zeros((0, 3)), foot=(9.0, 0.0, 0.0), normal=(1.0, 0.0, 0.0))
    two, three, less = held(*pair), held(idle, *pair), started().step([pair[0], None, pair[1]])
    assert (
        (two.grip, two.load, two.ratio) == (three.grip, three.load, three.ratio) == (less.grip, less.load, less.ratio)
    )
    assert three.normal == (0.0, *two.normal) and less.margin == (two.margin[0], 0.0, two.margin[1])
    nothing = held(idle, idle)
    assert (nothing.grip, nothing.load, nothing.ratio, nothing.normal) == (0.0, 0.0, 0.0, (0.0, 0.0))


@pytest.mark.parametrize("count", [1, 2, 3, 5])
def test_internal_forces_are_the_null_space_projection_of_the_grasp_matrix(count):
    random = np.random.default_rng(count)
    for _ in range(20):
        points, forces = random.normal(0, 0.03, (count, 3)), random.normal(0, 1, (count, 3))
        internal, _ = internal_forces(points, forces)
        assert internal == approx(projected(points, forces), abs=1e-9)
        assert internal.sum(axis=0) == approx(np.zeros(3), abs=1e-12)
        assert np.cross(points, internal).sum(axis=0) == approx(np.zeros(3), abs=1e-12)
        moved = points @ TURNED.T + [1.0, -2.0, 3.0]
        assert grip_force(moved, forces @ TURNED.T) == approx(grip_force(points, forces), rel=1e-9)


def test_collinear_and_coincident_points_are_handled():
    line = np.outer([-0.03, 0.01, 0.02], [0.6, 0.0, 0.8])
    forces = np.array([[1.0, 0.2, 0.3], [-0.4, 0.1, 0.0], [-0.6, -0.3, -0.3]])
    assert internal_forces(line, forces)[0] == approx(projected(line, forces), abs=1e-9)
    same = np.zeros((2, 3))
    assert np.isfinite(internal_forces(same, forces[:2])[0]).all() and np.isfinite(grip_force(same, forces[:2]))


def test_a_thumb_opposed_to_four_fingers_grips_with_its_force():
    feet = [(0, -0.03, 0), *((x, 0.03, 0) for x in (-0.03, -0.01, 0.01, 0.03))]
    forces = [(0, 4.0, 0), *(((0, -1.0, 0),) * 4)]
    loads = [load(p, (0, -np.sign(f[1]), 0), f) for p, f in zip(feet, forces, strict=True)]
    assert held(*loads).grip == approx(4.0)
