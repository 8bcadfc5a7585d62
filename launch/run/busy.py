"""Reports how much of processor and memory other programs use; measured times are too long if they compute."""

import contextlib
import math
import os
from pathlib import Path

LIMITS = "memory.max", "memory.current"  # files of a group of processes (Linux, cgroup 2)
SPARE = 0.5  # cores of tolerance, since the load average covers the last minute


def busy(included: float = 0.0) -> str:
    """A sentence on the machine's load if it leaves no free core for this program; otherwise "", also on Windows, which
    has no load average.

    included  processes of this program that the load average includes
    """
    if not hasattr(os, "getloadavg"):
        return ""
    load, cores = os.getloadavg()[0], os.cpu_count() or 1
    if load - included <= cores - SPARE:
        return ""
    return f"This machine is busy: its load average is {load:.1f} on {cores} core{'s' if cores > 1 else ''}"


def free_memory(group: Path = Path("/sys/fs/cgroup"), system: Path = Path("/proc/meminfo")) -> float:
    """Memory [bytes] that this process can still allocate: the smaller of what the machine and the control group have
    free; infinite if the operating system does not report it."""
    room = math.inf
    with contextlib.suppress(OSError, ValueError, StopIteration):
        line = next(line for line in system.read_text().splitlines() if line.startswith("MemAvailable:"))
        room = 1024.0 * int(line.split()[1])
    with contextlib.suppress(OSError, ValueError):  # "max": no limit
        most, used = (int((group / name).read_text()) for name in LIMITS)
        room = min(room, max(0.0, float(most - used)))
    return room
