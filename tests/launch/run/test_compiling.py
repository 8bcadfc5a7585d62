"""The first run on a machine reports the compilation once, on a terminal or not; later runs report nothing."""

import faulthandler
import os
import time
from types import SimpleNamespace

import numba
import pytest
from rich.console import Console

from palpate.compiler.kernel import kernel
from palpate.engine import clock
from palpate.engine.health import HealthCounters
from palpate.engine.job import Job, NodeJob
from palpate.engine.slot import NodeError, ObserverSlot
from palpate.launch.run import member
from palpate.launch.run.launcher import Launcher
from palpate.launch.run.reports import Compiling
from palpate.launch.run.result import Result
from palpate.launch.run.screen import Screen
from palpate.launch.run.work.compiling import LONGEST, compiler_watched, compiling
from palpate.launch.run.work.watchdog import START_PATIENCE, HangError, watch_call


def test_compiled_kernels_are_counted_and_cached_ones_are_not():
    kernels = [numba.njit(lambda x, k=k: x + k) for k in range(3)]
    printed = []
    with compiling(printed.append):
        for kernel in (*kernels, *kernels):
            kernel(1.0)
    assert printed == [1, 2, 3]
    numba.njit(lambda x: x)(1.0)
    assert printed == [1, 2, 3]


@pytest.mark.parametrize("terminal", [False, True])
def test_the_first_run_reports_the_compilation_once(terminal):
    console = Console(width=120, force_terminal=terminal)
    with console.capture() as capture, Screen(console, "kidney", 1000.0, 100, ["tissue"]) as screen:
        for kernels in (0, 1, 0, 2):
            screen._drawn = 0.0
            screen.show(Result(), "starting", {"tissue": "tissue"}, kernels)
    printed = capture.get()
    assert printed.count("compiling the kernels for this processor: once") == 1
    assert ("2 of about" in printed) is terminal  # text of the bar


def test_a_run_with_cached_kernels_reports_nothing():
    console = Console(width=120)
    with console.capture() as capture, Screen(console, "kidney", 1000.0, 100, ["tissue"]) as screen:
        screen.show(Result(), "starting", {"tissue": "tissue"}, 0)
    assert capture.get() == ""


@kernel
def halved(x):
    return 0.5 * x


def long_sum():
    """A function without cache whose compilation takes about 0.5 s of processor time."""
    lines = [f"    y = y * x + {k}.0" for k in range(250)]
    names = {}
    exec("\n".join(["def polynomial(x):", "    y = 0.0", *lines, "    return y"]), names)
    return numba.njit(names["polynomial"])


@pytest.mark.parametrize("hangs", [False, True])
def test_compiling_is_a_sign_of_life_for_the_watchdog_of_one_process(monkeypatch, hangs):
    """A call that compiles for longer than the limit goes through; one that then hangs does not."""
    ends = []
    monkeypatch.setattr(faulthandler, "dump_traceback_later", lambda end, exit: ends.append(end))
    begun, took = time.monotonic(), []

    def observe(stream, tick, payload):
        long_sum()(1.5)
        took.append(time.monotonic() - begun)
        end = time.monotonic() + 60.0
        while hangs and time.monotonic() < end:
            time.sleep(0.001)

    slot = ObserverSlot.__new__(ObserverSlot)
    slot.name, slot.node, slot.last, slot.health = "log", SimpleNamespace(observe=observe), {}, HealthCounters()
    slot.pending = [("pose", 0, b"")]
    with watch_call(0.05):
        if hangs:
            with pytest.raises(NodeError, match=r"no sign of life for 0\.05 s") as raised:
                slot.take()
            assert isinstance(raised.value.__cause__, HangError)
        else:
            slot.take()
    assert took[0] > 0.1 and max(ends) >= 2.0 * LONGEST and min(ends) == 60.0


def test_waiting_for_a_kernel_that_another_process_compiles_is_a_sign_of_life(monkeypatch, tmp_path):
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "cache"))
    function = kernel(halved.py_func)
    reading, writing = os.pipe()
    child = os.fork()
    if not child:
        try:
            with function.made._cache.lock_compilation((numba.types.float64,)):
                os.write(writing, b"locked")
                time.sleep(0.3)
        finally:  # an error must not return into the tests of this process
            os._exit(0)
    os.close(writing)
    assert os.read(reading, 6) == b"locked"
    changes = []
    with compiler_watched(lambda active: changes.append((active, time.monotonic()))):
        assert function(3.0) == 1.5
        assert function(5.0) == 2.5
    os.waitpid(child, 0)
    assert changes[0][0] and not changes[-1][0] and changes[1][1] - changes[0][1] > 0.1  # it waited
    again = []
    with compiler_watched(again.append):
        assert kernel(halved.py_func)(3.0) == 1.5
    assert again == []  # cached: nothing to report


def test_the_launcher_does_not_end_a_worker_that_compiles(monkeypatch):
    """It hangs if it is silent for 120 s, and while it compiles for half an hour."""
    now, faults = [0.0], []
    monkeypatch.setattr(clock, "now", lambda: int(1e9 * now[0]))
    worker = member.WorkerHandle(Job("a", (NodeJob("a", "", {}, 1, (), ()),)))
    fake = SimpleNamespace(
        members={"a": worker}, patience=5.0, forkserver=SimpleNamespace(ask=lambda _: None), _tail=[],
        _report_death=lambda member, fault: faults.append(fault.text),
        _ending=SimpleNamespace(closed=False, forsake=lambda member: False),
    )  # fmt: skip

    def silent(seconds):
        faults.clear()
        worker.asked = None
        end = now[0] + seconds
        while now[0] < end and not faults:
            now[0] += 0.05
            Launcher._check_hung(fake)
        return faults

    Launcher._take(fake, worker, Compiling(True))
    assert not silent(LONGEST - 1.0)
    assert "1800 s" in silent(2.0)[0]
    Launcher._take(fake, worker, Compiling(False))
    assert not silent(START_PATIENCE - 1.0)
    assert "120 s" in silent(2.0)[0]
    worker.state = "running"
    Launcher._take(fake, worker, Compiling(True))
    assert not silent(100.0)
    Launcher._take(fake, worker, Compiling(False))
    assert "5 s" in silent(6.0)[0]
