"""Room for the frames of Python's calls, in one piece of memory.

CPython keeps frames in pieces of 16 kB. A call that does not fit gets a piece from the system, and returns it when it
ends: a call at the edge of a piece that is repeated a million times maps, faults in and unmaps memory a million times.
This takes 15 % of the time of a compilation, whose calls are nested deeply. A call whose frame is larger than a piece
gets a larger one, and the calls inside it use the rest: `with_room` declares a large frame, which it does not touch.
"""

import threading
from collections.abc import Callable
from typing import Any, TypeVar

T = TypeVar("T")

SLOTS = 1 << 16
"""Values in the frame that is declared: CPython doubles the size of a piece until it fits, so that more than a third of
a megabyte remains, for a thousand calls."""

_state = threading.local()


def with_room(call: Callable[..., T], *given: Any, **named: Any) -> T:
    """The result of a call, whose calls find their frames in one piece of memory. No effect inside another one."""
    if getattr(_state, "inside", False):
        return call(*given, **named)
    _state.inside = True
    try:
        return _with_large_frame(call, *given, **named)
    finally:
        _state.inside = False


def _with_large_frame(call: Callable[..., T], *given: Any, **named: Any) -> T:
    return call(*given, **named)


_with_large_frame.__code__ = _with_large_frame.__code__.replace(co_stacksize=SLOTS)
