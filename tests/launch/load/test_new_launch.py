"""`palpate new launch`, and the shipped example of a launch file."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.launch.load.launchfile import find


@pytest.mark.parametrize("graph", ["kidney", "softness"])
def test_a_new_launch_file_loads_and_is_not_overwritten(tmp_path, graph):
    command = ["new", "launch", "mine", "--like", graph, "-o", str(tmp_path)]
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 0, done.output
    run = find(str(tmp_path / "mine.yaml"))
    assert (run.graph.stem, run.duration, run.clock) == (graph, 2.0, "simulated")
    assert run.load().nodes
    assert CliRunner().invoke(app, command).exit_code == 2


def test_a_copied_graph_contains_the_run_of_its_launch_file(tmp_path):
    done = CliRunner().invoke(app, ["new", "graph", "mine", "--like", "kidney", "-o", str(tmp_path)])
    assert done.exit_code == 0, done.output
    copy = find(str(tmp_path / "mine.yaml"))
    assert copy.duration == find("kidney").duration and copy.record == Path("mine.mcap")


def test_a_graph_takes_the_duration_of_the_shipped_one_that_it_extends(tmp_path):
    for name, base in (("first", "falcon"), ("second", str(tmp_path / "first.yaml"))):
        (tmp_path / f"{name}.yaml").write_text(f"extends: {base}\n")
        run = find(str(tmp_path / f"{name}.yaml"))
        assert (run.duration, run.record, run.clock) == (30.0, Path(f"{name}.mcap"), None)


def test_a_graph_that_extends_itself_has_no_run(tmp_path):
    (tmp_path / "loop.yaml").write_text("extends: ./loop.yaml\n")
    assert find(str(tmp_path / "loop.yaml")).duration is None


def test_the_list_of_launch_files_names_graph_and_purpose():
    done = CliRunner().invoke(app, ["list", "launch", "--json"])
    listed = json.loads(done.stdout)["launch"]
    assert listed["kidney-real"]["graph"] == "kidney" and listed["kidney-real"]["clock"] == "real"
    assert all(one["purpose"].endswith(".") for one in listed.values())


def test_a_launch_file_for_an_unknown_graph_is_not_written(tmp_path):
    done = CliRunner().invoke(app, ["new", "launch", "mine", "--like", "kidny", "-o", str(tmp_path)])
    assert done.exit_code == 2 and not list(tmp_path.iterdir())


def test_the_example_loads():
    run = find(str(Path(__file__).parents[3] / "docs" / "examples" / "stiff-kidney.yaml"))
    assert run.only == "sources" and run.load().nodes
