"""A simulated force sensor: the finger's force on a display without a simulated contact."""

import math
from typing import Annotated, Any, ClassVar

import numpy as np

from palpate.messages import Contact, Vector, Vector3
from palpate.nodes.base import Node, SettingError


class ForceSensor(Node):
    """Simulated sensor: a normal force interpolated linearly between given points.

    It only measures the force, so compression and indentation of its messages are 0. After the last point the force is
    constant or, with `repeat`, starts again. The default presses from 0 to 4 N and releases.
    """

    paced: ClassVar[bool] = True

    times: Annotated[Vector, "s"] = (0.0, 2.0, 3.0, 5.0)
    forces: Annotated[Vector, "N"] = (0.0, 4.0, 4.0, 0.0)
    repeat: Annotated[bool, "1"] = False
    foot: Annotated[Vector3, "m"] = (0.0, 0.0, 0.0)
    normal: Annotated[Vector3, "1"] = (0.0, 0.0, 1.0)

    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        times, forces = np.asarray(self.times), np.asarray(self.forces)
        if len(times) != len(forces) or not len(times):
            raise SettingError(
                f"settings 'times' and 'forces': found {len(times)} times and {len(forces)} forces, expected equal"
                " numbers of both, at least one"
            )
        if not (np.isfinite(times).all() and np.all(np.diff(times) > 0)):
            raise SettingError(f"setting 'times' [s]: found {self.times}, expected finite increasing times")
        if not (np.isfinite(forces).all() and np.all(forces >= 0)):
            raise SettingError(f"setting 'forces' [N]: found {self.forces}, expected finite forces >= 0")
        self.normal = direction(self.normal)

    def start(self) -> None:
        self.clock: float | None = None

    def step(self, *, dt: float) -> Contact:
        self.clock = self.times[0] if self.clock is None else self.clock + dt
        if self.repeat and self.clock > self.times[-1] > self.times[0]:
            self.clock = self.times[0] + (self.clock - self.times[0]) % (self.times[-1] - self.times[0])
        return Contact(
            foot=self.foot,
            normal=self.normal,
            force=float(np.interp(self.clock, self.times, self.forces)),
            compression=0.0,
            indentation=0.0,
            compression_rate=0.0,
            indentation_rate=0.0,
        )


def direction(normal: Vector3) -> Vector3:
    """The unit vector of a setting `normal`. SettingError: its length is zero or not finite."""
    x, y, z = normal
    length = math.sqrt(x * x + y * y + z * z)
    if not (math.isfinite(length) and length > 0.0):
        raise SettingError(f"setting 'normal' [1]: found {normal}, expected a direction")
    return x / length, y / length, z / length
