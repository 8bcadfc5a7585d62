"""A finger closes a slot of one organ, whose walls touch: the scene's key `folds`, its faults, and its runs."""

import numpy as np
import pytest
from pytest import approx
from streams import payloads

import palpate
from palpate.engine.faults import GraphError
from palpate.launch.load.effect_costs import effect_costs
from palpate.launch.load.graph import load
from palpate.launch.load.launchfile import find
from palpate.launch.load.plan import plan
from palpate.launch.run.execute import execute
from palpate.messages import Contact, Ledger, Load, Surface, unpack
from palpate.messages.contact import OrganContact
from palpate.models.build import basis
from palpate.nodes.deformation import ReducedFE, basis_store
from palpate.physics.geometry.mesh import write_ply
from palpate.records.player import plan_of
from palpate.records.reader import Recording
from palpate.records.verify import verify
from palpate.studies.organs.gaps import MM, slotted

TOP = 0.105
GAP = 1.5 * MM  # of a slot 12 mm deep in a block 24 mm high
FOLDS = "scene.folds={tissue: {reach: 3 mm}}"
PRESS = f"[{{to: [0, -0.003, {TOP - 8e-3}], time: 0.25}}, {{hold: 0.1}}, {{to: [0, -0.003, {TOP + 8e-3}], time: 0.1}}]"


@pytest.fixture(scope="module")
def slot(tmp_path_factory):
    """The values of `--set` of the block, whose basis is built."""
    folder = tmp_path_factory.mktemp("slot")
    file = folder / "slot.ply"
    write_ply(file, slotted(GAP, (-0.5 * GAP,), 12 * MM, 200))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder))
        body = ReducedFE(surface=str(file), coarse=200, bed=1e4)
        basis.make(body, basis.home(body, basis_store.cache()))
        yield [
            "collision.use=collision.Mesh", "tissue.use=deformation.ReducedFE", "tissue.bed=1e4", "tissue.coarse=200",
            f"scene.surface.surface={file}", f"scene.surface.position=[0, 0, {TOP - 12e-3}]",
            "scene.energy.ledger=true", f"scene.hand.begin=[0, -0.003, {TOP + 8e-3}]", f"scene.hand.path={PRESS}",
        ]  # fmt: skip


def run(slot, path, *overrides, place="fused"):
    launch = find("kidney").but(duration=0.5, record=path, place=place, overrides=(*slot, *overrides))
    outcome = execute(launch)
    assert outcome.result.ok, outcome.result.deaths
    return Recording(path)


@pytest.fixture(scope="module")
def felt(slot, tmp_path_factory):
    return run(slot, tmp_path_factory.mktemp("folds") / "folds.mcap", FOLDS)


@pytest.fixture(scope="module")
def free(slot, tmp_path_factory):
    return payloads(run(slot, tmp_path_factory.mktemp("free") / "free.mcap"))


def test_the_finger_closes_the_slot_and_feels_the_wall_behind(felt, free):
    streams = payloads(felt)
    walls = [unpack(m, OrganContact) for m in streams["folds-tissue"]]
    assert max(w.force for w in walls) > 0.05 and not any(w.left for w in walls)
    assert min(w.gap for w in walls) > -1e-12 and max(w.generated for w in walls) < 1e-12
    assert walls[0].gap == approx(GAP, rel=1e-6) and walls[-1].force == 0.0
    at = int(np.argmax([w.force for w in walls]))
    both, alone = (unpack(each["contact"][at], Contact) for each in (streams, free))
    assert both.force / both.indentation > 1.03 * alone.force / alone.indentation


def test_both_walls_get_opposite_forces(felt):
    streams, pressed = payloads(felt), 0
    for first, second in zip(streams["first-wall-tissue.Load"], streams["second-wall-tissue.Load"], strict=True):
        one, other = unpack(first, Load), unpack(second, Load)
        total = one.forces.sum(axis=0)
        assert other.forces.sum(axis=0) == approx(-total, rel=1e-12, abs=1e-15)
        pressed += abs(total[1]) > 1e-3
    assert pressed > 50


def test_contact_and_organ_agree_on_the_indentation(felt):
    """The finger's contact predicts the indentation of the organ at the end of the step, with the response of its
    walls, except in the step in which cells touch or part."""
    streams = payloads(felt)
    found = [unpack(m, Contact).indentation for m in streams["contact"]]
    sent = [unpack(m, Surface).previous_indentation for m in streams["tissue"]]
    touching = np.flatnonzero([unpack(m, OrganContact).force > 0.0 for m in streams["folds-tissue"]])
    apart = np.abs(np.subtract(found, sent))[touching]
    assert np.median(apart) < 1e-6 and apart.max() < 12e-6, (np.median(apart), apart.max())


def test_nothing_generates_energy(felt):
    """The finger moves the walls outwards against their loads: these take from the energy of the organ, which counted
    before as if they had no load, or as that of both, from one step to the next."""
    books = [unpack(m, Ledger) for m in payloads(felt)["ledger"]]
    assert max(book.generated for book in books) < 2e-3 * max(book.hand for book in books)


def test_it_replays_bit_for_bit(felt):
    report = verify(felt, plan_of(felt), tolerance=0.0)
    assert report.ok and report.complete, report.first


def test_one_process_per_node_sends_the_same_bytes(felt, slot, tmp_path):
    assert payloads(run(slot, tmp_path / "apart.mcap", FOLDS, place=None)) == payloads(felt)


@pytest.mark.notes(
    "without friction", "does not take", "are divided", "are bridged", "the basis of", "may have an error"
)
def test_a_lane_is_a_run_with_the_body_of_that_lane(felt, slot):
    lanes = palpate.Ensemble(
        "kidney", lanes=2, over={"tissue.young": [19e3, 38e3]}, keep=["folds-tissue.force"], duration=0.5,
        sets=[*slot, FOLDS],
    )  # fmt: skip
    found = lanes.run(quiet=True)
    single = [unpack(m, OrganContact).force for m in payloads(felt)["folds-tissue"]]
    assert np.array_equal(found["folds-tissue.force"][0], single)
    assert found["folds-tissue.force"][1].max() != found["folds-tissue.force"][0].max()


@pytest.mark.parametrize("extra", ["scene.folds={tissue: {reach: 1 mm}}", "effects.folds=off"])
def test_without_walls_in_reach_or_the_effect_the_bytes_are_those_of_the_organ_alone(extra, free, slot, tmp_path):
    given = (extra,) if "scene" in extra else (FOLDS, extra)
    streams = payloads(run(slot, tmp_path / "far.mcap", *given))
    for stream in ("finger", "collision", "friction", "spread", "controller", "statics", "device"):
        assert streams[stream] == free[stream], stream


def test_the_plan_has_the_effect_and_the_nodes_that_run_for_it(slot):
    planned = plan(load("kidney", overrides=[*slot, FOLDS]))
    found = {item.effect: item for item in effect_costs(planned)}["folds"]
    assert found.on and found.nodes == ["folds-tissue", "first-wall-tissue", "second-wall-tissue"]


def test_a_graph_without_the_key_is_unchanged():
    assert not any("wall" in name or "folds" in name for name in load("kidney").nodes)
    assert load("kidney", overrides=["scene.folds={}"]).nodes.keys() == load("kidney").nodes.keys()


@pytest.mark.parametrize(("given", "text"), [
    ("4 mm", "expected a mapping of bodies to settings"),
    ("{tissue: 4 mm}", "expected a mapping of settings"),
    ("{tisue: {reach: 4 mm}}", "Did you mean 'tissue'"),
    ("{tissue: {reach: 4 s}}", "reach"),
])  # fmt: skip
def test_wrong_folds_are_faults(given, text):
    with pytest.raises(GraphError, match=text):
        load("kidney", overrides=[f"scene.folds={given}"])


def test_a_contact_of_two_organs_with_one_body_names_the_node_for_it_and_the_other_way_round():
    with pytest.raises(GraphError, match=r"use: contact.Folds"):
        load("kidney", overrides=["scene.folds={tissue: {}}", "folds-tissue.use=contact.Between"])
    with pytest.raises(GraphError, match=r"use: contact.Between"):
        load("neighbours", overrides=["between.use=contact.Folds"])


def test_organs_that_touch_others_and_themselves_are_wired_for_both():
    graph = load("neighbours", overrides=["scene.folds={liver: {reach: 2 mm}}", "scene.energy.ledger=true"])
    sent = {name: [(e.port, e.producer) for e in spec.edges] for name, spec in graph.nodes.items()}
    walls = ["first-wall-liver", "second-wall-liver"]
    assert [p for port, p in sent["liver"] if port == "load"] == ["spread", "side-liver", *walls]
    assert [p for port, p in sent["between"] if port == "first"] == ["spread", *walls]
    assert sent["folds-liver"] == [("first", "spread"), ("second", "side-liver")]
    assert [p for port, p in sent["contact"] if port == "neighbour"] == ["side-liver", *walls]
    assert graph.nodes["liver"].settings["organ_loads"] == 3
    assert graph.nodes["folds-liver"].settings["first_organs"] == 0
    assert graph.nodes["folds-liver"].settings["second_organs"] == 1
