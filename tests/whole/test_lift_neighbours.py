"""Organs on foundations that touch other organs, in graphs: a pinch that lifts one off another, and drops it."""

import json

import numpy as np
import pytest
from expected_notes import STIFF
from pytest import approx
from streams import read

import palpate
from palpate.launch.load.graph import load
from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.messages import Contact, Force, Ledger, Surface
from palpate.messages.contact import OrganContact
from palpate.messages.tissue import Support
from palpate.nodes.support import OrganFoundation
from palpate.records.player import plan_of
from palpate.records.reader import Recording
from palpate.records.verify import verify

G, MASS = 9.80665, 0.13
NOTES = pytest.mark.notes
COARSE = ("scene.surface.vertices=2000", "scene.liver-surface.vertices=2000")
QUICK = (
    *COARSE,
    "scene.hand.path=[{to: [0, 0, 0.140], time: 0.25}, {hold: 0.3}]",
    "scene.hand.begin=[0, 0, 0.1505]", "scene.energy.ledger=true",
)  # fmt: skip


def foundation_of(body, stiffness="255 N/m", mass="130 g", more=""):
    return f"{body}-foundation: {{moves: [{body}], mass: {mass}, stiffness: {stiffness}, damping: 4 N s/m{more}}}"


def on_foundations(*given):
    return f"scene.foundations={{{', '.join(given)}}}"


def run(path, *overrides, graph="neighbours", place="fused", duration=0.5):
    launch = find(graph).but(duration=duration, record=path, place=place, overrides=overrides)
    outcome = execute(launch)
    assert outcome.result.ok, outcome.result.deaths
    return Recording(path)


def column(messages, name):
    return np.array([getattr(each, name) for each in messages])


@pytest.fixture(scope="module")
def pressed(tmp_path_factory):
    """A finger presses the liver into the kidney, both on foundations."""
    path = tmp_path_factory.mktemp("pressed") / "both.mcap"
    return run(
        path, *QUICK, on_foundations(foundation_of("kidney"), foundation_of("liver", "900 N/m", "300 g")), duration=0.7
    )


@NOTES
@pytest.mark.parametrize("floating, waits", [(["kidney"], True), (["kidney", "liver"], False)])
def test_a_contact_knows_whether_its_organs_wait_for_it(floating, waits):
    """The foundation of an organ that a finger touches goes without a contact that fails, so that the finger keeps
    its force."""
    given = on_foundations(*map(foundation_of, floating))
    graph = load("neighbours", overrides=[*COARSE, given])
    assert json.loads(graph.nodes["between"].settings["island"])[0]["waits"] is waits


@NOTES
def test_at_rest_foundations_bear_what_the_finger_and_the_organs_give_them(pressed):
    """The liver bears the finger less the kidney, the kidney what the liver gives it: K d = F, and the moments about
    the centres of both organs balance those of their foundations."""
    kidneys, livers, between, fingers, hands = read(
        pressed,
        kidney_foundation=Support,
        liver_foundation=Support,
        between=OrganContact,
        contact=Contact,
        controller_world=Force,
    )
    kidney, liver, touch = kidneys[-1], livers[-1], between[-1]
    assert touch.force > 0.1 and fingers[-1].force > 0.5 and len(touch.torques) == 2
    stiff = np.array([2 / 3, 2 / 3, 1.0])
    push, hand = np.array(touch.resultant), np.array(hands[-1].force)
    np.testing.assert_allclose(255.0 * stiff * kidney.displacement, -push, atol=2e-3)
    np.testing.assert_allclose(900.0 * stiff * liver.displacement, push - hand, atol=5e-3)
    tilt = np.array([0.25, 0.25, 1 / 3]) * 255.0 * 0.03**2
    np.testing.assert_allclose(tilt * kidney.rotation, touch.torques[1], atol=2e-4)
    # one line of action: the moments of both about one point cancel
    centres = [np.array(each.centre) + each.displacement for each in (livers[-2], kidneys[-2])]
    total = np.cross(centres[0], push) + touch.torques[0] - np.cross(centres[1], push) + touch.torques[1]
    assert np.abs(total).max() < 1e-12


@NOTES
def test_its_ledger_closes_with_the_work_of_the_foundations_and_it_replays_with_the_same_bytes(pressed):
    (books,) = read(pressed, ledger=Ledger)
    last = books[-1]
    parts = sum(
        getattr(last, f"{part}_{what}")
        for part in ("fingertip", "tissue", "friction") for what in ("stored", "dissipated")
    )  # fmt: skip
    assert last.hand + last.carried[0] == approx(last.controller + last.sampling + parts + last.unexplained, abs=1e-9)
    assert last.carried[0] < -1e-4 and not last.tripped
    report = verify(pressed, plan_of(pressed), tolerance=0.0)
    assert report.ok, report


@NOTES
@pytest.mark.long
def test_it_runs_in_processes_with_the_same_bytes(pressed, tmp_path):
    both = on_foundations(foundation_of("kidney"), foundation_of("liver", "900 N/m", "300 g"))
    apart = run(tmp_path / "apart.mcap", *QUICK, both, place="apart", duration=0.4)
    ours = {(name, tick): payload for name, tick, payload in apart.payloads()}
    theirs = {(name, tick): payload for name, tick, payload in pressed.payloads()}
    assert len(ours) > 3000 and all(theirs[key] == payload for key, payload in ours.items())


@pytest.mark.notes("are linear where they touch", STIFF)
def test_lanes_have_the_bytes_of_single_runs(tmp_path):
    stiff, scene = [255.0, 900.0], tmp_path / "foundations.yaml"
    scene.write_text(f"extends: neighbours\nfoundations:\n  {foundation_of('kidney')}\n")
    lanes = palpate.Ensemble(
        "neighbours", 2, {"kidney-foundation.stiffness": stiff}, ["kidney-foundation.displacement", "between.force"],
        scene=str(scene), duration=0.35, sets=QUICK,
    )  # fmt: skip
    answers = lanes.run()
    for lane, stiffness in enumerate(stiff):
        foundations = on_foundations(foundation_of("kidney", f"{stiffness} N/m"))
        supports, between = read(
            run(tmp_path / "one.mcap", *QUICK, foundations, duration=0.35),
            kidney_foundation=Support,
            between=OrganContact,
        )
        assert np.array_equal(answers["kidney-foundation.displacement"][lane], column(supports, "displacement"))
        assert np.array_equal(answers["between.force"][lane], column(between, "force"))
        assert between[-1].force > 0.05


@NOTES
@pytest.mark.long
def test_a_foundation_of_1_gn_per_m_is_that_of_a_fixed_organ(tmp_path):
    """Within 1e-5 of the force of finger and organs."""
    found = [
        read(run(tmp_path / f"{k}.mcap", *QUICK, *sets), between=OrganContact, contact=Contact)
        for k, sets in enumerate(((), (on_foundations(foundation_of("kidney", "1e9 N/m")),)))
    ]
    for one, other in zip(*found, strict=True):
        forces = column(one, "force")
        assert forces.max() > 0.1
        np.testing.assert_allclose(column(other, "force"), forces, atol=1e-5 * forces.max())


@NOTES
def test_neighbours_out_of_reach_leave_the_bytes_of_an_organ_on_a_foundation(tmp_path):
    """All streams but those of the contact, against an organ on a foundation alone."""
    far = "scene.liver-surface.position=[0, 0, 0.160]"
    path = "scene.hand.path=[{to: [0, 0, 0.172], time: 0.2}]"
    sets = (*COARSE, far, "scene.hand.begin=[0, 0, 0.1825]", path)
    near, alone = (
        read(run(tmp_path / f"{k}.mcap", *sets, *more, duration=0.3), contact=Contact, liver=Surface)
        for k, more in enumerate(((), (on_foundations(foundation_of("kidney")),)))
    )
    assert max(each.force for each in near[0]) > 0.3
    for one, other in zip(near[0], alone[0], strict=True):
        assert one.force == other.force and one.indentation == other.indentation


@NOTES
@pytest.mark.long
def test_a_pinch_lifts_the_kidney_off_the_liver_and_drops_it_there(tmp_path):
    found = run(tmp_path / "lift.mcap", *COARSE, graph="pinch-liver", duration=3.9)
    kidneys, livers, between, books, one, other = read(
        found, foundation=Support, liver_foundation=Support, between=OrganContact, ledger=Ledger,
        controller_thumb_world=Force, controller_index_world=Force,
    )  # fmt: skip
    high = column(kidneys, "displacement")[:, 2]
    hands = column(one, "force") + column(other, "force")
    assert high[1850:2000].min() > 12e-3 and max(each.force for each in between[1500:2800]) == 0.0
    np.testing.assert_allclose(hands[1850:2000].mean(axis=0), [0.0, 0.0, -MASS * G], atol=0.02)
    fall = slice(2950, 3100)
    assert max(each.force for each in between[fall]) > 0.2
    assert column(livers, "displacement")[fall, 2].min() < -1e-5
    assert between[-1].generated < 1e-6 and np.ptp(high[-100:]) < 1e-5
    assert max(each.generated for each in books) < 1e-3 and not books[-1].tripped


@NOTES
def test_a_finger_feels_several_organs_of_which_one_is_on_a_foundation(tmp_path):
    """The kidney sinks into its foundation by the force of the hand, in the axes of the world."""
    sets = ("scene.surface.vertices=2000", on_foundations(foundation_of("kidney")))
    graph = load("organs", overrides=list(sets))
    assert any("move differently" in note for note in graph.notes)
    supports, hands = read(
        run(tmp_path / "organs.mcap", *sets, graph="organs", duration=0.8), kidney_foundation=Support, controller=Force
    )
    force = np.array(hands[-1].force)
    assert force[2] > 0.4 and abs(supports[-1].rotation[0]) > 0.02
    np.testing.assert_allclose(
        np.array([2 / 3, 2 / 3, 1.0]) * 255.0 * supports[-1].displacement, -force, atol=0.02 * force[2]
    )


def test_an_organ_without_finger_gets_a_foundation_of_its_contacts():
    graph = load("neighbours", overrides=[on_foundations(foundation_of("kidney"))])
    node = graph.nodes["kidney-foundation"]
    assert node.cls is OrganFoundation and node.settings["sides"] == (1,)


@NOTES
@pytest.mark.long
def test_a_stack_on_foundations_comes_to_rest_with_the_sum_of_its_forces(tmp_path):
    """The middle organ has two contacts: K d of it and of the lowest one add up to the force of the uppermost."""
    foundations = on_foundations(foundation_of("middle", "600 N/m", "80 g"), foundation_of("kidney", "400 N/m"))
    small = [f"scene.{name}.surface.vertices=2000" for name in ("upper", "middle", "kidney")]
    path = "scene.hand.path=[{to: [0, 0, 0.138], time: 0.4}, {hold: 1}]"
    middles, kidneys, upper = read(
        run(tmp_path / "stack.mcap", *small, foundations, path, graph="stack", duration=1.0),
        middle_foundation=Support, kidney_foundation=Support, between_upper_middle=OrganContact,
    )  # fmt: skip
    down = [-each[-1].displacement[2] for each in (middles, kidneys)]
    assert upper[-1].force > 0.1 and min(down) > 1e-5
    assert abs(upper[-1].resultant[2]) == approx(600.0 * down[0] + 400.0 * down[1], rel=5e-3)
