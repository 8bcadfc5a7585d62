"""`palpate plan` as a bill: what is on and why, what runs for it alone, what it costs, and what it changes."""

import json

import pytest
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.launch.load.bill import bill
from palpate.launch.load.graph import load
from palpate.launch.load.plan import plan
from palpate.records.reader import Recording
from palpate.studies.prove import prove


def items(*sets, graph="kidney", times=None):
    return {item.effect: item for item in bill(plan(load(graph, overrides=sets)), times)}


def test_each_effect_of_the_graph_is_told_with_the_rule_that_decided():
    bill_items = items()
    assert bill_items["friction"].on and bill_items["friction"].rule.startswith("tissue.friction holds (")
    assert not bill_items["band"].on and bill_items["band"].rule.startswith("finger.band is false (")
    assert bill_items["relaxation"].on and bill_items["relaxation"].rule == "contact.finger_damping is 8.0"
    assert bill_items["shape"].on and "read by log" in bill_items["shape"].rule
    switched = items("effects.friction=off", "effects.band=on")
    assert switched["friction"].rule == "effects: friction is off (--set effects.friction=off)"
    assert switched["band"].on and switched["band"].nodes == ["band"]
    assert "pressure" not in bill_items, "MassSpring has none"
    beams = items("tissue.use=deformation.BeamBundle")
    assert not beams["pressure"].on and beams["pressure"].rule == "output unused: pressure"


def test_what_runs_for_an_effect_alone_is_what_its_absence_leaves_out():
    bill_items = items("wanted=[controller]")
    assert bill_items["friction"].nodes == ["friction"]
    assert bill_items["deformation"].nodes[-1] == "tissue" and "controller" not in bill_items["deformation"].nodes
    assert items()["shape"].fields == ["tissue.displacement", "tissue.nodes"]


def test_an_effect_of_a_class_of_ones_own_is_on_the_bill(monkeypatch):
    from palpate.nodes.spread import Kernel

    monkeypatch.setattr(Kernel, "effect", "glow", raising=False)
    assert items()["glow"].on


def test_the_price_is_that_of_the_nodes_that_run_for_it_alone_by_their_divisors():
    times = {"friction": 4e-6, "band": 30e-6}
    bill_items = items("effects.band=on", times=times)
    assert bill_items["friction"].price == 4e-6 and bill_items["band"].price == pytest.approx(3e-6)
    assert bill_items["deformation"].price is None


def command(*args):
    return CliRunner().invoke(app, [str(arg) for arg in args])


@pytest.fixture(scope="module")
def recording(short_kidney):
    return Recording(short_kidney)


def test_a_recording_knows_the_times_of_its_nodes(recording):
    assert set(recording.times) >= {"device", "contact", "tissue"}
    assert all(0 < told["median"] <= told["p99"] and told["steps"] == 350 for told in recording.times.values())


def test_the_proof_says_what_the_force_would_be_the_other_way_round(recording):
    bill_items = items()
    prove(recording, list(bill_items.values()))
    assert "without it: force differs by" in bill_items["friction"].proof
    assert "without it: same force" in bill_items["shape"].proof
    assert "with it: same force" in bill_items["band"].proof
    assert bill_items["nodule"].proof == "not tried: tissue.nodule_radius needs a value"
    assert bill_items["recording"].proof == "no message depends on it"


def test_the_command_tells_it_as_text_as_json_and_as_a_picture(recording, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    text = command("plan", "kidney", "--ablate", recording.path).stdout
    said = " ".join(text.split())
    assert (
        "µs: median step time of the nodes that run only for this effect" in said
        and "the whole tick, computed again" in said
    )
    assert "the whole tick" not in " ".join(command("plan", "kidney").stdout.split())
    assert "friction" in text and "force differs by" in text and "no times yet" not in text
    data = json.loads(command("plan", "kidney", "--json").stdout)
    told = {item["effect"]: item for item in data["costs"]}
    assert told["friction"]["on"] and told["friction"]["price"] is None and data["times_from"] is None
    (tmp_path / "runs" / "kidney-1").mkdir(parents=True)
    (tmp_path / "runs" / "kidney-1" / "kidney.mcap").write_bytes(recording.path.read_bytes())
    assert "kidney.mcap" in command("plan", "kidney").stdout
    assert command("plan", "kidney", "--ablate", tmp_path / "none.mcap").exit_code == 2
