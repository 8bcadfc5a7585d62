"""Polls many sockets with one system call: epoll, or what the system has instead."""

import select
import selectors
from collections.abc import Callable
from typing import Any

READ = 1  # EPOLLIN


class _Selector:
    """The calls of `select.epoll` that are needed here, on systems without it."""

    def __init__(self) -> None:
        self._selector = selectors.DefaultSelector()
        self.unregister = self._selector.unregister

    def register(self, number: int, _: int) -> None:
        self._selector.register(number, selectors.EVENT_READ)

    def poll(self, seconds: float, most: int) -> list[tuple[int, int]]:
        return [(key.fd, events) for key, events in self._selector.select(seconds)[:most]]


class SocketPoller:
    """Calls a function for each socket that is readable or closed by its peer."""

    def __init__(self) -> None:
        self._epoll: Any = select.epoll() if hasattr(select, "epoll") else _Selector()
        self._calls: dict[int, Callable[[], None]] = {}

    def fileno(self) -> int:
        """A descriptor that is readable while one of the sockets is; only with epoll."""
        return int(self._epoll.fileno())

    def add(self, number: int, call: Callable[[], None]) -> None:
        self._calls[number] = call
        self._epoll.register(number, READ)

    def remove(self, number: int) -> None:
        """Stop watching a descriptor; call this before it is closed."""
        if self._calls.pop(number, None) is not None:
            self._epoll.unregister(number)

    def poll(self, wait: int = 0, most: int = 64) -> int:
        """Call the functions of at most `most` readable sockets; wait up to `wait` [ms] for the first. Returns their
        number."""
        ready = self._epoll.poll(wait * 1e-3, most)
        for number, _ in ready:
            call = self._calls.get(number)
            if call is not None:
                call()
        return len(ready)
