"""The hand that holds a device which is simulated or emulated: its script, its arm, the grip."""

import math
from typing import Annotated, Literal

import msgspec
import numpy as np

from palpate.messages import Vector3
from palpate.nodes.base import Node
from palpate.physics.device.falcon import FALCON, HOME
from palpate.physics.device.grip import LINEAR, MINIMUM_JERK


class Segment(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One piece of the path that a scripted hand wants to follow: a move, or a rest.

        {to: [0, 0, 0.10], time: 0.5}                    to a point [m, world], starting and ending at rest
        {to: [0, 0, 0.10], time: 0.5, shape: linear}     at constant speed
        {hold: 0.2}                                      stay [s]

    `buttons` is the mask of the buttons pressed meanwhile.
    """

    to: Vector3 | None = None
    time: float | None = None
    shape: Literal["minimum-jerk", "linear"] | None = None
    hold: float | None = None
    buttons: int = 0

    def __post_init__(self) -> None:
        if (self.to is None) == (self.hold is None):
            raise ValueError("expected either 'to' with 'time', or 'hold'")
        if self.hold is not None and (self.time is not None or self.shape is not None):
            raise ValueError("'hold' takes neither 'time' nor 'shape'")
        if self.to is not None and self.time is None:
            raise ValueError("'to' needs 'time' [s]")
        if not (0.0 < self.duration < math.inf):
            raise ValueError(f"a duration of {self.duration} s, expected more than 0")
        if self.to is not None and not all(map(math.isfinite, self.to)):
            raise ValueError(f"'to' is {self.to}, expected finite numbers [m]")

    @property
    def duration(self) -> float:
        """How long it takes [s]."""
        return self.hold if self.hold is not None else self.time or 0.0


class HeldGrip(Node):
    """Settings of a grip and the hand that holds it with a compliant arm:

    begin     where the grip is at the start, world frame
    origin    where the device's own frame lies in the world
    mass      of grip and hand together; damping: of the device alone; hand_stiffness and hand_damping: of the arm,
              both 0 when nobody holds the grip
    """

    begin: Annotated[Vector3, "m"] = HOME
    origin: Annotated[Vector3, "m"] = (0.0, 0.0, 0.0)
    mass: Annotated[float, "kg", msgspec.Meta(gt=0)] = 0.2
    damping: Annotated[float, "N s/m", msgspec.Meta(ge=0)] = 0.2
    hand_stiffness: Annotated[float, "N/m", msgspec.Meta(ge=0)] = 500.0
    hand_damping: Annotated[float, "N s/m", msgspec.Meta(ge=0)] = 10.0

    def constants(self, resolution: float) -> np.ndarray:
        """What `grip_kernel` takes of these settings; resolution [rad] of the encoders."""
        own = self.mass, self.damping, self.hand_stiffness, self.hand_damping
        return np.array([*own, resolution, FALCON.limit])


class SimulatedOperator(HeldGrip):
    """Settings of a hand that follows a scripted path:

    path      goes on from `begin` (see Segment) and ends at rest
    speed_factor  of the speed that the path says: 2 follows it in half of the time
    """

    path: Annotated[tuple[Segment, ...], "1"] = ()
    speed_factor: Annotated[float, "1", msgspec.Meta(gt=0, le=1000)] = 1.0

    def points(self) -> np.ndarray:
        """Where the segments begin and end [m] (n + 1,3), in the device's own frame."""
        points, here = [self.begin], self.begin
        for segment in self.path:
            here = segment.to or here
            points.append(here)
        return np.array(points) - np.array(self.origin)

    def ends(self) -> np.ndarray:
        """When the segments end [s] (n)."""
        return np.cumsum([segment.duration for segment in self.path], dtype=float) / self.speed_factor

    def shapes(self) -> np.ndarray:
        return np.array([LINEAR if s.shape == "linear" else MINIMUM_JERK for s in self.path], dtype=np.int64)
