"""The launcher's control channel to its workers, and the streams that workers read from one another.

The launcher sends orders and receives reports. Orders to a worker wait until it has subscribed.
"""

from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from typing import Protocol

import msgspec
import zmq

from palpate.engine.job import Job
from palpate.launch.run.reports import REPORTS, Addressed, Beat, Order
from palpate.launch.run.wire.addresses import LOOPBACK, RunFolder, endpoint, has_unix_sockets, is_tcp
from palpate.launch.run.wire.bus import END, HEALTH, frame
from palpate.launch.run.wire.keys import Authenticator, Key
from palpate.launch.run.wire.printable import one_line

LONGEST_REPORT = 1 << 26  # [bytes]


class Waker(Protocol):
    """What has sockets that wake the launcher: the fork server."""

    def register(self, poller: zmq.Poller) -> None:
        """Register them."""


class ControlSockets:
    """Sockets of the launcher of a run, and the folder of all Unix sockets of the run.

    address  TCP address for workers on other machines: `tcp://host:port`, reports at port + 1
    key      encrypts TCP; None: no encryption

    control, reports  addresses that workers on this machine connect to: Unix sockets, or without them TCP on loopback
    guarded           whether they are encrypted

    OSError: that address cannot be bound.
    """

    def __init__(self, run: str, address: str | None, key: Key | None) -> None:
        unix = has_unix_sockets()
        self._folder = RunFolder(run) if unix else None
        guard = key if address or not unix else None
        self.guarded = guard is not None
        self._context = zmq.Context()
        self._keeper = Authenticator(self._context, guard) if guard is not None else None
        self._orders, self._told = self._context.socket(zmq.XPUB), self._context.socket(zmq.PULL)
        self._orders.set(zmq.XPUB_VERBOSE, 1)
        self._orders.set(zmq.MAXMSGSIZE, 1024)  # subscriptions only
        self._told.set(zmq.MAXMSGSIZE, LONGEST_REPORT)
        self._poller = zmq.Poller()
        for socket in (self._orders, self._told):
            socket.set(zmq.LINGER, 500)
            if guard is not None:
                guard.secure(socket, server=True)
            self._poller.register(socket, zmq.POLLIN)
        ends = [endpoint(run, name) for name in ("control", "reports")] if unix else [f"tcp://{LOOPBACK}:*"] * 2
        self._orders.bind(ends[0])
        self._told.bind(ends[1])
        self.control, self.reports = (
            each.get_string(zmq.LAST_ENDPOINT).rstrip("\0") for each in (self._orders, self._told)
        )
        if address:
            host, _, port = address.removeprefix("tcp://").rpartition(":")
            try:
                self._orders.bind(f"tcp://{host}:{port}")
                self._told.bind(f"tcp://{host}:{int(port) + 1}")
            except zmq.ZMQError as error:
                self.close(0)
                raise OSError(f"cannot bind {address} (and the port after it): {error.strerror}") from None

    def wake_by(self, forkserver: Waker) -> None:
        """`wait` also returns when the fork server answers."""
        forkserver.register(self._poller)

    def wait(self, wait: int) -> None:
        """Wait up to `wait` [ms] for reports, subscriptions and answers of the fork server."""
        self._poller.poll(wait)

    def send(self, data: bytes) -> None:
        """Send an order to its subscribers."""
        self._orders.send(data)

    def subscription(self) -> bytes | None:
        """The next subscription (first byte 1) or cancellation (0); None: none has arrived."""
        return self._orders.recv() if self._orders.poll(0) else None

    def has_report(self, wait: int = 0) -> bool:
        """Whether a report is waiting, or arrives within `wait` [ms]."""
        return bool(self._told.poll(wait))

    def report(self) -> bytes:
        """The next report."""
        return self._told.recv()

    def close(self, linger: int) -> None:
        """Close; buffered orders have `linger` [ms] to be delivered."""
        if self._keeper is not None:
            self._keeper.close()
        self._context.destroy(linger=linger)
        if self._folder is not None:
            self._folder.close()


class ControlChannel:
    """Orders of the launcher to its workers, and their reports.

    The orders to a worker are numbered, and sent again whenever it subscribes: at its start, and when its connection to
    another machine was broken. The worker takes each once, in their order (`Bus.order`); so does this side the reports
    with a number.

    received  number of the last numbered report of each group
    foreign   dropped frames that are not reports of this run's workers
    """

    def __init__(self, sockets: ControlSockets, jobs: Mapping[str, Job]) -> None:
        self.sockets = sockets
        self.foreign = 0
        self.received = dict.fromkeys(jobs, 0)
        self._sent: dict[str, list[bytes]] = {group: [] for group in jobs}

    def send_order(self, group: str, order: Order) -> None:
        """Send an order to the worker of a group; `*`: to all."""
        for name in self._sent if group == "*" else (group,):
            number = 0  # of an order that is not sent again
            if name in self._sent and not isinstance(order, Beat):
                number = len(self._sent[name]) + 1
            data = frame(f"~{name}", b"%d %b" % (number, msgspec.json.encode(order)))
            if number:
                self._sent[name].append(data)
            self.sockets.send(data)

    def expect(self, group: str) -> None:
        """A worker of this group starts; orders to its predecessor are void."""
        self._sent[group].clear()
        self.received[group] = 0

    def deliver(self) -> None:
        """Send all their orders to the workers that have subscribed since the last call."""
        while (note := self.sockets.subscription()) is not None:
            group = note[2:-1].decode(errors="replace")
            if note[:2] == b"\x01~" and group in self._sent:
                for data in self._sent[group]:
                    self.sockets.send(data)
            elif note[:1] not in (b"\x00", b"\x01"):
                self.foreign += 1

    def report(self) -> Addressed | None:
        """The next report; None if it is not from a worker of this run, or has arrived before."""
        try:
            addressed = REPORTS.decode(self.sockets.report())
        except (msgspec.MsgspecError, ValueError):
            addressed = None
        if addressed is None or addressed.group not in self._sent:
            self.foreign += 1
            return None
        if addressed.number not in (0, self.received[addressed.group] + 1):
            return None
        self.received[addressed.group] = max(self.received[addressed.group], addressed.number)
        return addressed


OUTLETS = {"force": "force", "observers": "members"}  # names of the local sockets by outlet


def wrong_endpoint(run: str, group: str, joined: bool, endpoints: Mapping[str, Collection[str]]) -> str:
    """What is wrong with the addresses that a worker reports; empty: nothing.

    Other workers connect to them. The report may come from another machine, so accepted are the local sockets that
    belong to the group, if it runs here, and `tcp://host:port`. A group without one of the two outlets is wrong.
    """
    for outlet, name in OUTLETS.items():
        if not endpoints.get(outlet):
            return f"it reports no address of its outlet {outlet!r}"
        local = "" if joined or not has_unix_sockets() else endpoint(run, group, name)
        for address in endpoints[outlet]:
            if address != local and not is_tcp(address):
                return (
                    f"it reports the address {one_line(address)!r}, expected {local and f'{local} or '}tcp://host:port"
                )
    return ""


def read_streams(job: Job, others: Mapping[str, Job]) -> Iterator[tuple[str, str, list[str]]]:
    """The streams that a worker reads from each of the others: group, outlet and streams."""
    reads = {given.stream for node in job.nodes for given in node.inputs}
    observes = {stream for observer in job.observers for stream in observer.streams}
    for other, theirs in others.items():
        sent = {stream for node in theirs.nodes for stream in node.streams}
        for outlet, wanted in (("force", reads), ("observers", observes)):
            streams = sorted(sent & wanted)
            if outlet == "observers" and job.observers and sent:
                streams += [HEALTH, END]
            if streams:
                yield other, outlet, streams


def listeners(job: Job, others: Mapping[str, Job]) -> dict[str, int]:
    """Number of other workers that observe each stream of a worker."""
    observed = Counter(
        stream
        for theirs in others.values()
        for stream in {stream for observer in theirs.observers for stream in observer.streams}
    )
    counts = {stream: observed[stream] for node in job.nodes for stream in node.streams if observed[stream]}
    if any(node.streams for node in job.nodes):
        counts[HEALTH] = counts[END] = sum(bool(theirs.observers) for theirs in others.values())
    return counts


def blocked_by(jobs: Collection[Job], dead: set[str]) -> set[str]:
    """Nodes that cannot run without the dead ones, directly or through others."""
    blocked: set[str] = set()
    while True:
        gone = dead | blocked
        more = {
            node.name
            for job in jobs
            for node in job.nodes
            if node.name not in gone and any(g.producer in gone and not g.optional for g in node.inputs)
        }
        if not more:
            return blocked
        blocked |= more
