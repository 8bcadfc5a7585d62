"""Process attributes: death signal of the parent, and title."""

import ctypes
import signal
import sys

_PR_SET_PDEATHSIG, _PR_SET_NAME = 1, 15


def die_with_parent(number: int | None = None) -> None:
    """Have the kernel send this process a signal (default SIGKILL) when its parent ends. Only on Linux."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(signal.SIGKILL if number is None else number))


def set_title(text: str) -> None:
    """Name this process for `ps -e` and `top`; 15 characters. Only on Linux."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_NAME, text.encode())
