"""A finger presses one organ into another: the shipped graph, its faults, and its runs."""

import numpy as np
import pytest
from pytest import approx

import palpate
from palpate.engine.faults import GraphError
from palpate.launch.load.graph import load
from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.messages import Contact, Load, Surface, unpack
from palpate.messages.contact import OrganContact
from palpate.records.player import plan_of
from palpate.records.reader import Recording
from palpate.records.verify import verify

QUICK = (
    "scene.surface.vertices=2000", "scene.liver-surface.vertices=2000",
    "scene.hand.path=[{to: [0, 0, 0.138], time: 0.2}, {hold: 0.1}, {to: [0, 0, 0.160], time: 0.1}]",
)  # fmt: skip
APART = "scene.liver-surface.position=[0, 0, 0.1322]"


def run(path, *overrides, place="fused", duration=0.45):
    launch = find("neighbours").but(duration=duration, record=path, place=place, overrides=(*QUICK, *overrides))
    outcome = execute(launch)
    assert outcome.result.ok, outcome.result.deaths
    return Recording(path)


def payloads(recording):
    by_stream: dict[str, list[bytes]] = {}
    for name, _, payload in recording.payloads():
        by_stream.setdefault(name, []).append(payload)
    return by_stream


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


def test_contact_and_organ_agree_on_the_indentation_also_where_the_organs_meet_and_part(felt):
    """The finger's contact predicts the indentation of the organ at the end of the step, with the response of the other
    organ; the first cells that touch are felt a step later, while the finger moves by 100 um per step. A patch that
    changed with the load of the other organ made a difference of 6 um where they parted."""
    streams = payloads(felt)
    found = [unpack(m, Contact).indentation for m in streams["contact"]]
    sent = [unpack(m, Surface).previous_indentation for m in streams["liver"]]
    touching = np.flatnonzero([unpack(m, OrganContact).force > 0.0 for m in streams["between"]])
    apart = np.abs(np.subtract(found, sent))
    assert apart[touching[0]] < 12e-6 and apart[touching[0] + 1 : touching[-1]].max() < 6e-6
    assert apart[touching[-1] + 1 : touching[-1] + 5].max() < 1e-6


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
        "  liver: {in: {load: [spread]}}\n  kidney: null\n  between: null\n  side-liver: null\n  side-kidney: null\n"
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


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ("side-kidney.side=first", "has 2 contact.Side with `side: first`, expected 1"),
        ("kidney.in={load: []}", "read by 0 bodies"),
    ],
)
def test_wrong_wiring_is_refused(change, says):
    with pytest.raises(GraphError, match=says.replace(".", r"\.")):
        load("neighbours", overrides=[change])


def test_organs_that_overlap_at_the_start_are_refused_with_their_depth(tmp_path):
    with pytest.raises(palpate.PalpateError, match=r"overlap by [0-9.]+ mm at the start"):
        palpate.run(
            "neighbours", record=None, duration=0.01, sets=(*QUICK, "scene.liver-surface.position=[0, 0, 0.12]")
        )
