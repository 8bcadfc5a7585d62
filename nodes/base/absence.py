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


class Pace:
    """The time between the steps of a node."""

    def __init__(self) -> None:
        self.usual = 0.0  # [s] the last step's, or the one before's where that was shorter
        self._last = 0.0

    def update(self, dt: float) -> bool:
        """Take the time dt [s] since the last step; whether the node stood still meanwhile."""
        stood = dt > GAP and 0.0 < 3.0 * self._last < dt
        self.usual = self._last if 0.0 < self._last < dt else dt
        self._last = dt
        return stood


class Gain:
    """A share between 0 and 1 [1]: falls to 0 within `fall` [s] while something is missing, rises within `rise` [s]."""

    def __init__(self, fall: float, rise: float) -> None:
        self.fall, self.rise = fall, rise
        self.value = 1.0

    def update(self, present: bool, dt: float) -> float:
        """The share after a step of dt [s]."""
        if not present:
            self.value = max(self.value - dt / self.fall, 0.0)
        elif self.value < 1.0:
            self.value = min(self.value + dt / self.rise, 1.0) if self.rise > 0.0 else 1.0
        return self.value


class Faded:
    """A force or a command that may stop coming: its last value fades out within `seconds`, and it fades in again."""

    def __init__(self, seconds: float, size: int = 3) -> None:
        self._gain = Gain(seconds, seconds)
        self._last: object = (0.0,) * size

    def update(self, value: object | None, dt: float) -> object:
        """The value to use in a step of dt [s]; None: there is none."""
        if value is not None:
            self._last = value
            if self._gain.value == 1.0:
                return value
        gain = self._gain.update(value is not None, dt)
        return self._last if gain == 1.0 else tuple(gain * number for number in self._last)


class Lost:
    """Whether a message was computed without an input that earlier ones of its sender had."""

    def __init__(self) -> None:
        self._had: set[int] = set()

    def update(self, used: tuple[int, ...]) -> bool:
        """Take the `used` of the next message."""
        if -1 not in used and len(self._had) == len(used):
            return False
        there = {place for place, tick in enumerate(used) if tick >= 0}
        self._had |= there
        return there != self._had
