"""The launcher's wires to its workers: orders go out, reports come in, and who hears his orders is known."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import msgspec
import zmq

from palpate.launch.running.bus import endpoint


class Wires:
    """Sockets of the launcher of a run.

    control, reports  local addresses that workers connect to
    address           where workers on other machines find them as well: `tcp://host:port`, reports at port + 1

    OSError: that address cannot be bound.
    """

    def __init__(self, run: str, groups: Iterable[str], address: str | None) -> None:
        self.control, self.reports = (endpoint(run, "launcher", name) for name in ("control", "reports"))
        self._context = zmq.Context()
        self._orders, self._told = self._context.socket(zmq.XPUB), self._context.socket(zmq.PULL)
        self._orders.set(zmq.XPUB_VERBOSE, 1)
        for socket in (self._orders, self._told):
            socket.set(zmq.LINGER, 500)
        self._orders.bind(self.control)
        self._told.bind(self.reports)
        if address:
            host, _, port = address.removeprefix("tcp://").rpartition(":")
            try:
                self._orders.bind(f"tcp://{host}:{port}")
                self._told.bind(f"tcp://{host}:{int(port) + 1}")
            except zmq.ZMQError as error:
                self.close(0)
                raise OSError(f"cannot bind {address} (and the port after it): {error.strerror}") from None
        self._subscribed = dict.fromkeys(groups, 0)
        self._expected = dict.fromkeys(groups, 0)

    def register(self, poller: zmq.Poller) -> None:
        """Wake this poller when there is something to take."""
        poller.register(self._told, zmq.POLLIN)
        poller.register(self._orders, zmq.POLLIN)

    def tell(self, group: str, **what: object) -> None:
        """Send an order to the worker of a group; `*` is all of them."""
        self._orders.send(f"~{group}".encode() + b"\0" + msgspec.json.encode(what))

    def expect(self, group: str) -> None:
        """One more worker of this group is on its way."""
        self._expected[group] += 1

    def hears(self, group: str) -> bool:
        """Whether the worker of a group hears what it is told; what it is told before is lost."""
        return self._subscribed[group] >= self._expected[group]

    def new(self) -> Iterator[str]:
        """Groups whose workers have begun to hear since the last call."""
        while self._orders.poll(0):
            note = self._orders.recv()
            group = note[2:-1].decode(errors="replace")
            if note[:2] == b"\x01~" and group in self._subscribed:
                self._subscribed[group] += 1
                yield group

    def report(self, wait: int = 0) -> dict | None:
        """The next report; None where none comes within so many milliseconds."""
        return msgspec.msgpack.decode(self._told.recv()) if self._told.poll(wait) else None

    def close(self, linger: int) -> None:
        """Close; orders under way get so many milliseconds."""
        self._context.destroy(linger=linger)
