"""Base class of drivers with one connection."""

import time
from collections.abc import Callable, Iterator
from typing import Any, ClassVar, Generic, TypeVar

from palpate.drivers.errors import DeviceError
from palpate.drivers.frame import FrameRules, Refused

LEAST = 3  # lower bound of attempts, in case the machine stalls until the deadline


def attempts(seconds: float) -> Iterator[int]:
    """Number attempts to reach a device until a timeout [s], at least `LEAST`."""
    count, deadline = 0, time.monotonic() + seconds
    while count < LEAST or time.monotonic() < deadline:
        yield count
        count += 1


P = TypeVar("P")


def select_device(name: str, port: str, serials: dict[str, str | None]) -> str:
    """The device of this kind at a port or with this serial number; "": the only one. DeviceError: not exactly one.

    serials  serial number of the device at each port
    """
    chosen = [place for place, serial in serials.items() if not port or port in (place, serial)]
    listed = ", ".join(serials)
    if not chosen:
        raise DeviceError(f"no {name} at port {port!r}. There are: {listed}.")
    if len(chosen) > 1:
        raise DeviceError(f"{len(chosen)} devices are a {name}. Say which one with `port`: {listed}.")
    return chosen[0]


class PortDriver(Generic[P]):
    """A driver that opens and closes its connection.

    connect  opens the connection, which has a method `close`
    rules    what its frames say about themselves
    refused  number of frames that were no samples, by reason
    """

    name: ClassVar[str]

    rules: ClassVar[FrameRules]

    def __init__(self, connect: Callable[[], P]) -> None:
        self.connect = connect
        self.refused = Refused()
        self._port: Any = None

    @property
    def port(self) -> P:
        """The connection. DeviceError: it is not open."""
        if self._port is None:
            raise DeviceError(f"the {self.name} is not open", lost=True)
        return self._port  # type: ignore[no-any-return]

    @port.setter
    def port(self, port: P) -> None:
        self._port = port

    def close(self) -> None:
        if self._port is not None:
            port, self._port = self._port, None
            port.close()
