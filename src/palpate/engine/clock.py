"""The monotonic clock, precise waiting, and real-time settings of the process."""

import contextlib
import ctypes
import os
import sys
import threading
import time

SPIN = 100_000  # [ns] of busy waiting before a deadline: a plain sleep wakes up about 90 us late
POLL_INTERVAL = 20  # [ms] after which a waiting process polls for orders and other messages
LONGEST_GAP = 200_000_000  # [ns] of the time between two polls, at most this counts as silence
_PR_SET_TIMERSLACK = 29
_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4


now = time.monotonic_ns
"""[ns] The machine's monotonic clock, the same in all of its processes. The launcher and the workers call it and
`sleep_until` as attributes of this module, so that a simulation can replace both (`studies/faults/launcher`)."""


def seconds() -> float:
    """The same in [s]."""
    return 1e-9 * now()


def sleep_until(deadline: int) -> int:
    """Return at `deadline` [ns], or immediately if it has passed. Returns the delay [ns].

    It sleeps first and spins for the last 0.1 ms, or for a quarter of a shorter wait: the kernel stops a process that
    never sleeps for 50 ms of each second.
    """
    left = deadline - now()
    if left > 0:
        time.sleep((left - min(SPIN, left // 4)) * 1e-9)
    while (left := now() - deadline) < 0:
        pass
    return left


class Silence:
    """Time without a message, measured by repeated polls. Time during which this process was not scheduled does not
    count, because the sender may not have been scheduled either."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """A message has arrived."""
        self._duration, self._polled = 0, now()

    def poll(self) -> int:
        """Duration of the silence [ns]."""
        moment = now()
        self._duration, self._polled = self._duration + min(moment - self._polled, LONGEST_GAP), moment
        return self._duration


def real_time(core: tuple[int, ...] | None, priority: int | None) -> list[str]:
    """Pin this process, raise its priority, lock its memory and set fine timer slack, as far as permitted. Returns the
    settings that the system refused, one line each.

    All existing threads get the settings: ZeroMQ's thread wakes up for every message, and could otherwise wake up on
    another core.

    core      cores that the process may run on; None: unchanged
    priority  1 to 99 of the round-robin real-time scheduler, so that a busy node shares its core with nodes of equal
              priority; without pinning it does more harm than good. None: the batch scheduler, where a process that
              receives a message does not interrupt its sender: a tick needs 9 switches of nine processes, not 11
    """
    if sys.platform != "linux":
        wanted = [core and f"core {','.join(map(str, core))}", priority is not None and "SCHED_RR and locked memory"]
        return [f"{what}: only on Linux" for what in wanted if what]
    refused: list[str] = []
    libc = ctypes.CDLL(None, use_errno=True)
    libc.prctl(_PR_SET_TIMERSLACK, 1)
    for thread in map(int, os.listdir("/proc/self/task")):
        if core is not None:
            try:
                os.sched_setaffinity(thread, core)
            except OSError as error:
                refused.append(f"core {','.join(map(str, core))}: {error.strerror}")
        if priority is None:
            with contextlib.suppress(OSError):
                os.sched_setscheduler(thread, os.SCHED_BATCH, os.sched_param(0))
        else:
            try:
                os.sched_setscheduler(thread, os.SCHED_RR, os.sched_param(priority))
            except OSError:
                refused.append("SCHED_RR: not permitted (needs CAP_SYS_NICE, or an rtprio line in limits.conf)")
    if priority is not None:
        _free_memory_last()
    # On fault: only used pages are locked, so pages shared with the fork server and never written are not copied.
    if priority is not None and libc.mlockall(_MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT) != 0:
        refused.append("locked memory: not permitted (needs CAP_IPC_LOCK, or a memlock line in limits.conf)")
    return sorted(set(refused))


def _free_memory_last() -> None:
    """Start a thread that waits forever at the lowest real-time priority.

    When a process dies, its last thread frees the memory. At the priority of the force path, this blocked the other
    nodes of the core for 5 to 15 ms.
    """
    thread = threading.Thread(target=threading.Event().wait, daemon=True)
    thread.start()
    with contextlib.suppress(OSError):
        os.sched_setscheduler(thread.native_id or 0, os.SCHED_RR, os.sched_param(1))
