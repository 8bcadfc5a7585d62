"""Many runs at once, on fewer cores: nobody is taken for hung who gets no processor, and no message is lost."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import warm_fork_server
from graphs_for_runs import GRAPH, NODES, write_graph

from palpate.engine.job import Job, NodeJob
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.run.execute import execute
from palpate.launch.run.launcher import Launcher
from palpate.launch.run.member import GLANCE, QUIET, WorkerHandle, threads
from palpate.records.reader import Recording


def spinner(nice: int, core: int, apart: bool = False) -> subprocess.Popen:
    """A process that computes without end on one core; apart: in a session of its own, for the kernel may share a core
    evenly between sessions, of which each worker has one."""
    program = f"import os\nos.sched_setaffinity(0, {{{core}}})\nos.nice({nice})\nwhile True: pass"
    return subprocess.Popen([sys.executable, "-S", "-c", program], start_new_session=apart)


@pytest.fixture
def crowd():
    """Starts processes that all want one core; ends them."""
    started: list[subprocess.Popen] = []
    yield lambda *how: started.append(spinner(*how)) or started[-1]
    for process in started:
        process.kill()
        process.wait()


def test_time_without_a_processor_is_no_silence(crowd):
    core = max(os.sched_getaffinity(0))
    starved = crowd(19, core)
    others = [crowd(0, core) for _ in range(3)]
    member = WorkerHandle(Job("a", (NodeJob("a", "", {}, 1, (), ()),)), pid=starved.pid)
    begun, silence = time.monotonic(), 0.0
    while time.monotonic() < begun + 2.0:
        silence = member.silence()
        time.sleep(0.02)
    if not threads(starved.pid):
        pytest.skip("the kernel does not tell who waits for a processor")
    assert silence < QUIET + 0.7
    for other in others:
        other.kill()
    starved.send_signal(signal.SIGSTOP)  # it is ready to run no more
    while threads(starved.pid)[str(starved.pid)].state == "R":
        time.sleep(0.01)
    before = member.silence()
    passed, looked = 0.0, time.monotonic()
    while passed < 1.0:
        time.sleep(0.02)
        silence = member.silence()
        passed, looked = passed + min(time.monotonic() - looked, GLANCE), time.monotonic()
    assert silence - before > 0.7


def test_what_the_launcher_was_kept_from_looking_at_is_no_silence():
    member = WorkerHandle(Job("a", (NodeJob("a", "", {}, 1, (), ()),)))
    time.sleep(0.5)
    assert member.silence() < 0.25


def test_a_step_that_gets_little_of_a_busy_core_does_not_count_as_hung(tmp_path, crowd):
    """It needs 0.5 s of a core for which the others compete: twice the patience, by the clock on the wall."""
    core = max(os.sched_getaffinity(0))
    crowded = []

    def watch(running: Launcher) -> None:  # the start of a run is not what is starved here
        if not crowded and any(member.state == "running" for member in running.members.values()):
            crowded.extend(crowd(0, core, True) for _ in range(3))

    text = GRAPH.replace("nodes_for_runs.Spring,", "nodes_for_runs.Work, seconds: 0.5,")
    place = tmp_path / "place.yaml"
    place.write_text(f"work: {{nodes: [spring], core: {core}}}\n")
    launch = LaunchFile(graph=write_graph(tmp_path, text), place=place, duration=0.1)
    outcome = execute(launch, patience=1.0, watch=watch)
    assert crowded and outcome.result.ok, outcome.result.deaths


def test_several_runs_at_once_end_well_and_their_recordings_lack_nothing(tmp_path):
    text = GRAPH.replace("nodes_for_runs.Spread,", "nodes_for_runs.Spread, count: 3000,")
    path = os.pathsep.join([str(Path(__file__).parents[2] / "support"), os.environ.get("PYTHONPATH", "")])
    command = ["run", "loop.yaml", "--duration", "0.3", "--record", "run.mcap", "--timeout", "2", "-q", "--no-pictures"]
    started = []
    for number in range(3):
        folder = tmp_path / str(number)
        folder.mkdir()
        write_graph(folder, text)
        with open(folder / "said", "w") as said:
            env = {**os.environ, "PYTHONPATH": path}
            started.append(warm_fork_server.palpate(command, cwd=folder, env=env, stdout=said, stderr=said))
    for number, process in enumerate(started):
        assert process.wait(200) == 0, (tmp_path / str(number) / "said").read_text()
        recording = Recording(tmp_path / str(number) / "run.mcap")
        assert recording.counts == {name: {"count": 300, "lost": 0} for name in NODES}


def test_a_logger_that_is_slower_than_its_senders_gets_all(tmp_path):
    """When the nodes have ended it has most of the messages still before it, for several seconds."""
    text = GRAPH.replace("logger.Mcap", "nodes_for_runs.Slow, pause: 0.002")
    outcome = execute(LaunchFile(graph=write_graph(tmp_path, text), duration=0.6), patience=1.0)
    assert outcome.result.ok, outcome.result.deaths
    assert outcome.result.health["log"]["steps"] == 600 * len(NODES)
