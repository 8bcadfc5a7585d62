"""A worker counts as hung by what its process does, not by the clock alone; before tick 0 no dead, stopped or hung
worker leaves the launcher waiting."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
from graphs_for_runs import GRAPH, write_graph
from test_run import with_a_group_joined_by_hand

from palpate.engine import clock
from palpate.engine.job import Job, NodeJob
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.run import member, reports
from palpate.launch.run.execute import RunOutcome, execute
from palpate.launch.run.launcher import Launcher
from palpate.launch.run.member import WorkerHandle
from palpate.launch.run.work import process
from palpate.launch.run.work.activity import (
    COMPUTES,
    DISK,
    ENDED,
    STOPPED,
    WAITS,
    Activity,
    SilentTime,
    activity,
    waited_for_processor,
)
from palpate.launch.run.work.compiling import LONGEST
from palpate.launch.run.work.far_clock import FarClock
from palpate.launch.run.work.watchdog import START_PATIENCE
from palpate.launch.run.work.worker import EndedError
from palpate.physics.errors import RunError

PATIENCE, STEP, NEVER = 5.0, 0.1, 4000.0
JOB = Job("a", (NodeJob("spring", "", {}, 1, (), ()),))
TICK = 1.0 / os.sysconf("SC_CLK_TCK")


def table(folder: Path, main: str, used: int, *threads: str) -> Path:
    """A process table with one process, 7, of the name `a) R (b`."""
    for path, state in (("7", main), *((f"7/task/{k}", state) for k, state in enumerate(threads))):
        (folder / path).mkdir(parents=True, exist_ok=True)
        (folder / path / "stat").write_text(f"7 (a) R (b) {state} 1 7 7 0 -1 0 0 0 0 0 {used} {2 * used} 5 5 20 0 1\n")
    return folder


@pytest.mark.parametrize(
    ("main", "threads", "state"),
    [
        ("S", ("S", "S"), WAITS), ("S", ("S", "R"), COMPUTES), ("R", ("R",), COMPUTES), ("D", ("D", "S"), DISK),
        ("S", ("D", "S"), DISK), ("D", ("D", "R"), COMPUTES), ("T", ("T",), STOPPED), ("Z", (), ENDED),
        ("t", ("t",), WAITS),
    ],
)  # fmt: skip
def test_the_process_table_contains_what_a_process_does(tmp_path, main, threads, state):
    found = activity(7, table(tmp_path, main, 100, *threads))
    assert found == Activity(state, pytest.approx(300 * TICK))


def test_a_missing_or_unreadable_process_is_known_or_unknown(tmp_path):
    assert activity(8, table(tmp_path, "S", 1)) == Activity(ENDED)
    assert activity(8, tmp_path / "no table") is None
    (tmp_path / "7" / "stat").write_text("garbage")
    assert activity(7, tmp_path) is None
    assert waited_for_processor(tmp_path / "none") == 0.0 <= waited_for_processor()


def test_a_real_process_is_seen_to_compute_to_wait_and_to_be_stopped():
    program = "import sys\nfor line in sys.stdin:\n  sum(range(int(line)))\n  print(line)"
    with subprocess.Popen([sys.executable, "-uc", program], stdin=-1, stdout=-1, text=True) as other:

        def becomes(state: str) -> Activity:
            while (found := activity(other.pid)) is None or found.state != state:
                time.sleep(0.005)
            return found

        idle = becomes(WAITS)
        other.stdin.write("20000000\n")
        other.stdin.flush()
        becomes(COMPUTES)
        other.stdout.readline()
        assert becomes(WAITS).used > idle.used
        other.send_signal(signal.SIGSTOP)
        becomes(STOPPED)
        other.kill()
        becomes(ENDED)


# -- the state machine of the launcher, with a clock and a process table of our choice ---------------------------------

FIRST = {  # of each behaviour, time [s] after which a worker hangs: in `starting`; in `ready`, `linked`, `running`
    "computes": (LONGEST, PATIENCE),
    "waits for a processor": (NEVER, NEVER),
    "10 % of a processor": (10 * LONGEST, 10 * PATIENCE),
    "stopped": (PATIENCE, PATIENCE),
    "waits": (START_PATIENCE, PATIENCE),
    "waits for the disk": (SilentTime.DISK_PATIENCE + START_PATIENCE, SilentTime.DISK_PATIENCE + PATIENCE),
    "unknown": (START_PATIENCE, PATIENCE),
}


def seen(behaviour: str, moment: float) -> Activity | None:
    """What the process table contains at a time [s]."""
    match behaviour:
        case "computes":
            return Activity(COMPUTES, moment)
        case "waits for a processor":
            return Activity(COMPUTES, 3.0)
        case "10 % of a processor":
            return Activity(COMPUTES if round(moment / STEP) % 2 else WAITS, 0.1 * moment)
        case "stopped":
            return Activity(STOPPED, 3.0)
        case "waits":
            return Activity(WAITS, 3.0)
        case "waits for the disk":
            return Activity(DISK, 3.0)
    return None


@pytest.fixture
def moment(monkeypatch):
    """A clock that only the test advances [s]."""
    now = SimpleNamespace(s=0.0)
    monkeypatch.setattr(clock, "seconds", lambda: now.s)
    return now


def hung_after(handle: WorkerHandle, moment: SimpleNamespace, act=lambda: None) -> tuple[float, str]:
    handle.reset_silence()
    begun = moment.s
    while moment.s - begun < NEVER:
        moment.s += STEP
        act()
        if text := handle.hang(PATIENCE):
            return moment.s - begun, text
    return NEVER, ""


@pytest.mark.parametrize("behaviour", FIRST)
@pytest.mark.parametrize("state", ["starting", "ready", "linked", "running"])
@pytest.mark.parametrize("joined", [False, True], ids=["here", "on another machine"])
def test_a_worker_hangs_after_the_limit_of_what_it_does(moment, state, behaviour, joined):
    handle = WorkerHandle(JOB, joined=joined, state=state, taken=joined, look=lambda pid: seen(behaviour, moment.s))
    handle.pid = None if joined else 7

    def pulse() -> None:
        if joined and round(moment.s / STEP) % 5 == 0 and (found := seen(behaviour, moment.s)) is not None:
            handle.take_pulse(found)

    hung, text = hung_after(handle, moment, pulse)
    limit = min(NEVER, FIRST[behaviour][state != "starting"])
    assert hung == pytest.approx(limit, rel=0.2, abs=1.5)
    assert ("a signal has stopped its process" in text) == (behaviour == "stopped")
    handle.reset_silence()
    assert not handle.hang(PATIENCE)


def test_a_compiling_worker_may_wait_for_another_process(moment):
    handle = WorkerHandle(JOB, pid=7, compiling=True, look=lambda pid: seen("waits", moment.s))
    assert hung_after(handle, moment)[0] == pytest.approx(LONGEST, rel=0.01)


def test_a_worker_that_its_server_has_not_started_yet_waits_with_the_server(moment):
    """Otherwise a fork server that imports slowly on a loaded machine would be taken for a hung node."""
    pids = []
    handle = WorkerHandle(JOB, starter=3, look=lambda pid: pids.append(pid) or seen("waits for a processor", 0.0))
    assert hung_after(handle, moment)[0] == NEVER and set(pids) == {3}


def test_pulses_that_stop_say_nothing(moment):
    """The network was interrupted: what its process did last does not count."""
    handle = WorkerHandle(JOB, joined=True, taken=True, state="ready")
    handle.take_pulse(Activity(COMPUTES, 1.0))
    assert hung_after(handle, moment)[0] == pytest.approx(PATIENCE + member.PULSELESS, abs=1.0)


def test_a_group_that_has_yet_to_be_started_by_hand_is_awaited(moment):
    handle = WorkerHandle(JOB, joined=True)
    handle.reset_silence()
    faults: list[str] = []
    fake = SimpleNamespace(members={"a": handle}, patience=PATIENCE, _report_death=lambda *given: faults.append(given))
    for _ in range(20_000):
        moment.s += STEP
        Launcher._check_hung(fake)
    assert not faults


def test_the_end_of_a_joined_process_is_a_failure_with_its_name():
    handle, deaths = WorkerHandle(JOB, joined=True, taken=True, state="ready"), []
    fake = SimpleNamespace(_report_death=lambda _, fault: deaths.append(fault), _is_gone=lambda _: None)
    Launcher._take_pulse(fake, handle, Activity(WAITS, 1.0))
    assert not deaths
    Launcher._take_pulse(fake, handle, Activity(ENDED))
    assert [fault.text for fault in deaths] == ["its process ended without a report"]


@pytest.mark.parametrize("alone", [False, True])
def test_a_waiting_worker_sends_heartbeats_and_notices_the_end_of_its_launcher(monkeypatch, alone):
    now, sent = [0], []
    monkeypatch.setattr(clock, "now", lambda: now[0])

    def order(wait: int) -> reports.Order | None:
        now[0] += wait * 1_000_000
        return reports.Quit() if now[0] > 10_000_000_000 else None

    bus = SimpleNamespace(order=order, report=sent.append)
    with pytest.raises(RunError if alone else EndedError, match="the launcher sent nothing" if alone else None):
        process._link(bus, FarClock() if alone else None)
    assert len(sent) >= (10 if alone else 20) and set(map(type, sent)) == {reports.Alive}
    assert now[0] < 6_000_000_000 or not alone


# -- real runs ---------------------------------------------------------------------------------------------------------


def go(folder: Path, node: str, watch=lambda running: None, patience: float = 1.0) -> RunOutcome:
    text = GRAPH.replace("nodes_for_runs.Spring,", f"nodes_for_runs.{node},")
    return execute(LaunchFile(graph=write_graph(folder, text), duration=0.05), patience=patience, watch=watch)


@pytest.mark.parametrize(
    ("how", "text"),
    [
        ("stop", "a signal has stopped its process"), ("exception", "cannot start"),
        pytest.param("exit", "exit code 7", marks=pytest.mark.long),
        pytest.param("kill", "killed by SIGKILL", marks=pytest.mark.long),
    ],
)  # fmt: skip
def test_a_start_that_fails_in_any_way_ends_the_run_with_the_name_of_the_node(tmp_path, how, text):
    outcome = go(tmp_path, f"Starting, how: {how}")
    (death,) = outcome.result.deaths
    assert death.node == "spring" and text in death.text


@pytest.mark.parametrize("number", [signal.SIGSTOP, pytest.param(signal.SIGKILL, marks=pytest.mark.long)])
def test_a_ready_worker_that_ends_or_is_stopped_while_others_start_ends_the_run_with_its_name(tmp_path, number):
    sent: list[int] = []

    def watch(running: Launcher) -> None:
        if running.members["drag"].state == "ready" and not sent:
            sent.append(running.pids["drag"])
            os.kill(sent[0], number)

    outcome = go(tmp_path, f"Starting, file: {tmp_path / 'go'}", watch)
    (death,) = outcome.result.deaths
    assert death.node == "drag" and ("stopped" if number == signal.SIGSTOP else "SIGKILL") in death.text


def test_a_slow_start_is_awaited(tmp_path):
    """Longer than the patience, while it computes and the others wait ready."""
    ready: list[float] = []

    def watch(running: Launcher) -> None:
        if all(m.state == "ready" for g, m in running.members.items() if g != "spring"):
            ready.append(time.monotonic())
            if ready[-1] - ready[0] > 2.0:
                (tmp_path / "go").touch()

    assert go(tmp_path, f"Starting, file: {tmp_path / 'go'}", watch, patience=0.5).result.ok


@pytest.mark.parametrize("number", [signal.SIGKILL, pytest.param(signal.SIGSTOP, marks=pytest.mark.long)])
def test_a_joined_worker_that_ends_before_tick_0_ends_the_run_with_its_name(tmp_path, monkeypatch, number):
    sent: list[int] = []

    def watch(running: Launcher, far: subprocess.Popen) -> None:
        handle = running.members["far"]
        if handle.taken and handle.pulse is not None and not sent:
            sent.append(far.pid)
            os.kill(far.pid, number)

    graph = GRAPH.replace("nodes_for_runs.Drag,", f"nodes_for_runs.StartingDrag, file: {tmp_path / 'go'},")
    outcome, code = with_a_group_joined_by_hand(tmp_path, monkeypatch, 0.1, watch, graph, patience=1.0, stops=True)
    (death,) = outcome.result.deaths
    assert death.node == "spring, drag, spread" or death.node == "drag"
    assert ("stopped" if number == signal.SIGSTOP else "ended") in death.text and code == -signal.SIGKILL
