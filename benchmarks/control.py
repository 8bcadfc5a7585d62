"""A process that only sleeps, in parallel with a run on the real clock.

Ticks that this process misses are due to the machine, not to the run.
"""

from __future__ import annotations

import multiprocessing
import os
from multiprocessing.connection import Connection
from pathlib import Path

from palpate.cli.machine.diagnostics import Lateness, measure
from palpate.launch.run.launcher import Launcher


class Control:
    """Sleeps until each tick of a run, on the core and with the priority of the process that paces the run.

    seconds, rate  duration [s] and rate [Hz] of the run, which calls `look` repeatedly
    """

    def __init__(self, seconds: float, rate: float) -> None:
        self.seconds, self.rate = seconds, rate
        self._first: dict[str, int] = {}
        self._last: dict[str, int] = {}
        self._end, self._process = _sleeper()

    def look(self, launcher: Launcher) -> None:
        """Start the sleep at the first call during the run; at each call read how long processes waited for a core."""
        if launcher.phase != "running":
            return
        pids = {**launcher.pids, "the sleeper": self._process.pid or 0}
        waited = {group: wait for group, pid in pids.items() if (wait := _waited(pid)) is not None}
        if not self._first:
            lead = next(job for job in launcher.jobs.values() if job.leads)
            self._end.send((lead.core, lead.priority, self.seconds, 1.0 / self.rate))
            self._first = waited
        self._last |= waited

    def result(self) -> dict[str, object]:
        """Share of missed ticks, lateness of the wake-ups [s], and run-queue wait of each process per tick [s].

        The waits are those between the first and the last `look`.
        """
        lateness: Lateness = self._end.recv()
        self._process.join()
        ticks = self.seconds * self.rate
        waits = {group: (self._last[group] - before) * 1e-9 / ticks for group, before in self._first.items()}
        return {"missed": lateness.missed, "p50": lateness.p50, "p99": lateness.p99, "p999": lateness.p999,
                "queue": waits}  # fmt: skip


def missed(seconds: float, core: tuple[int, ...] | None, priority: int, period: float) -> Lateness:
    """The lateness of a process that sleeps until each tick, without a run."""
    end, process = _sleeper()
    end.send((core, priority, seconds, period))
    lateness: Lateness = end.recv()
    process.join()
    return lateness


def _sleeper() -> tuple[Connection, multiprocessing.process.BaseProcess]:
    """A process that waits for what to do, see `_sleep`, and the connection to it."""
    end, theirs = multiprocessing.Pipe()
    process = multiprocessing.get_context("fork").Process(target=_sleep, args=(theirs,), daemon=True)
    process.start()
    return end, process


def _sleep(end: Connection) -> None:
    core, priority, seconds, period = end.recv()
    if core is not None:
        os.sched_setaffinity(0, core)
    end.send(measure(seconds, priority, period) or measure(seconds, None, period))


def _waited(pid: int) -> int | None:
    """Time [ns] that a process was ready to run but had no core; None if it has ended."""
    try:
        return int(Path(f"/proc/{pid}/schedstat").read_text().split()[1])
    except (OSError, IndexError):
        return None
