"""The launcher's connections to simulated processes: orders and reports.

Takes the place of the sockets of `launch/run/wire/wires.py`. Frames of a connection arrive in order, each after a
delay. A report has left its process a little after it was sent: a process that is killed before loses it. A connection
within a machine loses nothing else. One to another machine may break: then frames in transit are lost, orders find no
subscriber, and it connects again later.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

from palpate.launch.run.reports import Order, Report
from palpate.studies.faults.launcher.process import Process
from palpate.studies.faults.launcher.world import MS, World

RECONNECT = 100 * MS  # [ns] from the end of an outage to the new connection, at most


class Line:
    """The connection of a process to the launcher, for both directions.

    up       whether it is connected
    subject  topic to which the process has subscribed
    """

    def __init__(self, sockets: Sockets, process: Process, subject: str, take: Callable[[bytes], None]) -> None:
        self.sockets, self.process, self.world = sockets, process, sockets.world
        self.topic, self.take, self.up = f"~{subject}".encode() + b"\0", take, True
        self._random = self.world.random_of(f"line {process.name}")
        self._kept: deque[bytes] = deque()  # reports that have not left the process
        self._flushed = self._arrived = self._ordered = 0  # times of the last ones [ns]
        self._transit = 0  # number of the connection: frames of an earlier one are lost
        self.closed = False
        process.on_end.append(self._end)
        process.on_continue.append(self._flush_later)
        self._subscribe()

    def _subscribe(self) -> None:
        self._deliver(lambda: self.sockets.subscribe(self, True))

    def _deliver(self, call: Callable[[], None]) -> None:
        """Something for the launcher, in order."""
        self._arrived = max(self._arrived, self.world.time + self.world.delay(self._random))
        transit = self._transit

        def arrive() -> None:
            if transit == self._transit:
                call()

        self.world.at(self._arrived, arrive)

    def report(self, data: bytes) -> None:
        """Send a report from the process."""
        self._kept.append(data)
        self._flush_later()

    def _flush_later(self) -> None:
        self._flushed = max(self._flushed, self.world.time + self.world.delay(self._random) // 2)
        self.world.at(self._flushed, self._flush)

    def _flush(self) -> None:
        """What was reported leaves the process, unless it has been killed."""
        while self._kept and self.up and not self.closed and not self.process.stopped and self.process.alive:
            data = self._kept.popleft()
            self._deliver(lambda data=data: self.sockets.arrive(self.process, data))  # type: ignore[misc]

    @property
    def sent(self) -> bool:
        """Whether all reports have left."""
        return not self._kept

    def order(self, data: bytes) -> None:
        """Send an order to the process."""
        self._ordered = max(self._ordered, self.world.time + self.world.delay(self._random))
        transit = self._transit

        def arrive() -> None:
            if transit == self._transit and self.process.alive and not self.closed:
                self.take(data)
                self.world.poke(self.process)

        self.world.at(self._ordered, arrive)

    def break_(self, duration: int) -> None:
        """Break the connection for a time [ns]; then it connects again."""
        if not self.up or self.closed:
            return
        self.up = False
        self._transit += 1
        self.world.note(f"the connection of {self.process.name} breaks")
        self.sockets.subscribe(self, False)
        self.world.after(duration + self._random.randint(0, RECONNECT), self._connect)

    def _connect(self) -> None:
        if not self.closed:
            self.up = True
            self.world.note(f"{self.process.name} is connected again")
            self._subscribe()
            self._flush_later()

    def _end(self) -> None:
        self.close()

    def close(self) -> None:
        """Cancel the subscription; reports that have left are delivered."""
        if not self.closed:
            self.closed = True
            if self.up:
                self._deliver(lambda: self.sockets.subscribe(self, False))


class Sockets:
    """The launcher's sockets, see `ControlSockets`. `process`: the launcher."""

    control = reports = "simulated"
    guarded = False

    def __init__(self, world: World, process: Process) -> None:
        self.world, self._process = world, process
        self._lines: list[Line] = []
        self._notes: deque[bytes] = deque()
        self._reports: deque[bytes] = deque()
        self.answers: deque[Any] = deque()  # of the fork server
        self.closed = False  # whether the fork server has ended
        self.watch: Callable[[str, Report], None] = lambda name, report: None
        self.watch_orders: Callable[[str, Order], None] = lambda name, order: None

    def wake_by(self, forkserver: Any) -> None:
        """Answers are in `answers`."""

    def _woken(self) -> bool:
        return bool(self._notes or self._reports or self.answers or self.closed)

    def wait(self, wait: int) -> None:
        self.world.wait(self.world.time + wait * MS, self._woken)

    def send(self, data: bytes) -> None:
        topic = data[: data.index(b"\0") + 1]
        for line in self._lines:
            if line.topic == topic:
                line.order(data)

    def subscription(self) -> bytes | None:
        self.world.check()
        return self._notes.popleft() if self._notes else None

    def has_report(self, wait: int = 0) -> bool:
        if wait and not self._reports:
            self.world.wait(self.world.time + wait * MS, lambda: bool(self._reports))
        return bool(self._reports)

    def report(self) -> bytes:
        self.world.check()
        return self._reports.popleft()

    def close(self, linger: int) -> None:
        """Orders that were sent are delivered."""

    def subscribe(self, line: Line, wanted: bool) -> None:
        """A subscription, or its cancellation, has arrived."""
        if wanted:
            self._lines.append(line)
        elif line in self._lines:
            self._lines.remove(line)
        else:
            return
        self._notes.append((b"\1" if wanted else b"\0") + line.topic)
        self.world.poke(self._process)

    def arrive(self, process: Process, data: bytes) -> None:
        """A report has arrived."""
        self._reports.append(data)
        self.world.poke(self._process)
