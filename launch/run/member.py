"""The launcher's state of a worker, with detection of hangs and of lost messages."""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from palpate.engine import clock
from palpate.engine.job import Job, members
from palpate.launch.run.work.activity import Activity, SilentTime, activity
from palpate.launch.run.work.compiling import LONGEST
from palpate.launch.run.work.watchdog import START_PATIENCE

ALIVE = ("starting", "ready", "linked", "running")
LONGEST_GAP = 1e-9 * clock.LONGEST_GAP  # [s] counted at most between two checks
QUIET = 0.3  # [s] of silence after which the process table is read
LOOK = 0.4  # [s] between two readings of the process table, which has a file for each thread
PULSELESS = 2.0  # [s] without a pulse after which it is unknown what a process on another machine does


class Asked(NamedTuple):
    """A silent worker was asked for its traceback.

    text   why it counts as hung
    lines  number of lines printed before
    since  when it was asked
    """

    text: str
    lines: int
    since: clock.Silence


@dataclass
class WorkerHandle:
    """The worker of a group.

    job        its job
    joined     started by hand on another machine
    state      starting, ready, linked, running; done, failed, killed, restarting; gone
    busy       the node that it builds, or whose call hangs
    kernels    number of kernels compiled so far
    compiling  it compiles a function, or waits for another process that does
    pid        process id; None: not started, or on another machine
    endpoints  addresses of its outlets, once it is ready
    secured    whether they are encrypted
    paused     the tick after which it waits for the number of the last tick
    flushed    its nodes have ended, and their messages are being delivered
    observes   its nodes have ended, and its observers still receive messages
    clean_exit its nodes have ended without failure, and all their messages were delivered
    awaits     stream and tick of the message that it waits for
    awaited    number of heartbeats since that message was sent; None: not known to be sent
    starter    id of the process that starts it, while `pid` is None
    look       returns what the process with an id does
    silent     time without a sign of life
    pulse      what its process on another machine did last
    taken      it was started by hand and has its job
    waited     [s] time of its last heartbeat without progress, when all nodes have ended
    exited     exit status of its process, whose last report may arrive later
    since      the end of its process
    asked      why it counts as hung, while the launcher waits for its traceback
    """

    job: Job
    joined: bool = False
    state: str = "starting"
    busy: str = ""
    kernels: int = 0
    compiling: bool = False
    pid: int | None = None
    endpoints: dict[str, list[str]] = field(default_factory=dict)
    secured: bool = False
    paused: int | None = None
    flushed: bool = False
    observes: bool = False
    clean_exit: bool = False
    awaits: tuple[str, int] | None = None
    awaited: int | None = None
    starter: int | None = None
    look: Callable[[int], Activity | None] = activity
    silent: SilentTime = field(default_factory=SilentTime)
    pulse: Activity | None = None
    taken: bool = False
    waited: float = -math.inf
    exited: int | None = None
    since: clock.Silence = field(default_factory=clock.Silence)
    asked: Asked | None = None
    _pulsed: bool = False  # whether the pulse is newer than the last reading
    _passed: float = 0.0  # [s] since the last reading, as far as it counts
    _checked: float = field(default_factory=clock.seconds)

    @property
    def alive(self) -> bool:
        return self.state in ALIVE

    @property
    def nodes(self) -> list[str]:
        """Names of its nodes and observers. A report about another one is not about this worker."""
        return [given.name for given in members(self.job)]

    @property
    def names(self) -> str:
        return ", ".join(self.nodes)

    def reset_silence(self) -> None:
        self.silent, self._passed, self._checked = SilentTime(), 0.0, clock.seconds()

    def waits(self, awaits: tuple[str, int] | None) -> None:
        """Note the message that it waits for, from a heartbeat."""
        if awaits != self.awaits:
            self.awaited = None
        elif self.awaited is not None:
            self.awaited += 1
        self.awaits = awaits

    def silence(self) -> float:
        """Time without a sign of life [s], see `SilentTime`; call this often.

        Each call counts at most `LONGEST_GAP`, so time in which the launcher was not scheduled does not count.
        """
        moment = clock.seconds()
        self._passed, self._checked = self._passed + min(moment - self._checked, LONGEST_GAP), moment
        if self.joined and self.silent.total > QUIET:
            if self._pulsed:
                self._count(self.pulse)
            elif self._passed > PULSELESS:
                self._count(None)
        elif self._passed > LOOK or self.silent.total <= QUIET:
            pid = self.pid if self.pid is not None else self.starter
            self._count(self.look(pid) if pid is not None and self.silent.total > QUIET else None)
        return self.silent.total

    def _count(self, found: Activity | None) -> None:
        """Count the time since the last reading; None: it is unknown what its process did."""
        self.silent.add(self._passed, found)
        self._passed, self._pulsed = 0.0, False

    def take_pulse(self, pulse: Activity) -> None:
        """Note what the process of a worker on another machine does."""
        self.pulse, self._pulsed = pulse, True

    def hang(self, patience: float) -> str:
        """Why it counts as hung, "" if it does not. `patience` [s]: longest silence while it runs or awaits an order.

        Before tick 0 its nodes may compute for long, so only the time in which it does nothing counts there.
        """
        self.silence()
        silent, starting = self.silent, self.state == "starting"
        if silent.stopped and silent.stopped + min(silent.idle, 2.0 * QUIET) > patience:
            return f"no sign of life for {patience:g} s: a signal has stopped its process"
        if self.state == "done":  # it waits for its observers
            return ""
        limit = START_PATIENCE if starting else patience
        longest = max(limit, LONGEST) if self.compiling or starting else limit
        idle = silent.total - silent.busy
        if idle > (longest if self.compiling else limit):
            limit = longest if self.compiling else limit
        elif silent.total > longest:
            limit = longest
        else:
            return ""
        return f"no sign of life for {limit:g} s: it hangs or was suspended"

    def reset_state(self) -> None:
        """Reset the state for a new process."""
        self.state, self.pid, self.paused, self.exited, self.asked = "starting", None, None, None, None
        self.flushed = self.observes = self.clean_exit = self.compiling = False
        self.reset_silence()


def find_loss(
    members: Iterable[WorkerHandle], health: Mapping[str, Mapping[str, Any]], signs: int
) -> tuple[WorkerHandle, str] | None:
    """The sender of a lost message and the text of the fault. Call it when all received reports were handled.

    A connection to another machine may break. If a later message of the stream arrives, its reader detects the gap
    (`Input.is_lost`). On the simulated clock none arrives, since all other nodes wait as well, so the launcher detects
    it: a message counts as lost if its reader still waits for it `signs` heartbeats after it was sent.

    health  counters of the nodes by name. The message has been sent if its sender has stepped beyond it, or has made
            the step and waits for a message; otherwise another reader may still block the sender

    Heartbeats are counted from the time at which the message is known to be sent: before, the reader may have waited
    for a slow sender.
    """
    members = list(members)
    sent = {stream: (member, node.name) for member in members for node in member.job.nodes for stream in node.streams}
    for member in members:
        if member.awaits is None:
            continue
        stream, tick = member.awaits
        sender, node = sent[stream]
        counters = health.get(node)
        if counters is None or counters["tick"] < tick + (sender.awaits is None):
            member.awaited = None
        elif member.awaited is None:
            member.awaited = 0
        elif member.awaited >= signs:
            return sender, f"its message of tick {tick} did not arrive at {member.names}: it was lost on the network"
    return None
