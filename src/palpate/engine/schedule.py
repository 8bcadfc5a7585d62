"""The ticks at which a node runs, and the message that it uses at a tick.

Tick k of a graph is at time k/rate on its clock. A node runs at the ticks that its divisor `every` divides. Loops in
Python call these functions as they are; `compiled_tick` compiles them.
"""

FRESH, HELD, OLD, MISSED = range(4)
"""How a step on the real clock takes a message: as the one it needs; as an older one that it holds; as absent, because
it is too old to be held; or not at all, because it is the driving one and not of this tick."""


def needed_tick(tick: int, every: int, loop: bool) -> int:
    """Tick of the message that a consumer uses at `tick` from a producer with the divisor `every`.

    A forward edge takes the latest tick up to `tick`, a loop edge the latest one before it. -1: no message yet.
    """
    last = tick - 1 if loop else tick
    return last - last % every if last >= 0 else -1


def slept(tick: int, due: int, hardware: bool) -> int:
    """Ticks before `tick` in which a node, due at tick `due`, did not step. They do not age its inputs: if the whole
    loop stalls, the last messages are still current. For hardware they count, since it moves on during a stall."""
    return 0 if hardware or due == 0 else max(0, tick - due)


def standing(sent: int, need: int, drives: bool, age: int, rate: float, permitted: float) -> int:
    """How a step takes a message of tick `sent`: `FRESH`, `HELD`, `OLD` or `MISSED`.

    need       tick of the message that it needs, see `needed_tick`
    drives     whether the arrival of the message runs the step
    age        [ticks] of the message, without those that do not count, see `slept`
    rate       [Hz];  permitted  [s] age up to which the message is held
    """
    if sent >= need:
        return FRESH
    if drives:
        return MISSED
    return OLD if age / rate > permitted else HELD


def lacks(state: int, optional: bool) -> bool:
    """Whether a step cannot run with a message in this state; a missing one is `OLD`."""
    return state == MISSED or (state == OLD and not optional)


def sender_stopped(state: int, optional: bool) -> bool:
    """Whether the sender of an optional input has stopped, so that waiting for it is useless."""
    return optional and state == OLD


def unread(runs: int, newest: int, due: int, last: int) -> int:
    """Lost runs of a node that takes the newest of several driving messages.

    runs    number of its runs from tick `due` on to which the messages belong
    newest  tick of the newest message;  last  tick of the node's last run, which it must exceed
    """
    if newest <= last:  # duplicates, or out of order
        return runs if newest >= due else 0
    return runs - (newest >= due)


def left_out(late: float, period: float, tick: int, last: int) -> int:
    """Ticks to leave out from `tick` on, which begins `late` [ns]: those whose whole period [ns] has passed, except the
    last one of the run."""
    return min(int(late // period), last - tick) if late > period else 0


def next_run(tick: int, every: int) -> int:
    """The first tick after `tick` at which a node with this divisor runs."""
    return tick - tick % every + every


def nanoseconds(tick: int, rate: float) -> int:
    """Time [ns] of a tick on the simulated clock at `rate` [Hz]."""
    return round(tick * 1e9 / rate)


def begin_of(tick: int, period: float) -> int:
    """Time [ns] at which a tick of the real clock begins, after that of tick 0; `period` [ns]."""
    return round(tick * period)
