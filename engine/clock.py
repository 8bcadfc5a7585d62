"""Keeping time, and asking the operating system for the means to keep it."""

import contextlib
import ctypes
import os
import threading
import time

SPIN = 100_000  # [ns] wait actively for this long before a deadline: a plain sleep wakes up about 90 us late
POLL_INTERVAL = 20  # [ms] after which those who wait look round: for orders, and what else has come
_PR_SET_TIMERSLACK = 29
_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4


now = time.monotonic_ns  # [ns] of the machine's monotonic clock, the same in all processes of one machine


def sleep_until(deadline: int) -> int:
    """Return at `deadline` [ns], or at once when it has passed; sleeps first, spins the last 0.1 ms, or a quarter of a
    shorter wait: a process that never sleeps is stopped by the kernel for 50 ms of each second.

    Returns by how much it is late [ns].
    """
    left = deadline - now()
    if left > 0:
        time.sleep((left - min(SPIN, left // 4)) * 1e-9)
    while (left := now() - deadline) < 0:
        pass
    return left


GLANCE = 200_000_000  # [ns] of silence that count at most between two looks


class Silence:
    """How long nobody has said anything to one who looks again and again. A machine that stands still is no silence: it
    keeps everybody from speaking."""

    def __init__(self) -> None:
        self.heard()

    def heard(self) -> None:
        """Somebody has said something."""
        self._lasted, self._looked = 0, now()

    def look(self) -> int:
        """[ns] for which it has lasted."""
        moment = now()
        self._lasted, self._looked = self._lasted + min(moment - self._looked, GLANCE), moment
        return self._lasted


def real_time(core: tuple[int, ...] | None, priority: int | None) -> list[str]:
    """Pin this process, raise its priority, lock its memory and sharpen its timers, as far as that is permitted.

    It holds for all threads that exist: ZeroMQ's own thread has to be woken for every message, and would otherwise
    be woken on another core.

    core      the cores that it may run on, None: leave it
    priority  of the round-robin real-time scheduler, 1 to 99, None: leave it. A node that computes without end then
              shares the core with its equals. Without pinning it does more harm than good.

    Returns what was refused, a line each.
    """
    refused: list[str] = []
    libc = ctypes.CDLL(None, use_errno=True)
    libc.prctl(_PR_SET_TIMERSLACK, 1)
    for thread in map(int, os.listdir("/proc/self/task")):
        if core is not None:
            try:
                os.sched_setaffinity(thread, core)
            except OSError as error:
                refused.append(f"core {','.join(map(str, core))}: {error.strerror}")
        if priority is not None:
            try:
                os.sched_setscheduler(thread, os.SCHED_RR, os.sched_param(priority))
            except OSError:
                refused.append("SCHED_RR: not permitted (needs CAP_SYS_NICE, or an rtprio line in limits.conf)")
    if priority is not None:
        _free_memory_last()
    # On fault: what a process has used stays; what it shares with the fork server and never writes is not copied.
    if priority is not None and libc.mlockall(_MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT) != 0:
        refused.append("locked memory: not permitted (needs CAP_IPC_LOCK, or a memlock line in limits.conf)")
    return sorted(set(refused))


def _free_memory_last() -> None:
    """Start a thread that waits without end at the lowest real-time priority.

    When a process dies, its last thread frees the memory, with that thread's priority. At that of the force path this
    kept the other nodes of the core from running for 5 to 15 ms.
    """
    thread = threading.Thread(target=threading.Event().wait, daemon=True)
    thread.start()
    with contextlib.suppress(OSError):
        os.sched_setscheduler(thread.native_id or 0, os.SCHED_RR, os.sched_param(1))
