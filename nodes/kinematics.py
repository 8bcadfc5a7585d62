"""Pose of the finger from the measurements of a device, and torques from the force (docs/equations/falcon.md)."""

import math
from typing import Annotated

import msgspec
import numpy as np

from palpate.compiler.fields import form
from palpate.compiler.records import array_of, floats, lend_first, put, unpacking, vector
from palpate.messages import DeviceState, Force, MessageError, Pose, Torque, Vector3
from palpate.nodes.base import ARRAY, Agrees, CompiledNode, Ideal, Out, Wants
from palpate.nodes.base.absence import PACE, gap_of, keep_pace
from palpate.nodes.base.kernels import kernel
from palpate.physics.device.average import MOST, READINGS
from palpate.physics.device.catch_up import CATCH_UP, catch_up
from palpate.physics.device.catch_up import begin as begin_to_follow
from palpate.physics.device.falcon import FALCON, HOME, Geometry
from palpate.physics.device.falcon_statics import torque_kernel
from palpate.physics.device.tracking import COUNT, SLACK, TRACK, pose, pose_falcon

ZERO = (0.0, 0.0, 0.0)
BETWEEN = Ideal("observer between counts")
geometry_of, _window_of = unpacking(Geometry), array_of(READINGS)
WRONG_DEVICE = 1  # fault: not three numbers


class _Tracker(CompiledNode):
    """Shared by both kinds of device: settings, state of the filter, and clock of the samples.

    average  number of samples of a moving average that replaces the observer between counts; 0: the observer. The
             kidney study has 8, which delays the position by 3.5 samples, the velocity by 4 (docs/equations/falcon.md)
    catch_up  largest speed, relative to the device, at which the pose moves to the device's place after an outage

    An outage is a time without samples of more than 9 ms and three usual steps, or a position that the device cannot
    have reached in one step at `speed_limit`. The pose then continues from its last place and moves to the device
    (`physics.device.catch_up`): no force jumps, and the finger does not pass through the organ in one step. Until it
    arrives, the message has the vector to the device, `behind`.
    """

    origin: Annotated[Vector3, "m", Agrees(DeviceState, Pose)] = ZERO
    speed_limit: Annotated[float, "m/s", msgspec.Meta(gt=0)] = 5.0
    resolution: Annotated[float, "m", msgspec.Meta(ge=0, le=1e-3), BETWEEN] = 0.0
    average: Annotated[int, "1", msgspec.Meta(ge=0, le=MOST)] = 0
    catch_up: Annotated[float, "m/s", msgspec.Meta(gt=0)] = 0.3

    State = {
        "track": TRACK, "window": ARRAY,
        "clock": int, "last": (3,),  # [ns] of the last sample; the last position [m]
        "known": bool, "pace": PACE, "behind": CATCH_UP,  # whether there was a sample; the time between samples
        "gap": ARRAY, "outages": int,  # [m] (3) from the pose to the device
    }  # fmt: skip
    home = ZERO

    def start(self) -> None:
        super().start()
        self.hold("window", np.zeros(self.average + 1, READINGS))
        self.hold("gap", np.zeros(3))
        track = self.own["track"]
        track["reading"] = track["pose"] = self.own["last"] = self.home

    def notes(self) -> list[str]:
        if self.known["outages"]:
            self._note_once(
                f"{type(self).__name__}: after an outage of the device the pose moved to its place at up to "
                f"{1e3 * self.catch_up:.3g} mm/s more than the speed of the hand. Until then the finger was elsewhere"
            )
        return super().notes()


@kernel
def send(own, seen, age, out):
    """Send a pose, as of `follow`, in the world frame; `age` [ns] of its sample."""
    out.delayed = age
    x, y, z, vx, vy, vz, out.dt = seen
    lend_first(out.behind, own.gap, 3 if own.behind.active else 0)
    put(own.last, (x, y, z))
    put(out.position, (x + own.origin[0], y + own.origin[1], z + own.origin[2]))
    put(out.velocity, (vx, vy, vz))


@kernel
def follow(own, seen, before, dt):
    """The pose after a step of dt [s] in which the kinematics found `seen` (x, y, z, vx, vy, vz, dt).

    before  [ns]  time of the last sample before this step

    Without an outage this is `seen`. After one it stays at the last place, and follows the device.
    """
    place = follower(own, seen, before, dt)
    if own.behind.active:
        put(floats(own.gap), (seen[0] - place[0], seen[1] - place[1], seen[2] - place[2]))
    return place


@kernel
def follower(own, seen, before, dt):
    """The pose of `follow`, without the vector to the device."""
    behind, last, stamp = own.behind, vector(own.last), own.track.stamp
    if not own.known:
        own.known = own.track.filled
        return seen
    if stamp == before:  # no new sample
        return (last[0], last[1], last[2], 0.0, 0.0, 0.0, 0.0) if behind.active else seen
    elapsed = (stamp - before) / 1e9 if stamp > before else dt
    paused = keep_pace(own.pace, elapsed)
    step = min(elapsed, own.pace.usual)
    if not behind.active:
        x, y, z = seen[0] - last[0], seen[1] - last[1], seen[2] - last[2]
        most = own.catch_up if paused else own.speed_limit
        if math.sqrt(x * x + y * y + z * z) <= most * step + SLACK:
            return seen
        begin_to_follow(behind, last[0], last[1], last[2])
        own.outages += 1
        return last[0], last[1], last[2], 0.0, 0.0, 0.0, elapsed
    x, y, z, vx, vy, vz = catch_up(behind, seen[:3], seen[3:6], own.catch_up, step)
    return x, y, z, vx, vy, vz, elapsed


@kernel
def read_clock(own, state, count, out, dt):
    """Set the clock to the time of a sample of `count` numbers. Returns whether to use the sample.

    The time is that of the message less its age, or the sum of the steps if it has none. Until the device is homed, the
    node sends the last position, at rest, and the history is cleared.
    """
    if state.homed and count != 3:
        own.fault = WRONG_DEVICE
        return False
    own.clock = state.time - state.delayed if state.time >= 0 else own.clock + round(dt * 1e9)
    if not state.homed:
        own.track.filled = False
        send(own, (own.last[0], own.last[1], own.last[2], 0.0, 0.0, 0.0, 0.0), 0, out)
    return state.homed


@kernel
def age_of(own, state):
    """Age [ns] of the last good sample: 0 in time, more if the device's message was late or its sample rejected."""
    return state.delayed + own.clock - own.track.stamp if own.track.filled else 0


class FalconKinematics(_Tracker):
    """Pose of a Novint Falcon's grip from its three driven angles.

    A sample that implies a speed above `speed_limit` is rejected unless four consecutive samples agree. After a stale
    or repeated sample the pose is unchanged, with dt = 0. `origin` is the position of the device's frame in the world.
    With a `resolution`, the motion of the grip by one encoder count, an observer estimates the angles between counts;
    0: as measured. The velocity is the last difference of the positions. With `average` both are moving averages
    instead, as in the kidney study: 8 samples, which delay the position by 3.5 samples.
    """

    resolution: Annotated[float, "m", msgspec.Meta(ge=0, le=1e-3), BETWEEN] = COUNT

    State = _Tracker.State | {"geometry": form(Geometry)}
    home = HOME

    def start(self) -> None:
        super().start()
        self.hold("geometry", FALCON.geometry)

    @kernel
    def compute(own, state: Annotated[DeviceState, Wants("joints", "homed")], out: Out[Pose], dt):
        if read_clock(own, state, state.joints.count, out, dt):
            before = own.track.stamp
            given = own.track, own.resolution, own.speed_limit, _window_of(own.window), own.clock
            seen = pose_falcon(*given, vector(state.joints.values), geometry_of(own.geometry))
            send(own, follow(own, seen, before, dt), age_of(own, state), out)

    def explain(self, fault: int, *messages: DeviceState) -> Exception:
        return MessageError(
            f"DeviceState.joints: found {len(messages[0].joints)} angles, expected 3 [rad]. "
            "For a device that reports a position use kinematics.Cartesian."
        )


class Cartesian(_Tracker):
    """Pose of a device that reports a position, with the same observer at `resolution` or moving `average`, and the
    same `speed_limit`."""

    @kernel
    def compute(own, state: Annotated[DeviceState, Wants("position", "homed")], out: Out[Pose], dt):
        if read_clock(own, state, state.position.count, out, dt):
            before = own.track.stamp
            given = own.track, own.resolution, own.speed_limit, _window_of(own.window), own.clock
            seen = pose(*given, vector(state.position.values))
            send(own, follow(own, seen, before, dt), age_of(own, state), out)

    def explain(self, fault: int, *messages: DeviceState) -> Exception:
        return MessageError(
            f"DeviceState.position: found {len(messages[0].position)} numbers, expected 3 [m]. "
            "For a device that reports the angles of a Falcon use kinematics.FalconKinematics."
        )


class FalconStatics(CompiledNode):
    """Torques of a Falcon for the commanded force: G^-T F, scaled together to the motors' limit.

    G is that of the place of the device, also while the pose follows it after an outage. Zero without a force. Without
    a pose the node sends no message, and the device releases its motors. `origin`: as in kinematics.FalconKinematics.
    """

    origin: Annotated[Vector3, "m", Agrees(DeviceState, Pose)] = ZERO

    State = {"geometry": form(Geometry)}

    def start(self) -> None:
        super().start()
        self.hold("geometry", FALCON.geometry)

    @kernel
    def compute(
        own,
        force: Annotated[Force | None, Wants("force")],
        pose: Annotated[Pose, Wants("position", "behind")],
        out: Out[Torque],
        dt,
    ):
        torques = ZERO
        if force.there:
            f, p, o, b = force.force, pose.position, own.origin, gap_of(pose)
            x, y, z = p[0] - o[0] + b[0], p[1] - o[1] + b[1], p[2] - o[2] + b[2]
            _, t0, t1, t2 = torque_kernel(geometry_of(own.geometry), f[0], f[1], f[2], x, y, z)
            torques = (t0, t1, t2)
        put(out.torques, torques)
