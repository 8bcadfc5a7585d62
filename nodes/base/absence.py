"""What a node does while an input that it had is missing, or after it stood still: fade out and fade in, never jump.

Kernels on groups of a state: `PACE`, `GAIN`, `FADED`.
"""

from typing import Any

from palpate.physics.kernel import kernel

FALL = 4e-3
"""[s] in which a force falls from full to zero once what it is computed from is missing. With the time for which a node
holds an input (7 ms) and a device its command (9 ms) it makes the 20 ms after which a dead node has no effect."""
FADE = 20e-3  # [s] in which an optional effect fades out when its sender is gone, and in when it is back
GAP = 9e-3  # [s] without a step, and three times the step before, in which a node stood still: a slow one is not meant

PACE = {"usual": (), "last": ()}
"""The time between the steps of a node: the last step's, or the one before's where that was shorter; the last [s]."""
GAIN = {"value": (), "fall": (), "rise": ()}
"""A share between 0 and 1 [1] that falls to 0 within `fall` [s] while something is missing, rises within `rise` [s]."""
FADED = {"gain": GAIN, "last": (3,)}
"""A force or a command (3) that may stop coming: its last value fades out, and it fades in again."""


def begin(gain: Any, fall: float, rise: float) -> None:
    """The state of a share before the first step: all of it."""
    gain["value"], gain["fall"], gain["rise"] = 1.0, fall, rise


@kernel
def paced(pace, dt):
    """Take the time dt [s] since the last step; whether the node stood still meanwhile."""
    stood = dt > GAP and 0.0 < 3.0 * pace.last < dt
    pace.usual = pace.last if 0.0 < pace.last < dt else dt
    pace.last = dt
    return stood


@kernel(error_model="numpy")
def shared(gain, present, dt):
    """The share after a step of dt [s]."""
    if not present:
        gain.value = max(gain.value - dt / gain.fall, 0.0)
    elif gain.value < 1.0:
        gain.value = min(gain.value + dt / gain.rise, 1.0) if gain.rise > 0.0 else 1.0
    return gain.value


@kernel
def faded(state, there, value, dt):
    """What to use of a value (3) in a step of dt [s]; `there`: whether there is one."""
    if there:
        for i in range(3):
            state.last[i] = value[i]
        if state.gain.value == 1.0:
            return value[0], value[1], value[2]
    gain = shared(state.gain, there, dt)
    if gain == 1.0:
        return state.last[0], state.last[1], state.last[2]
    return gain * state.last[0], gain * state.last[1], gain * state.last[2]
