"""From what a device measures to the pose of the finger, and from force to torque (docs/equations/falcon.md)."""

from typing import Annotated

import msgspec

from palpate.messages import DeviceState, Force, MessageError, Pose, Torque, Vector3
from palpate.nodes.base import Node, Wants
from palpate.physics.device import observer
from palpate.physics.device.falcon import FALCON, HOME
from palpate.physics.device.falcon_statics import torque_kernel
from palpate.physics.device.tracking import FILLED, buffers, pose, pose_falcon
from palpate.physics.entry_point import entry_point

ZERO = (0.0, 0.0, 0.0)


class _Tracker(Node):
    """What both kinds of device share: settings, the filter's state, and the clock of the samples."""

    origin: Annotated[Vector3, "m"] = ZERO
    speed_limit: Annotated[float, "m/s", msgspec.Meta(gt=0)] = 5.0
    resolution: Annotated[float, "m", msgspec.Meta(ge=0)] = 0.0

    def _reset(self, home: Vector3) -> None:
        self.filter = *buffers(*home), observer.buffers()
        self.clock = 0
        self.last = home

    def _stamp(self, state: DeviceState, dt: float) -> int:
        """Time of the sample [ns]: the message's own, or the sum of the steps where it brings none."""
        self.clock = state.time if state.time >= 0 else self.clock + round(dt * 1e9)
        return self.clock

    def _pose(self, x: float, y: float, z: float, vx: float, vy: float, vz: float, dt: float) -> Pose:
        self.last = x, y, z
        ox, oy, oz = self.origin
        return Pose(position=(x + ox, y + oy, z + oz), velocity=(vx, vy, vz), dt=dt)

    def _lost(self) -> Pose:
        """The last position at rest, while the device does not know where it is; then the history begins anew."""
        self.filter[0][FILLED] = 0
        return self._pose(*self.last, 0.0, 0.0, 0.0, 0.0)


class FalconKinematics(_Tracker):
    """Pose of a Novint Falcon's grip from its three driven angles.

    A sample that would need more than `speed_limit` is refused, unless four in a row agree. A stale or doubled sample
    leaves the pose as it was, with dt = 0. `origin` is where the device's frame lies in the world. With a `resolution`
    (one encoder count at the grip, about) an observer finds the angles between their counts; 0: as measured. The
    velocity is the last difference of the positions.
    """

    resolution: Annotated[float, "m", msgspec.Meta(ge=0)] = 60e-6

    def start(self) -> None:
        self.falcon = FALCON.count, FALCON.geometry
        self._reset(HOME)
        self._follow = entry_point(pose_falcon, *self.filter, 0.0, 0.0, 0, ZERO, self.falcon)

    def step(self, state: Annotated[DeviceState, Wants("joints", "homed")], *, dt: float) -> Pose:
        time = self._stamp(state, dt)
        if not state.homed:
            return self._lost()
        if len(state.joints) != 3:
            raise MessageError(
                f"DeviceState.joints: found {len(state.joints)} angles, expected 3 [rad]. "
                "For a device that reports a position use kinematics.Cartesian."
            )
        return self._pose(
            *self._follow(*self.filter, self.resolution, self.speed_limit, time, state.joints, self.falcon)
        )


class Cartesian(_Tracker):
    """Pose of a device that reports a position: the same observer, at `resolution`, and the same refusal of impossible
    speeds."""

    def start(self) -> None:
        self._reset(ZERO)
        self._follow = entry_point(pose, *self.filter, 0.0, 0.0, 0, ZERO)

    def step(self, state: Annotated[DeviceState, Wants("position", "homed")], *, dt: float) -> Pose:
        time = self._stamp(state, dt)
        if not state.homed:
            return self._lost()
        if len(state.position) != 3:
            raise MessageError(
                f"DeviceState.position: found {len(state.position)} numbers, expected 3 [m]. "
                "For a device that reports the angles of a Falcon use kinematics.FalconKinematics."
            )
        return self._pose(*self._follow(*self.filter, self.resolution, self.speed_limit, time, state.position))


class FalconStatics(Node):
    """Torques that make a Falcon push with the commanded force: G^-T F, scaled as a whole to the motors' limit.

    Zero without a force; without a pose it is silent, and the device lets go. `origin` is the same as in
    kinematics.FalconKinematics.
    """

    origin: Annotated[Vector3, "m"] = ZERO

    def start(self) -> None:
        self.geometry = FALCON.geometry
        self._torque = entry_point(torque_kernel, self.geometry, *ZERO, *ZERO)

    def step(self, force: Annotated[Force | None, Wants("force")], pose: Annotated[Pose, Wants("position")]) -> Torque:
        if force is None:
            return Torque(torques=ZERO)
        x, y, z = pose.position
        ox, oy, oz = self.origin
        _, t0, t1, t2 = self._torque(self.geometry, *force.force, x - ox, y - oy, z - oz)
        return Torque(torques=(t0, t1, t2))
