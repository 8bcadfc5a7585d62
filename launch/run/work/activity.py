"""What the processes of a run do, from the process table of Linux: a process that computes, or waits for a processor,
is alive, however long it takes by the clock."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

import msgspec

COMPUTES, WAITS, DISK, STOPPED, ENDED = "computes", "waits", "disk", "stopped", "ended"
"""A thread of it runs or waits for a processor; none does; none does, and a disk blocks one; a signal has stopped it;
it has ended."""
_TICK = 1.0 / os.sysconf("SC_CLK_TCK") if hasattr(os, "sysconf") else 0.01  # [s] of processor time
_USER, _SYSTEM = 11, 12  # places of the times among the fields after the name


class Activity(msgspec.Struct, frozen=True):
    """What a process does now, and the processor time [s] of all its threads since its start."""

    state: str
    used: float = 0.0


def activity(pid: int, table: Path = Path("/proc")) -> Activity | None:
    """What a process of this machine does; None: unknown, as on systems without a process table."""
    try:
        state, used = _read(table / str(pid) / "stat")
    except FileNotFoundError:
        return Activity(ENDED) if table.is_dir() else None
    except (OSError, ValueError, IndexError):
        return None
    if state in "TZX":
        return Activity(STOPPED if state == "T" else ENDED, used)
    states = {state}
    with contextlib.suppress(OSError):
        for thread in (table / str(pid) / "task").iterdir():
            with contextlib.suppress(OSError, ValueError, IndexError):
                states.add(_read(thread / "stat")[0])
    return Activity(COMPUTES if "R" in states else DISK if "D" in states else WAITS, used)


def _read(file: Path) -> tuple[str, float]:
    """State and processor time [s] of a process or a thread. OSError, ValueError, IndexError: it cannot be read."""
    fields = file.read_text(errors="replace").rpartition(")")[2].split()
    return fields[0], (int(fields[_USER]) + int(fields[_SYSTEM])) * _TICK


def waited_for_processor(file: Path = Path("/proc/self/schedstat")) -> float:
    """Time [s] since its start in which this thread could run and had no processor; 0 where it is unknown."""
    try:
        return int(file.read_text().split()[1]) * 1e-9
    except (OSError, ValueError, IndexError):
        return 0.0


class SilentTime:
    """Time of a process without a sign of life [s], by its cause. Time in which it waits for a processor does not
    count, nor do the first `DISK_PATIENCE` in which a disk blocks it: the kernel would not kill it, and its recording
    would be lost.

    idle     it waits, or nothing is known about it
    busy     it computes: processor time
    stopped  a signal has stopped it
    """

    DISK_PATIENCE = 120.0  # [s]

    def __init__(self) -> None:
        self.idle = self.busy = self.stopped = self.at_disk = 0.0
        self.used: float | None = None  # processor time at the last reading

    @property
    def total(self) -> float:
        return self.idle + self.busy + self.stopped + max(0.0, self.at_disk - self.DISK_PATIENCE)

    def add(self, passed: float, found: Activity | None) -> None:
        """Count a time [s] at the end of which the process did this; None: unknown."""
        if found is None:
            self.idle += passed
            return
        computed = 0.0 if self.used is None else max(0.0, found.used - self.used)
        self.used = found.used
        if found.state == STOPPED:
            self.stopped += passed
        elif computed > 0.0 or found.state == COMPUTES:
            self.busy += min(computed, passed)
        elif found.state == DISK:
            self.at_disk += passed
        else:
            self.idle += passed
