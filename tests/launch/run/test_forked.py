"""The fork server that is forked from a command: it has the modules of the command, and nothing else of it."""

import json
import os
import subprocess
import sys
import threading

import pytest
from graphs_for_runs import write_graph

from palpate.launch.run.forkserver import ForkServer
from palpate.launch.run.work.forked import forkable

KEEPS = """
import json, os, signal, sys, time
from palpate.launch.run.work import forked
held, kept = os.open(os.devnull, os.O_RDONLY), os.open(os.devnull, os.O_RDONLY)
signal.signal(signal.SIGTERM, signal.SIG_IGN)
os.environ["OURS"] = "1"
print("before", end="")
def child():
    files = [number for number in range(64) if os.path.exists(f"/proc/self/fd/{number}")]
    unhandled = signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
    seen = {"session": os.getsid(0) == os.getpid(), "files": files, "term": unhandled,
            "environment": dict(os.environ), "module": "json" in sys.modules, "input": sys.stdin.read()}
    print(json.dumps(seen), flush=True)
    os._exit(7)
one = forked.fork(child, [kept], {"A": "b"})
said = one.stdout.read()
print(json.dumps([said.decode(), one.wait(20.0), one.poll(), kept]))
"""


def test_it_is_a_session_with_its_files_environment_and_streams():
    out = subprocess.run([sys.executable, "-c", KEEPS], capture_output=True, text=True, check=True, timeout=120).stdout
    assert out.startswith("before[") and out.count("before") == 1  # by the parent, which had not flushed it
    said, code, again, kept = json.loads(out.removeprefix("before"))
    seen = json.loads(said)
    assert seen["session"] and seen["term"] and seen["module"] and seen["input"] == ""
    assert seen["environment"] == {"A": "b"} and seen["files"] == [0, 1, 2, kept]
    assert (code, again) == (7, 7)


FAILS = """
import time
from palpate.launch.run.work.forked import fork
def child():
    raise ValueError("what went wrong")
one = fork(child, [], {})
print(one.stdout.read().decode(), one.wait(20.0))
one = fork(lambda: time.sleep(60.0), [], {})
one.terminate()
print(one.wait(20.0))
"""


def test_a_fault_is_printed_and_a_signal_ends_it():
    out = subprocess.run([sys.executable, "-c", FAILS], capture_output=True, text=True, check=True, timeout=120).stdout
    assert "ValueError: what went wrong" in out and out.splitlines()[-2:] == [" 1", "-15"]


def test_a_process_with_a_second_thread_is_not_forked(monkeypatch):
    """A lock that the other thread holds would stay locked in the child: the fork server is started as a program."""
    stop = threading.Event()
    thread = threading.Thread(target=stop.wait)
    thread.start()
    try:
        assert not forkable()
        monkeypatch.setattr("palpate.launch.run.forkserver.fork", lambda *_: pytest.fail("forked"))
        ForkServer(forked=True).close()
    finally:
        stop.set()
        thread.join()


COMMAND = """
import os, sys
from palpate.launch.run import forkserver
fork, known = forkserver.fork, []
def counted(*given):
    known.append(1)
    return fork(*given)
forkserver.fork = counted
from palpate.cli.__main__ import app
try: app(["run", "loop", "--no-record", "--duration", "0.01", "-q"])
except SystemExit as end: print("exit", end.code, "forks", len(known))
"""


def test_a_command_forks_its_server(tmp_path):
    write_graph(tmp_path)
    path = os.pathsep.join(p for p in sys.path if p)
    out = subprocess.run(
        [sys.executable, "-c", COMMAND.replace('"loop"', '"loop.yaml"')], capture_output=True, text=True, cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": path}, timeout=120,
    )  # fmt: skip
    assert out.stdout.splitlines()[-1] == "exit 0 forks 1", out.stdout + out.stderr


ENDED = """
import os, signal
from palpate.launch.run.work import forked
def end(*_):
    raise KeyboardInterrupt
signal.signal(signal.SIGTERM, end)
become = forked._become
forked._become = lambda *given: (os.kill(os.getpid(), signal.SIGTERM), become(*given))
one = forked.fork(lambda: os._exit(0), (), os.environ)
print(one.stdout.read(), one.wait(10.0))
"""


def test_a_child_that_is_ended_at_once_prints_nothing():
    """It called the handler of its parent, and printed a traceback of it."""
    done = subprocess.run([sys.executable, "-c", ENDED], capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("b'' -15\n", "")
