"""Reading what has come from a device: the newest counts, and a flood does not hold up the next command."""

from collections.abc import Callable
from typing import TypeVar

MOST = 64  # messages taken at once

T = TypeVar("T", bytes, str)


def burst(read: Callable[[float], T], timeout: float) -> list[T]:
    """The messages that have come, the first one within `timeout` [s], and MOST of them at most: then there may be
    more, and the last of these may be old."""
    taken: list[T] = []
    while len(taken) < MOST and (message := read(0.0 if taken else timeout)):
        taken.append(message)
    return taken
