"""A finger presses one organ into another: the shipped graph, its faults, and its runs."""

import re

import numpy as np
import pytest
from pytest import approx
from streams import payloads

import palpate
from palpate.engine.faults import GraphError
from palpate.launch.load.graph import load
from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.messages import Contact, Contacts, Ledger, Load, Surface, unpack
from palpate.messages.contact import OrganContact
from palpate.records.player import plan_of
from palpate.records.reader import Recording
from palpate.records.verify import verify

QUICK = (
    "scene.energy.ledger=true", "scene.surface.vertices=2000", "scene.liver-surface.vertices=2000",
    "scene.hand.path=[{to: [0, 0, 0.138], time: 0.2}, {hold: 0.1}, {to: [0, 0, 0.160], time: 0.1}]",
)  # fmt: skip
APART = "scene.liver-surface.position=[0, 0, 0.1322]"


def run(path, *overrides, place="fused", duration=0.45):
    launch = find("neighbours").but(duration=duration, record=path, place=place, overrides=(*QUICK, *overrides))
    outcome = execute(launch)
    assert outcome.result.ok, outcome.result.deaths
    return Recording(path)


@pytest.fixture(scope="module")
def felt(tmp_path_factory):
    return run(tmp_path_factory.mktemp("neighbours") / "both.mcap")


def test_the_finger_presses_one_organ_into_the_other_and_feels_both(felt, tmp_path):
    streams = payloads(felt)
    both = [unpack(m, Contact) for m in streams["contact"]]
    between = [unpack(m, OrganContact) for m in streams["between"]]
    kidney = unpack(streams["kidney"][290], Surface)
    assert max(b.force for b in between) > 0.05 and kidney.previous_indentation > 1e-4
    assert max(b.generated for b in between) < 1e-12 and min(b.gap for b in between) > -1e-12
    assert not any(b.left for b in between)
    # the finger goes back: the organs part, and everything recovers
    assert between[-1].force == 0.0 and between[-1].gap > 1e-3
    alone = [unpack(m, Contact) for m in payloads(run(tmp_path / "alone.mcap", APART))["contact"]]
    at = np.argmax([b.force for b in between])
    stiffness = [each[at].force / each[at].indentation for each in (both, alone)]
    assert stiffness[0] > 1.05 * stiffness[1]


def test_contact_and_organ_agree_on_the_indentation_also_where_the_organs_meet_and_part(tmp_path):
    """The finger's contact predicts the indentation of the organ at the end of the step, with the response of the other
    organ; the first cells that touch are felt a step later, while the finger moves by 100 um per step. A patch that
    changed with the load of the other organ made a difference of 6 um where they parted, now 2.8 um. Positions are
    exact: steps of the encoders move the finger by 20 um more or less, at other ticks on another processor."""
    streams = payloads(run(tmp_path / "exact.mcap", "scene.hand.ideal=true"))
    found = [unpack(m, Contact).indentation for m in streams["contact"]]
    sent = [unpack(m, Surface).previous_indentation for m in streams["liver"]]
    touching = np.flatnonzero([unpack(m, OrganContact).force > 0.0 for m in streams["between"]])
    apart = np.abs(np.subtract(found, sent))
    assert apart[touching[0]] < 12e-6 and apart[touching[0] + 1 : touching[-1]].max() < 6e-6
    assert apart[touching[-1] + 1 : touching[-1] + 5].max() < 4e-6


def test_the_ledger_counts_both_organs_and_their_contact_and_nothing_generates_energy(felt):
    """By independent arithmetic: the work of the neighbour's load on the recorded displacement of the kidney's surface
    is what the kidney stores and loses, and the ledger has the sum of both organs."""
    streams = payloads(felt)
    books = [unpack(m, Ledger) for m in streams["ledger"]]
    surfaces = {name: [unpack(m, Surface) for m in streams[name]] for name in ("liver", "kidney")}
    for book, liver, kidney in zip(books, surfaces["liver"], surfaces["kidney"], strict=True):
        assert book.tissue_stored == liver.stored[0] + kidney.stored[0]
    loads = [unpack(m, Load) for m in streams["side-kidney.Load"]]
    work, before, works = 0.0, np.zeros((20_000, 3)), []
    for given, surface in zip(loads, surfaces["kidney"], strict=True):
        now = np.zeros_like(before)
        now[surface.nodes] = surface.displacement
        work += float(np.sum(given.forces * (now - before)[given.nodes]))
        works.append(work)
        before = now
    stored = np.array([s.stored[0] for s in surfaces["kidney"]])
    assert stored.max() > 0.2e-3 and (np.array(works) >= 0.95 * stored).all()
    held = 290  # the finger rests: what the kidney received beyond what it stores was lost in its viscosity
    assert stored[held] < works[held] < 2.5 * stored[held]
    assert works[-1] > 0.0 and stored[-1] < 1e-3 * stored.max()
    # a sampled display generates energy, also on one organ
    assert max(book.generated for book in books) < 2e-3 * max(book.hand for book in books)
    assert books[-1].tissue_dissipated > 0.9 * unpack(streams["between"][-1], OrganContact).dissipated


def test_action_equals_reaction(felt):
    streams = payloads(felt)
    pressed = 0
    for m, first, second in zip(
        streams["between"], streams["side-liver.Load"], streams["side-kidney.Load"], strict=True
    ):
        between, one, other = unpack(m, OrganContact), unpack(first, Load), unpack(second, Load)
        total = np.array(between.resultant)
        assert one.forces.sum(axis=0) == approx(total, rel=1e-12, abs=1e-15)
        assert other.forces.sum(axis=0) == approx(-total, rel=1e-12, abs=1e-15)
        pressed += len(one.nodes) > 0
    assert pressed > 100


def test_friction_between_the_organs_acts_on_both_and_stays_below_its_limit(tmp_path):
    recording = run(tmp_path / "rubbed.mcap", "scene.between.friction=0.3")
    streams, slid = payloads(recording), 0
    for m, first, second in zip(
        streams["between"], streams["side-liver.Load"], streams["side-kidney.Load"], strict=True
    ):
        between, one, other = unpack(m, OrganContact), unpack(first, Load), unpack(second, Load)
        assert one.forces.sum(axis=0) == approx(np.array(between.resultant), rel=1e-9, abs=1e-12)
        assert other.forces.sum(axis=0) == approx(-np.array(between.resultant), rel=1e-9, abs=1e-12)
        pull = np.linalg.norm(between.friction)
        assert pull <= 0.3 * between.force * (1.0 + 1e-9)
        slid += pull > 0.29 * between.force > 0.0
    assert slid > 10
    report = verify(recording, plan_of(recording), tolerance=0.0)
    assert report.ok and report.complete, report.first
    books = [unpack(m, Ledger) for m in streams["ledger"]]
    # a sampled display generates energy, friction a part of its work; 0.23 % with exact positions
    assert max(book.generated for book in books) < 3e-3 * max(book.hand for book in books)


def test_it_replays_bit_for_bit(felt):
    report = verify(felt, plan_of(felt), tolerance=0.0)
    assert report.ok and report.complete, report.first


def test_one_process_per_node_sends_the_same_bytes(felt, tmp_path):
    assert payloads(run(tmp_path / "apart.mcap", place=None)) == payloads(felt)


@pytest.mark.notes("without friction")
def test_a_lane_is_a_run_with_the_second_body_of_that_lane(felt):
    """The settings of a body reach the contact of each lane."""
    lanes = palpate.Ensemble(
        "neighbours", lanes=2, over={"kidney.young": [19e3, 38e3]}, keep=["between.force", "contact.force"],
        duration=0.45, sets=QUICK,
    )  # fmt: skip
    found = lanes.run()
    single = [unpack(m, OrganContact).force for m in payloads(felt)["between"]]
    assert np.array_equal(found["between.force"][0], single)
    assert found["between.force"][1].max() > 1.05 * found["between.force"][0].max()


def test_organs_out_of_reach_have_the_bytes_of_one_alone(tmp_path):
    """Hand, contact and friction of a finger on a body with an unused neighbour equal those without it to the bit."""
    graph = tmp_path / "alone.yaml"
    graph.write_text(
        "extends: neighbours\nnodes:\n"
        "  contact: {use: contact.Series, in: {proximity: collision, body: liver}, with: $finger}\n"
        "  liver: {in: {load: [spread]}}\n  kidney: null\n  between: null\n  side-liver: null\n"
        "  side-kidney: null\n  ledger: null\n  controller: {in: {ledger: null}}\n"
    )
    far = "scene.liver-surface.position=[0, 0, 0.140]", "scene.hand.path=[{to: [0, 0, 0.150], time: 0.2}]"
    found = []
    for k, name in enumerate(("neighbours", graph)):
        path = tmp_path / f"{k}.mcap"
        assert execute(find(str(name)).but(duration=0.3, record=path, place="fused", overrides=far)).result.ok
        found.append(payloads(Recording(path)))
    with_neighbour, alone = found
    assert max(unpack(m, Contact).force for m in alone["contact"]) > 0.5
    for stream in ("finger", "collision", "spread", "controller", "statics", "device"):
        assert with_neighbour[stream] == alone[stream]


@pytest.fixture(scope="module")
def three(tmp_path_factory):
    """Two fingers on the liver-like ball and one on the kidney below it: the graph, and a recording."""
    folder = tmp_path_factory.mktemp("three")
    graph = folder / "three.yaml"
    graph.write_text(THREE)
    return graph, run_three(graph, folder / "three.mcap")


THREE = """
extends: neighbours
nodes:
  device-2:    {use: device.Simulated, in: {torque: statics-2}, with: $hand, begin: [0.018, 0, 0.155],
                path: [{to: [0.014, 0, 0.136], time: 0.2}, {hold: 0.1}, {to: [0.018, 0, 0.155], time: 0.1}]}
  device-3:    {use: device.Simulated, in: {torque: statics-3}, with: $hand, begin: [-0.034, 0, 0.115],
                path: [{to: [-0.034, 0, 0.098], time: 0.2}, {hold: 0.1}, {to: [-0.034, 0, 0.115], time: 0.1}]}
  finger-2:    {use: kinematics.FalconKinematics, in: {state: device-2}}
  finger-3:    {use: kinematics.FalconKinematics, in: {state: device-3}}
  collision-2: {use: collision.Nurbs, in: {pose: finger-2}, with: [$liver-surface, $finger]}
  collision-3: {use: collision.Nurbs, in: {pose: finger-3}, with: [$surface, $finger]}
  joint:       {use: contact.Joint, in: {proximity: [collision, collision-2], body: liver, neighbour: [side-liver]},
                with: $finger}
  contact:     {use: contact.Share, in: {contacts: joint, proximity: collision, body: liver}}
  contact-2:   {use: contact.Share, in: {contacts: joint, proximity: collision-2, body: liver}}
  contact-3:   {use: contact.Backed, in: {proximity: collision-3, body: kidney, neighbour: [side-kidney]},
                with: $finger}
  friction-2:  {use: friction.LuGre, in: {contact: contact-2, proximity: collision-2}, with: $sliding}
  friction-3:  {use: friction.LuGre, in: {contact: contact-3, proximity: collision-3}, with: $sliding}
  spread-2:    {use: spread.Kernel, in: {contact: contact-2, friction: friction-2}, with: $liver-surface}
  spread-3:    {use: spread.Kernel, in: {contact: contact-3, friction: friction-3}, with: $surface}
  between:     {in: {first: [spread, spread-2], second: [spread-3]}}
  liver:       {in: {load: [spread, spread-2, side-liver]}}
  kidney:      {in: {load: [spread-3, side-kidney]}}
  controller-2: {use: controller.Haptic, in: {contact: contact-2, friction: friction-2, pose: finger-2}}
  controller-3: {use: controller.Haptic, in: {contact: contact-3, friction: friction-3, pose: finger-3}}
  statics-2:   {use: kinematics.FalconStatics, in: {force: controller-2, pose: finger-2}}
  statics-3:   {use: kinematics.FalconStatics, in: {force: controller-3, pose: finger-3}}
  ledger:      {in: {force: [controller, controller-2, controller-3], contact: [contact, contact-2, contact-3],
                pose: [finger, finger-2, finger-3], friction: [friction, friction-2, friction-3]}}
"""


def run_three(graph, path, *overrides, place="fused"):
    launch = find(str(graph)).but(duration=0.45, record=path, place=place, overrides=(*QUICK, *overrides))
    outcome = execute(launch)
    assert outcome.result.ok, outcome.result.deaths
    return Recording(path)


def test_two_fingers_on_an_organ_and_one_on_its_neighbour_feel_the_other_organ_in_the_same_step(three, tmp_path):
    graph, recording = three
    streams = payloads(recording)
    between = [unpack(m, OrganContact) for m in streams["between"]]
    assert max(b.force for b in between) > 0.05 and not any(b.left for b in between)
    assert max(b.generated for b in between) < 1e-12 and between[150].first_yields.shape == (2, 2)
    assert max(abs(b.first_yields[0, 1]) for b in between) > 1e-6
    assert max(unpack(m, Contact).force for m in streams["contact-3"]) > 0.3
    # as steady as without the other organ, for one step's delay of its response to friction made the force alternate
    alone = payloads(run_three(graph, tmp_path / "alone.mcap", APART))
    known, without = course(streams), course(alone)
    assert (known["change"] < 2.0 * without["change"]).all(), (known, without)  # the organ is stiffer; 12 times before
    assert (known["apart"] < 1.3 * without["apart"] + 6e-6).all(), (known, without)
    assert known["generated"] < 1.1 * without["generated"]
    # both fingers on the ball feel the kidney
    at = int(np.argmax([b.force for b in between]))
    for name in ("contact", "contact-2"):
        both, one = (unpack(given[name][at], Contact) for given in (streams, alone))
        assert both.force / both.indentation > 1.02 * one.force / one.indentation


def course(streams):
    """Of each finger on the ball the largest change of its force per step [N], and the largest difference [m] between
    the indentation that the contact computed and that of the body at the end of the step; energy generated [J]."""
    joint = [unpack(m, Contacts) for m in streams["joint"]]
    liver = [unpack(m, Surface) for m in streams["liver"]]
    forces = np.array([c.force for c in joint])
    apart = np.abs(np.array([c.indentation for c in joint]) - [b.laws[:2, 4] for b in liver])
    books = [unpack(m, Ledger) for m in streams["ledger"]]
    return {
        "change": np.abs(np.diff(forces, axis=0)).max(axis=0), "apart": (apart * (forces > 0.0)).max(axis=0),
        "generated": max(book.generated for book in books),
    }  # fmt: skip


def test_three_fingers_replay_bit_for_bit_and_have_the_same_bytes_in_processes(three, tmp_path):
    """In three processes, between which nearly all messages pass, in place of thirty."""
    graph, recording = three
    report = verify(recording, plan_of(recording), tolerance=0.0)
    assert report.ok and report.complete, report.first
    names = [node["name"] for node in recording.about["plan"]["nodes"] if node["name"] != "log"]
    place = tmp_path / "place.yaml"
    place.write_text("".join(f"g{k}: {{nodes: [{', '.join(names[k::3])}]}}\n" for k in range(3)))
    assert payloads(run_three(graph, tmp_path / "apart.mcap", place=place)) == payloads(recording)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ("side-kidney.side=first", "has 2 contact.Side with `side: first`, expected 1"),
        ("kidney.in={load: []}", "read by 0 bodies"),
        (
            "contact.use=contact.Series",
            "a contact.Series feels [] of the organs that touch 'liver', expected [side-liver]",
        ),
        ("contact.in.neighbour=[side-kidney]", "feels [side-kidney] of the organs that touch 'liver'"),
        ("between.in.first=[]", "gets the loads [] of 'liver', which bears [spread] and that of the contact"),
        ("liver.in.load=[side-liver, spread]", "a load of another organ is before that of a finger"),
        ("ledger.in.others=[]", "its energy balance would not close"),
        ("ledger.in.between=[]", "its energy balance would not close"),
    ],
)
def test_wrong_wiring_is_refused(change, says):
    with pytest.raises(GraphError, match=re.escape(says)):
        load("neighbours", overrides=["scene.energy.ledger=true", change])


def test_organs_that_overlap_at_the_start_are_refused_with_their_depth(tmp_path):
    with pytest.raises(palpate.PalpateError, match=r"overlap by [0-9.]+ mm at the start"):
        palpate.run(
            "neighbours", record=None, duration=0.01, sets=(*QUICK, "scene.liver-surface.position=[0, 0, 0.12]")
        )


SPRINGS = ["kidney.use=deformation.MassSpring", "kidney.exponent=1", "kidney.damping=0"]


@pytest.mark.parametrize(("setting", "value"), [("exponent", 1.5), ("damping", 5)])
def test_a_law_that_is_not_linear_is_refused_when_the_graph_is_loaded(setting, value):
    """And the remedy that the fault names is accepted."""
    load("neighbours", overrides=SPRINGS)
    with pytest.raises(GraphError) as found:
        load("neighbours", overrides=[*SPRINGS, f"kidney.{setting}={value}"])
    (fault,) = found.value.faults
    assert (fault.node, fault.setting) == ("kidney", setting)
    right = {"exponent": 1, "damping": 0}[setting]
    assert f"found {value} " in fault.text and f"`--set kidney.{setting}={right}`" in fault.cure


def test_an_organ_out_of_reach_may_have_any_law(tmp_path):
    scene = tmp_path / "far.yaml"
    scene.write_text(
        "extends: stack\norgans:\n"
        "  - {name: upper, surface: sphere, vertices: 2000, position: [0, 0, 0.1237], tissue: {young: 20 kPa}}\n"
        "  - {name: lower, surface: sphere, vertices: 2000, position: [0, 0, 0], tissue: {young: 20 kPa}}\n"
    )
    loaded = load("stack", scene=str(scene), overrides=["lower.use=deformation.MassSpring"])
    assert loaded.nodes["lower"].settings["exponent"] == 1.5
