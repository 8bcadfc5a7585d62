"""Whether other programs use the processor, so that measured times are too long."""

import os

SPARE = 0.5  # cores of tolerance, since the load average covers the last minute


def busy(included: float = 0.0) -> str:
    """A sentence on the machine's load if it leaves no free core for this program; otherwise "".

    included  processes of this program that the load average includes
    """
    load, cores = os.getloadavg()[0], os.cpu_count() or 1
    if load - included <= cores - SPARE:
        return ""
    return f"This machine is busy: its load average is {load:.1f} on {cores} core{'s' if cores > 1 else ''}"
