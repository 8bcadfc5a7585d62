"""UDP to one peer."""

import socket

from palpate.drivers.errors import DeviceError


class Udp:
    """A socket connected to one host.

    DeviceError: unknown host.
    """

    def __init__(self, host: str, port: int, name: str) -> None:
        self.name, self.host = name, host
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self.socket.connect((host, port))
        except OSError as error:
            self.socket.close()
            raise DeviceError(f"the {name} at {host!r}: {error.strerror or error}. Is the address right?") from None

    def write(self, data: bytes) -> None:
        """Send one datagram. DeviceError: refused."""
        try:
            self.socket.send(data)
        except OSError as error:
            raise self._gone_error(error) from None

    def read(self, timeout: float) -> bytes:
        """One datagram; empty if none arrives within `timeout` [s]. DeviceError: refused."""
        self.socket.settimeout(max(timeout, 0.0))  # 0: do not wait; other timeouts are at least 1 ms
        try:
            return self.socket.recv(2048)
        except (TimeoutError, BlockingIOError):
            return b""
        except OSError as error:
            raise self._gone_error(error) from None

    def _gone_error(self, error: OSError) -> DeviceError:
        return DeviceError(
            f"the {self.name} at {self.host} is gone: {error.strerror or error}. Check its power and cable.",
            lost=True,
        )

    def close(self) -> None:
        self.socket.close()
