"""The hand that holds the grip of an emulated device: the arm of `physics.device.grip`, in the machine's own time."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from palpate.physics.device.falcon import HOME
from palpate.physics.device.grip import SUBSTEP, advance, propagator, wanted

Point = tuple[float, float, float]
LONGEST = 0.25  # [s] a longer pause between two looks counts as this one


@dataclass(frozen=True)
class Script:
    """The path that a hand wants to follow, and the arm that follows it.

    points     [m]   (n+1,3)  in the device's frame
    ends       [s]   (n)      when each segment ends
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
    """A held grip. The clock of its way begins with `begin`, but not while it `waits` for `go`."""

    def __init__(self, script: Script, waits: bool = False) -> None:
        self.script, self.waits = script, waits
        self.ends = np.array(script.ends, dtype=float)
        self.points = np.array(script.points, dtype=float)
        self.shapes = np.array(script.shapes, dtype=np.int64)
        self.constants = np.array([script.mass, script.drag, script.stiffness, script.damping, 0.0, 0.0])
        self.position = self.points[0].copy()
        self.velocity = np.zeros(3)
        self.time = 0.0
        self.segment = -1
        self._then: int | None = None
        self._length = 0.0
        self._step((0.0, 0.0, 0.0), SUBSTEP)  # compiled before an answer waits for it
        self.position, self.velocity = self.points[0].copy(), np.zeros(3)
        self.time, self.segment = 0.0, -1

    @property
    def buttons(self) -> int:
        """[1] mask of the buttons that are pressed."""
        return self.script.buttons[self.segment] if 0 <= self.segment < len(self.script.buttons) else 0

    def go(self) -> None:
        self.waits = False

    def begin(self, now: int) -> None:
        """Go from here at `now` [ns], unless it waits or is on its way."""
        if not self.waits and self._then is None:
            self._then = now

    def move(self, force: Callable[[np.ndarray], Point], now: int) -> np.ndarray:
        """Advance to `now` [ns] under a force [N] that depends on the place; the position [m] (3)."""
        if self._then is None:
            return self.position
        left, self._then = min((now - self._then) * 1e-9, LONGEST), max(now, self._then)
        count = int(np.ceil(left / SUBSTEP)) if left > 0.0 else 0
        for _ in range(count):
            self._step(force(self.position), left / count)
        return self.position

    def _step(self, force: Point, h: float) -> None:
        made = self.script
        if h != self._length:
            self._matrix = propagator((made.drag + made.damping) / made.mass, made.stiffness / made.mass, h)
            self._length = h
        _, *p = wanted(self.time, self.ends, self.points, self.shapes)
        self.segment, *q = wanted(self.time + h, self.ends, self.points, self.shapes)
        for i in range(3):
            x, v = self.position[i], self.velocity[i]
            self.position[i], self.velocity[i] = advance(
                self._matrix, h, made.mass, made.drag, force[i], x, v, p[i], q[i], self.constants
            )
        self.time += h
