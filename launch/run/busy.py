"""Whether other programs take the processor: what is timed then is too slow."""

from __future__ import annotations

import os

SPARE = 0.5  # cores that may be taken though nothing goes on: the load average is that of the last minute


def busy(own: float = 0.0) -> str:
    """The machine's load in a sentence where it leaves this program no core of its own; else "".

    own  processes of this program that the load average counts already
    """
    load, cores = os.getloadavg()[0], os.cpu_count() or 1
    if load - own <= cores - SPARE:
        return ""
    return f"This machine is busy: its load average is {load:.1f} on {cores} core{'s' if cores > 1 else ''}"
