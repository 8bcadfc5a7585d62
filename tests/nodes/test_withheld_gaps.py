"""Contacts of organs that begin in the middle of a run, and organs that leap: no gap closes in one step."""

import json

import numpy as np
import pytest
from msgspec.structs import replace
from pytest import approx

from palpate.messages.tissue import Support
from palpate.nodes.contact.between import Between
from palpate.nodes.contact.finger import regained
from palpate.studies.organ_stacks import Row, ball, body

REST, GAP = 3e-3, 1e-3  # [m] rise of the lower ball; gap at the start


def viscous(friction=0.0):
    """Two balls on springs with a retardation of 20 ms."""
    bodies = [body(ball(42e-3 + GAP), 300.0, 20e-3), body(ball(0.0), 300.0, 20e-3)]
    node = Between(bodies=json.dumps(bodies), friction=friction, cells=100)
    node.start()
    return node


def sent(height, tick, before=None, turn=None, timed=True):
    """The support of an organ that rises, as a graph at 1 kHz sends it."""
    rise = 0.0 if before is None else 1e3 * (height - before)
    more = {} if turn is None else {"rotation": turn, "spin": np.zeros(3), "centre": np.zeros(3)}
    place = {"tick": tick, "time": 1_000_000 * tick} if timed else {}
    return Support(displacement=(0.0, 0.0, height), velocity=(0.0, 0.0, rise), **more, **place)


def course(count=60, rest=400):
    """A rise to `REST` at 50 mm/s, and a rest."""
    return [*np.linspace(0.0, REST, count), *[REST] * rest]


def feel(node, heights, first=0, **given):
    """Forces [N], one for each height; the velocity is that of the motion before each, also before the first."""
    before, found = heights[0], []
    for tick, height in enumerate(heights, first):
        found.append(node.step([], [], second_support=sent(height, tick, before, **given), dt=1e-3))
        before = height
    return np.array([each.force for each in found]), found[-1]


@pytest.mark.parametrize("turn", [None, np.array([0.0, 0.0, 0.3])])
@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_a_contact_that_joins_a_run_presses_no_more_than_at_rest(friction, turn):
    """It closed the overlap of 2 mm in its first step, with 21 times the force at rest."""
    force, _ = feel(viscous(friction), course(), turn=turn)
    again, last = feel(viscous(friction), [REST] * 400, first=460, turn=turn)
    assert force[-1] > 0.1 and again[0] == 0.0
    assert again.max() < 1.5 * force[-1] and again[-1] == approx(force[-1], rel=0.02)  # other cells after a turn
    assert again[60] > 0.8 * force[-1]  # it does not take longer than a finger that returns
    assert last.generated < 1e-15 and last.gap > -1e-9
    assert np.diff(again).min() > -0.03 * force[-1]


def test_work_that_returns_a_gap_is_that_of_the_foundation():
    """Springs at rest store p²C/2; what the foundation does more is dissipated there."""
    node = viscous()
    _, last = feel(node, [REST] * 400, first=460)
    force, held = node._held["pair.active.force"], node._held
    stored = 0.5 * sum(force @ held[f"pair.{side}"] @ force for side in ("first", "second"))
    assert stored < last.carried[0] < 2.5 * stored


@pytest.mark.parametrize("rate", [0.05, 1.0])
def test_no_motion_at_its_velocity_is_a_leap(rate):
    """At up to 1 m/s the same bytes as of messages that are in no run."""
    heights, nodes = course(int(REST / rate * 1e3) + 1, 50), [viscous(), viscous()]
    ours, theirs = (feel(node, heights, timed=timed)[0] for node, timed in zip(nodes, (True, False), strict=True))
    assert ours.max() > 0.1 and np.array_equal(ours, theirs)
    assert not any(node.own["withheld"] for node in nodes)


def test_an_organ_that_leaps_presses_no_more_than_where_it_rests():
    """Its support was restarted at another place: the velocity is zero."""
    node = viscous()
    low, _ = feel(node, course(50, 200)[:-200] + [2e-3] * 200)
    force, _ = feel(node, [REST] * 400, first=250)
    right, _ = feel(viscous(), course())
    assert 0.0 < low[-1] < 0.5 * right[-1]
    assert force.max() < 1.5 * right[-1] and force[-1] == approx(right[-1], rel=1e-6)
    assert 0.5 * low[-1] < force[0] <= low[-1]


def test_an_organ_whose_messages_were_lost_presses_as_one_that_leaps():
    node, heights = viscous(), course()
    right, _ = feel(viscous(), heights)
    lost, before = [], None
    for tick, height in enumerate(heights):
        message = None if 25 <= tick < 55 else sent(height, tick, heights[max(tick - 1, 0)])
        lost.append(node.step([], [], second_support=message, dt=1e-3).force)
        before = height
    assert before == REST and right.max() > 1.5 * right[-1]
    assert max(lost) < right.max() and lost[-1] == approx(right[-1], rel=1e-6)


def hold_up(row, heights, first=0):
    """Forces between a loose organ and one below it at these heights, and where the loose one is."""
    found = []
    for tick, height in enumerate(heights, first):
        row.foundations[1] = [sent(height, -1, timed=False)]
        row.sent = [each and replace(each, tick=tick, time=1_000_000 * tick) for each in row.sent]
        found.append((row.run(1)[0].force, row.moving()[0].own["motion"]["at"][2]))
    return np.array(found).T


LOOSE = {"mass": 0.2, "stiffness": 1e3, "damping": 5.0, "attached": False}


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_a_contact_that_bears_an_organ_on_its_foundation_bears_it_when_it_joins_a_run(friction):
    """A loose organ of 2 N is lifted by one below it when their contact begins again. It sank by 60 um, and was lifted
    again by 0.19 mJ that the contact gave; now it stays. Without bristles that are stretched it moves by 0.5 um."""
    bodies = [body(ball(42.4e-3), 300.0, 20e-3), body(ball(0.0), 300.0, 20e-3)]
    row = Row(bodies, [LOOSE, None], friction)
    before, at = hold_up(row, [*np.linspace(0.0, 2e-3, 100), *[2e-3] * 900])
    joined = Row(bodies, [LOOSE, None], friction)
    joined.foundations, joined.sent = row.foundations, row.sent
    force, again = hold_up(joined, [2e-3] * 1000, first=1000)
    assert before[-1] > 0.1 and at[-1] > 1e-4
    assert force == approx(np.full(1000, before[-1]), rel=1e-3 if friction else 1e-9)
    assert again == approx(np.full(1000, at[-1]), abs=1e-6 if friction else 1e-12)
    answer = joined.history[-1][0][0]
    assert answer.generated < 1e-12 and answer.dissipated < 3e-6


def test_a_contact_for_which_no_organ_waited_begins_without_force_and_counts_the_energy_of_its_return():
    """The organ sinks, and is lifted to where it was, by energy that the contact counts as generated, because it does
    not know what the bodies had stored."""
    bodies = [body(ball(42.4e-3), 300.0, 20e-3), body(ball(0.0), 300.0, 20e-3)]
    row, joined = Row(bodies, [LOOSE, None]), Row(bodies, [LOOSE, None])
    before, at = hold_up(row, [*np.linspace(0.0, 2e-3, 100), *[2e-3] * 900])
    joined.foundations, joined.sent = row.foundations, row.sent
    joined.contacts[0].own["members"][0]["waited"] = False
    force, again = hold_up(joined, [2e-3] * 1000, first=1000)
    assert force[0] == 0.0 and force.max() < 1.5 * before[-1] and force[-1] == approx(before[-1], rel=2e-3)
    assert np.diff(force).min() > -0.05 * before[-1]
    assert again.min() < 0.8 * at[-1] and again[-1] == approx(at[-1], rel=1e-2)
    held, answer = joined.contacts[0]._held, joined.history[-1][0][0]
    force = held["members.0.pair.active.force"]
    stored = 0.5 * sum(force @ held[f"members.0.pair.{side}"] @ force for side in ("first", "second"))
    assert stored < answer.generated < 3.0 * stored  # viscous bodies take more


def test_a_contact_that_joins_a_run_while_it_lifts_an_organ_gives_hardly_any_energy():
    """It begins without what the bodies resisted by their viscosity, which the foundation did not expect. It gave
    0.08 mJ."""
    bodies = [body(ball(42.4e-3), 300.0, 20e-3), body(ball(0.0), 300.0, 20e-3)]
    heights = [*np.linspace(0.0, 2e-3, 100), *[2e-3] * 400]
    right, _ = hold_up(Row(bodies, [LOOSE, None]), heights)
    row, joined = Row(bodies, [LOOSE, None]), Row(bodies, [LOOSE, None])
    hold_up(row, heights[:60])
    joined.foundations, joined.sent = row.foundations, row.sent
    force, _ = hold_up(joined, heights[60:], first=60)
    assert 0.0 < force[0] < right[60] and force.max() < 1.2 * right.max()
    assert force[-1] == approx(right[-1], rel=1e-3) and joined.history[-1][0][0].generated < 1e-8


@pytest.mark.parametrize("which", [0, 1])
def test_a_copy_of_contacts_that_are_solved_together_agrees_with_the_others_when_it_is_restarted(which):
    """Three organs in a row, whose two contacts each solve for both. The one that was restarted began without force,
    while the other one expected its organ to be held."""
    bodies = [body(ball(84.4e-3), 300.0, 20e-3), body(ball(42.2e-3), 300.0, 20e-3), body(ball(0.0), 300.0, 20e-3)]
    row = Row(bodies, [{"mass": 0.1, "stiffness": 100.0, "damping": 3.0}] * 2 + [None])

    def lift(heights, first):
        found = []
        for tick, height in enumerate(heights, first):
            row.foundations[2] = [sent(height, -1, timed=False)]
            row.sent = [each and replace(each, tick=tick, time=1_000_000 * tick) for each in row.sent]
            found.append([each.force for each in row.run(1)])
        return np.array(found)

    before = lift([*np.linspace(0.0, 2e-3, 100), *[2e-3] * 1400], 0)[-1]
    assert before.min() > 0.01
    old = row.contacts[which]
    row.contacts[which] = type(old)(island=old.island, place=old.place, bodies=old.bodies, cells=old.cells)
    row.contacts[which].start()
    after = lift([2e-3] * 300, 1500)
    assert after == approx(np.tile(before, (300, 1)), rel=1e-4)
    for k in range(2):
        copies = [each._held[f"members.{k}.pair.active.force"] for each in row.contacts]
        np.testing.assert_allclose(*copies, rtol=0.0, atol=1e-6 * before[k])
    assert all(each.generated < 1e-12 for each in row.history[-1][0])


def test_what_was_withheld_returns_at_a_rate_that_falls_to_zero():
    """It ended at 20 mm/s: viscous bodies lost 22 % of their force in the last step. The same course with any step."""
    ways = []
    for dt in (1e-4, 1e-3, 4e-3):
        way = [5e-3]
        while way[-1] > 0.0:
            way.append(regained(way[-1], dt))
        rates = -np.diff(way) / dt
        assert (np.diff(rates) < 0.0).all() and rates[-1] < 2.0 * dt
        ways.append(np.interp(np.arange(0.0, 0.12, 4e-3), dt * np.arange(len(way)), way))
    assert ways[1] == approx(ways[0], abs=0.1e-3) and ways[2] == approx(ways[0], abs=0.4e-3)
