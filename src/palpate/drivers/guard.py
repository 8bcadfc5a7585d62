"""The last step before a command is sent: limits commands of any node to what is safe for the device.

A gain between 0 and 1 multiplies the command. It ramps up to 1 within the ramp time, and down to 0 within FALL on any
of these conditions: the device is not homed or its numbers are invalid, answers are missing, the command is stale or
not finite, the dead-man button is not held, the grip or a joint is too fast, or the grip is outside its box. If the
condition ends before the gain is 0, the difference between the last and the new command also fades within FALL, so that
the force does not jump; likewise after a pause of the thread that sends the commands. One factor for all components
limits the command and its power, which keeps the direction.
"""

import math
from collections import deque
from typing import NamedTuple

from palpate.drivers.limits import Limits

FALL = 0.015  # [s] from full to zero
MISSED = 3  # [1] successive missing answers at which the gain falls
SILENT = 0.020  # [s] longest time without an answer
STALE = 0.010  # [s] longest age of a command
HORIZON = 0.005  # [s] limit of extrapolation
HISTORY = 8  # [1] number of differences between samples over which rates are computed


class DeviceSample(NamedTuple):
    """One answer of a device.

    time      [ns]      arrival, on the machine's monotonic clock
    joints    [rad] (j) angles conjugate to the torques; empty if commands are forces
    position  [m]   (3) of the grip in the device's frame; empty if unknown
    buttons   [1]       bit mask
    homed     [1]       whether joints and position are valid
    wrench    [N], [N m] (6)  measured force and torque; empty without a sensor
    age       [ns]      of joints and position when they are read, beyond their extrapolation
    """

    time: int
    joints: tuple[float, ...] = ()
    position: tuple[float, ...] = ()
    buttons: int = 0
    homed: bool = True
    wrench: tuple[float, ...] = ()
    age: int = 0


class Guard:
    """Limits the commands of one device.

    limits   limits of the device
    deadman  mask of buttons of which one must be held; 0: no dead-man button
    ramp     [s] ramp time; None: that of the device
    """

    def __init__(self, limits: Limits, deadman: int = 0, ramp: float | None = None) -> None:
        self.limits, self.deadman = limits, deadman
        self.ramp = limits.ramp if ramp is None else ramp
        self.reset()

    def reset(self) -> None:
        self.gain, self.missed, self._then = 0.0, 0, 0
        self._step = 0.0  # [s] between the last two commands
        self._finite: tuple[float, ...] = ()  # the last command of numbers
        self._stopped, self._share = True, 0.0
        self._sent: tuple[float, ...] = ()
        self._jointed = False  # whether the last valid sample had joints, so that commands are torques
        self._rest: tuple[float, ...] = ()
        self._samples: deque[DeviceSample] = deque(maxlen=HISTORY + 1)

    def note_answer(self, sample: DeviceSample | None) -> None:
        """Note the answer to the last command; None: it is missing."""
        if sample is None:
            self.missed += 1
            return
        self.missed = 0
        if not sample.homed:
            self._samples.clear()
        elif not self._samples or sample.time > self._samples[-1].time:
            self._samples.append(sample)
            self._jointed = bool(sample.joints)

    def why(self, now: int, given: int) -> str:
        """Why a command given at `given` [ns] must not be sent at `now` [ns]; empty if it may be sent."""
        if not self._samples:
            return "not homed"
        last = self._samples[-1]
        if self.missed >= MISSED or now - last.time > SILENT * 1e9:
            return "answers are missing"
        if now - given > STALE * 1e9:
            return "the command is old"
        if self.deadman and not last.buttons & self.deadman:
            return "the dead-man button is not held"
        if not all(map(math.isfinite, last.joints)):
            return "no angles"
        if not all(abs(rate) <= self.limits.turn for rate in self._rate("joints")):
            return "too fast"
        if last.position:
            low, high = self.limits.box
            if not all(a <= x <= b for a, x, b in zip(low, last.position, high, strict=True)):
                return "outside its box"
            if math.hypot(*self._rate("position")) > self.limits.speed:
                return "too fast"
        return ""

    def apply(self, command: tuple[float, ...], now: int, given: int) -> tuple[float, ...]:
        """The limited command for `now` [ns]; `given` [ns]: when the command was given."""
        stopped = bool(self.why(now, given))
        if all(map(math.isfinite, command)):
            self._finite = command
        else:
            stopped, command = True, self._finite or (0.0,) * len(command)
        wanted = self._limit_command(command)
        elapsed = self._pace(now, stopped)
        if self._stopped and not stopped and self._sent:
            self._share = 1.0
            self._rest = tuple(s - self.gain * w for s, w in zip(self._sent, wanted, strict=True))
        self._stopped = stopped
        if stopped:
            self.gain = max(0.0, self.gain - elapsed / FALL)
        else:
            self.gain = min(1.0, self.gain + elapsed / self.ramp) if self.ramp > 0.0 else 1.0
        self._share = max(0.0, self._share - elapsed / FALL)
        if self._share > 0.0:
            both = zip(wanted, self._rest, strict=True)
            sent = self._limit_command(tuple(self.gain * w + self._share * r for w, r in both))
        else:
            sent = tuple(self.gain * w for w in wanted)
        power = self._power(sent)
        if power > self.limits.power:
            sent = tuple(self.limits.power / power * c for c in sent)
        self._sent = sent
        return sent

    def _pace(self, now: int, stopped: bool) -> float:
        """Time [s] since the last command. After a pause, in which the device has kept its command, it is a usual step
        unless the force must fall: the ramp and the fades begin there, as after a stop."""
        elapsed = (now - self._then) * 1e-9 if self._then else 0.0
        usual, self._then, self._step = self._step, now, elapsed
        if not stopped and elapsed > STALE and 0.0 < 3.0 * usual < elapsed:
            self._stopped = True
            return usual
        return elapsed

    def _limit_command(self, command: tuple[float, ...]) -> tuple[float, ...]:
        """The command, at most the largest."""
        largest = max(map(abs, command), default=0.0)
        if largest == 0.0:
            return (0.0,) * len(command)
        most, each = self.limits.command, self.limits.each
        if self._jointed and self.limits.torque is not None:
            most, each = self.limits.torque, True
        length = 1.0 if each else math.hypot(*(c / largest for c in command))
        scale = min(1.0, most / length / largest)  # this order avoids overflow
        return tuple(scale * c for c in command)

    def rates(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Rates of joints [rad/s] and position [m/s] over the last samples; empty if unknown."""
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
        """Power [W] that the command gives to the hand at the current rate."""
        if not self._samples:
            return 0.0
        rate = self._rate("joints" if self._samples[-1].joints else "position")
        return sum(c * r for c, r in zip(command, rate, strict=False))


def ahead(sample: DeviceSample, rates: tuple[tuple[float, ...], tuple[float, ...]], now: int) -> DeviceSample:
    """A sample extrapolated with its rates to `now` [ns], by at most HORIZON; its age is the rest.

    A graph with another rate than its device gets samples of uneven age. Without extrapolation they look like jumps of
    the velocity, which damping would turn into force spikes.
    """
    left = min(max((now - sample.time) * 1e-9, 0.0), HORIZON)
    joints, position = (
        tuple(x + r * left for x, r in zip(given, rate, strict=True)) if rate else given
        for given, rate in zip((sample.joints, sample.position), rates, strict=True)
    )
    return sample._replace(joints=joints, position=position, age=max(now - sample.time - round(HORIZON * 1e9), 0))
