"""Several fingertips on one body, solved together (physics.contact.joint)."""

import math

import numpy as np
import pytest
from formulas import force
from hypothesis import given, settings
from hypothesis import strategies as st
from pytest import approx
from scipy.optimize import least_squares

from palpate.physics.contact.joint import joint_step
from palpate.physics.contact.series import elastic, exponential, kernel_form, power, series_step

FINGER, C1 = exponential(26.2641, 1681.06), 8.0
FORM = kernel_form(FINGER, C1)


def solved(approach, laws, coupling, before=None, dt=1e-3, form=FORM, start=0.0):
    count = len(approach)
    before = np.zeros(count) if before is None else np.asarray(before, float)
    out = np.zeros((count, 3))
    joint_step(
        np.asarray(approach, float), dt, before, form, np.asarray(laws, float),
        np.asarray(coupling, float), np.full(count, start), out,
    )  # fmt: skip
    return out


def organ(places, compliance=3.7e-3, near=8e-3):
    """Compliance [m/N] between points [m] on a line, positive definite, and the resulting laws and coupling."""
    x = np.asarray(places, float)
    matrix = compliance * np.exp(-np.abs(x[:, None] - x) / near)
    laws = [(1.0 / compliance, 1.0, 0.0, 0.0, 0.0)] * len(x)
    return matrix, laws, matrix / compliance


def test_one_finger_alone_equals_the_series_step():
    law = (3e3, 1.5, 5.0, 0.0, 1e-3)
    (found,) = solved([6e-3], [law], [[1.0]], [1e-3])
    assert tuple(found) == approx(series_step(6e-3, 1e-3, 1e-3, FORM, *law), rel=1e-12)


@pytest.mark.parametrize("count", [2, 3, 5])
def test_the_forces_agree_with_a_simultaneous_solver(count):
    compliance, laws, coupling = organ(0.012 * np.arange(count))
    approach = 5e-3 + 1e-3 * np.arange(count)
    found = solved(approach, laws, coupling, dt=math.inf)

    def residual(depths):
        pressed = np.array([elastic(s, *FINGER)[0] for s in approach - depths])
        return (compliance @ pressed - depths) * 1e3

    expected = least_squares(residual, 0.6 * approach, xtol=1e-15, ftol=1e-15, gtol=1e-15).x
    assert found[:, 2] == approx(expected, rel=1e-9)
    assert found[:, 0] == approx(force(FINGER, approach - expected), rel=1e-7)
    assert found[:, 1] + found[:, 2] == approx(approach, rel=1e-12)


@pytest.mark.parametrize("law", [(1.0 / 3.7e-3, 1.0, 0.0, 0.0, 0.0), (3e3, 1.5, 5.0, 0.0, 0.0)])
def test_fingers_at_one_point_share_the_force_of_one_stiffer_finger(law):
    """Two equal fingertips act like one with twice the stiffness."""
    two = solved([6e-3, 6e-3], [law, law], np.ones((2, 2)), form=kernel_form(power(8e3, 1.5), 0.0))
    (one,) = solved([6e-3], [law], [[1.0]], form=kernel_form(power(16e3, 1.5), 0.0))
    assert two[0] == approx(two[1], rel=1e-12)
    assert 2.0 * two[0, 0] == approx(one[0], rel=1e-10)
    assert two[0, 2] == approx(one[2], rel=1e-10)


def test_a_finger_above_the_indentation_of_another_touches_only_when_it_reaches_it():
    compliance, laws, coupling = organ([0.0, 5e-3])
    dent = solved([8e-3, -1.0], laws, coupling, dt=math.inf)
    assert dent[1, 0] == 0.0 and dent[1, 2] == approx(compliance[1, 0] * dent[0, 0], rel=1e-10)
    above = solved([8e-3, 0.99 * dent[1, 2]], laws, coupling, dt=math.inf)
    below = solved([8e-3, 1.05 * dent[1, 2]], laws, coupling, dt=math.inf)
    assert above[1, 0] == 0.0 < below[1, 0]


def test_fingers_on_opposite_sides_of_a_thin_organ_press_against_each_other():
    """Each finger raises the surface under the other: the coupling is negative."""
    _, laws, _ = organ([0.0, 0.0])
    alone = solved([5e-3], laws[:1], [[1.0]], dt=math.inf)
    pinched = solved([5e-3, 5e-3], laws, [[1.0, -0.4], [-0.4, 1.0]], dt=math.inf)
    assert (pinched[:, 0] > 1.05 * alone[0, 0]).all()
    s2 = 3.7e-3 * (pinched[:, 0] - 0.4 * pinched[::-1, 0])
    assert pinched[:, 2] == approx(s2, rel=1e-9)


@pytest.mark.parametrize("start", [0.0, 1.0, 5.0])
def test_of_two_fingers_at_one_place_the_one_that_leaves_has_no_force(start):
    """Newton's steps and single sweeps cycled at 0.013 N; by the equations of two fingers, one of them alone."""
    _, laws, coupling = organ([0.016875, 0.016875, 0.0], near=1e-3)
    approach, before = [9.3977e-3, 10.90625e-3, 5e-3], [0.421875e-3, 1.84375e-3, 0.0]
    found = solved(approach, laws, coupling, before, 1e-4, start=start)
    alone = solved(approach[1:], laws[1:], coupling[1:, 1:], before[1:], 1e-4)
    assert found[0, 0] == 0.0 and found[1:] == approx(alone, rel=1e-12)


@settings(max_examples=200, deadline=None)
@given(data=st.data())
def test_the_solution_is_finite_never_negative_and_independent_of_the_start(data):
    count = data.draw(st.integers(1, 6))
    number = st.floats(0.0, 1.0)
    places = [0.08 * data.draw(number) for _ in range(count)]
    _, laws, coupling = organ(places, near=data.draw(st.sampled_from([1e-3, 8e-3, 0.1])))
    steep = data.draw(st.booleans())
    if steep:
        laws = [(3e3, 1.5, 5.0, 0.0, 5e-3 * data.draw(number)) for _ in range(count)]
    approach = [-2e-3 + 14e-3 * data.draw(number) for _ in range(count)]
    before = [2e-3 * data.draw(number) for _ in range(count)]
    dt = data.draw(st.sampled_from([1e-4, 1e-3, 0.1, math.inf]))
    found = solved(approach, laws, coupling, before, dt)
    again = solved(approach, laws, coupling, before, dt, start=1.0)
    assert np.isfinite(found).all() and (found[:, 0] >= 0.0).all()
    assert found[:, 0] == approx(again[:, 0], rel=1e-9, abs=1e-12)
    # the law of each contact, under its force and the forces of the others
    acting = found[:, 0] + (coupling - np.eye(count)) @ found[:, 0]
    for (k, n, c, free, previous), s, f, mine in zip(laws, found[:, 2], acting, found[:, 0], strict=True):
        rate = 1.0 if math.isinf(dt) else max(0.0, 1.0 + c * (s - previous) / dt)
        if mine > 1e-9:
            assert k * max(s - free, 0.0) ** n * rate == approx(f, rel=1e-6)
