"""Fade outputs out and in while an input is missing, or after a pause of the node, so that forces do not jump.

Kernels on groups of a state: `PACE`, `GAIN`, `FADED`.
"""

from typing import Any

from palpate.compiler.records import floats, vector
from palpate.nodes.base.kernels import ieee_kernel, kernel

FALL = 4e-3
"""[s] Time in which a force falls to zero after an input of its computation is missing. Together with the hold time of
an input (7 ms) and of a device's command (9 ms) this is 20 ms, after which a dead node has no effect."""
FADE = 20e-3  # [s] time in which an optional effect fades out or in when its sender disappears or returns
GAP = 9e-3  # [s] a longer step, if also 3 times the one before, is a pause of the node; slow nodes are excluded

PACE = {"usual": (), "last": ()}
"""[s] `usual`: the shorter of the last two steps of a node; `last`: the last one."""
GAIN = {"value": (), "fall": (), "rise": ()}
"""[1] A gain from 0 to 1 that falls to 0 within `fall` [s] while an input is missing, and rises within `rise` [s]."""
FADED = {"gain": GAIN, "last": (3,), "rest": (3,), "share": (), "missing": bool}
"""A force or a command (3) whose last value fades out when messages stop, and fades in when they return.

If messages return before the value is zero, its difference `rest` from the new value fades out with factor `share`.
"""


def begin(gain: Any, fall: float, rise: float) -> None:
    """Initialize a gain to 1."""
    gain["value"], gain["fall"], gain["rise"] = 1.0, fall, rise


@kernel
def gap_of(pose):
    """Vector [m] (3) from a `Pose` to the place of the device; zero unless it follows the device after an outage."""
    if pose.behind.shape[0] == 0:
        return 0.0, 0.0, 0.0
    return vector(floats(pose.behind))


@kernel
def keep_pace(pace, dt):
    """Record the time dt [s] since the last step. Returns whether the node was paused during it."""
    pause = dt > GAP and 0.0 < 3.0 * pace.last < dt
    pace.usual = pace.last if 0.0 < pace.last < dt else dt
    pace.last = dt
    return pause


@ieee_kernel
def step_gain(gain, present, dt):
    """The gain after a step of dt [s]."""
    if not present:
        gain.value = max(gain.value - dt / gain.fall, 0.0)
    elif gain.value < 1.0:
        gain.value = min(gain.value + dt / gain.rise, 1.0) if gain.rise > 0.0 else 1.0
    return gain.value


@kernel
def fade_value(state, there, value, dt):
    """The faded value (3) in a step of dt [s]; `there`: whether the current value is available."""
    if there:
        for i in range(3):
            if state.missing:
                state.rest[i] = state.gain.value * (state.last[i] - value[i]) + state.share * state.rest[i]
            state.last[i] = value[i]
        if state.missing:
            state.share = 1.0
        elif state.gain.value == 1.0 and state.share == 0.0:
            return value[0], value[1], value[2]
    state.missing = not there
    gain = step_gain(state.gain, there, dt)
    state.share = max(state.share - dt / state.gain.fall, 0.0)
    if gain == 1.0 and state.share == 0.0:
        return state.last[0], state.last[1], state.last[2]
    x, y, z = state.last[0], state.last[1], state.last[2]
    a, b, c = state.rest[0], state.rest[1], state.rest[2]
    return gain * x + state.share * a, gain * y + state.share * b, gain * z + state.share * c
