"""A simulated device and the simulated hand that holds it."""

from __future__ import annotations

import math
from collections import deque
from typing import Annotated, Any, Literal

import msgspec
import numpy as np

from palpate.messages import DeviceState, Torque, Vector3
from palpate.nodes.base import Node, SettingError
from palpate.physics.device.falcon import FALCON, HOME, reachable
from palpate.physics.device.grip import CLOCK, LINEAR, MINIMUM_JERK, POSITION, grip_kernel

GLITCH = 1000 * FALCON.count  # [rad]


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


class Simulated(Node):
    """A Falcon held by a hand that follows a scripted path, with an arm that gives way (docs/equations/controller.md).

    It reports what a real one would: driven angles in whole encoder counts. Torques work on the grip through the same
    geometry; without a torque there is none. The weight is balanced. Settings:

    begin     first point of the path, world frame; `path` goes on from there (see Segment) and ends at rest
    origin    where the device's own frame lies in the world
    mass      of grip and hand together; damping: of the device alone; hand_stiffness and hand_damping: of the arm,
              both 0 when nobody holds the grip
    delay     samples by which reports are late; lost: chance that a report repeats the one before; glitches: chance
              that one angle is off by 1000 counts for one report. The same seed gives the same bad days
    """

    paced = True
    sink = True

    begin: Annotated[Vector3, "m"] = HOME
    path: Annotated[tuple[Segment, ...], "1"] = ()
    origin: Annotated[Vector3, "m"] = (0.0, 0.0, 0.0)
    mass: Annotated[float, "kg", msgspec.Meta(gt=0)] = 0.2
    damping: Annotated[float, "N s/m", msgspec.Meta(ge=0)] = 0.2
    hand_stiffness: Annotated[float, "N/m", msgspec.Meta(ge=0)] = 500.0
    hand_damping: Annotated[float, "N s/m", msgspec.Meta(ge=0)] = 10.0
    resolution: Annotated[float, "rad", msgspec.Meta(ge=0)] = FALCON.count
    delay: Annotated[int, "1", msgspec.Meta(ge=0, le=1000)] = 0
    lost: Annotated[float, "1", msgspec.Meta(ge=0, le=1)] = 0.0
    glitches: Annotated[float, "1", msgspec.Meta(ge=0, le=1)] = 0.0
    seed: Annotated[int, "1", msgspec.Meta(ge=0)] = 0

    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        self._reach("begin", self.begin)
        for i, segment in enumerate(self.path):
            if segment.to is not None:
                self._reach(f"path[{i}].to", segment.to)

    def _reach(self, name: str, point: Vector3) -> None:
        inside = tuple(p - o for p, o in zip(point, self.origin, strict=True))
        if not reachable(FALCON.geometry, *inside):
            raise SettingError(
                f"setting {name!r} [m]: found {point}, {inside} from the device's origin, which is out of its reach. "
                f"Points near {HOME} from its origin work; 'origin' places the device in the world."
            )

    def start(self) -> None:
        self.geometry = FALCON.geometry
        self.constants = np.array(
            [self.mass, self.damping, self.hand_stiffness, self.hand_damping, self.resolution, FALCON.limit]
        )
        self.ends = np.cumsum([s.duration for s in self.path], dtype=float)
        self.points = np.array([self.begin, *self._ways()]) - np.array(self.origin)
        self.shapes = np.array([LINEAR if s.shape == "linear" else MINIMUM_JERK for s in self.path], dtype=np.int64)
        self.state, self.memory = np.zeros((3, 3)), np.zeros((4, 3))
        self.state[POSITION] = self.points[0]
        self.random = np.random.Generator(np.random.PCG64(self.seed))
        first = self._move((0.0, 0.0, 0.0), 0.0)
        self.reports = deque([first] * (self.delay + 1), maxlen=self.delay + 1)
        self.last = first

    def _ways(self) -> list[Vector3]:
        points, here = [], self.begin
        for segment in self.path:
            here = segment.to or here
            points.append(here)
        return points

    def _move(self, torques: Vector3, dt: float) -> tuple[float, float, float]:
        return grip_kernel(
            self.geometry, self.constants, self.state, self.memory, self.ends, self.points, self.shapes, *torques, dt
        )

    def step(self, torque: Torque | None, *, dt: float) -> DeviceState:
        self.reports.append(self._move(torque.torques if torque is not None else (0.0, 0.0, 0.0), dt))
        if not self.lost or self.random.random() >= self.lost:
            self.last = self.reports[0]
        joints = self.last
        if self.glitches and self.random.random() < self.glitches:
            joints = (joints[0] + GLITCH, joints[1], joints[2])
        return DeviceState(joints=joints, buttons=self.path[int(self.state[CLOCK, 1])].buttons if self.path else 0)
