"""palpate as a library needs no module or function that exists only on POSIX."""

import ast
import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from palpate.cli.machine import diagnostics
from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.nodes.base import SettingError
from palpate.nodes.device import Pointer
from palpate.physics.errors import RunError
from palpate.views.errors import PageError
from palpate.views.page.steered import Pointers

TESTS = Path(__file__).parents[1]
ROOT = TESTS.parent
PROCESSES = ("launch/run/", "src/palpate/models/build/on_demand.py", "src/palpate/studies/sweeps/runner.py")
"""Nodes in processes, and work in another process: an error names the systems before one of these names is reached, or
the name is behind `hasattr`, in a `try` or in a file that only Linux reaches."""
GUARDED = {
    "nodes/device/mouse.py": "start raises on a system without Unix sockets",
    "src/palpate/views/page/steered.py": "the same",
    "src/palpate/cli/machine/diagnostics.py": "only on Linux",
    "src/palpate/compiler/cores.py": "hasattr",
    "src/palpate/compiler/kernel_files.py": "import in a try; the descriptor of a folder is None",
    "src/palpate/compiler/trust.py": "hasattr; the same descriptor",
    "src/palpate/engine/clock.py": "only for the processes of a run",
    "src/palpate/physics/writable.py": "import in a try",
    "src/palpate/records/format/mcap_writer.py": "suppress(AttributeError)",
    "src/palpate/views/page/live.py": "hasattr",
    "src/palpate/views/page/server.py": "hasattr",
}
MODULES = {"fcntl", "resource", "termios", "pwd", "grp", "pty", "tty", "readline", "syslog"}
NAMES = {
    "os": set(
        """fork forkpty register_at_fork getuid geteuid getgid getpgid setpgid setsid killpg uname pipe2 waitid wait
        sched_getaffinity sched_setaffinity sched_setscheduler sched_param SCHED_RR getpriority setpriority mkfifo
        statvfs chown WNOHANG posix_spawn O_CLOEXEC O_NONBLOCK getloadavg nice memfd_create""".split()  # noqa: SIM905
    ),
    "signal": set(
        """SIGALRM SIGHUP SIGCHLD SIGUSR1 SIGUSR2 SIGSTOP SIGCONT SIGPIPE SIGKILL SIGQUIT setitimer getitimer
        ITIMER_REAL alarm pthread_sigmask pthread_kill sigwait""".split()  # noqa: SIM905
    ),
    "socket": {"AF_UNIX", "SO_PEERCRED"},
}
OPTIONS = {"pass_fds", "process_group", "preexec_fn", "start_new_session", "dir_fd", "src_dir_fd", "dst_dir_fd"}


def posix_only(path):
    """The names in a source file that Windows or macOS lacks."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            if node.attr in NAMES.get(node.value.id, ()):
                yield f"{node.value.id}.{node.attr}"
        elif isinstance(node, ast.Import):
            yield from (each.name for each in node.names if each.name in MODULES)
        elif isinstance(node, ast.keyword) and node.arg in OPTIONS:
            yield node.arg


def test_names_that_exist_only_on_posix_occur_only_where_they_are_guarded():
    """`os.sched_getaffinity` in seven files kept ensembles and environments from running on macOS."""
    found = {}
    for folder in ("src/palpate", "nodes", "launch", "messages"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            name = path.resolve().relative_to(ROOT).as_posix()
            if (names := sorted(set(posix_only(path)))) and not name.startswith(PROCESSES):
                found[name] = names
    assert found.keys() == GUARDED.keys(), found


def test_a_run_in_processes_names_the_systems_that_it_needs(monkeypatch, tmp_path):
    monkeypatch.delattr(os, "fork")
    monkeypatch.delattr(socket, "AF_UNIX")
    launch = find("kidney").but(duration=0.01, clock="simulated", place="apart")
    with pytest.raises(RunError, match=r"without fork and Unix sockets; .* need Linux or macOS.*--fused"):
        execute(launch)
    with pytest.raises(SettingError, match="without Unix sockets, expected Linux or macOS"):
        Pointer(socket=str(tmp_path / "pointer")).start()
    with pytest.raises(PageError, match="without Unix sockets; `palpate touch` needs Linux or macOS"):
        Pointers([tmp_path / "pointer"], [(0.0, 0.0, 0.1)])


def test_one_process_on_simulated_time_runs_without_posix(tmp_path):
    command = [sys.executable, TESTS / "support" / "without_posix.py", TESTS / "golden" / "kidney.yaml"]
    done = subprocess.run(command, env=dict(os.environ), capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert float(done.stdout) > 0.05


def test_doctor_names_the_tested_system(monkeypatch):
    def found():
        return {one.what: one for one in diagnostics.examine(pictures=False, seconds=0.0)}

    assert found()["system"].state == "ok"
    monkeypatch.setattr(diagnostics.sys, "platform", "darwin")
    elsewhere = found()
    assert elsewhere["system"].state == "note" and "untested" in elsewhere["system"].found
    assert "SCHED_RR" not in elsewhere
