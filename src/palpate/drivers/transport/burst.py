"""Reads the backlog of a device, limited so that a flood of messages does not delay the next command."""

from collections.abc import Callable
from typing import TypeVar

MOST = 64  # messages taken at once

T = TypeVar("T", bytes, str)


def burst(read: Callable[[float], T], timeout: float) -> list[T]:
    """The waiting messages; waits up to `timeout` [s] for the first. With MOST messages there may be more, so that the
    last one may not be the newest."""
    taken: list[T] = []
    while len(taken) < MOST and (message := read(0.0 if taken else timeout)):
        taken.append(message)
    return taken
