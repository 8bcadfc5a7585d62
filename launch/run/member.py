"""One worker as the launcher sees it, whether it hangs, and whether it waits for what was lost on its way."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

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
    pid        of its process, once there is one here; keeper: of the one above it
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
    keeper: int | None = None
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
    _threads: dict[str, Thread] = field(default_factory=dict)

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
        """[s] that it has been silent although it could have spoken; call this often.

        Not counted is what the launcher was kept from looking, the time for which the worker was ready to run and got
        no processor, and two minutes at the disk: a busy machine is no hang. A worker that waits for input gives signs
        of life; one that is silent computes without end, or is blocked or stopped.
        """
        moment = time.monotonic()
        passed, self._looked = min(moment - self._looked, GLANCE), moment
        if self.pid is not None and self._silence > QUIET:
            before, self._threads = self._threads, threads(self.pid)
            if at_the_disk(self._threads):
                self._at_disk += passed
                passed = 0.0
            else:
                passed = min(passed, able(passed, before, self._threads))
        self._silence += max(0.0, passed)
        return self._silence + max(0.0, self._at_disk - DISK_PATIENCE)

    def forked(self) -> None:
        """A new worker is on its way."""
        self.state, self.early, self.pid, self.paused = "starting", None, None, None
        self.flushed = self.clean_exit = False
        self.heard()


class Thread(NamedTuple):
    """What the kernel tells of a thread: its state, and for how long [s] it has run, and has waited for a processor."""

    state: str
    ran: float
    queued: float


def threads(pid: int) -> dict[str, Thread]:
    """The threads of a process by number; empty where the kernel does not tell."""
    states = {}
    with contextlib.suppress(OSError):
        for task in Path(f"/proc/{pid}/task").iterdir():
            with contextlib.suppress(OSError, IndexError, ValueError):
                state = (task / "stat").read_text(errors="replace").rpartition(")")[2].split()[0]
                ran, queued, _ = (task / "schedstat").read_text().split()
                states[task.name] = Thread(state, int(ran) * 1e-9, int(queued) * 1e-9)
    return states


def at_the_disk(threads: dict[str, Thread]) -> bool:
    """Whether none can go on and one waits in the system for a disk or another device, where no signal reaches it: a
    recording is written by a thread of its own, for which the others wait."""
    states = {thread.state for thread in threads.values()}
    return "D" in states and "R" not in states


def able(passed: float, before: dict[str, Thread], now: dict[str, Thread]) -> float:
    """[s] of the `passed` ones for which a process could have gone on, from what its threads were and are.

    While a thread is ready to run the processor time that it gets counts; where all are blocked or stopped, all that
    they did not spend waiting for a processor before.
    """
    pairs = [(before[name], now[name]) for name in now.keys() & before.keys()]
    ready = [new.ran - old.ran for old, new in pairs if new.state == "R"]
    if ready:
        return max(ready)
    return passed - max((new.queued - old.queued for old, new in pairs), default=0.0)


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
