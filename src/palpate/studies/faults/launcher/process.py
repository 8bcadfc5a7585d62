"""A process of the simulation."""

from __future__ import annotations

import math
import random
import threading
from collections.abc import Callable
from typing import Protocol

from palpate.launch.run.work.activity import COMPUTES, ENDED, STOPPED, WAITS, Activity


class Time(Protocol):
    """What a process needs of its world.

    time  [ns]
    """

    time: int

    def new_pid(self) -> int:
        """A process id."""
        ...

    def random_of(self, name: str) -> random.Random:
        """Random numbers of one process."""
        ...


class Process:
    """A process of the simulation.

    main     its program
    status   exit code, as in `os.waitstatus_to_exitcode`; None while it runs
    error    exception that its program raised
    ended    time of its end [ns]
    stopped  by a signal
    call     name of the node whose step runs, for a signal that asks for it
    begun    time at which it began to compute [ns]; None: it waits
    ahead    what the clock of its machine is ahead of that of the simulation [ns]
    fast     and by how much it is faster [1]
    """

    def __init__(self, world: Time, name: str, main: Callable[[], int]) -> None:
        self.world, self.name, self.main = world, name, main
        self.pid = world.new_pid()
        self.status: int | None = None
        self.error: BaseException | None = None
        self.ended: int | None = None
        self.stopped = self.killed = self.interrupted = self.hangs = False
        self.call = ""
        self.ahead, self.fast = 0, 0.0
        self.begun: int | None = None
        self.halted = 0  # time at which it was stopped [ns]
        self.used = 0
        self.left: int | None = None  # of its computation while it is stopped [ns]
        self.ready: Callable[[], bool] | None = None  # what it waits for
        self.until: int | None = None
        self.blocked = True
        self.token = self.scheduled = 0  # number of its wait, and of the last wait whose end is scheduled
        self.due = False  # whether its wait ended while it was stopped
        self.calls, self.since = 0, 0
        self.lock = threading.Semaphore(0)
        self.thread: threading.Thread | None = None
        self.on_end: list[Callable[[], None]] = []
        self.on_continue: list[Callable[[], None]] = []
        self.held: list[Callable[[], None]] = []  # arrivals of what has not left it while it is stopped
        self.random = world.random_of(name)

    @property
    def alive(self) -> bool:
        return self.ended is None

    def clock(self, time: int) -> int:
        """What the clock of its machine shows at a time [ns]."""
        return time + self.ahead + int(time * self.fast)

    def time_at(self, moment: int) -> int:
        """The first time [ns] at which the clock of its machine shows this."""
        time = math.ceil((moment - self.ahead) / (1 + self.fast))
        while self.clock(time) < moment:
            time += 1
        return time

    def stopped_before(self, moment: int) -> bool:
        """Whether it is stopped since before a time [ns]."""
        return self.stopped and self.halted < moment

    def activity(self) -> Activity:
        """What the process table contains about it."""
        if self.ended is not None:
            return Activity(ENDED)
        used = self.used + (self.world.time - self.begun if self.begun is not None and not self.stopped else 0)
        state = STOPPED if self.stopped else COMPUTES if self.begun is not None else WAITS
        return Activity(state, used * 1e-9)
