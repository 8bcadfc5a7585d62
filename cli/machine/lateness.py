"""Wake-up latency of this machine, which decides whether it can run at 1 kHz."""

import ctypes
import os
import time
from dataclasses import dataclass

import numpy as np

PRIORITY = 60
PERIOD = 1e-3  # [s]
TIMERSLACK = 29


@dataclass(frozen=True)
class Lateness:
    """Wake-up latency [s]: median, 99 %, 99.9 %, maximum; and the fraction later than a whole period."""

    p50: float
    p99: float
    p999: float
    worst: float
    missed: float


def measure(seconds: float, priority: int | None, period: float = PERIOD) -> Lateness | None:
    """Measure the latency of wake-ups at the end of each period [s]. None: the priority is not permitted.

    priority  of SCHED_RR; None: normal scheduling. The previous policy is restored.
    """
    policy, given = os.sched_getscheduler(0), os.sched_getparam(0)
    libc = ctypes.CDLL(None)
    try:
        if priority is not None:
            os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(priority))
        libc.prctl(TIMERSLACK, 1)
        count = max(10, round(seconds / period))
        late = np.zeros(count)
        begin = time.monotonic()
        for k in range(count):
            due = begin + (k + 1) * period
            left = due - time.monotonic()
            if left > 0.0:
                time.sleep(left)
            late[k] = time.monotonic() - due
    except PermissionError:
        return None
    finally:
        os.sched_setscheduler(0, policy, given)
    late = np.maximum(late, 0.0)
    p50, p99, p999 = np.percentile(late, (50, 99, 99.9))
    return Lateness(float(p50), float(p99), float(p999), float(late.max()), float(np.mean(late > period)))


def words(lateness: Lateness) -> str:
    parts = [f"{name} {1e3 * value:.3f}" for name, value in (
        ("p50", lateness.p50), ("p99", lateness.p99), ("p99.9", lateness.p999), ("max", lateness.worst))]  # fmt: skip
    return f"{', '.join(parts)} ms late; {100 * lateness.missed:.2f} % miss their millisecond"
