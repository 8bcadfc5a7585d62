"""A stall of the machine is not silence: a waiting process counts only the time in which it has polled."""

import faulthandler
import fcntl
import os
import signal
from types import SimpleNamespace

import pytest

from palpate.engine import clock
from palpate.engine.health import HealthCounters
from palpate.engine.job import Job, NodeJob
from palpate.engine.slot import NodeError, ObserverSlot
from palpate.launch.run import ending
from palpate.launch.run.launcher import Launcher
from palpate.launch.run.member import WorkerHandle
from palpate.launch.run.reports import REPORTED, Exited, NodeFault, Quit
from palpate.launch.run.wire import addresses
from palpate.launch.run.work import watchdog
from palpate.launch.run.work.loops import QUIET, observe
from palpate.launch.run.work.watchdog import START_PATIENCE, watch_call

MS = 1_000_000


@pytest.fixture
def time(monkeypatch):
    """A clock that only the test advances [ns]."""
    moment = SimpleNamespace(ns=0)
    monkeypatch.setattr(clock, "now", lambda: moment.ns)
    return moment


def test_silence_adds_up_over_polls(time):
    silence = clock.Silence()
    for _ in range(10):
        time.ns += 20 * MS
        silence.poll()
    assert silence.poll() == 200 * MS
    time.ns += 5000 * MS
    assert silence.poll() == 400 * MS
    silence.reset()
    assert silence.poll() == 0


def test_an_observer_receives_frames_in_transit_during_a_stall(time):
    """The stall is longer than the silence that marks the end of the streams of a killed sender."""
    comes = iter([(20, True), (3000, False), (20, True)])
    received = []

    def overhear(wait: bool) -> bool:
        passed, came = next(comes, (20, False))
        time.ns += passed * MS
        received.append(came)
        return came

    nothing = lambda: None  # noqa: E731
    worker = SimpleNamespace(
        slots=[None], job=SimpleNamespace(clock="real"), last=None, stopping=True,
        audience=SimpleNamespace(has_all=lambda last: False, ended=set(), lost={"other"}),
        overhear=overhear, offer_end=nothing, drain=nothing, check_orders=nothing, housekeep=nothing,
    )  # fmt: skip
    observe(worker, {"other"})
    assert received[:3] == [True, False, True]
    assert len(received) == 3 + QUIET // (20 * MS) + 1


def test_after_a_death_and_a_stall_the_others_get_time_for_the_news(time):
    """`Quit` is sent after this running time, not at once, when the report of the death is still unread."""
    printed = []
    wires = SimpleNamespace(send_order=lambda group, order: printed.append(order))
    end = ending.Ending({}, wires, None, True, lambda text: None)
    end.quit_after(0.1)
    for passed in (20, 3000, 20, 40):
        time.ns += passed * MS
        end.check(True)
        assert printed == []
    time.ns += 40 * MS
    end.check(True)
    assert printed == [Quit()]


def test_the_last_report_of_a_worker_is_read_after_a_stall(time, monkeypatch):
    member = WorkerHandle(Job("a", (NodeJob("a", "", {}, 1, (), ()),)), state="running", pid=1)

    def later() -> int:
        time.ns += 5000 * MS
        return time.ns

    monkeypatch.setattr(clock, "now", later)
    launcher = SimpleNamespace(members={"a": member}, _is_gone=lambda member: None, _tail=[])
    Launcher._answer(launcher, Exited("a", 1))
    Launcher._end_process(launcher, member)
    assert member.exited == 1  # the reports that have arrived meanwhile are handled before the next turn
    member.state = "failed"
    Launcher._end_process(launcher, member)
    assert (member.state, member.exited) == ("failed", None)


@pytest.mark.parametrize(("status", "state"), [(REPORTED, "failed"), (3, "died")])
def test_the_launcher_waits_for_a_reported_failure_only(time, status, state):
    """The report arrives 2 s after the end of the process, while other reports arrive continuously."""
    member = WorkerHandle(Job("a", (NodeJob("a", "", {}, 1, (), ()),)), state="running", pid=1)
    due = time.ns + 2000 * MS

    def died(member: WorkerHandle, fault: NodeFault) -> None:
        member.state = "died"

    launcher = SimpleNamespace(members={"a": member}, _is_gone=lambda member: None, _report_death=died, _tail=[])
    Launcher._answer(launcher, Exited("a", status))
    while member.exited is not None:
        time.ns += MS
        if time.ns >= due:
            member.state = "failed"
        Launcher._end_process(launcher, member)
    assert member.state == state


def test_a_starting_run_keeps_the_folder_of_another_starting_run(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path) if len(str(tmp_path)) < 40 else "")
    first, second = f"1-{os.getpid()}", f"2-{os.getpid()}"
    lock, others = fcntl.flock, []

    def flock(number: int, how: int) -> None:
        """The first run stalls before it has the lock."""
        if how == fcntl.LOCK_EX and not others:
            others.append(None)
            others.append(addresses.RunFolder(second))
        lock(number, how)

    monkeypatch.setattr("fcntl.flock", flock)
    made = addresses.RunFolder(first)
    assert made.path.is_dir() and {first, second} <= dict(addresses.runs()).keys()
    made.close()
    others[1].close()
    assert not {first, second} & dict(addresses.runs()).keys()


@pytest.mark.parametrize(("patience", "least"), [(0.05, 60.0), (5.0, 60.0), (START_PATIENCE, 240.0)])
def test_a_fused_run_survives_a_stall_of_a_minute(monkeypatch, patience, least):
    """The system's watchdog thread cannot distinguish a stall from a node that never returns, and would end the run."""
    ends = []
    monkeypatch.setattr(faulthandler, "dump_traceback_later", lambda end, exit: ends.append(end))
    with watch_call(patience):
        signal.raise_signal(signal.SIGALRM)
    assert ends and min(ends) >= least


@pytest.mark.parametrize("stuck", [False, True])
def test_an_observer_may_be_slow_for_many_messages_but_not_for_one(monkeypatch, stuck):
    """A process without processor time may take seconds for the messages of one batch."""
    moment = [0.0]
    monkeypatch.setattr(watchdog, "time", SimpleNamespace(monotonic=lambda: moment[0], process_time=lambda: 0.0))

    def observe(stream: str, tick: int, payload: bytes) -> None:
        for _ in range(20 if stuck and tick == 3 else 1):
            moment[0] += 1.0
            signal.raise_signal(signal.SIGALRM)

    slot = ObserverSlot.__new__(ObserverSlot)
    slot.name, slot.node, slot.last, slot.health = "log", SimpleNamespace(observe=observe), {}, HealthCounters()
    slot.pending = [("pose", tick, b"") for tick in range(20)]
    with watch_call(5.0):
        if stuck:
            with pytest.raises(NodeError, match="'pose' at tick 3") as raised:
                slot.take()
            assert isinstance(raised.value.__cause__, watchdog.HangError)
        else:
            slot.take()
            assert slot.health.step.count == 20
