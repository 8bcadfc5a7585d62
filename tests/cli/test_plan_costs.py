"""`palpate plan`: the cost of each effect, the nodes that run only for it, and its influence on the force."""

import json

import pytest
from shell_text import unwrapped
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.launch.load.effect_costs import effect_costs
from palpate.launch.load.graph import load
from palpate.launch.load.plan import plan
from palpate.records.reader import Recording
from palpate.studies.ablation import ablate


def items(*sets, graph="kidney", times=None):
    return {item.effect: item for item in effect_costs(plan(load(graph, overrides=sets)), times)}


def test_each_effect_is_listed_with_the_rule_that_decided():
    costs = items()
    assert costs["friction"].on and costs["friction"].rule.startswith("tissue.friction holds (")
    assert not costs["band"].on and costs["band"].rule.startswith("finger.band is false (")
    assert costs["relaxation"].on and costs["relaxation"].rule == "contact.finger_damping is 8.0"
    assert costs["shape"].on and "read by log" in costs["shape"].rule
    switched = items("effects.friction=off", "effects.band=on")
    assert switched["friction"].rule == "effects: friction is off (--set effects.friction=off)"
    assert switched["band"].on and switched["band"].nodes == ["band"]
    assert "pressure" not in costs, "MassSpring has none"
    beams = items("tissue.use=deformation.BeamBundle")
    assert not beams["pressure"].on and beams["pressure"].rule == "output unused: pressure"


def test_the_nodes_of_an_effect_are_those_that_do_not_run_without_it():
    costs = items("wanted=[controller]")
    assert costs["friction"].nodes == ["friction"]
    assert costs["deformation"].nodes[-1] == "tissue" and "controller" not in costs["deformation"].nodes
    assert items()["shape"].fields == ["tissue.displacement", "tissue.nodes"]


def test_the_effect_of_a_custom_class_is_listed(monkeypatch):
    from palpate.nodes.spread import Kernel

    monkeypatch.setattr(Kernel, "effect", "glow", raising=False)
    assert items()["glow"].on


def test_the_cost_of_an_effect_is_that_of_its_nodes_over_their_divisors():
    times = {"friction": 4e-6, "band": 30e-6}
    costs = items("effects.band=on", times=times)
    assert costs["friction"].price == 4e-6 and costs["band"].price == pytest.approx(3e-6)
    assert costs["deformation"].price is None


def command(*args):
    return CliRunner().invoke(app, [str(arg) for arg in args])


@pytest.fixture(scope="module")
def recording(short_kidney):
    return Recording(short_kidney)


def test_a_recording_contains_the_step_times_of_its_nodes(recording):
    assert set(recording.times) >= {"device", "contact", "tissue"}
    assert all(
        0 < printed["median"] <= printed["p99"] and printed["steps"] == 350 for printed in recording.times.values()
    )


def test_the_proof_prints_the_force_with_the_opposite_choice(recording):
    costs = items()
    ablate(recording, list(costs.values()))
    assert "without it: force differs by" in costs["friction"].proof
    assert "without it: same force" in costs["shape"].proof
    assert "with it: same force" in costs["band"].proof
    assert costs["nodule"].proof == "not tried: tissue.nodule_radius needs a value"
    assert costs["recording"].proof == "no message depends on it"


def test_the_command_prints_text_or_json_and_draws_a_picture(recording, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    text = command("plan", "kidney", "--ablate", recording.path).stdout
    output = " ".join(text.split())
    assert (
        "µs: median step time of the nodes that run only for this effect" in output
        and "the whole tick, recomputed" in output
    )
    untimed = unwrapped(command("plan", "kidney").stdout)
    assert "the whole tick" not in untimed and "no times: no recording of this graph in runs/" in untimed
    assert "friction" in text and "force differs by" in text and "no times" not in text
    data = json.loads(command("plan", "kidney", "--json").stdout)
    printed = {item["effect"]: item for item in data["costs"]}
    assert printed["friction"]["on"] and printed["friction"]["price"] is None and data["times_from"] is None
    (tmp_path / "runs" / "kidney-1").mkdir(parents=True)
    (tmp_path / "runs" / "kidney-1" / "kidney.mcap").write_bytes(recording.path.read_bytes())
    assert "kidney.mcap" in command("plan", "kidney").stdout
    assert command("plan", "kidney", "--ablate", tmp_path / "none.mcap").exit_code == 2
