"""One worker as the launcher sees it, whether it hangs, and whether it waits for what was lost on its way."""

import contextlib
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from palpate.engine import clock
from palpate.engine.job import Job, members
from palpate.launch.run.reports import Ready

ALIVE = ("starting", "ready", "linked", "running")
GLANCE = 1e-9 * clock.GLANCE  # [s]: what kept the launcher from looking is no silence
DISK_PATIENCE = 120.0  # [s] for which waiting for a disk is no silence
QUIET = 0.3  # [s] of silence from which on the kernel is asked what a worker waits for


@dataclass
class WorkerHandle:
    """A group of a run.

    job        what its worker runs
    joined     started by hand on another machine
    state      starting, ready, linked, running; done, failed, killed, restarting; gone
    busy       the node that it starts;  kernels  that it has compiled so far
    pid        of its process, once there is one here
    endpoints  of its outlets, once it is ready; secured: by the key of the run
    early      a report that it is ready, which has overtaken its subscription
    paused     the tick after which it waits to hear which one is the last
    flushed    its nodes have ended, and others get what they sent
    clean_exit they have ended as they were told, and all that they sent was delivered
    foreign    frames that it has dropped
    awaits     stream and tick of the message that it waits for; awaited: in so many signs of life since it was sent,
               None: it was not sent yet, as far as is known
    """

    job: Job
    joined: bool = False
    state: str = "starting"
    busy: str = ""
    kernels: int = 0
    pid: int | None = None
    endpoints: dict[str, list[str]] = field(default_factory=dict)
    secured: bool = False
    early: Ready | None = None
    paused: int | None = None
    flushed: bool = False
    clean_exit: bool = False
    foreign: int = 0
    awaits: tuple[str, int] | None = None
    awaited: int | None = None
    _silence: float = 0.0
    _at_disk: float = 0.0
    _looked: float = field(default_factory=time.monotonic)

    @property
    def alive(self) -> bool:
        """Whether its worker works."""
        return self.state in ALIVE

    @property
    def names(self) -> str:
        """Its nodes and observers, for people."""
        return ", ".join(given.name for given in members(self.job))

    def heard(self) -> None:
        """It has given a sign of life."""
        self._silence = self._at_disk = 0.0
        self._looked = time.monotonic()

    def waits(self, awaits: tuple[str, int] | None) -> None:
        """It tells what it waits for."""
        if awaits != self.awaits:
            self.awaited = None
        elif self.awaited is not None:
            self.awaited += 1
        self.awaits = awaits

    def silence(self) -> float:
        """[s] without a sign of life; call this often.

        Each call counts at most `GLANCE`, so time in which the launcher itself was not scheduled does not count. Nor do
        the first two minutes in which the worker is blocked by a disk: it cannot be killed there, and its recording
        would be lost.
        """
        moment = time.monotonic()
        passed, self._looked = min(moment - self._looked, GLANCE), moment
        if self.pid is not None and self._silence > QUIET and at_the_disk(self.pid):
            self._at_disk += passed
        else:
            self._silence += passed
        return self._silence + max(0.0, self._at_disk - DISK_PATIENCE)

    def forked(self) -> None:
        """A new worker is on its way."""
        self.state, self.early, self.pid, self.paused = "starting", None, None, None
        self.flushed = self.clean_exit = False
        self.heard()


def at_the_disk(pid: int) -> bool:
    """Whether no thread of a process can run and one is in an uninterruptible wait for a disk: a separate thread writes
    the recording, and the others wait for it."""
    states = set()
    with contextlib.suppress(OSError):
        for task in Path(f"/proc/{pid}/task").iterdir():
            with contextlib.suppress(OSError, IndexError):
                states.add((task / "stat").read_text(errors="replace").rpartition(")")[2].split()[0])
    return "D" in states and "R" not in states


def lost(
    members: Iterable[WorkerHandle], health: Mapping[str, Mapping[str, Any]], signs: int
) -> tuple[WorkerHandle, str] | None:
    """The sender of a message that somebody still waits for so many signs of life after it was sent, and what is to be
    told. Call it whenever all reports that have come were taken.

    A way to another machine may break. Where a later message of the stream comes its reader sees what is missing
    (`Input.lost`); on the simulated clock none comes, as all others wait as well, and only the launcher can see it.

    health  counters of the nodes by name. A sender that has stepped but is held back by another reader may not have
            sent yet: it counts where it waits for a message itself, or has stepped once more

    A reader's signs are counted from when the sender is known to be beyond the message: before, the reader may have
    waited for long, for a sender that had much to compute.
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
            return sender, f"its message of tick {tick} has not come to {member.names}: it was lost on its way"
    return None
