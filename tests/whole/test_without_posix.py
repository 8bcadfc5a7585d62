"""palpate needs no module or function that exists only on POSIX, and only for other programs Unix sockets."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest
from sources import nodes

from palpate.cli.machine import diagnostics
from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import Network, execute
from palpate.launch.run.wire import addresses, discover
from palpate.nodes.device import mailbox
from palpate.physics.errors import RunError

TESTS = Path(__file__).parents[1]
ROOT = TESTS.parent
GUARDED = {
    "launch/run/busy.py": "hasattr",
    "launch/run/descendants.py": "only on Linux",
    "launch/run/execute.py": "import in a try",
    "launch/run/forkserver.py": "has_unix_sockets",
    "launch/run/tasks/link.py": "hasattr",
    "launch/run/tasks/runner.py": "hasattr; other systems ignore the option",
    "launch/run/wire/addresses.py": "has_unix_sockets",
    "launch/run/wire/inlet.py": "has_unix_sockets",
    "launch/run/wire/outlet.py": "has_unix_sockets",
    "launch/run/work/compiling.py": "hasattr",
    "launch/run/work/forked.py": "only where has_unix_sockets",
    "launch/run/work/fused.py": "hasattr",
    "launch/run/work/process.py": "hasattr",
    "launch/run/work/spawner.py": "Windows ignores the option",
    "launch/run/work/watchdog.py": "hasattr",
    "launch/run/wire/keys.py": "hasattr",
    "src/palpate/models/files/apart.py": "import in a try",
    "src/palpate/physics/scratch.py": "import in a try",
    "src/palpate/models/build/on_demand.py": "Windows ignores the option",
    "nodes/device/mailbox.py": "hasattr",
    "src/palpate/cli/machine/diagnostics.py": "only on Linux",
    "src/palpate/compiler/cores.py": "hasattr",
    "src/palpate/compiler/kernel_files.py": "import in a try; the descriptor of a folder is None",
    "src/palpate/compiler/trust.py": "hasattr; the same descriptor",
    "src/palpate/engine/clock.py": "only for the processes of a run",
    "src/palpate/physics/writable.py": "import in a try",
    "src/palpate/records/format/mcap_writer.py": "suppress(AttributeError)",
    "src/palpate/views/page/live.py": "hasattr",
    "src/palpate/views/page/measuring.py": "hasattr",
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
    for node in nodes(path):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            if node.attr in NAMES.get(node.value.id, ()):
                yield f"{node.value.id}.{node.attr}"
        elif isinstance(node, ast.Import):
            yield from (each.name for each in node.names if each.name in MODULES)
        elif isinstance(node, ast.keyword) and node.arg in OPTIONS:
            yield node.arg


def test_names_that_exist_only_on_posix_occur_only_where_they_are_guarded():
    """`os.sched_getaffinity` in seven files kept ensembles and environments from running on macOS; `os.getloadavg` in
    one kept `rates`, `tune` and `bench` from running on Windows."""
    found = {}
    for folder in ("src/palpate", "nodes", "launch", "messages"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            name = path.resolve().relative_to(ROOT).as_posix()
            if names := sorted(set(posix_only(path))):
                found[name] = names
    assert found.keys() == GUARDED.keys(), found


def without_posix(folder, *parts):
    """Run parts of `without_posix` in a process that lacks the names, as do the processes that it starts."""
    path = [TESTS / "support" / "hidden", TESTS / "support", TESTS / "views"]
    command = [sys.executable, TESTS / "support" / "without_posix.py", TESTS / "golden" / "kidney.yaml", *parts]
    env = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, path))}
    done = subprocess.run(command, env=env, capture_output=True, text=True, cwd=folder)
    assert done.returncode == 0, done.stderr


def test_one_process_on_simulated_time_runs_without_posix(tmp_path):
    without_posix(tmp_path, "runs", "many", "shown")


def test_processes_are_connected_by_encrypted_tcp_without_unix_sockets(tmp_path):
    without_posix(tmp_path, "apart")


@pytest.mark.long
def test_processes_compute_a_study_and_a_basis_without_inherited_pipes(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    without_posix(tmp_path, "computed")


@pytest.mark.long
def test_commands_run_without_posix(tmp_path):
    without_posix(tmp_path, "commands")


@pytest.mark.long
def test_a_page_moves_the_finger_without_unix_sockets(tmp_path):
    without_posix(tmp_path, "touched")


def test_what_needs_unix_sockets_says_so(monkeypatch):
    monkeypatch.setattr(addresses.sys, "platform", "win32")
    assert not list(addresses.runs())
    with pytest.raises(RunError, match=r"found win32: another program reads a run through Unix sockets.*record"):
        discover.find()
    launch = find("kidney").but(duration=0.01, clock="simulated", place="apart")
    with pytest.raises(RunError, match=r"--unencrypted: found win32, .* connected by TCP, expected Linux"):
        execute(launch, network=Network(unencrypted=True))


@pytest.mark.parametrize("kind", [mailbox._SocketInbox, mailbox._FileInbox])
def test_a_mailbox_passes_datagrams_of_this_user(kind, tmp_path, monkeypatch):
    if kind is mailbox._FileInbox:
        monkeypatch.delattr(mailbox.socket, "AF_UNIX", raising=False)
    elif not hasattr(mailbox.socket, "AF_UNIX"):
        pytest.skip("no Unix sockets")
    path, outbox = tmp_path / "Ü pointer", mailbox.Outbox()
    outbox.send(path, b"lost")
    inbox = mailbox.open_inbox(str(path))
    assert isinstance(inbox, kind) and (os.name == "nt" or path.stat().st_mode & 0o077 == 0)
    assert inbox.read() == []
    for sample in (b"a", b"bc" * 250, b"d"):
        outbox.send(path, sample)
        assert inbox.read() == [sample] and inbox.read() == []
    again = mailbox.open_inbox(str(path))  # of a run after one that was killed
    outbox.send(path, b"e")
    assert again.read() == [b"e"]
    again.close()
    assert not path.exists()
    path.write_text("a text")
    with pytest.raises(FileExistsError):
        mailbox.open_inbox(str(path))
    assert path.read_text() == "a text"


def test_a_datagram_that_is_being_written_is_read_later(tmp_path, monkeypatch):
    monkeypatch.delattr(mailbox.socket, "AF_UNIX", raising=False)
    inbox, outbox = mailbox.open_inbox(str(tmp_path / "pointer")), mailbox.Outbox()
    outbox.send(tmp_path / "pointer", b"whole")
    whole = (tmp_path / "pointer").read_bytes()
    (tmp_path / "pointer").write_bytes(whole[:-2])
    assert inbox.read() == []
    (tmp_path / "pointer").write_bytes(whole)
    assert inbox.read() == [b"whole"]


def test_doctor_names_the_tested_system(monkeypatch):
    def found():
        return {one.what: one for one in diagnostics.examine(pictures=False, seconds=0.0)}

    assert found()["system"].state == "ok"
    monkeypatch.setattr(diagnostics.sys, "platform", "darwin")
    elsewhere = found()
    assert elsewhere["system"].state == "note" and "untested" in elsewhere["system"].found
    assert "SCHED_RR" not in elsewhere
