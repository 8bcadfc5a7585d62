"""The collision nodes: gap, approach, slip, and difficult points of a surface."""

import numpy as np
import pytest
from formulas import outward_normal
from pytest import approx

from palpate.launch.testing import FakeBus
from palpate.messages import Pose
from palpate.nodes.base import SettingError
from palpate.nodes.base.surface import PLACE, surface_mesh, surface_patch
from palpate.nodes.collision import Mesh, Nurbs
from palpate.physics.geometry.closest import ClosestPoint
from palpate.physics.geometry.proxy import SUDDEN

BOTH = pytest.mark.parametrize("kind", [Nurbs, Mesh])


def pose(position, velocity=(0.0, 0.0, 0.0)):
    return Pose(position=tuple(map(float, position)), velocity=tuple(map(float, velocity)), dt=1e-3)


def send(node, path):
    return FakeBus(node).publish(*map(pose, path))


@BOTH
def test_the_approach_begins_at_the_tissue_thickness(kind):
    z = np.array([0.02, 0.0041, 0.004, 0.003, 0.0, -0.002])
    path = np.stack([0 * z, 0 * z, 0.01 + z], axis=1)
    for answer, gap in zip(send(kind(surface="plane", position=(0, 0, 0.01)), path), z, strict=True):
        assert answer.gap == approx(gap, abs=1e-12)
        assert answer.approach == approx(max(0.0, 4e-3 - gap), abs=1e-12)
        assert answer.normal == approx((0, 0, 1))
    (answer,) = send(kind(surface="plane", position=(0, 0, 0), thickness=0.0), [(0, 0, 1e-3)])
    assert answer.approach == 0.0


@BOTH
def test_the_slip_is_the_tangential_part_of_the_velocity(kind):
    bus = FakeBus(kind())
    position = (0.03, 0.01, 0.1)
    (answer,) = bus.publish(pose(position, (0.3, -0.2, -0.5)))
    n, v = np.array(answer.normal), np.array([0.3, -0.2, -0.5])
    np.testing.assert_allclose(answer.slip, v - (v @ n) * n, atol=1e-15)
    assert np.dot(answer.slip, n) == approx(0, abs=1e-12)


@BOTH
def test_at_the_default_pose_a_finger_at_the_centre_touches_slightly_below(kind):
    high, low = send(kind(), [(0, 0, 0.110), (0, 0, 0.108)])
    assert high.approach == 0.0 and low.approach > 5e-4
    assert low.normal[2] > 0.99


@BOTH
def test_position_and_rotation_move_the_surface_equally_for_every_node(kind):
    turn = (0.0, 0.0, np.pi / 2)
    moved, still = kind(position=(0.05, -0.02, 0.1), rotation=turn), kind(position=(0, 0, 0))
    p = np.array([0.02, 0.011, 0.024])
    (a,) = send(moved, [np.array([-p[1], p[0], p[2]]) + (0.05, -0.02, 0.1)])
    (b,) = send(still, [p])
    assert a.gap == approx(b.gap, abs=1e-12)
    assert a.normal == approx((-b.normal[1], b.normal[0], b.normal[2]), abs=1e-9)


def test_the_two_nodes_agree_as_the_mesh_gets_finer():
    path = np.array(PLACE) + np.random.default_rng(1).uniform(-0.05, 0.05, (200, 3))
    exact = np.array([a.gap for a in send(Nurbs(), path)])
    errors = [np.abs([a.gap for a in send(Mesh(vertices=n), path)] - exact).max() for n in (1000, 16000)]
    assert errors[1] < 5e-5
    assert errors[0] / errors[1] > 8


@BOTH
@pytest.mark.parametrize("seed", range(2))
def test_the_gap_never_changes_faster_than_the_finger_moves(kind, seed):
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 1, 1500)[:, None]
    a, b = rng.normal(size=(2, 4, 3)) * 0.015
    path = np.array(PLACE) + np.sin(2 * np.pi * t * np.arange(1, 5)) @ a + np.cos(2 * np.pi * t * np.arange(1, 5)) @ b
    gap = np.array([x.gap for x in send(kind(), path)])
    assert (np.abs(np.diff(gap)) - np.linalg.norm(np.diff(path, axis=0), axis=1)).max() <= 1e-9


@BOTH
def test_inside_the_gap_is_negative_and_the_normal_still_points_out(kind):
    patch = surface_patch("kidney", PLACE)
    foot, normal = patch(0.25, 0.45), outward_normal(patch, 0.25, 0.45)
    for depth in (1e-3, 5e-3):
        (answer,) = send(kind(vertices=20000) if kind is Mesh else kind(), [foot - depth * normal])
        assert answer.gap == approx(-depth, abs=3e-5)
        assert np.dot(answer.normal, normal) > 0.999


def test_the_normal_rotates_continuously_over_seam_and_poles():
    patch = surface_patch("kidney", PLACE)
    v = np.linspace(-0.02, 0.02, 800)
    over_pole = [
        patch(0.1 if x > 0 else 0.6, abs(x)) + 3e-3 * outward_normal(patch, 0.1 if x > 0 else 0.6, abs(x)) for x in v
    ]
    u = np.linspace(-0.05, 0.05, 800)
    over_seam = patch(u, np.full(800, 0.3)) + 3e-3 * outward_normal(patch, u, np.full(800, 0.3))
    for path in (np.array(over_pole), over_seam):
        normal = np.array([a.normal for a in send(Nurbs(), path)])
        moved = np.linalg.norm(np.diff(path, axis=0), axis=1)
        assert (np.linalg.norm(np.diff(normal, axis=0), axis=1) <= moved / 3e-3 + 1e-7).all()


@BOTH
def test_crossing_the_middle_inside_turns_the_normal_once_and_no_faster_than_the_finger_moves(kind):
    """From one half of the kidney to the other, at a depth of 20 mm: the nearest point leaps by 40 mm."""
    z = np.linspace(3e-3, -20e-3, 1000)
    path = np.array(PLACE) + np.stack([0 * z, 0 * z + 0.004, z], axis=1)
    answers = send(kind(), path)
    normal = np.array([a.normal for a in answers])
    moved, approach = -np.diff(z), np.array([a.approach for a in answers])[:-1]
    turned = np.linalg.norm(np.diff(normal, axis=0), axis=1)
    assert (turned <= 1.02 * moved / (SUDDEN * approach) + 1e-6).all()
    assert normal[0, 2] > 0.9 and (np.diff(normal[:, 2]) < 1e-3).all()
    gap = np.array([a.gap for a in answers])
    assert np.abs(np.diff(gap)).max() <= np.abs(np.diff(z)).max() + 1e-9


@BOTH
def test_the_coordinates_lead_back_to_the_foot(kind):
    (answer,) = send(kind(), [(0.02, 0.01, 0.11)])
    if kind is Nurbs:
        foot = surface_patch("kidney", PLACE)(*answer.coordinates)
        assert answer.element == 0
    else:
        mesh = surface_mesh("kidney", 3000, PLACE)
        v, w = answer.coordinates
        a, b, c = mesh.vertices[mesh.triangles[answer.element]]
        foot = (1 - v - w) * a + v * b + w * c
    assert foot == approx(answer.foot, abs=1e-12)


@BOTH
def test_extreme_positions_give_finite_results_without_later_effect(kind):
    bus = FakeBus(kind())
    (before,) = bus.publish(pose((0.01, 0, 0.108)))
    bus.publish(pose((1e12, 0, 0)), pose((0, -1e300, 5)), pose(PLACE), pose((1e-300, 0, 0)))
    (after,) = bus.publish(pose((0.01, 0, 0.108)))
    assert after.gap == approx(before.gap, abs=1e-12)
    assert after.foot == approx(before.foot, abs=1e-8)


@BOTH
def test_dropped_repeated_and_late_samples_change_nothing(kind):
    path = [(0.001 * k, 0.0, 0.108) for k in range(6)]
    expected = [a.gap for a in send(kind(), path)]
    bus = FakeBus(kind())
    bus.drop()
    bus.publish(pose(path[0]))
    bus.twice()
    first, second = bus.publish(pose(path[1]))
    assert (first.gap, second.gap) == approx((expected[1], expected[1]), abs=1e-12)
    bus.swap()
    newer, late = bus.publish(pose(path[2]), pose(path[3]))
    assert newer.gap == late.gap == approx(expected[3], abs=1e-12)
    (after,) = bus.publish(pose(path[4]))
    assert after.gap == approx(expected[4], abs=1e-12)


@BOTH
def test_start_is_a_reset_and_runs_repeat_to_the_byte(kind):
    path = [(0.02 * np.sin(k / 20), 0.01 * np.cos(k / 9), 0.106) for k in range(200)]
    node = kind()
    assert send(node, path) == send(node, path) == send(kind(), path)


@pytest.mark.parametrize(
    "given", [{"thickness": 0.06}, {"thickness": -1e-3}, {"hysteresis": -1.0}, {"position": (1, 2)}, {"thikness": 1e-3}]
)
@BOTH
def test_settings_out_of_their_limits_are_errors(kind, given):
    with pytest.raises(SettingError, match=next(iter(given))):
        kind(**given)


@BOTH
def test_an_unknown_surface_is_an_error_at_the_start(kind):
    with pytest.raises(SettingError, match="kidny"):
        kind(surface="kidny").start()


@BOTH
@pytest.mark.parametrize("name", ["position", "rotation"])
def test_a_position_that_is_not_finite_is_an_error(kind, name):
    with pytest.raises(SettingError, match=f"{name}.*finite"):
        kind(**{name: (0.0, float("nan"), 0.0)}).start()


def test_every_foot_is_on_the_surface_with_the_connection_along_the_normal():
    path = np.array(PLACE) + np.random.default_rng(2).uniform(-0.07, 0.07, (300, 3))
    closest = ClosestPoint(surface_patch("kidney", PLACE))
    for p, answer in zip(path, send(Nurbs(hysteresis=0.0), path), strict=True):
        foot, normal = np.array(answer.foot), np.array(answer.normal)
        np.testing.assert_allclose(p - foot, answer.gap * normal, atol=1e-9)
        assert abs(closest.find(foot)[3]) <= 1e-9


@BOTH
@pytest.mark.parametrize("height", [3e-3, 1e-3, 0.0, -2e-3, -6e-3])
def test_contact_ends_beyond_the_border_of_a_plate(kind, height):
    """The plate ends at x = 50 mm: a finger slides off, above it or pressed in."""
    x = np.linspace(0.03, 0.09, 1200)
    path = np.concatenate([[(0.03, 0.002, z) for z in np.linspace(5e-3, height, 200)], [(a, 0.002, height) for a in x]])
    answers = send(kind(surface="plane", position=(0, 0, 0)), path)
    gap = np.array([a.gap for a in answers])
    assert gap[path[:, 0] <= 0.05] == approx(path[path[:, 0] <= 0.05, 2], abs=1e-9)
    assert (np.abs(np.diff(gap)) <= np.linalg.norm(np.diff(path, axis=0), axis=1) + 1e-12).all()
    assert answers[-1].approach == 0.0 and gap[-1] > 4e-3
    normal = np.array([a.normal for a in answers])
    assert (normal[:, 2] > -0.6).all()
    if height > 0:
        beside = path[:, 0] > 0.05
        assert gap[beside] == approx(np.hypot(path[beside, 0] - 0.05, height), abs=1e-7)


@pytest.mark.parametrize("lost", [0, 17, 40])
def test_a_finger_deep_inside_moves_its_foot_after_lost_samples(lost):
    """Regression at 120 mm/s, deeper in the kidney than 25 % of its width: the foot stayed behind, then moved 13 mm in
    one step, and the contact had 36 N."""
    node = FakeBus(Nurbs())
    for z in np.linspace(0.12, 0.091, 60):  # from outside
        node.publish(Pose(position=(0.0, 0.0, z), velocity=(0.0, 0.0, -0.5), dt=1e-3))
    far = 0.0
    for tick in range(150):
        x = 0.12e-3 * tick
        if not 20 <= tick < 20 + lost:
            (seen,) = node.publish(Pose(position=(x, 0.0, 0.091), velocity=(0.12, 0.0, 0.0), dt=1e-3))
            far = max(far, abs(seen.foot[0] - x))
    assert far < 4e-3
