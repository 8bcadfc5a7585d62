"""Addresses of the sockets of runs on this machine: files in a folder that only their user can enter.

    FOLDER/RUN/control  FOLDER/RUN/reports           of the launcher
    FOLDER/RUN/GROUP.force  FOLDER/RUN/GROUP.observers   of each worker: for nodes, and for external programs
    FOLDER/RUN/GROUP.members                             for the observers of the run

FOLDER is `palpate` in the user's runtime folder (XDG_RUNTIME_DIR), otherwise /tmp/palpate-UID. The launcher locks the
folder of its run, so that stale folders of killed launchers can be recognised.
"""

import contextlib
import hashlib
import os
import re
import shutil
import socket
import stat
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import quote, unquote

LONGEST = 100  # [bytes] path of a socket; the kernel's limit is 107
LOOPBACK = "127.0.0.1"
_LOCK = "lock"
_TCP = re.compile(r"tcp://([\w.-]{1,253}|\[[0-9a-fA-F:.]{2,45}(%\w{1,15})?\]):([0-9]{1,5})", re.ASCII)


def has_unix_sockets() -> bool:
    """Whether the processes of a run on this machine are forked from a server and connected by Unix sockets. Otherwise
    each is started separately, and they are connected by encrypted TCP on loopback: on Windows, and on macOS, whose
    `fork`, polls and credentials of sockets differ from those of Linux."""
    return sys.platform == "linux" and hasattr(os, "fork") and hasattr(socket, "AF_UNIX")


def folder() -> Path:
    """The folder of all runs of this user, created if missing.

    PermissionError: another user owns it or can enter it.
    """
    runtime = os.environ.get("XDG_RUNTIME_DIR", "")
    here = runtime and len(runtime) < 40 and os.access(runtime, os.W_OK | os.X_OK)
    path = Path(runtime) / "palpate" if here else Path(f"/tmp/palpate-{os.getuid()}")
    with contextlib.suppress(FileExistsError):
        path.mkdir(mode=0o700)
    status = path.lstat()
    if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.getuid() or status.st_mode & 0o077:
        raise PermissionError(
            f"{path}: the sockets of a run need a folder that belongs to this user (uid {os.getuid()}) and that nobody "
            f"else can enter; found one of uid {status.st_uid} with mode {stat.S_IMODE(status.st_mode):o}. "
            "Remove it, or set XDG_RUNTIME_DIR."
        )
    return path


def endpoint(run: str, name: str, outlet: str = "") -> str:
    """Local address of a socket of a run: of the launcher, or an outlet of the worker of a group."""
    path = folder() / run / (f"{quote(name, safe='')}.{outlet}" if outlet else name)
    if len(os.fsencode(path)) > LONGEST:
        path = path.with_name(f"{hashlib.sha256(name.encode()).hexdigest()[:16]}.{outlet}")
    return f"ipc://{path}"


def is_tcp(address: str) -> bool:
    """Whether an address is `tcp://host:port` of one host and port: neither a local socket nor another transport, which
    a peer on another machine must not name."""
    found = _TCP.fullmatch(address)
    return found is not None and 0 < int(found[3]) < 1 << 16


class RunFolder:
    """The folder of one run, created and locked; `close` removes it. Stale folders of dead launchers are removed."""

    def __init__(self, run: str) -> None:
        here = folder()
        import fcntl  # POSIX only; the module itself must be importable elsewhere

        for old in here.iterdir():
            if not _in_use(old):
                shutil.rmtree(old, ignore_errors=True)
        # Lock it before it is visible: another launcher that starts now would remove it.
        made = Path(tempfile.mkdtemp(prefix=f"{here.name}-", dir=here.parent))
        self._lock = os.open(made / _LOCK, os.O_CREAT | os.O_RDWR | os.O_CLOEXEC, 0o600)
        fcntl.flock(self._lock, fcntl.LOCK_EX)
        self.path = made.rename(here / run)

    def close(self) -> None:
        shutil.rmtree(self.path, ignore_errors=True)
        os.close(self._lock)


def runs() -> Iterator[tuple[str, list[str]]]:
    """Active runs, the newest last, and their groups with an outlet for observers; none without Unix sockets."""
    if not has_unix_sockets():
        return
    with contextlib.suppress(FileNotFoundError):
        for path in sorted(folder().iterdir(), key=lambda file: file.stat().st_ctime):
            if _in_use(path):
                yield path.name, sorted(unquote(file.stem) for file in path.glob("*.observers"))


def _in_use(path: Path) -> bool:
    """Whether the launcher of this run is alive. A stray file is no run."""
    import fcntl

    try:
        number = os.open(path / _LOCK, os.O_RDWR | os.O_CLOEXEC)
    except (FileNotFoundError, NotADirectoryError):
        return False
    try:
        fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(number)
    return False
