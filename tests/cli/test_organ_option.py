"""--organ: one option of all commands that start a graph, with the same organ, notes and refusals."""

import inspect
import json

import numpy as np
import pytest
import typer.main
import yaml
from shell_text import unwrapped
from trimesh import Trimesh
from typer.core import TyperGroup
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.cli.terminal.options import choose_launch, organ_file, with_organ_file
from palpate.launch.load.launchfile import find
from palpate.launch.load.organ_file import OrganFile
from palpate.launch.run.execute import execute
from palpate.nodes.base.surface import surface_mesh
from palpate.physics.errors import PalpateError
from palpate.records.changed import organ_overrides
from palpate.records.compare import compare
from palpate.records.reader import Recording
from palpate.studies.psychophysics.file import EXPERIMENTS
from palpate.studies.psychophysics.opening import open_sitting
from palpate.studies.search import write
from palpate.studies.sweeps.file import STUDIES, load

ORGAN = {"organ", "unit", "piece", "repair"}
NO_ORGAN = {
    "palpate bench organs": "its surfaces are drawn at random",
    "palpate replay": "computes the recorded graph; palpate compare takes another organ",
    "palpate fit run": "fits settings of the recorded graph, with its organ",
    "palpate fit record": "a device presses a real sample",
}
"""Commands with --set that run no graph with an organ, and why."""
QUICK = ("scene.surface.vertices=600", "tissue.use=deformation.MassSpring")


def commands(command=None, name="palpate"):
    command = command or typer.main.get_command(app)
    if isinstance(command, TyperGroup):
        for word, below in command.commands.items():
            yield from commands(below, f"{name} {word}")
    else:
        yield name, {parameter.name: parameter for parameter in command.params}


@pytest.fixture(scope="module")
def liver(tmp_path_factory):
    """A mesh of 60 mm, in mm."""
    mesh = surface_mesh("sphere", 600)
    file = tmp_path_factory.mktemp("organ") / "liver.stl"
    Trimesh(60.0 / np.ptp(mesh.vertices[:, 0]) * mesh.vertices, mesh.triangles).export(file)
    return file


def call(*words):
    done = CliRunner().invoke(app, [str(word) for word in words])
    return done.exit_code, done.output + (str(done.exception) if isinstance(done.exception, PalpateError) else "")


def test_every_command_that_starts_a_graph_takes_an_organ():
    with_graph = {name for name, given in commands() if "graph" in given and "sets" in given}
    with_graph |= {name for name, given in commands() if name.split()[1] in ("study", "experiment", "compare")}
    lacking = {name for name, given in commands() if name in with_graph and not given.keys() >= ORGAN}
    assert lacking - set(NO_ORGAN) == set() and len(with_graph - lacking) >= 10


def test_the_options_have_the_same_names_and_helps_everywhere():
    every = [given for _, given in commands() if given.keys() >= ORGAN]
    for name in ORGAN:
        assert len({(tuple(given[name].opts), given[name].help) for given in every}) == 1
    assert set(inspect.signature(organ_file).parameters) >= {"file", "unit", "piece", "repair"}


def test_check_and_plan_take_the_organ_of_run(liver):
    code, text = call("check", "kidney", "--organ", liver, "--unit", "mm", "--set", QUICK[0], "--json")
    assert code == 0 and json.loads(text)["ok"] and any("liver.stl in mm" in note for note in json.loads(text)["notes"])
    code, text = call("plan", "kidney", "--organ", liver, "--unit", "mm", "--set", QUICK[0], "--json")
    nodes = {node["name"]: node for node in json.loads(text)["nodes"]}
    assert code == 0 and nodes["collision"]["use"] == "collision.Mesh"
    run = with_organ_file(choose_launch("kidney", [QUICK[0]]), liver, "mm", None, False, silent=True).load()
    for name in ("collision", "tissue"):
        assert nodes[name]["settings"] == run.nodes[name].settings


@pytest.mark.parametrize("words", [("check", "kidney"), ("plan", "kidney"), ("tune", "kidney", "--budget", "1 ms"),
                                   ("rates", "kidney"), ("study", "kidney-stiffness"), ("fit", "body", "kidney"),
                                   ("experiment", "kidney-stiffness", "--simulate")], ids=" ".join)  # fmt: skip
def test_a_bad_organ_is_refused_in_the_same_words(words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert call(*words, "--organ", "nobody.stl") == (2, call("run", "kidney", "--organ", "nobody.stl")[1])
    code, text = call(*words, "--unit", "mm")
    assert code == 2 and "--unit needs --organ FILE" in text
    assert not list(tmp_path.rglob("*.yaml")) and not list(tmp_path.rglob("*.tsv"))


def test_ablation_of_a_recording_refuses_an_organ(liver):
    code, text = call("plan", "kidney", "--organ", liver, "--unit", "mm", "--ablate", "x.mcap")
    assert code == 2 and "on its organ" in unwrapped(text), text


def test_a_study_and_an_experiment_take_the_organ(liver, tmp_path):
    organ = OrganFile(liver, "mm")
    study = load(STUDIES / "kidney-stiffness.yaml", organ=organ)
    assert study.launch.load().nodes["collision"].settings["surface"] == str(liver)
    file, none = EXPERIMENTS / "kidney-stiffness.yaml", lambda text: None
    with open_sitting(str(file), tmp_path, None, None, [QUICK[0]], False, none, None, organ) as sitting:
        graph = sitting.stimuli.run("main", sitting.stimuli.levels["main"][0]).load()
        assert graph.nodes["collision"].settings["surface"] == str(liver)


def test_the_launch_file_of_a_tuned_organ_has_the_organ(liver, tmp_path):
    """It had only the settings given as texts: neither the organ nor those of a launch file."""
    launch = with_organ_file(choose_launch("kidney-accurate", [QUICK[0]]), liver, "mm", None, False, silent=True)
    write(launch, {"tissue.every": 2}, ["chosen"], tmp_path / "tuned.yaml")
    data = yaml.safe_load((tmp_path / "tuned.yaml").read_text())
    assert data["set"]["tissue.every"] == 2
    there, back = launch.load(), find(str(tmp_path / "tuned.yaml")).load()
    for name, spec in there.nodes.items():
        assert back.nodes[name].use == spec.use
        assert back.nodes[name].settings == spec.settings, name


def test_a_recorded_touch_is_compared_on_another_organ(liver, tmp_path):
    file = tmp_path / "touch.mcap"
    path = "scene.hand.path=[{to: [0, 0, 0.1], time: 0.15}]"
    launch = find("kidney").but(record=file, place="fused", duration=0.2,
                                overrides=[QUICK[0], "scene.hand.begin=[0, 0, 0.111]", path])  # fmt: skip
    assert execute(launch).result.ok
    recording, organ = Recording(file), OrganFile(liver, "mm")
    sets, note = organ_overrides(recording, organ)
    assert "liver.stl in mm: 60.1 x 60.1 x 60.1 mm" in note and "path" not in note
    assert not any(text.startswith("scene.hand") for text in sets)
    base, moved = compare(recording, [[]], reference=[], organ=organ)
    assert base.name == "recorded" and moved.name == "organ=liver.stl"
    settings = moved.plan.graph.nodes["collision"].settings
    assert settings["surface"] == str(liver) and base.force.report()["peak"] == 0.0
    assert moved.force.report()["reference_peak"] > 0.1 and moved.plan.graph.nodes["collision"].use == "collision.Mesh"
    # the top lies where the kidney's is, so the finger also touches there
    assert moved.curves[-1][1] > 0.1
