"""The limit of the slope of a contact force, and the measured slope: each rule computed by hand, step by step."""

from math import exp

import pytest
from pytest import approx

from palpate.compiler.fields import blank_record
from palpate.physics.device.rendered import (
    FORGET,
    GAUGE,
    WALL,
    correct_slope,
    fit_slope,
    is_steep,
    rejoin,
    slope,
    soften,
)

MOST, STEP, DT = 1000.0, 1e-4, 1e-3  # [N/m], [m], [s]
SOFT = {"depth": 2e-3, "mark": 2e-3, "mark_force": 3.0, "slope": 500.0}  # a law that is not steep


def softened(force, way, *, law=1.0, line=0.0, cut=False, sideways=0.0, approach=1.0):
    """The rendered force [N] and the state of the wall after it."""
    wall = blank_record(WALL, line=line, law=law, cut=cut)
    return soften(wall, force, approach, way, sideways, MOST, STEP, DT), wall


@pytest.mark.parametrize(
    ("given", "shown"),
    [
        (dict(way=0.3e-4), 1.03),  # loading: the line rises by the stiffest slope,
        (dict(way=0.3e-4, sideways=0.2e-4), 1.05),  # and equally for tangential motion
        (dict(way=-0.3e-4), 1.0),  # unloading: it does not rise
        (dict(way=-0.3e-4, sideways=0.2e-4), 1.02),
        (dict(way=0.3e-4, approach=1.01e-3), 1.01),  # part of the path was in the air
        (dict(way=0.0), 5.0),  # a force that changes without motion has no slope
        (dict(way=0.0, approach=-6e-3), 0.0),  # above the surface at rest there is no force, and none below zero
    ],
)
def test_a_law_that_is_too_steep_is_replaced_by_a_line(given, shown):
    force, wall = softened(5.0, **given)
    assert force == approx(shown) and wall.law == 5.0
    assert wall.cut == (shown < 5.0)


@pytest.mark.parametrize(
    ("force", "given", "shown"),
    [
        (2.0, dict(way=1e-4), 1.1),
        (2.0, dict(way=0.0, sideways=1e-4), 1.1),
        (1.45, dict(way=-1e-4), 0.95),  # unloading: at most as fast as the law falls,
        (1.10, dict(way=-1e-4), 0.90),  # at most by the stiffest slope,
        (1.60, dict(way=-1e-4), 1.00),  # and constant if the law rises
        (1.60, dict(way=-1e-4, sideways=0.2e-4), 1.02),
        (1.00, dict(way=-1e-4, line=0.05), 0.0),  # never below zero
    ],
)
def test_the_line_applies_while_the_law_is_above_it(force, given, shown):
    given = dict(line=1.0, law=1.5, cut=True) | given
    assert softened(force, **given)[0] == approx(shown, abs=1e-15)


@pytest.mark.parametrize(
    ("force", "given", "shown"),
    [
        (0.5, dict(way=-0.5e-4), 0.95),  # unloading by one step: at most the stiffest slope,
        (0.5, dict(way=-1.4e-4), 0.86),
        (0.5, dict(way=-0.5e-4, sideways=0.2e-4), 0.93),  # minus the share of tangential motion
        (0.5, dict(way=-1.6e-4), 0.5),  # a longer path is a movement: the law applies
        (0.005, dict(way=-0.5e-4, law=0.01), 0.005),
        (0.0, dict(way=-0.5e-4), 0.0),  # contact has ended
        (0.05, dict(way=1e-4, law=0.0), 0.05),  # loading: the law applies
    ],
)
def test_a_fall_within_one_position_step_is_not_steeper(force, given, shown):
    assert softened(force, **given)[0] == approx(shown)


def test_a_line_ends_10_ms_after_the_law_fell_below_it():
    wall = blank_record(WALL, line=1.0, law=0.5, cut=True)
    for step in range(15):
        assert soften(wall, 0.5, 1.0, 0.0, 0.0, MOST, STEP, 0.9 * DT) == 0.5
        assert wall.cut == (step < 11)
    wall.line, wall.cut, wall.below = 0.4, True, 0.9 * FORGET
    soften(wall, 0.5, 1.0, 0.0, 0.0, MOST, STEP, DT)
    assert wall.cut and wall.below == 0.0  # above it again: the time restarts


def test_a_slope_is_measured_from_the_contact_and_then_over_each_span():
    gauge, span = blank_record(GAUGE), (0.0, 2.5e-4, DT)
    assert [slope(gauge, force, 1e-4, *span) for force in (0.1, 0.2)] == approx([1000.0, 1000.0])
    assert slope(gauge, 0.6, 1e-4, *span) == approx(2000.0)  # over the first span
    assert [slope(gauge, force, 1e-4, *span) for force in (0.9, 1.2)] == approx([2000.0, 2000.0])
    assert slope(gauge, 1.5, 1e-4, *span) == approx(3000.0)  # over the second span only
    assert slope(gauge, 1.8, -3e-4, *span) == 0.0  # a force that rises during unloading has no slope
    assert slope(gauge, 1.2, -3e-4, *span) == approx(2000.0)
    assert slope(gauge, 0.0, 1e-4, *span) == 0.0 and gauge.item() == (0.0,) * len(GAUGE)


@pytest.mark.parametrize(
    ("gauge", "force", "steep"),
    [
        (dict(), 0.1, True),  # contact begins: not known yet,
        (dict(depth=0.9e-4), 0.01, True),
        (dict(depth=1.1e-4), 0.1, False),  # 910 N/m since it began
        (dict(depth=1.1e-4), 0.12, True),
        (dict(depth=-1.1e-4), 0.12, False),  # it rises while the finger moves out: something else presses
        (dict(depth=2e-3, mark=1e-3, mark_force=2.0, slope=900.0), 2.9, False),
        (dict(depth=2e-3, mark=1e-3, mark_force=2.0, slope=900.0), 3.1, True),  # steep from the last span on,
        (dict(depth=1e-3, mark=2e-3, mark_force=2.0, slope=900.0), 0.9, True),  # and outwards,
        (dict(depth=1e-3, mark=2e-3, mark_force=2.0, slope=900.0), 3.1, False),
        (dict(depth=1.05e-3, mark=1e-3, mark_force=2.0, slope=900.0), 2.9, False),  # a change within a step
        (dict(depth=1.05e-3, mark=1e-3, mark_force=2.0, slope=1100.0), 2.0, True),  # in the last span
    ],
)
def test_a_law_is_steep_by_its_slope_over_some_steps_of_the_position(gauge, force, steep):
    assert is_steep(blank_record(GAUGE, **gauge), force, MOST, STEP) == steep


TURNED = {"depth": 2e-3, "mark": 2.5e-3, "mark_force": 4.5, "slope": 4e3, "turn": 3e-3, "turn_force": 4.0}


@pytest.mark.parametrize(
    ("force", "given", "corrected"),
    [
        (3.2, dict(), True),  # 800 N/m from the turn; from the mark it is 2600 N/m, as the finger moved in there
        (3.0, dict(), True),
        (2.99, dict(), False),  # 1010 N/m
        (4.0, dict(), True),
        (4.01, dict(), False),  # a force that rises in a retreat is not of the depth
        (3.2, dict(retreat=1.9e-3), False),  # not the least depth: the finger moves in
        (3.95, dict(depth=2.95e-3, retreat=2.96e-3), False),  # less than a step of 0.1 mm
        (3.2, dict(slid=0.9e-3), True),
        (3.2, dict(slid=1.1e-3), False),  # a slide longer than the retreat
        (3.2, dict(slope=900.0, mark_force=3.3), False),  # not steep: it stays
        (3.2, dict(slope=900.0), True),  # steep from the mark on
    ],
)
def test_the_secant_of_a_retreat_replaces_a_steep_slope(force, given, corrected):
    gauge = blank_record(GAUGE, **TURNED | {"retreat": 2.1e-3} | given)
    before = gauge.slope, gauge.mark, gauge.mark_force
    correct_slope(gauge, force, 0.0, MOST, STEP)
    after = ((4.0 - force) / 1e-3, gauge.depth, force) if corrected else before
    assert (gauge.slope, gauge.mark, gauge.mark_force) == approx(after)


def test_exact_positions_have_no_steps_to_correct():
    gauge = blank_record(GAUGE, **TURNED | {"retreat": 2.1e-3})
    correct_slope(gauge, 3.2, 0.0, MOST, 0.0)
    assert (gauge.slope, gauge.mark, gauge.mark_force) == (4e3, 2.5e-3, 4.5)


def test_a_turn_is_the_deepest_place_since_the_finger_moved_in_by_a_step():
    gauge, found = blank_record(GAUGE), []
    for depth, sideways in ((1.0, 0.5), (3.0, 0.5), (2.0, 0.25), (2.9, 0.25), (1.0, 0.0), (1.9, 0.0), (2.1, 0.0)):
        gauge.depth = depth * STEP
        correct_slope(gauge, depth, sideways * STEP, MOST, STEP)
        found.append((gauge.turn / STEP, gauge.turn_force, gauge.retreat / STEP, gauge.slid / STEP))
    first = [(1.0, 1.0, 1.0, 0.0), (3.0, 3.0, 3.0, 0.0), (3.0, 3.0, 2.0, 0.25), (3.0, 3.0, 2.0, 0.5)]
    last = [(3.0, 3.0, 1.0, 0.5), (3.0, 3.0, 1.0, 0.5), (2.1, 2.1, 2.1, 0.0)]
    assert found == [approx(each) for each in first + last]


@pytest.mark.parametrize("dt", [DT, 0.125 * DT])
@pytest.mark.parametrize(("paid", "end"), [(1.0, 3.0), (4.6e-3, 3.0), (2e-3, 2.0)])  # 3 N: 4.5 mJ, 2 N: 2 mJ
def test_a_line_returns_within_10_ms_to_the_law_as_far_as_the_hand_paid(dt, paid, end):
    wall, gauge, shown = blank_record(WALL, line=1.0, law=3.0, cut=True), blank_record(GAUGE, paid=paid, **SOFT), 1.0
    for step in range(1, 30):
        shown = rejoin(wall, gauge, shown, 0.0, MOST, STEP, dt)
        assert shown == wall.line == gauge.shown == approx(end - (end - 1.0) * exp(-step * dt / FORGET))


@pytest.mark.parametrize("paid", [-1.0, 0.0, 0.4e-3])
def test_a_line_neither_rises_nor_falls_where_the_hand_has_not_paid_for_it(paid):
    wall = blank_record(WALL, line=1.0, law=3.0, cut=True)
    assert rejoin(wall, blank_record(GAUGE, paid=paid, **SOFT), 1.0, 0.0, MOST, STEP, DT) == 1.0 and wall.line == 1.0


def test_a_line_does_not_return_to_a_steep_law():
    wall, gauge = (
        blank_record(WALL, line=1.0, law=3.0, cut=True),
        blank_record(GAUGE, paid=1.0, **SOFT | {"slope": 2e3}),
    )
    assert rejoin(wall, gauge, 1.0, 0.0, MOST, STEP, DT) == gauge.shown == wall.line == 1.0


def test_the_hand_pays_by_the_work_of_the_force_that_it_felt():
    wall, gauge = blank_record(WALL, line=1.0, law=3.0, cut=True), blank_record(GAUGE, paid=1e-4, shown=0.8, **SOFT)
    assert rejoin(wall, gauge, 1.0, 2e-4, MOST, STEP, DT) == gauge.shown == 1.0
    assert gauge.paid == approx(2.6e-4)
    assert rejoin(wall, gauge, 1.0, -1e-4, MOST, STEP, DT) == 1.0 and gauge.paid == approx(1.6e-4)


def test_a_force_that_no_line_limits_does_not_return():
    gauge = blank_record(GAUGE, paid=1.0, **SOFT)
    assert rejoin(blank_record(WALL, line=1.0, law=3.0, cut=False), gauge, 3.0, 0.0, MOST, STEP, DT) == 3.0
    below = blank_record(WALL, line=4.0, law=3.0, cut=True)
    assert rejoin(below, gauge, 3.0, 0.0, MOST, STEP, DT) == 3.0 and below.line == 4.0


@pytest.mark.parametrize("given", [(5.0, 1e-3, 1e-5, 0.0), (5.0, 1e-3, 0.0, 0.7), (5.0, -3e-4, 0.0, 0.0)])
def test_within_a_span_a_slope_is_measured_only_during_first_loading(given):
    gauge = blank_record(GAUGE)
    gauge.slope, gauge.depth, gauge.mark, gauge.mark_force = given
    assert slope(gauge, 1.0, 1e-4, 0.0, 1e-2, DT) == 5.0


def exact(gauge, force, way, sideways=0.0, dt=DT):
    return slope(gauge, force, way, sideways, 0.0, dt)


@pytest.mark.parametrize("dt", [DT, 0.125 * DT])
@pytest.mark.parametrize("sideways", [0.0, 1e-6])
def test_exact_positions_give_a_slope_within_10_ms_and_rest_keeps_it(dt, sideways):
    gauge, force = blank_record(GAUGE), 0.0
    for way in (1e-6, 3e-6, -2e-6, 1e-6):
        force += 1e5 * way
        assert exact(gauge, force, way, sideways, dt) == approx(1e5)
    assert exact(gauge, 0.7, 0.0, 0.0, dt) == approx(1e5)
    assert exact(gauge, 0.7, 0.0, 1e-3, dt) == approx(1e5)
    gauge, force = blank_record(GAUGE, slope=1e5, rise=1e-7, square=1e-12, mark=1e-3, mark_force=1.0, depth=1e-3), 1.0
    for step in range(1, 40):
        force += 3e5 * 1e-6
        share = 1.0 / (1.0 + (sideways / 1e-6) ** 2) * (1.0 - exp(-dt / FORGET))
        assert exact(gauge, force, 1e-6, sideways, dt) == approx(3e5 - 2e5 * (1.0 - share) ** step)


def test_a_change_of_force_in_a_slide_is_no_slope():
    """As in a slide over a rim at 4 kHz: 1.4 um out of 74 um of motion, and changes of 0.09 N to and fro."""
    gauge, force = blank_record(GAUGE, rise=8e-8, square=1e-10, mark=1e-3, mark_force=3.0, depth=1e-3), 3.0
    for step in range(100):
        force += 0.09 if step % 2 else -0.09
        assert exact(gauge, force, -1.4e-6, 74e-6, 0.25 * DT) == approx(800.0, rel=0.01)


def test_a_hold_keeps_the_slope_of_the_press_for_a_slide():
    """A press of 50 mm/s, 200 ms in which the finger creeps, and a slide in which the place changes the force while the
    finger moves out by 35 of 250 um. The slope became that of the slide, 1.6 kN/m in place of 600 N/m."""
    gauge, force = blank_record(GAUGE), 0.0
    for _ in range(100):
        force += 600.0 * 5e-5
        exact(gauge, force, 5e-5)
    for _ in range(200):
        force += 600.0 * 1e-8
        exact(gauge, force, 1e-8)
    for _ in range(20):
        force -= 0.056
        assert exact(gauge, force, -35e-6, 250e-6) == approx(600.0, rel=0.05)


@pytest.mark.parametrize("slower", [3.0, 30.0])
def test_a_slower_retreat_finds_its_slope_within_the_way_of_the_press_in_40_ms(slower):
    gauge, force = blank_record(GAUGE), 0.0
    for _ in range(100):
        force += 900.0 * 5e-5
        exact(gauge, force, 5e-5)
    found = []
    for _ in range(round(40 * slower)):
        force -= 300.0 * 5e-5 / slower
        found.append(exact(gauge, force, -5e-5 / slower))
    assert found[0] > 800.0
    assert found[-1] == approx(300.0, rel=0.02)


def test_a_force_that_rises_while_the_finger_moves_out_has_no_slope():
    gauge = blank_record(GAUGE)
    assert fit_slope(gauge, 0.1, -1e-5, 0.0, DT) == 0.0 and gauge.rise < 0.0
    assert fit_slope(blank_record(GAUGE), 0.1, 0.0, 0.0, DT) == 0.0
