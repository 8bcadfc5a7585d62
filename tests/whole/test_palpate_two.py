"""Two fingers palpate one body with a nodule: the shipped graph, its faults, and its runs."""

import numpy as np
import pytest
from pytest import approx
from streams import payloads

from palpate.engine.faults import GraphError
from palpate.launch.load.graph import load
from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.messages import Contact, Contacts, Surface, unpack
from palpate.records.player import plan_of
from palpate.records.reader import Recording
from palpate.records.verify import verify

QUICK = ("scene.surface.vertices=1500", "scene.index.begin=[-0.012, 0, 0.110]", "scene.middle.begin=[-0.030, 0, 0.110]")

REDUCED = ("tissue.use=deformation.ReducedFE", "scene.nodule.nodule_radius=0")


def run(path, *overrides, place="fused", duration=0.8, clock=None):
    more = {} if clock is None else {"clock": clock}
    launch = find("palpate-two").but(
        duration=duration, record=path, place=place, overrides=(*QUICK, *overrides), **more
    )
    outcome = execute(launch)
    assert outcome.result.ok, outcome.result.deaths
    return Recording(path)


@pytest.fixture(scope="module")
def felt(tmp_path_factory):
    return run(tmp_path_factory.mktemp("two") / "two.mcap", *REDUCED)


def test_both_hands_get_forces_and_the_body_gets_both_loads(felt):
    streams = payloads(felt)
    first, second = ([unpack(m, Contact) for m in streams[f"contact-{i}"]] for i in (1, 2))
    assert max(c.force for c in first) > 0.3 and max(c.force for c in second) > 0.3
    for share, place in ((first, 0), (second, 1)):
        joint = [unpack(m, Contacts) for m in streams["joint"]]
        assert [c.force for c in share] == [c.force[place] for c in joint]
    last = unpack(streams["tissue"][-1], Surface)
    assert last.laws.shape == (2, 5) and 0.05 < last.coupling[0, 1] < 0.5


def test_it_replays_bit_for_bit(felt):
    report = verify(felt, plan_of(felt), tolerance=0.0)
    assert report.ok and report.complete, report.first


def test_one_process_per_node_sends_the_same_bytes(felt, tmp_path):
    assert payloads(run(tmp_path / "apart.mcap", *REDUCED, place=None)) == payloads(felt)


def test_a_run_on_the_real_clock_replays_bit_for_bit(tmp_path):
    recording = run(tmp_path / "real.mcap", duration=0.6, clock="real")
    report = verify(recording, plan_of(recording), tolerance=0.0)
    assert report.ok, report.first


def test_an_invalid_condition_of_a_finger_is_an_error(tmp_path):
    path = tmp_path / "two.yaml"
    path.write_text("extends: palpate-two\nnodes: {contact-2: {when: tissue.second}}\nscene: palpate-two\n")
    with pytest.raises(GraphError) as error:
        load(path)
    assert "the scene has no 'tissue.second'" in str(error.value)


FAULTS = {
    "the other way round": (
        "tissue: {in: {load: [spread-2, spread-1]}}",
        ["input 'load': gets the loads of the fingers 'collision-2' and 'collision-1', but 'joint' solves for",
         "`joint: {in: {proximity: [collision-2, collision-1]}}`"],
    ),
    "one sender twice": (
        "tissue: {in: {load: [spread-1, spread-1]}}", ["input 'load': has the sender 'spread-1' twice"]),
    "a body that takes one": (
        "tissue: {use: tests.support.graph_nodes.Spring}",
        ["takes one Load, found 2 senders", "take several: deformation.BeamBundle"],
    ),
    "no sender": ("tissue: {in: {load: []}}", ["input 'load', which drives the node, has no sender"]),
    "each for itself": (
        "contact-2: {use: contact.Series, in: {contacts: null, proximity: collision-2, body: tissue}}",
        ["gets the loads of 'contact-1' and 'contact-2', which are not solved together", "use: contact.Joint"],
    ),
    "energy balance of one contact": (
        "ledger: {use: ledger.Energy, in: {contact: contact-1, friction: friction-1, force: controller-1, "
        "pose: finger-1, body: tissue}}",
        ["includes 'contact-1', but 'contact-1' and 'contact-2' press on 'tissue'", "`ledger: null`"],
    ),
    "energy balance with two orders of fingers": (
        "ledger: {use: ledger.Energy, in: {contact: [contact-1, contact-2], friction: [friction-2, friction-1], "
        "force: [controller-1, controller-2], pose: [finger-1, finger-2], body: tissue}}",
        ["input 'friction': gets 'friction-2' and 'friction-1', but 'controller-1' and 'controller-2' at 'force'",
         "in the same order"],
    ),
    "energy balance with one force": (
        "ledger: {use: ledger.Energy, in: {contact: [contact-1, contact-2], friction: [friction-1, friction-2], "
        "force: controller-1, pose: [finger-1, finger-2], body: tissue}}",
        ["input 'contact': gets 'contact-1' and 'contact-2', but 'controller-1' at 'force'"],
    ),
    "more than a record can contain": (
        f"grip: {{use: contact.Grip, in: {{load: [{', '.join(['spread-1'] * 17)}]}}}}",
        ["node 'grip', input 'load': takes at most 16 senders, found 17"],
    ),
    "a finger that is not the joint's": (
        "joint: {in: {proximity: [collision-1]}}",
        ["node 'contact-2', input 'proximity'", "is the finger 'collision-2', but 'joint' solves for 'collision-1'",
         "`joint: {in: {proximity: [collision-1, collision-2]}}`"],
    ),
    "a share without a finger": (
        "contact-2: {in: {proximity: null}}",
        ["node 'contact-2', input 'proximity'", "takes the contact of 'joint', and has no `proximity`",
         "with one of the fingers of 'joint'"],
    ),
    "a load that is left out": (
        "tissue: {in: {load: spread-1}}",
        ["node 'contact-2'", "reads the body 'tissue', on which only 'contact-1' presses"],
    ),
}  # fmt: skip


@pytest.mark.parametrize(("line", "words"), FAULTS.values(), ids=FAULTS)
def test_wiring_with_wrong_forces_is_an_error_with_a_remedy(tmp_path, line, words):
    path = tmp_path / "two.yaml"
    path.write_text(f"extends: palpate-two\nnodes:\n  {line}\n")
    with pytest.raises(GraphError) as error:
        load(path)
    printed = str(error.value).replace("input 'load': input, which", "input 'load', which")
    for word in words:
        assert word in printed, printed


def test_the_surface_is_recorded_under_both_fingers(felt):
    surfaces = [unpack(m, Surface) for m in payloads(felt)["tissue"]]
    deep = max(surfaces, key=lambda s: np.abs(s.displacement).sum())
    depth = -deep.displacement[:, 2]
    assert depth.max() > 1e-3 and np.isfinite(depth).all()
    assert deep.previous_indentation == approx(deep.laws[0, 4])
