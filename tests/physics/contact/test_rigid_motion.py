"""Rigid motion of two organs that touch: derivatives of the gaps, momentum, and the mobility of organs."""

import numpy as np
import pytest
from pytest import approx
from scipy.spatial.transform import Rotation

from palpate.compiler.fields import blank_record
from palpate.physics.bodies.floating.foundation import FIELDS, MOTION, Constants, step
from palpate.physics.bodies.floating.mobility import look_ahead
from palpate.physics.contact.organs import coupled
from palpate.physics.contact.organs import rigid_motion as rigid

UP = (0.0, 0.0, 1.0)
KIDNEY = Constants(0.15, 0.15 * 0.02**2, 0.0, 200.0, 1.5, 130.0, 1.0, 0.03, 0.3, True)


def ride_at(at, turn, centre):
    made = blank_record(rigid.RIDE)
    made["at"][:], made["turn"][:], made["centre"][:] = at, turn, centre
    rigid.orient(made)
    return made


def cells(rng, count, tilt=0.0):
    """Normals on both organs, which differ after a slide, places, and gaps."""
    normal = rng.normal(size=(count, 3))
    other = normal + tilt * rng.normal(size=(count, 3))
    normal, other = (each / np.linalg.norm(each, axis=1)[:, None] for each in (normal, other))
    return normal, other, *rng.normal(0.0, 0.03, (2, count, 3)), rng.uniform(0.0, 1e-3, count)


def placed(one, two, given):
    normal, opposite, first, second, rest = given
    turns, levers, gap = np.zeros((3, len(rest))), np.zeros((6, len(rest))), np.zeros(len(rest))
    before = np.einsum("ij,ij->i", normal, first - second)
    rigid.place_cells(one, two, normal, opposite, first, second, turns, levers, rest, before, gap)
    return turns.T, levers.T, gap


@pytest.mark.parametrize("tilt", [0.0, 0.3])
def test_forces_and_moments_are_the_derivatives_of_the_gaps_and_balance_each_other(tilt):
    """Central differences; both organs turn by up to 1 rad and move by 20 mm."""
    rng = np.random.default_rng(3)
    given, size = cells(rng, 20, tilt), 1e-6
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


def test_the_motion_with_the_load_of_fingers_is_that_of_the_mobility():
    mobility, expected, load = np.arange(1.0, 19.0).reshape(6, 3), np.ones((1, 6)), np.array([0.0, 0, 2, 0, 0, 0])
    made = blank_record(rigid.RIDE)
    rigid.expect(made, expected, mobility, load)
    np.testing.assert_allclose(made["soft"], mobility)
    assert made["ahead"][0] == approx(1.0 + 2.0 * mobility[0, 2]) and made["ahead"][4] == approx(1.0)
    rigid.expect(made, expected, mobility, load)
    assert made["ahead"][0] == approx(1.0)


def test_the_matrix_of_two_contacts_of_an_organ_is_that_of_its_mobility():
    """J A J' of all candidates by numpy: the organ is the second of one contact and the first of another."""
    rng = np.random.default_rng(5)
    soft = np.zeros((6, 3))
    for half in range(2):
        root = rng.normal(size=(3, 3))
        soft[3 * half : 3 * half + 3] = root @ root.T
    whole = np.zeros((6, 6))
    whole[:3, :3], whole[3:, 3:] = soft[:3], soft[3:]
    turns, levers = [rng.normal(size=(3, n)) for n in (4, 3)], [rng.normal(size=(6, n)) for n in (4, 3)]
    rows = np.hstack([np.vstack([-turns[0], levers[0][3:]]), np.vstack([turns[1], levers[1][:3]])]).T
    found, begins, sides = np.zeros((7, 7)), (0, 4), (1, 0)
    for k in range(2):
        for j in range(2):
            coupled.add_block(
                soft, sides[k], turns[k], levers[k], sides[j], turns[j], levers[j], found, begins[k], begins[j]
            )
    np.testing.assert_allclose(found, rows @ whole @ rows.T, rtol=1e-12, atol=1e-14)


def test_motions_moments_and_mobility_at_a_place_are_those_about_the_centre_where_the_organ_is():
    rng = np.random.default_rng(6)
    rides, mobilities, arms = [], [], []
    place = rng.normal(0.0, 0.05, 3)
    for _ in range(2):
        at, turn, centre = rng.normal(0.0, 0.02, 3), rng.normal(0.0, 0.6, 3), rng.normal(0.0, 0.05, 3)
        ride, arm, soft = ride_at(at, turn, centre), place - centre - at, np.zeros((6, 6))
        for half in (slice(0, 3), slice(3, 6)):
            root = rng.normal(size=(3, 3))
            soft[half, half] = root @ root.T
            ride["soft"][half] = soft[half, half]
        by, force = rng.normal(size=6), rng.normal(size=3)
        moved, moment = rigid.moved_at(ride, by, tuple(place)), rigid.torque_at(ride, tuple(force), tuple(place))
        np.testing.assert_allclose(moved, by[:3] + np.cross(by[3:], arm), rtol=1e-12)
        np.testing.assert_allclose(moment, np.cross(arm, force), rtol=1e-12, atol=1e-15)
        rides.append(ride)
        mobilities.append(soft)
        arms.append(np.cross(np.eye(3), arm))  # of omega: arm x omega is minus the motion
    total = np.zeros((3, 3))
    for soft, skew in zip(mobilities, arms, strict=True):
        motion = np.hstack([np.eye(3), skew])  # of the place by a motion (6) of the organ
        total += motion @ soft @ motion.T
    found = np.zeros((3, 3))
    rigid.mobile_at(*rides, tuple(place), found)
    np.testing.assert_allclose(found, total, rtol=1e-10)
