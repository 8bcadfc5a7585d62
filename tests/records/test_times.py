"""Step times for `palpate plan` and `--place auto`: of the newest recording that ran the same classes."""

from graphs_for_runs import write_graph
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.launch.load.launchfile import find
from palpate.records.times import step_times


def test_run_times_of_another_class_are_not_used(tmp_path, monkeypatch):
    graph = write_graph(tmp_path)
    monkeypatch.chdir(tmp_path)
    run = ["run", str(graph), "--fused", "-q", "--no-pictures", "--duration", "0.05"]
    for folder, swap in (("first", []), ("second", ["--set", "spread.use=nodes_for_runs.Swell"])):
        file = tmp_path / "runs" / folder / "loop.mcap"
        assert CliRunner().invoke(app, [*run, "--record", str(file), *swap]).exit_code == 0
    times, source = step_times(find(str(graph)).plan(), None)
    assert source.parent.name == "first" and {"spread", "drag"} <= set(times)
    assert (
        step_times(find(str(graph)).but(overrides=["spread.use=nodes_for_runs.Swell"]).plan(), None)[1].parent.name
        == "second"
    )
    assert step_times(find(str(graph)).but(overrides=["drag.use=nodes_for_runs.FaultyDrag"]).plan(), None) == ({}, None)


def test_the_logger_of_a_recording_does_not_count_as_another_class(tmp_path, monkeypatch):
    graph = write_graph(tmp_path)
    bare = "\n".join(line for line in graph.read_text().splitlines() if "logger.Mcap" not in line)
    graph.write_text(bare)
    monkeypatch.chdir(tmp_path)
    run = ["run", str(graph), "--fused", "-q", "--no-pictures", "--duration", "0.05", "--record", "runs/a/loop.mcap"]
    assert CliRunner().invoke(app, run).exit_code == 0
    assert "log" not in find(str(graph)).plan().graph.nodes
    assert step_times(find(str(graph)).plan(), None)[1] is not None
