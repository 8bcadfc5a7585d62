"""`palpate new launch`, and the shipped example of a launch file."""

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


def test_a_launch_file_for_an_unknown_graph_is_not_written(tmp_path):
    done = CliRunner().invoke(app, ["new", "launch", "mine", "--like", "kidny", "-o", str(tmp_path)])
    assert done.exit_code == 2 and not list(tmp_path.iterdir())


def test_the_example_loads():
    run = find(str(Path(__file__).parents[3] / "docs" / "examples" / "stiff-kidney.yaml"))
    assert run.only == "sources" and run.load().nodes
