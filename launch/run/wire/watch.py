"""Which of many sockets have something to read, by one call of the system."""

import select
from collections.abc import Callable


class SocketPoller:
    """Calls the owner of each socket that has something to read, or whose other end is gone."""

    def __init__(self) -> None:
        self._epoll = select.epoll()
        self._calls: dict[int, Callable[[], None]] = {}
        self.fileno = self._epoll.fileno

    def add(self, number: int, call: Callable[[], None]) -> None:
        """Watch a descriptor."""
        self._calls[number] = call
        self._epoll.register(number, select.EPOLLIN)

    def remove(self, number: int) -> None:
        """Do not watch it any more; call this before it is closed."""
        if self._calls.pop(number, None) is not None:
            self._epoll.unregister(number)

    def poll(self, wait: int = 0, most: int = 64) -> None:
        """Call those who have something now, or within so many milliseconds: so many at most."""
        for number, _ in self._epoll.poll(wait * 1e-3, most):
            call = self._calls.get(number)
            if call is not None:
                call()
