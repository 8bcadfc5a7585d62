"""The segments of a scripted path, of a hand or of the foundation of an organ."""

import math
from collections.abc import Sequence
from typing import Annotated, Literal

import msgspec
import numpy as np

from palpate.messages import Vector3
from palpate.physics.device.grip import LINEAR, MINIMUM_JERK


class Segment(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One segment of the path of a scripted hand or organ: a motion or a rest.

        {to: [0, 0, 0.10], time: 0.5}                    to a point [m], starting and ending at rest
        {to: [0, 0, 0.10], time: 0.5, shape: linear}     at constant speed
        {hold: 0.2}                                      stay [s]

    `buttons` is the mask of the buttons that are pressed during the segment.
    """

    to: Vector3 | None = None
    time: float | None = None
    shape: Literal["minimum-jerk", "linear"] | None = None
    hold: float | None = None
    buttons: Annotated[int, msgspec.Meta(ge=0, lt=2**31)] = 0

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
        """Duration [s]."""
        return self.hold if self.hold is not None else self.time or 0.0


def points_of(begin: Vector3, path: Sequence[Segment]) -> np.ndarray:
    """Start and end points [m] (n + 1,3) of the segments of a path that begins at a point [m]."""
    points, here = [begin], begin
    for segment in path:
        here = segment.to or here
        points.append(here)
    return np.array(points, float)


def ends_of(path: Sequence[Segment]) -> np.ndarray:
    """End times of the segments [s] (n)."""
    return np.cumsum([segment.duration for segment in path], dtype=float)


def shapes_of(path: Sequence[Segment]) -> np.ndarray:
    """Shapes of the segments (n), for `physics.device.grip.path_point`."""
    return np.array([LINEAR if s.shape == "linear" else MINIMUM_JERK for s in path], dtype=np.int32)
