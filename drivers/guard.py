"""The last step before a command is sent: it is limited to what the device may do, whatever node asked for it.

One gain between 0 and 1 multiplies the command. It rises to 1 within the ramp time while all is well, and falls to 0
within FALL as soon as something is not: the device is not homed, answers are missing, the command is old, the dead-man
button is not held, the grip is too fast or outside its box. Then the command is scaled, always as a whole so that its
direction stays, to the largest command and the largest power.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

from palpate.drivers.limits import Limits

FALL = 0.015  # [s] from full to zero
MISSED = 3  # [1] answers in a row that may be missing
SILENT = 0.020  # [s] for which the device may be without an answer, in however many cycles
STALE = 0.010  # [s] a command older than this is no command
HORIZON = 0.005  # [s] by which a sample is carried on at most
HISTORY = 8  # [1] differences over which rates are taken


class DeviceSample(NamedTuple):
    """One answer of a device.

    time      [ns]      of the machine's monotonic clock when it came
    joints    [rad] (j) angles that conjugate torques; empty where the device takes forces
    position  [m]   (3) of the grip in the device's frame; empty where it is not known
    buttons   [1]       bit mask
    homed     [1]       whether joints and position can be trusted
    wrench    [N], [N m] (6)  force and torque that a sensor feels; empty where there is none
    """

    time: int
    joints: tuple[float, ...] = ()
    position: tuple[float, ...] = ()
    buttons: int = 0
    homed: bool = True
    wrench: tuple[float, ...] = ()


class Guard:
    """Holds the commands of one device to its limits.

    limits   of the device
    deadman  mask of buttons of which one has to be held for any command; 0: none
    ramp     [s] in place of the device's own
    """

    def __init__(self, limits: Limits, deadman: int = 0, ramp: float | None = None) -> None:
        self.limits, self.deadman = limits, deadman
        self.ramp = limits.ramp if ramp is None else ramp
        self.reset()

    def reset(self) -> None:
        """As after a start: no gain, no history."""
        self.gain, self.missed, self._then = 0.0, 0, 0
        self._samples: deque[DeviceSample] = deque(maxlen=HISTORY + 1)

    def saw(self, sample: DeviceSample | None) -> None:
        """Take the answer to the last command; None: none came in time."""
        if sample is None:
            self.missed += 1
            return
        self.missed = 0
        if not sample.homed:
            self._samples.clear()
        elif not self._samples or sample.time > self._samples[-1].time:
            self._samples.append(sample)

    def why(self, now: int, given: int) -> str:
        """Why a command of `given` [ns] may not be sent at `now` [ns]; empty where it may."""
        if not self._samples:
            return "not homed"
        last = self._samples[-1]
        if self.missed >= MISSED or now - last.time > SILENT * 1e9:
            return "answers are missing"
        if now - given > STALE * 1e9:
            return "the command is old"
        if self.deadman and not last.buttons & self.deadman:
            return "the dead-man button is not held"
        if last.position:
            low, high = self.limits.box
            if not all(a <= x <= b for a, x, b in zip(low, last.position, high, strict=True)):
                return "outside its box"
            if math.hypot(*self._rate("position")) > self.limits.speed:
                return "too fast"
        return ""

    def apply(self, command: tuple[float, ...], now: int, given: int) -> tuple[float, ...]:
        """The command that may be sent at `now` [ns], of one that was given at `given` [ns]."""
        elapsed = (now - self._then) * 1e-9 if self._then else 0.0
        self._then = now
        if self.why(now, given):
            self.gain = max(0.0, self.gain - elapsed / FALL)
        else:
            self.gain = min(1.0, self.gain + elapsed / self.ramp) if self.ramp > 0.0 else 1.0
        zero = (0.0,) * len(command)
        if self.gain == 0.0 or not all(map(math.isfinite, command)):
            return zero
        largest = max(map(abs, command), default=0.0)
        if largest == 0.0:
            return zero
        length = 1.0 if self.limits.each else math.hypot(*(c / largest for c in command))
        scale = self.gain * min(1.0, self.limits.command / length / largest)  # their product may be beyond all numbers
        power = scale * self._power(command)
        if power > self.limits.power:
            scale *= self.limits.power / power
        return tuple(scale * c for c in command)

    def rates(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Rates of joints [rad/s] and position [m/s] over the last samples; empty where there are none."""
        return self._rate("joints"), self._rate("position")

    def _rate(self, name: str) -> tuple[float, ...]:
        if not self._samples:
            return ()
        first, last = self._samples[0], self._samples[-1]
        a, b = getattr(first, name), getattr(last, name)
        if last.time <= first.time or len(a) != len(b):
            return ()
        return tuple((y - x) * 1e9 / (last.time - first.time) for x, y in zip(a, b, strict=True))

    def _power(self, command: tuple[float, ...]) -> float:
        """[W] that the command gives to the hand at the present rate."""
        if not self._samples:
            return 0.0
        rate = self._rate("joints" if self._samples[-1].joints else "position")
        return sum(c * r for c, r in zip(command, rate, strict=False))


def ahead(sample: DeviceSample, rates: tuple[tuple[float, ...], tuple[float, ...]], now: int) -> DeviceSample:
    """A sample extrapolated with its rates to `now` [ns], by HORIZON at most.

    A graph that runs at another rate than its device gets samples of uneven age. Left as they are, they look like a
    jerk within one tick, and a damped contact answers with a jerk of the force.
    """
    left = min(max((now - sample.time) * 1e-9, 0.0), HORIZON)
    joints, position = (
        tuple(x + r * left for x, r in zip(given, rate, strict=True)) if rate else given
        for given, rate in zip((sample.joints, sample.position), rates, strict=True)
    )
    return sample._replace(joints=joints, position=position)
