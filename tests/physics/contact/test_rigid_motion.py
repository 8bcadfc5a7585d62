"""Rigid motion of two organs that touch: derivatives of the gaps, momentum, and stable answers of several contacts."""

import numpy as np
import pytest
from pytest import approx
from scipy.spatial.transform import Rotation

from palpate.compiler.fields import blank_record
from palpate.physics.bodies.floating.foundation import FIELDS, MOTION, Constants, step
from palpate.physics.bodies.floating.mobility import look_ahead
from palpate.physics.contact.organs import rigid_motion as rigid

UP = (0.0, 0.0, 1.0)
KIDNEY = Constants(0.15, 0.15 * 0.02**2, 0.0, 200.0, 1.5, 130.0, 1.0, 0.03, 0.3, True)


def ride_at(at, turn, centre):
    made = blank_record(rigid.RIDE)
    made["at"][:], made["turn"][:], made["centre"][:] = at, turn, centre
    rigid.orient(made)
    return made


def cells(rng, count):
    normal = rng.normal(size=(count, 3))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    return normal, rng.normal(0.0, 0.03, (count, 3)), rng.normal(0.0, 0.03, (count, 3)), rng.uniform(0.0, 1e-3, count)


def placed(one, two, given):
    normal, first, second, rest = given
    turns, levers, gap = np.zeros((len(rest), 3)), np.zeros((len(rest), 6)), np.zeros(len(rest))
    rigid.place_cells(one, two, normal, first, second, turns, levers, rest, gap)
    return turns, levers, gap


def test_forces_and_moments_are_the_derivatives_of_the_gaps_and_balance_each_other():
    """Central differences; both organs turn by up to 1 rad and move by 20 mm."""
    rng = np.random.default_rng(3)
    given, size = cells(rng, 20), 1e-6
    places = [(rng.normal(0.0, 0.02, 3), rng.normal(0.0, 0.6, 3), rng.normal(0.0, 0.05, 3)) for _ in range(2)]
    turns, levers, _ = placed(*(ride_at(*place) for place in places), given)
    for body, sign in ((0, 1.0), (1, -1.0)):
        for axis in range(6):
            found = []
            for way in (size, -size):
                moved = [list(place) for place in places]
                shift = np.eye(6)[axis] * way
                moved[body][0] = places[body][0] + shift[:3]
                turned = Rotation.from_rotvec(shift[3:]) * Rotation.from_rotvec(places[body][1])
                moved[body][1] = turned.as_rotvec()
                found.append(placed(*(ride_at(*place) for place in moved), given)[2])
            want = sign * turns[:, axis] if axis < 3 else levers[:, 3 * body + axis - 3]
            np.testing.assert_allclose((found[0] - found[1]) / (2.0 * size), want, atol=1e-8)
    middles = [place[2] + place[0] for place in places]
    total = np.cross(middles[0] - middles[1], turns) + levers[:, :3] + levers[:, 3:]
    assert np.abs(total).max() < 1e-15 and np.abs(levers).max() > 0.05


def test_a_common_motion_of_both_organs_changes_no_gap_and_turns_all_forces():
    rng = np.random.default_rng(4)
    given, turn, way = cells(rng, 20), Rotation.from_rotvec([0.5, -0.8, 0.3]), np.array([0.02, 0.01, -0.03])
    still = [ride_at(np.zeros(3), np.zeros(3), c) for c in rng.normal(0.0, 0.05, (2, 3))]
    turns, _, gap = placed(*still, given)
    both = []
    for each in still:
        c = np.array(each["centre"])
        both.append(ride_at(turn.apply(c) + way - c, turn.as_rotvec(), c))
    moved, _, after = placed(*both, given)
    np.testing.assert_allclose(after, gap, atol=1e-15)
    np.testing.assert_allclose(moved, turn.apply(turns), atol=1e-14)
    np.testing.assert_allclose(turns, given[0], atol=1e-15)


@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.0), (0.4, -0.7, 1.1)])
def test_the_expected_motion_and_the_mobility_are_those_of_the_next_step(turn):
    """Of an attached organ, exactly, for the displacement and in the axes of the world for the rotation."""
    made, now, dt = blank_record(FIELDS, **KIDNEY._asdict()), blank_record(MOTION), 1e-3
    now["turn"][:], now["rate"][:], now["speed"][:], now["bend"][:] = turn, (1.0, 2.0, -1.0), (0.1, 0.0, -0.2), turn
    force, moment, added = (0.1, -0.2, 0.3), (1e-3, 2e-3, -1e-3), (0.01, 1e-6)
    expected, mobility = np.zeros(6), np.zeros((6, 3))
    look_ahead(made, UP, now, blank_record(MOTION), force, moment, added, False, dt, expected, mobility)

    def moved(force, moment):
        later = blank_record(MOTION)
        for name in MOTION:
            later[name][:] = now[name]
        step(made, UP, later, force, moment, added, added, dt)
        return np.concatenate([later["at"] - now["at"], later["turn"] - now["turn"]])

    r = np.array(turn)
    square = r @ r
    skew = np.array([[0.0, -r[2], r[1]], [r[2], 0.0, -r[0]], [-r[1], r[0], 0.0]])
    angle = np.sqrt(square)
    c, s = ((1 - np.cos(angle)) / square, (1 - np.sin(angle) / angle) / square) if square else (0.5, 1.0 / 6.0)
    jacobian = np.eye(3) + c * skew + s * skew @ skew  # omega = J r'
    base = moved(force, moment)
    np.testing.assert_allclose(expected, np.concatenate([base[:3], jacobian @ base[3:]]), rtol=1e-12, atol=1e-16)
    push, torque = np.array([0.3, 0.1, -0.5]), np.array([2e-3, 1e-3, -4e-3])
    more = moved(tuple(force + push), tuple(moment + jacobian.T @ torque)) - base
    np.testing.assert_allclose(mobility[:3] @ push, more[:3], rtol=1e-9)
    np.testing.assert_allclose(mobility[3:] @ torque, jacobian @ more[3:], rtol=1e-9)


def spectral_radius(rng, count, share, ahead):
    """Of a mass on a spring and damper with `count` springs that answer as contacts do, and a finger a step later."""
    dt, fingers = 10.0 ** rng.uniform(-4, -2.4), rng.integers(2)
    mass, stiff, damping = 10.0 ** rng.uniform(-3, 0.3), 10.0 ** rng.uniform(0, 9), 10.0 ** rng.uniform(-3, 3)
    soft, past = 10.0 ** rng.uniform(-7, -1, count), rng.choice([0.0, 1.0]) * 10.0 ** rng.uniform(-4, -1, count)
    take, sign = dt / (dt + past), np.where(np.arange(count) % 2, 1.0, -1.0) if rng.integers(2) else np.ones(count)
    spring, damper = fingers * 10.0 ** rng.uniform(1, 5), fingers * 10.0 ** rng.uniform(-2, 2)
    inertia = mass + dt * dt * (spring + damper / dt)
    yields = dt * dt / (inertia + dt * damping + dt * dt * stiff)

    def move(x, v, force):
        return yields / dt * (inertia * v + dt * (force - stiff * x))

    def after(state):
        x, v, before = state[:3]
        bent, pressed = state[3 : 3 + count], state[3 + count :]
        finger = -spring * x - damper * (x - before) / dt
        free = x + ahead * move(x, v, sign @ pressed + finger)
        by = ahead * share * yields
        force = -(sign * free - by * pressed + (1.0 - take) * bent) / (take * soft + by)
        way = move(x, v, sign @ force + finger)
        return np.concatenate([[x + way, way / dt, x], take * soft * force + (1.0 - take) * bent, force])

    return np.abs(np.linalg.eigvals(np.array([after(row) for row in np.eye(3 + 2 * count)]).T)).max()


@pytest.mark.parametrize("count", [1, 2, 3, 4, 8])
def test_several_contacts_on_an_organ_are_stable_for_any_mass_and_stiffness(count):
    """With the rule of `expect`; without the shares, or without looking ahead for more than two, many are not."""
    rng, grown = np.random.default_rng(count), 0
    for _ in range(150):
        assert spectral_radius(rng, count, count, max(count - 1, 1)) < 1.0 + 1e-9
        grown += spectral_radius(rng, count, 1, 1) > 1.0 + 1e-9
    assert (grown > 8) == (count > 1)


def test_contacts_share_the_mobility_of_an_organ_as_stated():
    """`expect` of n contacts: n A and, above two, n - 1 steps ahead; a change of the fingers' load with A."""
    mobility, expected, load = np.arange(1.0, 19.0).reshape(6, 3), np.ones((1, 6)), np.array([0.0, 0, 2, 0, 0, 0])
    for count, far in ((0.0, 1.0), (1.0, 1.0), (2.0, 1.0), (3.0, 2.0), (4.0, 3.0)):
        made = blank_record(rigid.RIDE)
        rigid.expect(made, expected, mobility, count, load)
        np.testing.assert_allclose(made["soft"], far * max(count, 1.0) * mobility)
        assert made["ahead"][0] == approx(far * (1.0 + 2.0 * mobility[0, 2])) and made["ahead"][4] == approx(far)
        rigid.expect(made, expected, mobility, count, load)
        assert made["ahead"][0] == approx(far)
