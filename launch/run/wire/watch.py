"""Polls many sockets with one system call (epoll)."""

import select
from collections.abc import Callable


class SocketPoller:
    """Calls a function for each socket that is readable or closed by its peer."""

    def __init__(self) -> None:
        self._epoll = select.epoll()
        self._calls: dict[int, Callable[[], None]] = {}
        self.fileno = self._epoll.fileno

    def add(self, number: int, call: Callable[[], None]) -> None:
        self._calls[number] = call
        self._epoll.register(number, select.EPOLLIN)

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
