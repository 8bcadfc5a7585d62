"""`palpate fit run`: the recorded motion drives the graph, and settings are found again, or not determined."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

import palpate
from palpate.cli.__main__ import app
from palpate.engine.faults import GraphError
from palpate.engine.slot import NodeError
from palpate.gradients.parameters import find_parameter
from palpate.launch.run.lane_runner import _Rows
from palpate.launch.run.lane_values import LanePreparation
from palpate.models.fit.sessions import SessionError
from palpate.physics.errors import ArgumentError
from palpate.records.stored import RecordingError
from palpate.studies.inverse.descent import Point
from palpate.studies.inverse.fit import find_parameters, fit_run
from palpate.studies.inverse.forward import Forward
from palpate.studies.inverse.measured import read_recording
from palpate.studies.inverse.motions import RECORDED, family, plan_touches
from palpate.studies.inverse.opening import read_run
from palpate.studies.inverse.problem import RunProblem
from palpate.studies.inverse.report import launches

TRUE = {"tissue.stiffness": 180.0, "tissue.retardation": 0.035, "friction.mu_slide": 0.6}
STROKE = [
    {"hold": 0.05}, {"to": [0, 0, 0.0975], "time": 0.3}, {"to": [0.015, 0, 0.0975], "time": 0.3, "shape": "linear"},
    {"to": [0.015, 0, 0.112], "time": 0.2},
]  # fmt: skip
KNOWN = [f"{key}={value}" for key, value in TRUE.items()]


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """A press and a stroke of 0.85 s, recorded with the usual encoder, on a tissue that is not that of the scene."""
    path = tmp_path_factory.mktemp("fit") / "stroke.mcap"
    sets = [*KNOWN, "scene.hand.begin=[0, 0, 0.112]", f"scene.hand.path={json.dumps(STROKE)}"]
    palpate.run("kidney", record=path, duration=0.85, sets=sets)
    return path


def read(file, fields=("contact.force", "friction.force"), graph="kidney", **named):
    given = {"scene": None, "sets": (), "until": None} | named
    return read_recording(file, fields, graph, given["scene"], given["sets"], given["until"])


def noisy(measured, size, seed=0):
    rng = np.random.default_rng(seed)
    measured.values = [values + size * rng.standard_normal(values.shape) for values in measured.values]
    return measured


def test_the_recorded_motion_gives_the_recorded_force_bit_for_bit(file):
    measured = read(file, graph=None)
    sets, length = [*measured.launch.overrides, *KNOWN], measured.ticks / measured.rate
    data = palpate.Ensemble("kidney", 1, {}, measured.fields, sets=sets, duration=length).run(quiet=True)
    for field, values in zip(measured.fields, measured.values, strict=True):
        assert (data[field].values[0].reshape(values.shape) == values).all()


def test_settings_are_found_again_with_intervals_that_contain_them(file):
    fit = fit_run([noisy(read(file), 5e-3)], list(TRUE))
    assert not fit.open_ and not fit.couples
    for name, value in TRUE.items():
        at = fit.estimate.intervals[name]
        assert at.low < value < at.high
        assert 0.0 < at.high - at.low < 0.1 * value
        assert at.profile[0] == pytest.approx(at.low, rel=0.02)
    assert all(rms == pytest.approx(5e-3, rel=0.1) for rms in fit.rms.values())
    assert fit.estimate.starts > 0.5


def test_without_noise_the_settings_are_exact(file):
    fit = fit_run([read(file)], list(TRUE), held_out=[read(file)])
    for name, value in TRUE.items():
        assert fit.estimate.values[name] == pytest.approx(value, rel=1e-5)
    assert max(fit.held_out.values()) < 1e-7


def test_derivatives_follow_the_residuals_when_fields_get_weights(file):
    """From compressed fields to weighted ones, and to those of other weights, as differences of these residuals."""
    measured = noisy(read(file), 5e-3)
    problem = RunProblem([measured], find_parameters(measured, list(TRUE), {}))
    try:
        x = problem.start()
        r = problem.residuals(x)
        at = Point(x, r, problem.slopes_at(x, r))
        for _ in range(2):
            at = problem.weigh(at)
            for field in np.split(at.r, np.cumsum([len(press.force) for press in problem.presses])[:-1]):
                assert np.mean(field**2) == pytest.approx(1.0)
            known = problem.slopes_at(x, at.r)
            assert np.abs(at.slopes - known).max() < 1e-3 * np.abs(known).max()
            problem.weight[0] = 3.0 * problem.weight[0]  # as if the noise were another one
            at = Point(x, problem.residuals(x), problem.slopes_at(x, problem.residuals(x)))
    finally:
        problem.close()


def test_a_fit_whose_runs_all_fail_is_refused_with_the_reason(file, monkeypatch):
    def fail(self, seat, row):
        self._fail(row, 0, NodeError("tissue", "start", ValueError("no such tissue")))
        return []

    monkeypatch.setattr(_Rows, "_begin", fail)
    with pytest.raises(ArgumentError, match=r"all runs of the starts of the search fail: .*tissue.*no such tissue"):
        fit_run([read(file)], ["tissue.stiffness"])


def test_a_fit_costs_few_runs_and_a_start_none_if_it_is_the_only_one(file):
    """Three starts, derivatives by central differences, and both ends of three profiles, which are 6 runs each."""
    fit = fit_run([noisy(read(file), 5e-3)], list(TRUE))
    assert 7 + 6 + 6 < fit.runs < 45
    assert fit.estimate.starts == 1.0
    alone = fit_run([noisy(read(file), 5e-3)], list(TRUE), starts=1)
    assert alone.runs <= fit.runs - 6  # no random points
    for name in TRUE:
        assert alone.estimate.values[name] == pytest.approx(fit.estimate.values[name], rel=1e-4)


@pytest.mark.parametrize("path", ["tissue.moduli[1]", "friction.mu_slide"])
def test_a_graph_is_loaded_once_for_all_values_of_a_setting(file, path, monkeypatch):
    measured = read(file, sets=["tissue.use=deformation.BeamBundle"])
    graph = measured.launch.load()
    numbers = [find_parameter(graph, each, graph.nodes) for each in ("tissue.moduli[0]", path)]
    loaded, load = [], LanePreparation._load
    monkeypatch.setattr(LanePreparation, "_load", lambda self, values: loaded.append(values) or load(self, values))
    forward = Forward(measured, numbers)
    values = np.array([each.value for each in numbers])
    try:
        made = forward(values * np.linspace(0.8, 1.2, 20)[:, None])
    finally:
        forward.close()
    assert len(loaded) <= 6 and (np.diff(made[0][:, :, 0].max(axis=1)) > 5e-4).all()


def test_correlated_noise_widens_the_interval(file):
    plain = fit_run([noisy(read(file, sets=KNOWN), 5e-3)], ["tissue.stiffness"], starts=1)
    measured, rng = read(file, sets=KNOWN), np.random.default_rng(1)
    for k, values in enumerate(measured.values):
        white = rng.standard_normal((len(values), values.shape[1]))
        for i in range(1, len(white)):
            white[i] = 0.95 * white[i - 1] + np.sqrt(1 - 0.95**2) * white[i]
        measured.values[k] = values + 5e-3 * white
    wide = fit_run([measured], ["tissue.stiffness"], starts=1)
    widths = [
        np.subtract(*(lambda at: (at.high, at.low))(f.estimate.intervals["tissue.stiffness"])) for f in (plain, wide)
    ]
    assert widths[1] > 3.0 * widths[0]


def test_a_setting_that_the_motion_does_not_excite_is_not_determined(file):
    fit = fit_run([noisy(read(file, ["contact.force"]), 5e-3)], ["tissue.stiffness", "friction.mu_slide"], starts=1)
    assert list(fit.open_) == ["friction.mu_slide"]
    written = yaml.safe_load(launches(fit, Path("out"))[Path("out/fit.yaml")])["set"]
    assert written["friction.mu_slide"] == fit.parameters[1].value != fit.estimate.values["friction.mu_slide"]
    fit = fit_run(
        [noisy(read(file, until=0.3, sets=KNOWN), 5e-3)], ["tissue.stiffness", "friction.mu_static"], starts=1
    )
    assert "friction.mu_static" in fit.open_
    at = fit.estimate.intervals["tissue.stiffness"]
    assert at.low < TRUE["tissue.stiffness"] < at.high


def test_a_planned_stroke_determines_friction_better(file):
    measured = noisy(read(file, until=0.4, sets=KNOWN), 5e-3)
    fit = fit_run([measured], ["tissue.stiffness", "friction.mu_slide"], starts=1)
    planned = {each.name: each for each in plan_touches(fit, measured)}
    assert set(planned) == set(family(measured.motion["finger"], 1000.0))
    now, stroke = planned[RECORDED], planned["with a stroke of 10 mm"]
    assert stroke.relative[1] < 0.5 * now.relative[1]
    assert list(planned.values()) == sorted(planned.values(), key=lambda each: -each.d)
    at = fit.estimate.intervals["tissue.stiffness"]
    assert now.relative[0] == pytest.approx(0.5 * (at.high - at.low) / at.value, rel=0.5)


def test_recordings_with_a_value_for_each(file, tmp_path):
    softer = tmp_path / "softer.mcap"
    sets = ["tissue.stiffness=140", "tissue.retardation=0.035", "scene.hand.begin=[0, 0, 0.112]",
            f"scene.hand.path={json.dumps(STROKE)}"]  # fmt: skip
    palpate.run("kidney", record=softer, duration=0.4, sets=sets)
    both = [read(each, ["contact.force"], until=0.4) for each in (file, softer)]
    fit = fit_run(both, ["tissue.stiffness", "tissue.retardation"], separate=["tissue.stiffness"], starts=1)
    values = fit.estimate.values
    assert values["tissue.stiffness, stroke.mcap"] == pytest.approx(180.0, rel=1e-4)
    assert values["tissue.stiffness, softer.mcap"] == pytest.approx(140.0, rel=1e-4)
    assert values["tissue.retardation"] == pytest.approx(0.035, rel=1e-4)


def test_the_command_writes_a_launch_file_that_runs(file, tmp_path):
    out = tmp_path / "fit"
    command = ["fit", "run", str(file), "--free", "tissue.stiffness", "tissue.retardation", "-o", str(out), "--json",
               "--graph", "kidney"]  # fmt: skip
    result = CliRunner().invoke(app, command)
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)
    assert found["parameters"]["tissue.stiffness"]["value"] == pytest.approx(180.0, rel=1e-4)
    assert found["parameters"]["tissue.retardation"]["determined"] is True
    assert (out / "report.json").exists()
    written = yaml.safe_load((out / "fit.yaml").read_text())
    assert written["set"]["tissue.stiffness"] == pytest.approx(180.0, rel=1e-4)
    run = palpate.run(out / "fit.yaml", record=None, duration=0.01)
    assert run._recording.about["plan"]["source"]["nodes"]["tissue"]["stiffness"] == pytest.approx(180.0, rel=1e-4)


def test_a_recording_may_have_any_name(file, tmp_path):
    """Spaces, commas and `#` separate neither settings nor comments."""
    odd = tmp_path / "a #1, b: c.mcap"
    odd.write_bytes(file.read_bytes())
    command = ["fit", "run", str(odd), "--free", "tissue.stiffness", "--starts", "1", "--until", "0.3 s", "--json",
               "-o", str(tmp_path / "f it")]  # fmt: skip
    result = CliRunner().invoke(app, command)
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["parameters"]["tissue.stiffness"]["value"] == pytest.approx(180.0, rel=1e-3)


def test_bad_input_is_refused_by_name(file, tmp_path):
    for free, error, text in (
        ("tissue.use", ArgumentError, "a choice"),
        ("tissue.vertices", ArgumentError, "a whole number"),
        ("controller.mass", ArgumentError, "does not run in this fit"),
        ("tissue.stifness", ArgumentError, "Did you mean 'stiffness'"),
        ("scene.hand.path[1].to[2]", GraphError, "reaches no node"),
    ):
        with pytest.raises(error, match=text):
            fit_run([read(file)], [free])
    for named, text in (
        ({"fields": ["contact.forc"]}, "Did you mean 'force'"),
        ({"fields": ["contacts.force"]}, "no stream 'contacts'"),
        ({"graph": "pinch"}, "no stream of this name; it is of another graph"),
        ({"sets": ["rate=500"]}, "recorded at 1000 Hz"),
    ):
        with pytest.raises((RecordingError, ArgumentError), match=text):
            read(file, **named)
    with pytest.raises(ArgumentError, match="a longer recording"):
        fit_run([read(file, ["contact.force"], until=0.002)], ["tissue.stiffness"])


def test_a_gap_is_refused_with_what_precedes_it(file, tmp_path, monkeypatch):
    from palpate.studies.inverse import measured

    present = measured.Recording(file).ticks()
    lost = {name: np.delete(ticks, 400) for name, ticks in present.items()}
    monkeypatch.setattr(measured.Recording, "ticks", lambda self: lost)
    with pytest.raises(RecordingError, match=r"has a gap: tick 400 is missing, and 401 follows.*--until '0.4 s'"):
        read(file)
    assert read(file, until=0.4).ticks == 400


@pytest.fixture(scope="module")
def table(file, tmp_path_factory):
    """The press of the recording as tables: with the place of the bone edge, and with the indentation alone."""
    run, rows = palpate.open(file), slice(0, 400)
    time, place, force = (
        np.asarray(each)[rows] for each in (run.contact.force.time, run.finger.position, run.contact.force)
    )
    folder = tmp_path_factory.mktemp("tables")
    for name, columns, head in (
        ("place", [1e3 * place], "x [mm],y [mm],z [mm]"),
        ("press", [1e3 * (0.1088 - place[:, 2:])], "indentation [mm]"),
    ):  # fmt: skip
        rows_of = np.column_stack([1e3 * time, *columns, force])
        np.savetxt(folder / f"{name}.csv", rows_of, delimiter=",", header=f"t [ms],{head},force [N]", comments="")
    return folder


@pytest.mark.parametrize(("name", "near"), [("place", 1e-4), ("press", 0.02)])
def test_a_table_of_motion_and_force_is_a_recording(table, name, near):
    measured = read_run(table / f"{name}.csv", ["contact.force"], "kidney", None, KNOWN[1:], None)
    fit = fit_run([measured], ["tissue.stiffness"], starts=1)
    assert fit.estimate.values["tissue.stiffness"] == pytest.approx(180.0, rel=near)
    assert ("finger.offset[2]" in fit.estimate.values) == (
        name == "press"
    )  # its zero is another than that of the kidney


def test_a_table_without_what_it_needs_is_refused(table, tmp_path):
    with pytest.raises(ArgumentError, match="a table has no graph; expected --graph"):
        read_run(table / "press.csv", ["contact.force"], None, None, (), None)
    with pytest.raises(ArgumentError, match="a table has one force"):
        read_run(table / "press.csv", ["contact.force", "friction.force"], "kidney", None, (), None)
    untimed = tmp_path / "untimed.csv"
    untimed.write_text("indentation [mm],force [N]\n0,0\n1,1\n2,2\n")
    with pytest.raises(SessionError, match="no column of time"):
        read_run(untimed, ["contact.force"], "kidney", None, (), None)


def test_random_touches_have_their_true_settings_in_the_intervals(tmp_path):
    """`palpate bench fits --runs` with one touch of MassSpring; docs/backwards.md has the table of 54."""
    command = ["bench", "fits", "--runs", "1", "-o", str(tmp_path), "--json"]
    found = json.loads(CliRunner().invoke(app, command).stdout)
    assert found["ok"]
    assert found["rows"][0]["inside"] + found["rows"][0]["missed"] + found["rows"][0]["open"] == 4
    assert found["rows"][0]["apart"] < 3.0
    again = CliRunner().invoke(app, command)  # it is not fitted again
    assert json.loads(again.stdout) == found
    assert len((tmp_path / "runs.jsonl").read_text().splitlines()) == 1
