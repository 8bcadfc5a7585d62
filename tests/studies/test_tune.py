"""The choice of the body for a budget, and its report."""

import json
import math
from dataclasses import replace

import pytest
import yaml
from shell_text import unwrapped
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.launch.load.launchfile import find
from palpate.physics.errors import ArgumentError
from palpate.records.compare import compare
from palpate.studies import tune
from palpate.studies.model_error import body_of, error_sentence, known_error
from palpate.studies.search import Evaluation, read_error, record_touch, write
from palpate.studies.tune import QUANTITIES, Goal, candidates, pick

FAST = Evaluation({"tissue.use": "deformation.MassSpring"}, 0.15, 30e-6, 60e-6)
MIDDLE = Evaluation({"tissue.use": "deformation.ReducedFE", "tissue.every": 5}, 0.01, 50e-6, 100e-6)
BEST = Evaluation({"tissue.use": "deformation.ReducedFE"}, 0.003, 100e-6, 200e-6)
PRESS = ("--duration", "0.15 s", "--set", "scene.hand.begin=[0, 0, 0.110]",
         "--set", "scene.hand.path=[{to: [0, 0, 0.100], time: 0.12}]")  # fmt: skip
BROKEN = Evaluation({"tissue.use": "deformation.BeamBundle"}, 0.0, 0.0, 0.0, "too thick")
ALL = [FAST, BROKEN, MIDDLE, BEST]


@pytest.mark.parametrize(
    ("goal", "chosen"),
    [
        (Goal(150e-6, None), MIDDLE),
        (Goal(1e-3, None), BEST),
        (Goal(None, 0.02), MIDDLE),
        (Goal(None, 0.5), FAST),
        (Goal(1e-3, 0.02), BEST),
        (Goal(50e-6, None), None),
        (Goal(80e-6, 0.02), None),
    ],
)
def test_the_choice_is_the_most_accurate_within_the_budget_or_the_cheapest_within_the_error(goal, chosen):
    assert pick(ALL, goal) is chosen


@pytest.mark.parametrize(
    ("text", "share"), [("2 % force", (0.02, "force")), ("0.5% shape", (0.005, "shape")), ("3 %", (0.03, "force"))]
)
def test_an_error_is_a_fraction_of_a_quantity(text, share):
    limit, quantity = read_error(text, QUANTITIES)
    assert (pytest.approx(limit), quantity) == share


@pytest.mark.parametrize("text", ["2", "force", "-1 % force", "2 % colour", "nan % force"])
def test_an_invalid_error_bound_is_reported(text):
    with pytest.raises(ArgumentError, match="such as '2 % force'"):
        read_error(text, QUANTITIES)


def test_a_graph_without_a_body_is_an_error():
    with pytest.raises(ArgumentError, match="expected one deformable body"):
        body_of(find("softness").load())


def test_candidates_are_every_model_at_every_fidelity():
    all_of_them = candidates(find("kidney").load())
    assert len({json.dumps(c.overrides) for c in all_of_them}) == len(all_of_them) == 27
    assert Evaluation({"tissue.use": "deformation.MassSpring"}) in all_of_them
    assert all_of_them[0].overrides == {"tissue.use": "deformation.ReducedFE"}


def test_the_written_file_is_a_launch_file_with_the_choice(tmp_path):
    launch = find("kidney").but(duration=0.5, overrides=["scene.tissue.friction=false"])
    write(launch, MIDDLE.overrides, ["why"], tmp_path / "tuned.yaml")
    assert (tmp_path / "tuned.yaml").read_text().startswith("# why\n")
    again = find(str(tmp_path / "tuned.yaml"))
    graph = again.load()
    assert again.duration == 0.5
    assert graph.nodes["tissue"].every == 5
    assert graph.nodes["tissue"].cls.__name__ == "ReducedFE"
    assert yaml.safe_load((tmp_path / "tuned.yaml").read_text())["set"]["scene.tissue.friction"] is False


def test_the_predicted_cost_is_compared_with_the_measured_one(tmp_path, monkeypatch):
    monkeypatch.setattr(tune, "bodies", lambda: ["deformation.ReducedFE", "deformation.MassSpring"])
    monkeypatch.setattr(tune, "COARSER", (10,))
    monkeypatch.setattr(tune, "EVERY", (1, 5))
    given = ["tune", "kidney", *PRESS, "--budget", "2 s", "-o", str(tmp_path / "t.yaml"), "--json"]
    ran = CliRunner().invoke(app, given)
    assert ran.exit_code == 0, ran.output
    printed = json.loads(ran.stdout)
    errors = {json.dumps(c["set"]): c["error"] for c in printed["candidates"]}
    assert printed["predicted"]["error"] == min(errors.values())
    assert printed["predicted"]["set"] == printed["reference"]
    assert printed["measured"]["error"] == pytest.approx(printed["predicted"]["error"], abs=1e-6)
    for name in ("p50_s", "p99_s", "wall_p50_s", "wall_p99_s"):
        assert 0.0 < printed["measured"][name] < math.inf and 0.0 < printed["candidates"][0][name] < math.inf
    assert CliRunner().invoke(app, ["check", str(tmp_path / "t.yaml")]).exit_code == 0


def test_a_bound_that_no_candidate_keeps_is_reported(tmp_path, monkeypatch):
    monkeypatch.setattr(tune, "bodies", lambda: ["deformation.MassSpring"])
    monkeypatch.setattr(tune, "COARSER", (10,))
    monkeypatch.setattr(tune, "EVERY", (1,))
    given = ["tune", "kidney", *PRESS, "--budget", "1 us", "-o", str(tmp_path / "t.yaml")]
    ran = CliRunner().invoke(app, given)
    assert ran.exit_code == 1
    assert "No model meets 0.001 ms at p99 on this machine." in unwrapped(ran.output)
    assert not (tmp_path / "t.yaml").exists()


def test_a_node_that_no_body_makes_faster_is_named():
    shown = [replace(one, slowest=("display", 600e-6)) for one in ALL]
    assert "Node 'display' alone takes 600 us" in tune.cause(shown, Goal(0.5e-3, None))
    assert tune.cause(shown, Goal(0.7e-3, None)) == ""
    assert tune.cause(shown, Goal(None, 1e-4)) == ""  # only the error counts here, not the time
    assert tune.cause(shown, Goal(0.5e-3, 1e-4)) == ""


WAITS = """
nodes:
  source: {use: nodes_for_rates.Still}
  waits:  {use: nodes_for_rates.Waits, in: {pose: source}}
  log:    {use: logger.Mcap, in: all}
wanted: [waits]
"""


def test_the_cost_is_processor_time_next_to_wall_time(write, tmp_path):
    """The node loses the processor for 4 ms of each step, as if other programs interrupted it."""
    recording = record_touch(find(str(write("waits.yaml", WAITS))).but(duration=0.05), tmp_path / "t.mcap")
    base, variant = compare(recording, [[]], reference=[])
    one = Evaluation({}).with_errors(base, variant)
    assert one.wall[0] >= 4e-3 and one.wall[1] >= 4e-3
    assert 0.0 < one.p50 <= one.p99 < 2e-3 and 0.0 < one.mean < 2e-3 and 0.0 < one.reference < 2e-3
    assert Goal(2e-3, None).met_by(replace(one, error=0.0))


def test_the_slowest_node_other_than_the_body_is_found(tmp_path):
    launch = find("nodule").but(duration=1.0)
    recording = record_touch(launch, tmp_path / "t.mcap")
    base = Evaluation({"tissue.use": "deformation.MassSpring"})
    wanted = Evaluation(base.overrides | {"scene.surface.vertices": 400})
    one = tune.evaluate_candidate(recording, wanted, base, Goal(1.0, None), 0.0)
    assert one.slowest[0] not in ("", "tissue")
    assert 0.0 < one.slowest[1] < 1.0


def test_a_touch_without_contact_is_an_error_and_has_no_error_of_zero(tmp_path):
    given = ["tune", "fingertip", "--duration", "0.1 s", "--budget", "1 s", "-o", str(tmp_path / "t.yaml")]
    ran = CliRunner().invoke(app, given)
    assert ran.exit_code == 2
    assert "try a longer touch: --duration" in unwrapped(ran.output)


def test_a_reason_common_to_several_settings_is_reported_once(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(tune, "bodies", lambda: ["deformation.ReducedFE", "deformation.MassSpring"])
    monkeypatch.setattr(tune, "COARSER", (10,))
    monkeypatch.setattr(tune, "EVERY", (1, 5))
    given = ["tune", "nodule", "--duration", "1 s", "--budget", "2 s", "-o", str(tmp_path / "t.yaml"),
             "--set", "scene.nodule.nodule_radius=3 mm"]  # fmt: skip
    ran = CliRunner().invoke(app, given)
    assert ran.exit_code == 0, ran.output
    text = unwrapped(ran.output)
    assert "left out ReducedFE, 1000 vertices; ReducedFE, 1000 vertices, every 5:" in text
    assert text.count("no reduced basis is stored") == 1
    assert "MassSpring, 1000 vertices, whose error is unknown." in text


def test_a_budget_or_an_error_bound_is_required():
    ran = CliRunner().invoke(app, ["tune", "kidney"])
    assert ran.exit_code == 2
    assert "--budget" in ran.output


def test_the_error_of_a_reference_is_shown_next_to_the_differences_from_it():
    kidney = find("kidney")
    reduced = kidney.but(overrides=["tissue.use=deformation.ReducedFE"]).load()
    assert 0.01 <= known_error(reduced) < 0.05 and "force error of ReducedFE itself: " in error_sentence(reduced)
    assert known_error(kidney.load()) == 0.0 and "error of MassSpring itself is not in these" in error_sentence(
        kidney.load()
    )
    assert error_sentence(find("indentation").load()) == ""


@pytest.mark.parametrize(
    "words",
    [
        ["tune", "kidney", "--budget", "1 ms"],
        ["rates", "kidney"],
        ["fit", "body", "kidney"],
        ["bench", "accuracy", "--quick", "--touch", "plate"],
    ],
)
def test_an_output_path_without_write_permission_is_an_error_before_the_computation(tmp_path, monkeypatch, words):
    (tmp_path / "file").write_text("")
    for work in ("tune.tune", "rates.rates", "fit_body.fit_body", "accuracy.cells.compute"):
        monkeypatch.setattr(f"palpate.studies.{work}", lambda *given, **more: pytest.fail("it computes first"))
    ran = CliRunner().invoke(app, [*words, "-o", str(tmp_path / "file" / "x.yaml")])
    assert ran.exit_code == 2 and "x.yaml: Not a directory" in unwrapped(ran.output), ran.output
