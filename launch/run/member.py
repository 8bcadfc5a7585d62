"""The launcher's state of a worker, with detection of hangs and of lost messages."""

import contextlib
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from palpate.engine import clock
from palpate.engine.job import Job, members

ALIVE = ("starting", "ready", "linked", "running")
LONGEST_GAP = 1e-9 * clock.LONGEST_GAP  # [s] counted at most between two checks
DISK_PATIENCE = 120.0  # [s] of waiting for a disk that do not count as silence
QUIET = 0.3  # [s] of silence after which the kernel is asked what a worker waits for


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
    _silence: float = 0.0
    _at_disk: float = 0.0
    _checked: float = field(default_factory=time.monotonic)

    @property
    def alive(self) -> bool:
        return self.state in ALIVE

    @property
    def names(self) -> str:
        return ", ".join(given.name for given in members(self.job))

    def reset_silence(self) -> None:
        self._silence = self._at_disk = 0.0
        self._checked = time.monotonic()

    def waits(self, awaits: tuple[str, int] | None) -> None:
        """Note the message that it waits for, from a heartbeat."""
        if awaits != self.awaits:
            self.awaited = None
        elif self.awaited is not None:
            self.awaited += 1
        self.awaits = awaits

    def silence(self) -> float:
        """Time without a sign of life [s]; call this often.

        Each call counts at most `LONGEST_GAP`, so time in which the launcher was not scheduled does not count. Nor do
        the first `DISK_PATIENCE` in which a disk blocks the worker: the kernel would not kill it, and its recording
        would be lost.
        """
        moment = time.monotonic()
        passed, self._checked = min(moment - self._checked, LONGEST_GAP), moment
        if self.pid is not None and self._silence > QUIET and at_the_disk(self.pid):
            self._at_disk += passed
        else:
            self._silence += passed
        return self._silence + max(0.0, self._at_disk - DISK_PATIENCE)

    def reset_state(self) -> None:
        """Reset the state for a new process."""
        self.state, self.pid, self.paused = "starting", None, None
        self.flushed = self.observes = self.clean_exit = self.compiling = False
        self.reset_silence()


def at_the_disk(pid: int) -> bool:
    """Whether a thread of a process is in an uninterruptible wait for a disk and no other thread runs. A separate
    thread writes the recording, and the others wait for it."""
    states = set()
    with contextlib.suppress(OSError):
        for task in Path(f"/proc/{pid}/task").iterdir():
            with contextlib.suppress(OSError, IndexError):
                states.add((task / "stat").read_text(errors="replace").rpartition(")")[2].split()[0])
    return "D" in states and "R" not in states


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
