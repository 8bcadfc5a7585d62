"""The hand that holds the grip of an emulated device: the arm of `physics.device.grip` in real time."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from palpate.compiler.fields import blank_record
from palpate.physics.device.falcon import HOME
from palpate.physics.device.grip import GRIP, SUBSTEP, advance, path_point, propagator

Point = tuple[float, float, float]
LONGEST = 0.25  # [s] limit of the time between two steps


@dataclass(frozen=True)
class Script:
    """The desired path of a hand, and the parameters of the arm that follows it.

    points     [m]   (n+1,3)  in the device's frame
    ends       [s]   (n)      end of each segment
    shapes     [1]   (n)      LINEAR or MINIMUM_JERK of `physics.device.grip`
    buttons    [1]   (n)      masks
    mass [kg], drag [N s/m] of the device; stiffness [N/m], damping [N s/m] of the arm
    """

    points: tuple[Point, ...] = (HOME,)
    ends: tuple[float, ...] = ()
    shapes: tuple[int, ...] = ()
    buttons: tuple[int, ...] = ()
    mass: float = 0.2
    drag: float = 0.2
    stiffness: float = 500.0
    damping: float = 10.0


class EmulatedOperator:
    """A held grip. The clock of its path starts with `begin`, but not while it `waits` for `go`."""

    def __init__(self, script: Script, waits: bool = False) -> None:
        self.script, self.waits = script, waits
        self.ends = np.array(script.ends, dtype=float)
        self.points = np.array(script.points, dtype=float)
        self.shapes = np.array(script.shapes, dtype=np.int64)
        self.grip = blank_record(
            GRIP, mass=script.mass, drag=script.drag, stiffness=script.stiffness, damping=script.damping
        )
        self.position = self.points[0].copy()
        self.velocity = np.zeros(3)
        self.time = 0.0
        self.segment = -1
        self._then: int | None = None
        self._length = 0.0
        self._step((0.0, 0.0, 0.0), SUBSTEP)  # compile now, so that no answer is delayed
        self.position, self.velocity = self.points[0].copy(), np.zeros(3)
        self.time, self.segment = 0.0, -1

    @property
    def buttons(self) -> int:
        """Bit mask of the pressed buttons."""
        return self.script.buttons[self.segment] if 0 <= self.segment < len(self.script.buttons) else 0

    def go(self) -> None:
        self.waits = False

    def begin(self, now: int) -> None:
        """Start the path at `now` [ns], unless it waits or has started."""
        if not self.waits and self._then is None:
            self._then = now

    def move(self, force: Callable[[np.ndarray], Point], now: int) -> np.ndarray:
        """Advance to `now` [ns] under a position-dependent force [N]; returns the position [m] (3)."""
        if self._then is None:
            return self.position
        left, self._then = min((now - self._then) * 1e-9, LONGEST), max(now, self._then)
        count = int(np.ceil(left / SUBSTEP)) if left > 0.0 else 0
        for _ in range(count):
            self._step(force(self.position), left / count)
        return self.position

    def _step(self, force: Point, h: float) -> None:
        arm = self.script
        if h != self._length:
            self._matrix = propagator((arm.drag + arm.damping) / arm.mass, arm.stiffness / arm.mass, h)
            self._length = h
        _, *p = path_point(self.time, self.ends, self.points, self.shapes)
        self.segment, *q = path_point(self.time + h, self.ends, self.points, self.shapes)
        for i in range(3):
            x, v = self.position[i], self.velocity[i]
            self.position[i], self.velocity[i] = advance(
                self._matrix, h, arm.mass, arm.drag, force[i], x, v, p[i], q[i], self.grip
            )
        self.time += h
