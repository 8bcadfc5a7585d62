"""Base class of drivers with one connection."""

import time
from collections.abc import Callable, Iterator
from typing import ClassVar, Generic, Protocol, TypeVar

from palpate.drivers.errors import DeviceError

LEAST = 3  # lower bound of attempts, in case the machine stalls until the deadline


def attempts(seconds: float) -> Iterator[int]:
    """Number attempts to reach a device until a timeout [s], at least `LEAST`."""
    count, deadline = 0, time.monotonic() + seconds
    while count < LEAST or time.monotonic() < deadline:
        yield count
        count += 1


class _Closable(Protocol):
    def close(self) -> None: ...


P = TypeVar("P", bound=_Closable)


class PortDriver(Generic[P]):
    """A driver that opens and closes its connection.

    connect  opens the connection
    """

    name: ClassVar[str]

    def __init__(self, connect: Callable[[], P]) -> None:
        self.connect = connect
        self._port: P | None = None

    @property
    def port(self) -> P:
        """The connection. DeviceError: it is not open."""
        if self._port is None:
            raise DeviceError(f"the {self.name} is not open", lost=True)
        return self._port

    @port.setter
    def port(self, port: P) -> None:
        self._port = port

    def close(self) -> None:
        if self._port is not None:
            port, self._port = self._port, None
            port.close()
