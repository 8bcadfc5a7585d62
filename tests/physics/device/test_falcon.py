"""Kinematics and statics of the Falcon: published constants, finite differences, virtual work, hard poses."""

import mpmath
import numpy as np
import pytest
from falcon_arrays import counts, force, forward, inverse, rates, torque
from formulas import angles_of
from pytest import approx

from palpate.physics.device.falcon import FALCON, HOME, leg, links, newton, reachable
from palpate.physics.device.falcon_statics import invert_lever, saturate, solve_damped

CENTRE = (0.0, 0.0, 0.11)
TABLE = [
    (CENTRE, (16.1880,) * 3, (-516,) * 3, [[15.488, -52.725, 37.237], [-51.940, 12.557, 39.383], [24.180] * 3]),
    (
        (0.03, 0.0, 0.11),
        (26.6885, -1.2173, 33.9661),
        (-228, -994, -28),
        [[17.150, -40.548, 43.621], [-56.569, 10.302, 47.678], [19.090, 38.103, 11.469]],
    ),
    (
        (-0.02, 0.015, 0.13),
        (21.7911, 46.6270, 32.8074),
        (-363, 319, -60),
        [[16.742, -73.181, 44.769], [-54.078, 15.574, 45.520], [36.430, 9.215, 26.961]],
    ),
]


def workspace(count: int, seed: int = 0) -> np.ndarray:
    """Points [m] (count, 3) inside the workspace of the grip, away from its border."""
    box = np.random.default_rng(seed).uniform((-0.05, -0.05, 0.08), (0.05, 0.05, 0.16), (4 * count, 3))
    return box[inverse(box)[1]][:count]


@pytest.mark.parametrize(("point", "angles", "encoder", "torques"), TABLE)
def test_angles_counts_and_torques_agree_with_the_table(point, angles, encoder, torques):
    joints, reach = inverse(point)
    assert reach
    assert np.degrees(joints[:, 0]) == approx(angles, abs=6e-5)
    assert tuple(counts(joints[:, 0])) == encoder
    for axis, expected in enumerate(torques):
        assert torque(np.eye(3)[axis], point)[0] * 1e3 == approx(expected, abs=6e-4)


def test_zero_counts_correspond_to_a_point_on_the_axis():
    point, ok = forward(angles_of([0, 0, 0]))
    assert ok and point == approx((0.0, 0.0, 0.134602), abs=1e-6)
    assert FALCON.count == approx(6.359047630e-4, rel=1e-9)
    assert tuple(counts(angles_of([-516, 0, 32767]))) == (-516, 0, 32767)


def test_the_closed_form_satisfies_the_loop_equations_of_each_leg():
    f = FALCON
    for point in workspace(50):
        for phi, (t1, t2, t3) in zip(f.phi, inverse(point)[0], strict=True):
            x, y, z = point
            length = f.d + f.e + f.b * np.sin(t3)
            u = f.a * np.cos(t1) - f.c + length * np.cos(t2)
            assert np.cos(phi) * x + np.sin(phi) * y - f.r == approx(u, abs=1e-15)
            assert -np.sin(phi) * x + np.cos(phi) * y - f.s + f.f == approx(f.b * np.cos(t3), abs=1e-15)
            assert z == approx(f.a * np.sin(t1) + length * np.sin(t2), abs=1e-15)


def test_forward_inverts_inverse_within_a_nanometre():
    rng = np.random.default_rng(1)
    for point in workspace(400):
        for start in (HOME, point + rng.normal(0.0, 1e-3, 3)):
            position, ok = forward(inverse(point)[0][:, 0], start)
            assert ok and np.abs(position - point).max() <= 1e-9


def test_forward_converges_from_a_start_out_of_reach():
    position, ok = forward(inverse(CENTRE)[0][:, 0], start=(1.0, -2.0, 5.0))
    assert ok and position == approx(CENTRE, abs=1e-9)


def test_rates_are_the_derivative_of_the_angles():
    step = 1e-6
    for point in workspace(100):
        difference = np.empty((3, 3))
        for axis, unit in enumerate(np.eye(3)):
            ahead, behind = (inverse(point + s * step * unit)[0][:, 0] for s in (1, -1))
            difference[:, axis] = (ahead - behind) / (2.0 * step)
        exact = rates(point)
        assert np.abs(exact - difference).max() <= 1e-6 * np.abs(exact).max()


def test_the_power_of_the_torques_equals_that_of_the_force():
    rng = np.random.default_rng(2)
    for point in workspace(100):
        push, motion = rng.normal(size=3) * 0.1, rng.normal(size=3)
        torques, _ = torque(push, point)
        ahead, behind = (inverse(point + s * 1e-6 * motion)[0][:, 0] for s in (1, -1))
        assert torques @ (ahead - behind) / 2e-6 == approx(push @ motion, rel=1e-5, abs=1e-7)
        assert force(torques, point)[0] == approx(push, abs=1e-12)


def test_the_reach_on_the_axis_has_its_limits():
    for z, expected in [(0.0595, False), (0.0605, True), (0.1825, True), (0.1835, False)]:
        assert inverse((0.0, 0.0, z))[1] == expected


@pytest.mark.parametrize(
    "point", [(0.3, 0, 0.1), (0, 0, 0), (0, 0, 10.0), (1e300, 0, 0), (np.nan, 0, 0.1), (0, np.inf, 0.1)]
)
def test_a_point_out_of_reach_is_flagged_without_nan(point):
    angles, reach = inverse(point)
    assert not reach and np.all(angles == 0.0)
    assert torque((1.0, 2.0, 3.0), point)[1] is False
    assert np.all(torque((1.0, 2.0, 3.0), point)[0] == 0.0)
    assert np.all(force((0.1, 0.1, 0.1), point)[0] == 0.0)


@pytest.mark.parametrize("angles", [(-1.5, 1.5, 3.0), (3.1, 3.1, 3.1), (np.nan, 0, 0), (np.inf, 0, 0), (1e300, 0, 0)])
def test_angles_without_a_position_are_flagged(angles):
    position, ok = forward(angles)
    assert not ok and np.all(np.isfinite(position))


def test_a_point_that_one_or_two_legs_reach_is_out_of_reach():
    box = np.random.default_rng(3).uniform((-0.1, -0.1, 0.0), (0.1, 0.1, 0.2), (300, 3))
    legs = np.array([[leg(FALCON.geometry, i, *point)[0] for i in range(3)] for point in box])
    for only in ([1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [1, 0, 1], [0, 1, 1]):
        point = box[(legs == only).all(axis=1)][0]
        assert not inverse(point)[1] and not reachable(FALCON.geometry, *point)
        assert torque((1.0, 2.0, 3.0), point)[1] is False
        assert np.all(force((0.1, 0.1, 0.1), point)[0] == 0.0)
        position, ok = forward(inverse(CENTRE)[0][:, 0], start=point)  # an unusable start
        assert ok and position == approx(CENTRE, abs=1e-9)


def test_driven_angles_are_within_half_a_turn_also_behind_the_device():
    behind = np.random.default_rng(4).uniform((-0.1, -0.1, -0.2), (0.1, 0.1, 0.0), (400, 3))
    angles = inverse(behind[inverse(behind)[1]])[0][..., 0]
    assert angles.size > 200 and np.pi - 0.1 < angles.max() <= np.pi and -np.pi < angles.min() < -np.pi + 0.2


def test_forward_accepts_angles_of_any_turn_and_an_exact_start():
    for point in workspace(20):
        angles = inverse(point)[0][:, 0]
        for turns in ((1, 0, -1), (-2, 3, 0)):
            position, ok = forward(angles + 2.0 * np.pi * np.array(turns))
            assert ok and position == approx(point, abs=1e-9)
        assert forward(angles, point)[0] == approx(point, abs=1e-15)


def test_forward_converges_from_the_border_of_the_workspace():
    box = np.random.default_rng(5).uniform((-0.09, -0.09, 0.05), (0.09, 0.09, 0.19), (2000, 3))
    edges = box[inverse(box)[1] & ~inverse(1.08 * box)[1]][:40]
    for start, point in zip(edges, workspace(40), strict=True):
        position, ok = forward(inverse(point)[0][:, 0], start)
        assert ok and position == approx(point, abs=1e-9)


@pytest.mark.parametrize(
    ("start", "point"),
    [((0.0193, -0.0483, 0.1442), (-0.0478, -0.0903, 0.0757)), ((0.0581, -0.0604, 0.1403), (0.0078, -0.0078, 0.1567))],
)
def test_a_step_out_of_reach_is_halved(start, point):
    ok, *found = newton(FALCON.geometry, *inverse(point)[0][:, 0], *start)
    assert ok and found == approx(point, abs=1e-9)


def test_the_damped_inverse_is_the_least_squares_solution():
    rng = np.random.default_rng(6)
    for damping in (0.0, 0.05, 0.7):
        rows = rng.normal(size=(3, 3))
        rows /= np.linalg.norm(rows, axis=1)[:, None]
        push = rng.normal(size=3)
        exact = np.linalg.solve(rows @ rows.T + damping**2 * np.eye(3), rows @ push)
        assert solve_damped(*map(tuple, rows), tuple(push), damping) == approx(exact, rel=1e-9)
    assert solve_damped((1.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 2.0, 3.0), 0.0) == (0.0, 0.0, 0.0)


def test_the_inverse_of_a_short_lever_goes_to_zero_with_its_length():
    assert [invert_lever(lever) for lever in (2e-3, 1e-3, 5e-4, 0.0, -5e-4)] == approx(
        [500.0, 1000.0, 500.0, 0.0, -500.0]
    )


@pytest.mark.parametrize("torques", [(np.inf, 0.0, 0.0), (0.0, np.nan, 0.0), (0.0, 0.1, -np.inf)])
def test_torques_that_are_not_finite_are_rejected(torques):
    assert saturate(*torques, 0.2) == (0.0, 0.0, 0.0)


def test_inverse_accepts_arrays():
    points = np.array([[CENTRE, (0.3, 0, 0.1)], [(0.03, 0, 0.11), (-0.02, 0.015, 0.13)]])
    angles, reach = inverse(points)
    assert angles.shape == (2, 2, 3, 3) and reach.tolist() == [[True, False], [True, True]]


def test_the_force_is_bounded_if_legs_are_stretched():
    low, high = 0.18, 0.19  # at the end of the reach on the axis all legs are stretched: t1 = t2
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if inverse((0.0, 0.0, middle))[1] else (low, middle)
    edge = (0.0, 0.0, low)
    t1, t2, _ = inverse(edge)[0][0]
    assert t1 == approx(t2, abs=1e-6)
    torques, ok = torque((3.0, -2.0, 9.0), edge)
    assert ok and np.abs(torques).max() < 1e-6
    pushed, ok = force((0.4096,) * 3, edge)
    assert ok and np.all(np.isfinite(pushed)) and np.linalg.norm(pushed) < 3 * 0.4096 / 1e-3


def test_a_flat_leg_has_no_lever():
    f = FALCON
    cos_phi, sin_phi = np.cos(f.phi[1]), np.sin(f.phi[1])
    v = np.nextafter(f.b, 0.0) + f.s - f.f  # t3 -> 0 for leg 2
    for u in np.linspace(-0.1, 0.1, 41):
        point = np.array([cos_phi * u - sin_phi * v, sin_phi * u + cos_phi * v, 0.08])
        torques, ok = torque((1.0, 1.0, 1.0), point)
        assert np.all(np.isfinite(torques)) and np.abs(torques).max() <= f.limit
        if ok:
            assert abs(torques[1]) < 1e-6


def test_the_torque_is_bounded_if_the_links_are_coplanar():
    box = np.random.default_rng(3).uniform((-0.12, -0.12, 0.03), (0.12, 0.12, 0.2), (20000, 3))
    flattest = 1.0
    for point in box[inverse(box)[1]]:
        torques, ok = torque((6e-3, -7e-3, 3e-3), point)  # 0.01 N
        assert ok and np.abs(torques).max() < 0.05
        _, _, n0, n1, n2, _ = links(FALCON.geometry, *point)
        flattest = min(flattest, abs(np.linalg.det([n0, n1, n2])))
    assert flattest < 2e-3  # nearly coplanar poses were included


def test_damping_starts_without_a_jump():
    box = np.random.default_rng(4).uniform((-0.12, -0.12, 0.03), (0.12, 0.12, 0.2), (2000, 3))
    inside = box[inverse(box)[1]]
    volumes = [abs(np.linalg.det(links(FALCON.geometry, *p)[2:5])) for p in inside]
    start, end = inside[np.argmin(volumes)], np.array(CENTRE)
    assert min(volumes) < 0.02

    def largest_jump(count):
        torques = [torque((0.01, 0.0, 0.0), start + s * (end - start)) for s in np.linspace(0.0, 1.0, count)]
        assert all(ok for _, ok in torques)
        return np.abs(np.diff([t for t, _ in torques], axis=0)).max()

    assert largest_jump(20001) < 0.6 * largest_jump(10001)


def test_saturation_keeps_the_direction():
    rng = np.random.default_rng(5)
    for size in (1e-3, 5.0, 1e3, 1e12, 1e300):
        wish = rng.normal(size=3)
        torques, _ = torque(size * wish, CENTRE)
        small, _ = torque(1e-3 * wish, CENTRE)
        assert np.abs(torques).max() <= FALCON.limit * (1 + 1e-15)
        angle = np.linalg.norm(np.cross(torques, small)) / np.linalg.norm(torques) / np.linalg.norm(small)
        assert angle <= 1e-9
    assert np.abs(torques).max() == approx(FALCON.limit, rel=1e-15)
    assert np.all(torque((np.inf, 0, 0), CENTRE)[0] == 0.0)


def test_the_largest_forces_at_the_centre_have_their_values():
    def largest(direction):
        return float(force(torque(1e3 * np.asarray(direction), CENTRE)[0], CENTRE)[0] @ direction)

    assert [largest(d) for d in np.eye(3)] == approx([7.8, 7.9, 16.9], abs=0.05)
    rng = np.random.default_rng(6)
    directions = rng.normal(size=(4000, 3))
    assert min(largest(d / np.linalg.norm(d)) for d in directions) == approx(6.9, abs=0.1)


def test_one_count_moves_the_tip_by_tens_of_micrometres():
    def moves(z):  # principal values over all directions of one count
        return np.linalg.svd(np.linalg.inv(rates((0.0, 0.0, z))), compute_uv=False) * FALCON.count * 1e6

    assert (min(moves(0.11)), max(moves(0.11))) == approx((27, 42), abs=0.5)
    on_axis = [m for z in np.linspace(0.074, 0.173, 24) for m in moves(z)]
    assert (min(on_axis), max(on_axis)) == approx((14, 58), abs=1)


def copied_rates(point) -> np.ndarray:
    """G as in a widely copied C++ code: the third column has sin(t2) sin(t2) instead of sin(t2) sin(t3)."""
    rows = []
    for phi, (t1, t2, t3) in zip(FALCON.phi, inverse(point)[0], strict=True):
        u, v, w = np.cos(t2) * np.sin(t3), np.cos(t3), np.sin(t2) * np.sin(t2)
        row = [np.cos(phi) * u - np.sin(phi) * v, np.sin(phi) * u + np.cos(phi) * v, w]
        rows.append(np.array(row) / (FALCON.a * np.sin(t2 - t1) * np.sin(t3)))
    return np.array(rows)


def test_the_widely_copied_jacobian_fails_the_test_of_virtual_work():
    def felt(push, point):
        return rates(point).T @ np.linalg.solve(copied_rates(point).T, push)

    assert felt((0, 0, 1), CENTRE)[2] == approx(1.34, abs=0.005)
    assert abs(felt((1, 0, 0), (0.03, 0.0, 0.11))[2]) == approx(0.19, abs=0.005)
    for point in (CENTRE, (0.03, 0.0, 0.11)):
        ours = rates(point).T @ torque((0.1, 0.0, 0.1), point)[0]
        assert ours == approx((0.1, 0.0, 0.1), abs=1e-12)
    up, down = np.array(CENTRE) + (0, 0, 1e-6), np.array(CENTRE) - (0, 0, 1e-6)
    difference = (inverse(up)[0][:, 0] - inverse(down)[0][:, 0]) / 2e-6
    assert rates(CENTRE)[:, 2] == approx(difference, rel=1e-6)
    assert copied_rates(CENTRE)[:, 2] != approx(difference, rel=0.1)


def test_the_widely_copied_forward_kinematics_stop_too_early():
    def copied_forward(angles, point):
        point = np.array(point)
        for _ in range(100):
            residual = inverse(point)[0][:, 0] - angles
            if np.abs(residual).max() < 0.01:
                break
            point = point - 0.5 * np.linalg.solve(rates(point), residual)
        return point

    rng = np.random.default_rng(7)
    errors = []
    for point in workspace(50):
        angles = inverse(point)[0][:, 0]
        near = point + rng.normal(0.0, 2e-3, 3)
        errors.append(np.linalg.norm(copied_forward(angles, near) - point))
        assert np.linalg.norm(forward(angles, near)[0] - point) <= 1e-9
    assert 0.2e-3 < np.median(errors) < 0.5e-3  # the sensor resolves 0.06e-3


def test_the_directions_of_the_legs_are_the_nearest_doubles():
    # They come from the C library, since reading a graph must not start the compiler
    for phi, cosine, sine in zip(FALCON.phi, FALCON.geometry.cos_phi, FALCON.geometry.sin_phi, strict=True):
        assert (cosine, sine) == (float(mpmath.cos(phi)), float(mpmath.sin(phi)))
