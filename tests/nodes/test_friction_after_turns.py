"""Friction of organs that have turned against each other: a ball on another one, without a finger."""

import numpy as np
import pytest
from pytest import approx
from scipy.spatial.transform import Rotation
from support.rolling_balls import CLOSING, FAR, UP, contact, course, roll

from palpate.messages.tissue import Support

MU, PLAIN = 0.3, np.zeros((2, 3))
SLIDE, STEPS = 6e-3, 250  # [m], ticks
CENTRE = FAR * UP


def slide(out, along, turn):
    """Displacements and rotations that slide the pressed ball from its place along `out` [1] (3) towards `along`."""
    found = []
    for share in np.linspace(0.0, SLIDE, STEPS):
        d = (FAR - CLOSING) * out + share * along
        found.append(((FAR - CLOSING) * d / np.linalg.norm(d) - CENTRE, turn))
    return found


def press():
    return [(-CLOSING * share * UP, 0.0 * UP) for share in np.linspace(0.0, 1.0, 300)]


def turned_in_place(axis, angle, speed=30e-3):
    """Rotations of the pressed ball about its centre by `angle` [rad], and the axis [1] (3)."""
    axis = np.array(axis) / np.linalg.norm(axis)
    return [(-CLOSING * UP, a * axis) for a in np.linspace(0.0, angle, int(angle * 21e-3 / speed * 1e3))], angle * axis


def parts(answer, turn, along, out, exchanged=False):
    """Friction on the upper ball over the normal force [1]: along the slide, along its normal at the end."""
    sign = -1.0 if exchanged else 1.0
    friction = np.array(answer.friction) if exchanged else Rotation.from_rotvec(turn).apply(answer.friction)
    end = (FAR - CLOSING) * out + SLIDE * along
    end /= np.linalg.norm(end)
    ahead = along - end * (end @ along)
    return sign * friction @ ahead / np.linalg.norm(ahead) / answer.force, sign * friction @ end / answer.force


def right(kind, place, turn, out, along):
    """The same for balls that are set up where the turn ends."""
    there = contact(kind, place, (turn, np.zeros(3)), friction=MU)
    down = [(-CLOSING * share * out, 0.0 * UP) for share in [*np.linspace(0.0, 1.0, 300), *[1.0] * 100]]
    down += [(at - (place - CENTRE), 0.0 * UP) for at, _ in slide(out, along, turn)]
    return course(there, down)[-1]


@pytest.mark.parametrize("kind, way, heading, across", [
    ("MassSpring", 5e-3, 0.0, False), ("MassSpring", 15e-3, 0.7, True), ("MassSpring", 30e-3, 2.0, False),
    ("ReducedFE", 15e-3, 0.7, False),
])  # fmt: skip
def test_friction_after_a_roll_is_that_of_organs_set_up_there(kind, way, heading, across):
    """With one vector in the axes of both organs it was 0.29, 0.23 and 0.05 of the normal force after 5, 15, 30 mm."""
    path, place, out, turn = roll(way, heading)
    axis = turn / np.linalg.norm(turn)
    along = axis if across else np.cross(axis, out)
    made = contact(kind, CENTRE, PLAIN, friction=MU)
    found = course(made, [*path, *[path[-1]] * 100, *slide(out, along, turn)])
    expected = right(kind, place, turn, out, along)
    end, other = parts(found[-1], turn, along, out), parts(expected, np.zeros(3), along, out)
    assert end[0] == approx(other[0], rel=0.01) and end[0] == approx(-MU, rel=0.02)
    assert end[1] == approx(other[1], abs=0.02 * MU)
    lost = found[-1].dissipated - found[-101].dissipated  # mu N v per time
    assert lost == approx(MU * found[-1].force * SLIDE * 100 / (STEPS - 1), rel=0.04)
    assert found[-1].generated < 1e-12


TURNS = [((0.0, 0.0, 1.0), angle) for angle in (0.3, 1.0, 2.0, 3.0)] + [
    ((1.0, 0.0, 0.0), 1.0), ((0.0, 1.0, 0.0), 2.0), ((1.0, 1.0, 1.0), 3.0)
]  # fmt: skip


@pytest.mark.parametrize("axis, angle", TURNS)
def test_friction_after_a_turn_in_place_is_that_before_it(axis, angle):
    """About the normal, and about axes along the surfaces and between. A turn by 3 rad left 0.02 to 0.2 of the normal
    force."""
    along = np.array([1.0, 0.0, 0.0])
    turns, turn = turned_in_place(axis, angle)
    made = contact("MassSpring", CENTRE, PLAIN, friction=MU)
    found = course(made, [*press(), *turns, *[turns[-1]] * 100, *slide(UP, along, turn)])
    before = course(contact("MassSpring", CENTRE, PLAIN, friction=MU), [*press(), *slide(UP, along, np.zeros(3))])
    end, other = parts(found[-1], turn, along, UP), parts(before[-1], np.zeros(3), along, UP)
    assert end[0] == approx(other[0], rel=0.01) and end[0] == approx(-MU, rel=0.02)
    assert end[1] == approx(other[1], abs=0.02 * MU)


def test_loads_on_both_organs_after_a_turn_are_opposite_in_the_world():
    """Also the moments of both: C_1 x F + T_1 + T_2 = C_2 x F about one point."""
    for axis in ((0.0, 0.0, 1.0), (1.0, 0.5, 0.2)):
        turns, turn = turned_in_place(axis, 2.0)
        made = contact("MassSpring", CENTRE, PLAIN, friction=MU)
        path = [*press(), *turns, *[turns[-1]] * 100, *slide(UP, np.array([0.0, 1.0, 0.0]), turn)]
        for answer, (at, _) in zip(course(made, [*path, *[path[-1]] * 300]), [*path, *[path[-1]] * 300], strict=True):
            moments = np.sum(answer.torques, axis=0) + np.cross(CENTRE + at, answer.resultant)
            np.testing.assert_allclose(moments, 0.0, atol=1e-12)
        first = Rotation.from_rotvec(turn).apply(np.sum(answer.first_forces, axis=0))
        second = np.sum(answer.second_forces, axis=0)
        assert np.linalg.norm(answer.friction) > 0.2 * answer.force
        np.testing.assert_allclose(first, -second, atol=2e-3 * answer.force)
        np.testing.assert_allclose(first, answer.resultant, atol=0.02 * answer.force)


def test_exchanged_organs_that_turned_have_the_same_bits():
    path, _, out, turn = roll(8e-3, 0.4)
    path += [path[-1]] * 20 + slide(out, np.cross(turn / np.linalg.norm(turn), out), turn)[:60]
    one, other = (
        course(contact("MassSpring", CENTRE, PLAIN, exchanged=exchanged, friction=MU), path, exchanged)
        for exchanged in (False, True)
    )
    for a, b in zip(one, other, strict=True):
        assert np.array_equal(np.negative(a.resultant), b.resultant)
        assert np.array_equal(a.torques, b.torques[::-1]) and a.dissipated == b.dissipated
        assert np.array_equal(a.first_forces, b.second_forces) and np.array_equal(a.second_forces, b.first_forces)
    assert np.linalg.norm(one[-1].friction) > 0.25 * one[-1].force


@pytest.mark.parametrize("way", [0.2e-3, 2e-3])
def test_a_rotation_of_both_organs_together_turns_their_friction_with_them(way):
    """Where they stick and after a slide, in 200 steps of 10 mrad about one axis."""
    made = contact("MassSpring", CENTRE, PLAIN, friction=MU)
    aside = [(-CLOSING * UP + s * np.array([1.0, 0.0, 0.0]), 0.0 * UP) for s in np.linspace(0.0, way, 50)]
    before = course(made, [*press(), *aside, *[aside[-1]] * 300])[-1]
    axis, at = np.array([0.6, 0.0, 0.8]), aside[-1][0]
    for angle in np.linspace(0.0, 2.0, 200):
        both = Rotation.from_rotvec(angle * axis)
        shared = {"velocity": (0.0, 0.0, 0.0), "rotation": angle * axis, "spin": np.zeros(3)}
        supports = [
            Support(displacement=tuple(map(float, both.apply(CENTRE + at) - CENTRE)), centre=CENTRE, **shared),
            Support(displacement=(0.0, 0.0, 0.0), centre=np.zeros(3), **shared),
        ]
        after = made.step([], [], first_support=supports[:1], second_support=supports[1:], dt=1e-3)
    assert 0.05 * before.force < np.linalg.norm(before.friction)
    np.testing.assert_allclose(after.friction, before.friction, atol=1e-6 * before.force)
    np.testing.assert_allclose(after.resultant, both.apply(before.resultant), atol=1e-6 * before.force)
    assert after.stored == approx(before.stored, rel=1e-5)
