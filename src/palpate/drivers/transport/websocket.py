"""Text messages over a WebSocket."""

from palpate.drivers.errors import DeviceError, package


class WebSocket:
    """A connection to a service.

    address  ws://host:port
    name     of the service, for errors
    """

    def __init__(self, address: str, name: str) -> None:
        client = package("websockets.sync.client")
        self.errors = package("websockets.exceptions")
        self.name, self.address = name, address
        try:
            self.context = client.connect(address, open_timeout=2.0, close_timeout=0.5, compression=None, proxy=None)
            self.link = self.context.__enter__()
        except (OSError, TimeoutError, self.errors.InvalidHandshake, self.errors.InvalidURI) as error:
            raise DeviceError(f"no {name} at {address}: {error}. Start it; `port` takes another address.") from None

    def _gone_error(self) -> DeviceError:
        return DeviceError(f"the {self.name} at {self.address} is gone. Start it again.", lost=True)

    def write(self, text: str) -> None:
        """Send a message. DeviceError: the connection is lost."""
        try:
            self.link.send(text)
        except (self.errors.ConnectionClosed, OSError):
            raise self._gone_error() from None

    def read(self, timeout: float) -> str:
        """One message; empty if none arrives within `timeout` [s]. DeviceError: the connection is lost."""
        try:
            message = self.link.recv(timeout=timeout)
        except TimeoutError:
            return ""
        except (self.errors.ConnectionClosed, OSError):
            raise self._gone_error() from None
        return message if isinstance(message, str) else message.decode(errors="replace")

    def close(self) -> None:
        self.context.__exit__(None, None, None)
