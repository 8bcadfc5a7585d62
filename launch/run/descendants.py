"""Nothing that a run has started outlives it: children die with their parents, orphans find one who ends them."""

import contextlib
import ctypes
import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

_PR_SET_PDEATHSIG, _PR_SET_NAME, _PR_SET_CHILD_SUBREAPER = 1, 15, 36
_ALL = 0x40000000  # __WALL: children that tell their parent of their end by another signal, or by none, too
PATIENCE = 5.0  # [s] for killed processes to go


def die_with_parent(number: int | None = None) -> None:
    """Have the kernel send this process a signal, SIGKILL where none is given, when its parent ends."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(signal.SIGKILL if number is None else number))


def adopt_orphans() -> None:
    """Processes below this one whose parent ends become its children, whatever session they have opened."""
    ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, 1)


def set_title(text: str) -> None:
    """Name this process for `ps` and `top`: its command line where there is room for it, and 15 letters as its name."""
    name = text.encode()
    ctypes.CDLL(None).prctl(_PR_SET_NAME, name)
    with contextlib.suppress(OSError, IndexError, ValueError):
        begin, end = map(
            int, Path("/proc/self/stat").read_text().rpartition(")")[2].split()[45:47]
        )  # arg_start, arg_end
        if begin and len(name) < end - begin:  # both are 0 where the kernel hides them
            ctypes.memmove(begin, name.ljust(end - begin, b"\0"), end - begin)


def _state(pid: int) -> str:
    """One letter, as the kernel tells it of a process; "?" where it does not."""
    with contextlib.suppress(OSError, IndexError):
        return Path(f"/proc/{pid}/stat").read_text(errors="replace").rpartition(")")[2].split()[0]
    return "?"


def stopped(pid: int) -> bool:
    """Whether a process was stopped by a signal (SIGSTOP)."""
    return _state(pid) in "Tt"


def awake(pid: int) -> None:
    """Have a process that was stopped by a signal go on; for those that others wait for, and no node runs in."""
    if stopped(pid):
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.kill(pid, signal.SIGCONT)


def end_descendants(but: frozenset[int] = frozenset()) -> None:
    """Kill all processes below this one, but these, and wait for their end. The caller adopts orphans."""
    until = time.monotonic() + PATIENCE
    while (left := descendants(os.getpid()) - but) and time.monotonic() < until:
        for pid in left:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.kill(pid, signal.SIGKILL)
            with contextlib.suppress(ChildProcessError):
                os.waitpid(pid, os.WNOHANG)
        time.sleep(0.001)


@contextlib.contextmanager
def none_left() -> Iterator[None]:
    """What is started meanwhile below this process, and is left there at the end, ends: a node that runs in this very
    process may have forked, or started a program in a session of its own."""
    before = frozenset(descendants(os.getpid()))
    adopt_orphans()
    try:
        yield
    finally:
        end_descendants(before)


def _childless() -> bool:
    """Whether this process has no child, not even one that has ended and is not waited for: nothing is below it."""
    try:
        os.waitid(os.P_ALL, 0, os.WEXITED | os.WNOHANG | os.WNOWAIT | _ALL)
    except ChildProcessError:
        return True
    return False


def descendants(pid: int) -> set[int]:
    """Processes below this one, as the kernel lists them."""
    if pid == os.getpid() and _childless():
        return set()
    children: dict[int, list[int]] = {}
    for name in os.listdir("/proc"):
        if name.isdigit():
            with contextlib.suppress(OSError, IndexError, ValueError), open(f"/proc/{name}/stat", "rb") as stat:
                parent = int(stat.read().rpartition(b")")[2].split()[1])
                children.setdefault(parent, []).append(int(name))
    offspring: set[int] = set()
    left = [pid]
    while left:
        for child in children.get(left.pop(), []):
            if child not in offspring:
                offspring.add(child)
                left.append(child)
    return offspring
