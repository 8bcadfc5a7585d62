"""A serial line, by pyserial."""

import errno
import select
from pathlib import Path
from typing import Any

from palpate.drivers.errors import DeviceError, package

LARGEST = 4096  # [bytes] taken at once
ROOM = 1.0  # [s] for which the line may have no room for a byte more


class SerialLine:
    """A port of this machine: 8 bits, no parity, one stop bit.

    port  its device file
    baud  [1/s]
    name  of the device at its other end, for errors

    DeviceError: the port is not there, not permitted or in use.
    """

    def __init__(self, port: str, baud: int, name: str) -> None:
        self.serial = package("serial")
        self.name = name
        if not port:
            raise DeviceError(f"the {name} is on a serial port: give it as `port`. {_ports()}")
        try:
            self.line: Any = self.serial.Serial(port, baud, timeout=0, write_timeout=0, exclusive=True)
        except self.serial.SerialException as error:
            raise DeviceError(self._refused(port, error)) from None

    def _refused(self, port: str, error: Any) -> str:
        if error.errno == errno.ENOENT:
            return f"the {self.name}: no port {port}. {_ports()}"
        if error.errno == errno.EACCES:
            return f"the {self.name}: no permission for {port}. `palpate devices --install-udev` gives it."
        if error.errno in (errno.EBUSY, errno.EAGAIN, errno.EWOULDBLOCK):
            return f"the {self.name}: {port} is in use by another program. End that one."
        return f"the {self.name}: {port} cannot be opened: {error}"

    def _gone(self) -> DeviceError:
        return DeviceError(f"the {self.name} is gone. Plug it in again.", lost=True)

    def write(self, data: bytes) -> None:
        """Send bytes. DeviceError: the line is gone, or its other end takes nothing any more.

        pyserial's own limit of time would also refuse what it has written, where the machine stood still meanwhile.
        """
        try:
            while data:
                if not select.select([], [self.line.fileno()], [], ROOM)[1]:
                    raise self._gone()
                data = data[self.line.write(data) :]
        except (self.serial.SerialException, OSError, TypeError):  # TypeError: closed while it was written to
            raise self._gone() from None

    def read(self, timeout: float) -> bytes:
        """What has come, or comes first within `timeout` [s]; empty when nothing does. DeviceError: it is gone."""
        try:
            self.line.timeout = max(timeout, 0.0)
            first = self.line.read(1)
            if not first:
                return b""
            self.line.timeout = 0
            return first + self.line.read(LARGEST)
        except (self.serial.SerialException, OSError, TypeError):
            raise self._gone() from None

    def close(self) -> None:
        self.line.close()


def _ports() -> str:
    ports = sorted(str(p) for pattern in ("ttyUSB*", "ttyACM*") for p in Path("/dev").glob(pattern))
    return f"There are: {', '.join(ports)}." if ports else "There is none on USB: plug it in."
