"""Connections between simulated workers: what one reads from another.

Takes the place of libzmq, Unix sockets and TCP. Messages to nodes are in the kernel when they are sent; frames for
observers leave their process a little later. A connection to another machine may break: frames in transit are lost, the
writer has one reader less, and the reader connects again later.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from typing import Protocol

from palpate.engine.clock import POLL_INTERVAL
from palpate.studies.faults.launcher.process import Process
from palpate.studies.faults.launcher.world import MS, World


class Wired(Protocol):
    """The sockets of a worker.

    open              whether its process runs
    readers           connections of its readers
    changed           whether these have changed
    overheard_frames  frames for its observers
    """

    world: World
    process: Process
    net: Net
    group: str
    open: bool
    readers: list[Reading]
    changed: bool
    overheard_frames: deque[bytes]

    def inlet(self, stream: str) -> Stream:
        """The inlet of a stream."""
        ...

    def wake_writers(self) -> None:
        """Frames were taken, so there is room."""


class Stream:
    """An inlet: one stream of another group, see `Inlet`."""

    def __init__(self, bus: Wired, stream: str) -> None:
        self._bus, self.stream = bus, stream
        self.queue: deque[bytes] = deque()
        self.linked = True  # unless it is connected to a group

    def wait(self) -> list[bytes]:
        return self.wait_until(self._bus.process.clock(self._bus.world.time) + POLL_INTERVAL * MS)

    def wait_until(self, deadline: int) -> list[bytes]:
        self._bus.world.wait(self._bus.process.time_at(deadline), lambda: bool(self.queue))
        return self.take()

    def take(self) -> list[bytes]:
        taken = list(self.queue)
        self.queue.clear()
        if taken:
            self._bus.wake_writers()
        return taken


class Reading:
    """A connection from a writer to a reader of some of its streams."""

    def __init__(self, reader: Wired, group: str, streams: Iterable[str], observed: bool) -> None:
        self.reader, self.group, self.streams, self.observed = reader, group, set(streams), observed
        self.writer: Wired | None = None
        self.waiting = 0  # messages in transit
        self._turn = 0  # number of the connection, of which these are
        self._broken = -1  # number of the last one that has broken: its frames do not arrive
        self._random = reader.world.random_of(f"reading {group} {reader.process.name} {observed}")
        self._last = 0

    def seek(self) -> None:
        """Connect to the group's worker, once it listens."""
        world = self.reader.world
        self._last = max(self._last, world.time + world.delay(self._random))
        world.at(self._last, self._connect)

    def _connect(self) -> None:
        writer = self.reader.net.listening.get(self.group)
        if self.writer is None and writer is not None and self.reader.open and writer.open:
            self.writer = writer
            writer.readers.append(self)
            writer.changed = True
            self._link(True)
            writer.world.poke(writer.process)

    def _link(self, linked: bool) -> None:
        for stream in () if self.observed else self.streams:
            self.reader.inlet(stream).linked = linked

    def leave(self) -> None:
        """The reader closes the connection."""
        writer, self.writer = self.writer, None
        if writer is not None:

            def left() -> None:
                if self in writer.readers:
                    writer.readers.remove(self)
                    writer.changed = True
                    writer.world.poke(writer.process)

            writer.world.after(writer.world.delay(self._random), left)

    def lose(self) -> None:
        """The writer has ended; what it sent arrives."""
        self.writer, self.waiting, self._turn = None, 0, self._turn + 1
        if self.reader.open:
            self._link(False)
            self.seek()

    def break_(self, duration: int) -> None:
        """Break the connection for a time [ns]; then it connects again."""
        writer, self.writer = self.writer, None
        if writer is None:
            return
        self.waiting, self._turn, self._broken = 0, self._turn + 1, self._turn
        writer.readers.remove(self)
        writer.changed = True
        writer.world.poke(writer.process)
        writer.world.after(duration, self.seek)

    def full(self, most: int) -> bool:
        """Whether the reader has no room."""
        if self.observed:
            return self.waiting + len(self.reader.overheard_frames) >= most
        return self.waiting + max(len(self.reader.inlet(stream).queue) for stream in self.streams) >= most

    def put(self, stream: str, data: bytes) -> None:
        """Send a frame, or a payload to a node."""
        world, reader = self.reader.world, self.reader
        self._last = max(self._last, world.time + world.delay(self._random))
        self.waiting += 1
        sender, left = self.writer.process if self.writer else None, (world.time + self._last) // 2

        turn = self._turn

        def arrive() -> None:
            if turn <= self._broken:
                return
            # frames for observers leave the process later, as reports do
            if self.observed and sender is not None and sender.stopped_before(left):
                sender.held.append(arrive)
                return
            self.waiting -= turn == self._turn
            kept = self.observed and sender is not None and sender.ended is not None and sender.ended < left
            if reader.open and not kept:
                (reader.overheard_frames if self.observed else reader.inlet(stream).queue).append(data)
                world.poke(reader.process)

        world.at(self._last, arrive)


class Net:
    """What listens: the worker of each group."""

    def __init__(self) -> None:
        self.listening: dict[str, Wired] = {}
        self.readings: list[Reading] = []
