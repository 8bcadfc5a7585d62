"""Parallel runs on fewer cores: no run counts as hung, and no message is lost."""

import os
from pathlib import Path

import warm_fork_server
from graphs_for_runs import GRAPH, NODES, write_graph

from palpate.engine.job import Job, NodeJob
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.run.execute import execute
from palpate.launch.run.member import WorkerHandle
from palpate.records.reader import Recording


def test_time_without_scheduling_does_not_count_as_silence():
    member = WorkerHandle(Job("a", (NodeJob("a", "", {}, 1, (), ()),)))
    member._checked -= 3600.0
    assert member.silence() < 0.25


def test_parallel_runs_succeed_and_their_recordings_are_complete(tmp_path):
    text = GRAPH.replace("nodes_for_runs.Spread,", "nodes_for_runs.Spread, count: 3000,")
    path = os.pathsep.join([str(Path(__file__).parents[2] / "support"), os.environ.get("PYTHONPATH", "")])
    command = ["run", "loop.yaml", "--duration", "0.3", "--record", "run.mcap", "--timeout", "2", "-q", "--no-pictures"]
    started = []
    for number in range(3):
        folder = tmp_path / str(number)
        folder.mkdir()
        write_graph(folder, text)
        with open(folder / "printed", "w") as printed:
            env = {**os.environ, "PYTHONPATH": path}
            started.append(warm_fork_server.palpate(command, cwd=folder, env=env, stdout=printed, stderr=printed))
    for number, process in enumerate(started):
        assert process.wait(200) == 0, (tmp_path / str(number) / "printed").read_text()
        recording = Recording(tmp_path / str(number) / "run.mcap")
        assert recording.counts == {name: {"count": 300, "lost": 0} for name in NODES}


def test_a_slow_logger_receives_all_messages(tmp_path):
    """When the nodes have ended, it still has several seconds of messages to process."""
    text = GRAPH.replace("logger.Mcap", "nodes_for_runs.Slow, pause: 0.002")
    outcome = execute(LaunchFile(graph=write_graph(tmp_path, text), duration=0.3), patience=2.5)
    assert outcome.result.ok, outcome.result.deaths
    assert outcome.result.health["log"]["steps"] == 300 * len(NODES)
