"""What a run asks of the kernel for its processes: that they die with their parent, and have a title."""

import contextlib
import ctypes
import signal
from pathlib import Path

_PR_SET_PDEATHSIG, _PR_SET_NAME = 1, 15


def die_with_parent(number: int | None = None) -> None:
    """Have the kernel send this process a signal, SIGKILL where none is given, when its parent ends."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(signal.SIGKILL if number is None else number))


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
