"""The ticks at which a node runs, and the message that it uses at a tick.

Tick k of a graph is at time k/rate on its clock. A node runs at the ticks that its divisor `every` divides.
"""


def needed(tick: int, every: int, loop: bool) -> int:
    """Tick of the message that a consumer uses at `tick` from a producer with the divisor `every`.

    A forward edge takes the latest tick up to `tick`, a loop edge the latest one before it. -1: no message yet.
    """
    last = tick - 1 if loop else tick
    return last - last % every if last >= 0 else -1


def next_run(tick: int, every: int) -> int:
    """The first tick after `tick` at which a node with this divisor runs."""
    return tick - tick % every + every


def nanoseconds(tick: int, rate: float) -> int:
    """Time [ns] of a tick on the simulated clock at `rate` [Hz]."""
    return round(tick * 1e9 / rate)
