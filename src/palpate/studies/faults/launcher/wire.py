"""The sockets of a simulated worker, with the methods of `Bus`."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable

from palpate.engine.clock import POLL_INTERVAL
from palpate.engine.job import Job
from palpate.launch.run.reports import ORDERS, Beat, NodesEnded, Order, Report
from palpate.launch.run.wire.addresses import endpoint
from palpate.launch.run.wire.bus import AGAIN_TIME, END, LINK_TIME, Exchange, frame, split
from palpate.studies.faults.launcher.control import Line, Sockets
from palpate.studies.faults.launcher.process import Process
from palpate.studies.faults.launcher.readings import Net, Reading, Stream
from palpate.studies.faults.launcher.world import MS, SECOND

ROOM = 8  # messages that a reader buffers, few so that full buffers are frequent
QUEUED = 100  # frames for an observer on the real clock


class Sender:
    """Sends a stream to the nodes of other groups."""

    def __init__(self, bus: Wire, stream: str, holds: Callable[[], None]) -> None:
        self._bus, self._stream, self._holds = bus, stream, holds

    def send(self, payload: bytes) -> None:
        bus = self._bus
        bus.world.check()
        for reading in tuple(bus.readers):
            if reading.observed or self._stream not in reading.streams:
                continue
            while not bus.real and reading in bus.readers and reading.full(ROOM):
                bus.wait_for_room(reading)
                self._holds()
            if reading in bus.readers and not reading.full(ROOM):
                reading.put(self._stream, payload)


class Wire:
    """The sockets of a worker, see `Bus`."""

    local = False
    key = None

    def __init__(self, net: Net, sockets: Sockets, process: Process, run: str, job: Job, alone: bool) -> None:
        self.net, self.process, self.world, self.job, self._alone = net, process, sockets.world, job, alone
        self.run, self.group, self.real, self.open = run, job.group, job.clock == "real", True
        self._orders: deque[bytes] = deque()
        self._ordered = True
        self._exchange = Exchange(job.group, repeats=alone)
        self.line = Line(sockets, process, job.group, self._take_order)
        self._sockets = sockets
        self._inlets: dict[str, Stream] = {}
        self.overheard_frames: deque[bytes] = deque()
        self.readers: list[Reading] = []
        self.changed = False
        self.ended: set[str] = set()
        self._kept: list[bytes] = []
        self.final: list[bytes] = []
        process.on_end.append(self._lose)

    # -- with the launcher -----------------------------------------------------------------------------------------

    def _take_order(self, data: bytes) -> None:
        self._orders.append(data)
        order = ORDERS.decode(split(data)[1].partition(b" ")[2])
        self.world.note(f"{self.process.name} receives {str(order)[:80]}")
        self._sockets.watch_orders(self.process.name, order)

    def report(self, report: Report) -> None:
        self.world.check()
        self._sockets.watch(self.process.name, report)
        self.line.report(self._exchange.write(report))

    def order(self, wait: int = 0) -> Order | None:
        self.world.check()
        if wait and not self._orders:
            self.world.wait(self.world.time + wait * MS, lambda: bool(self._orders))
            self._ordered = True
        while self._orders and self._ordered:
            order = self._exchange.take(self._orders.popleft())
            if isinstance(order, Beat):
                for data in self._exchange.lost(order.received):
                    self.line.report(data)
            if order is not None:
                return order
        self._ordered = False
        return None

    def sweep(self, wait: int = 0) -> list[Stream]:
        self.world.check()
        self._ordered = self._ordered or bool(self._orders)
        return [inlet for inlet in self._inlets.values() if inlet.queue]

    # -- streams of other groups -----------------------------------------------------------------------------------

    def bind(self, host: str | None) -> dict[str, list[str]]:
        self.world.check()
        endpoints: dict[str, list[str]] = {"force": [], "observers": []}
        if not self._alone:
            endpoints = {
                "force": [endpoint(self.run, self.group, "force")],
                "observers": [endpoint(self.run, self.group, "members")],
            }
        if host:
            for outlet, addresses in endpoints.items():
                addresses.append(f"tcp://{host}:{40000 + self.process.pid}" if outlet else "")
        self.net.listening[self.group] = self
        for reading in self.net.readings:
            if reading.group == self.group and reading.writer is None and reading.reader.open:
                reading.seek()
        return endpoints

    def inlet(self, stream: str) -> Stream:
        if stream not in self._inlets:
            self._inlets[stream] = Stream(self, stream)
        return self._inlets[stream]

    def connect(self, address: str, streams: Iterable[str], observed: bool, secured: bool, group: str) -> None:
        self.world.check()
        reading = Reading(self, group, streams, observed)
        if not observed:
            for stream in reading.streams:
                self.inlet(stream).linked = address.startswith("tcp:")
        self.net.readings.append(reading)
        reading.seek()

    def _mine(self) -> list[Reading]:
        return [reading for reading in self.net.readings if reading.reader is self]

    def end_group(self, group: str) -> None:
        for reading in self._mine():
            if reading.observed and reading.group == group:
                self.net.readings.remove(reading)
                reading.leave()

    def overheard(self, wait: bool) -> bytes | None:
        self.world.check()
        if wait and not self.overheard_frames:
            self.world.wait(self.world.time + POLL_INTERVAL * MS, lambda: bool(self.overheard_frames))
        if not self.overheard_frames:
            return None
        data = self.overheard_frames.popleft()
        self.wake_writers()
        return data

    # -- streams of this group -------------------------------------------------------------------------------------

    def sends(self, streams: Iterable[str]) -> None:
        """Streams that observers can subscribe to."""

    def sender(self, stream: str, holds: Callable[[], None]) -> Sender:
        return Sender(self, stream, holds)

    def wait_linked(self, observers: dict[str, int], poll: Callable[[], object], awaited: bool = True) -> None:
        external = self.job.external if awaited else {}
        until, again = self.world.time + LINK_TIME, self.world.time + AGAIN_TIME
        while (
            (
                any(self._count(stream) < count for stream, count in observers.items())
                and (awaited or self.world.time < again)
            )
            or any(
                len({r.reader.group for r in self.readers if not r.observed and stream in r.streams}) < len(groups)
                for stream, groups in external.items()
            )
            or (not all(i.linked for i in self._inlets.values()) and not (self.real and self.world.time > until))
        ):
            self.changed = False
            self.world.wait(self.world.time + POLL_INTERVAL * MS, lambda: self.changed)
            for inlet in self.sweep():
                inlet.take()
            poll()

    def _count(self, stream: str) -> int:
        return sum(reading.observed and stream in reading.streams for reading in self.readers)

    def has_reader(self, stream: str) -> bool:
        return self._count(stream) > 0

    def update_listeners(self) -> bool:
        changed, self.changed = self.changed, False
        return changed

    def keep(self, data: bytes) -> None:
        self._kept.append(data)

    def flush(self, holds: Callable[[], None] = lambda: None, rest: bool = True) -> None:
        """As of a bus; without `rest`, a frame goes at once, which is within the time for which it may wait."""
        self.world.check()
        kept, self._kept = self._kept, []
        for data in kept:
            stream = split(data)[0]
            for reading in tuple(self.readers):
                if not reading.observed or stream not in reading.streams:
                    continue
                while not self.real and reading in self.readers and reading.full(ROOM):
                    self.wait_for_room(reading)
                    holds()
                if reading in self.readers and not (self.real and reading.full(QUEUED)):
                    reading.put(stream, data)

    def wait_for_room(self, reading: Reading) -> None:
        """Wait for about `POLL_INTERVAL` until a reader has room, or has left."""
        until = self.world.time + POLL_INTERVAL * MS
        self.world.wait(until, lambda: not (reading in self.readers and reading.full(ROOM)))

    def wake_writers(self) -> None:
        """Frames were taken, so there is room."""
        for reading in self.net.readings:
            if reading.reader is self and reading.writer is not None:
                self.world.poke(reading.writer.process)

    def _send_end(self) -> None:
        for reading in self.readers:
            if reading.observed and not reading.full(ROOM):
                reading.put(END, frame(END, self.group.encode()))

    def offer_end(self) -> None:
        self.world.check()
        self._send_end()

    def end(self, clean_exit: bool) -> None:
        self.report(NodesEnded(clean_exit))

    def close(self, clean_exit: bool, orphaned: Callable[[], bool] = lambda: False) -> None:
        for reading in self._mine():
            self.net.readings.remove(reading)
            reading.leave()

        def holds() -> None:
            if orphaned():
                self.readers.clear()

        self.flush(holds)
        if clean_exit:
            while self._count(END) and not orphaned():
                self._send_end()
                self.changed = False
                self.world.wait(self.world.time + POLL_INTERVAL * MS, lambda: self.changed)
        while any(reading.observed and reading.waiting for reading in self.readers):
            self.world.wait(self.world.time + POLL_INTERVAL * MS)
        until = self.world.time + 2 * SECOND
        while not self.line.sent and self.world.time < until:
            self.world.wait(self.world.time + MS)

    def _lose(self) -> None:
        """The process has ended: the system closes its sockets."""
        self.open = False
        for reading in self._mine():
            self.net.readings.remove(reading)
            reading.leave()
        if self.net.listening.get(self.group) is self:
            del self.net.listening[self.group]
        for reading in self.readers:
            self.world.after(self.world.delay(self.process.random), reading.lose)
        self.readers.clear()
