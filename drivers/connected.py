"""What drivers share whose device is behind one connection."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar, Generic, Protocol, TypeVar

from palpate.drivers.errors import DeviceError


class _Port(Protocol):
    def close(self) -> None: ...


P = TypeVar("P", bound=_Port)


class PortDriver(Generic[P]):
    """A driver that opens and closes its connection.

    connect  opens it
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
