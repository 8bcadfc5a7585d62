"""A digit that a device closes on an object: commanded depth, and the force on its pad as of a measured subject."""

import math
from typing import Annotated, Any

from palpate.messages import ForceBand, Pose, Vector3
from palpate.nodes.base import SettingError, Wants
from palpate.nodes.contact.probabilistic import MeasuredSubject


class Digit(MeasuredSubject):
    """Predicted force on the pad of a digit at the commanded depth (docs/equations/probabilistic-force.md).

    The pose is that of the pad in a hand model: the position to which the device of a rehabilitation hand moves it. It
    touches a rigid object at `touch`, and closes along `closing`; the commanded depth is

        d = <(p - touch) . closing>

    the indentation of the pad, as of the rigid probe of the experiment. Beyond the measured depth the law keeps its
    value at the last depth, and `valid` is false. A grip has one node for each digit, with the `model` of its subject.
    """

    closing: Annotated[Vector3, "1"] = (0.0, 0.0, -1.0)
    touch: Annotated[Vector3, "m"] = (0.0, 0.0, 0.0)

    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        length = math.sqrt(sum(each * each for each in self.closing))
        if not (math.isfinite(length) and length > 0.0):
            raise SettingError(f"setting 'closing' [1]: found {self.closing}, expected a direction")
        x, y, z = self.closing
        self.closing = x / length, y / length, z / length

    def depth_of(self, position: Vector3) -> float:
        """Commanded depth [m] of a position [m] (3); 0 when apart."""
        (x, y, z), (a, b, c), (u, v, w) = position, self.touch, self.closing
        return max((x - a) * u + (y - b) * v + (z - c) * w, 0.0)

    def step(self, pose: Annotated[Pose, Wants("position")], *, dt: float) -> ForceBand:
        return self.force_at(self.depth_of(pose.position), pose.tick)
