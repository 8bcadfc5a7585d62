"""Position and velocity of a device from its raw samples: rejects outliers and stale time stamps.

A sample that implies a speed above the limit is rejected, and the last good position is kept. If several consecutive
samples agree at a new position, the device has moved (its encoders were reset): they are accepted, and the velocity
restarts at zero. A clock that was set back is likewise accepted after several stale stamps.

The observer (observer.py) estimates the position between encoder counts. The velocity is the last difference of
positions, so that its integral is the position. A moving average (average.py) may replace both.
"""

import math

from palpate.compiler.kernel import kernel
from palpate.compiler.records import put
from palpate.physics.arrays import Array, Record, Vector3
from palpate.physics.device import average
from palpate.physics.device.falcon import forward_kernel
from palpate.physics.device.observer import AXIS, begin, follow

TRACK = {
    "filled": bool, "stamp": int, "reading": (3,),  # whether there was a good sample; its time [ns] and reading [m]
    "pose": (3,), "velocity": (3,),  # [m], [m/s] estimated from it
    "stale": int,  # consecutive stamps that did not increase
    "rejected": int, "rejected_stamp": int, "rejected_reading": (3,),  # consecutive; the last one, [ns] and [m]
    "axes": (3, AXIS),
    "window": {"count": int, "at": int},  # of `average.add`
}  # fmt: skip
"""State of a tracked device."""
PATIENCE = 4  # consecutive samples that must agree before a jump is accepted
MOST_STALE = 9  # stamps in a row that do not increase before the clock counts as set back
BAD, TAKEN, ANEW = range(3)
COUNT = 60e-6  # [m] motion of the grip of a Falcon by one encoder count, roughly
SLACK = 2e-4  # [m] a few encoder counts, allowed for any time between two samples


@kernel
def too_far(limit: float, elapsed: int, place: Array, x: float, y: float, z: float):
    """Whether the motion from `place` [m] (3) to (x, y, z) [m] in `elapsed` [ns] is faster than `limit` [m/s]."""
    dx, dy, dz = x - place[0], y - place[1], z - place[2]
    return not math.sqrt(dx * dx + dy * dy + dz * dz) <= limit * elapsed * 1e-9 + SLACK


@kernel
def judge(track: Record, limit: float, t: int, x: float, y: float, z: float):
    """Classify a sample: `BAD`, `TAKEN`, or `ANEW`, which restarts the history.

    track         `TRACK`, changed in place
    limit  [m/s]  largest plausible speed
    t      [ns]   stamp of the sample at x, y, z [m]
    """
    if not abs(x + y + z) < math.inf:
        return BAD
    if not track.filled:
        return ANEW
    elapsed = t - track.stamp
    if elapsed <= 0:
        track.stale += 1
        return ANEW if track.stale >= MOST_STALE else BAD
    track.stale = 0
    if too_far(limit, elapsed, track.reading, x, y, z):
        waited = t - track.rejected_stamp
        agrees = track.rejected > 0 and not too_far(limit, waited, track.rejected_reading, x, y, z)
        track.rejected = track.rejected + 1 if agrees else 1
        track.rejected_stamp = t
        put(track.rejected_reading, (x, y, z))
        return ANEW if track.rejected >= PATIENCE else BAD
    track.rejected = 0
    return TAKEN


@kernel
def hold(track: Record):
    """Repeat the last pose, with dt = 0."""
    p, v = track.pose, track.velocity
    return p[0], p[1], p[2], v[0], v[1], v[2], 0.0


@kernel
def take(track: Record, kind: int, t: int, reading: Vector3, pose: Vector3):
    """(x, y, z, vx, vy, vz, dt) after a good sample with its reading [m] (3) and the estimated pose [m] (3)."""
    dt = max((t - track.stamp) * 1e-9, 0.0) if track.filled else 0.0
    for i in range(3):
        moves = kind == TAKEN and dt > 0.0
        track.velocity[i] = (pose[i] - track.pose[i]) / dt if moves else 0.0
        track.reading[i], track.pose[i] = reading[i], pose[i]
    track.stamp, track.filled, track.stale, track.rejected = t, True, 0, 0
    p, v = track.pose, track.velocity
    return p[0], p[1], p[2], v[0], v[1], v[2], dt


@kernel
def between(axes: Record, kind: int, readings: Vector3, count: float, dt: float):
    """Estimates between counts for three encoder readings; the readings if `count`, the size of a count, is 0."""
    r0, r1, r2 = readings
    if not count > 0.0:
        return r0, r1, r2
    if kind == ANEW:
        begin(axes[0], r0)
        begin(axes[1], r1)
        begin(axes[2], r2)
        return r0, r1, r2
    return follow(axes[0], r0, count, dt), follow(axes[1], r1, count, dt), follow(axes[2], r2, count, dt)


@kernel
def take_average(track: Record, kind: int, t: int, reading: Vector3, window: Record):
    """`take` with the moving averages of position and velocity over the readings in `window` (`average.add`)."""
    x, y, z, vx, vy, vz = average.add(window, track.window, kind == ANEW, t * 1e-9, reading)
    dt = take(track, kind, t, reading, (x, y, z))[6]
    put(track.velocity, (vx, vy, vz))
    return x, y, z, vx, vy, vz, dt


@kernel
def pose(track: Record, resolution: float, limit: float, window: Record, t: int, place: Vector3):
    """Process one sample: (x, y, z, vx, vy, vz, dt) of the last good one; dt is 0 if the sample was rejected.

    track, limit, t    as in `judge`
    resolution  [m]    step of the device's position; 0: exact
    window             of `average.add`; with at least two rows the moving average replaces the observer
    place       [m]    (3)
    """
    kind = judge(track, limit, t, place[0], place[1], place[2])
    if kind == BAD:
        return hold(track)
    if len(window) > 1:
        return take_average(track, kind, t, place, window)
    seen = between(track.axes, kind, place, resolution, (t - track.stamp) * 1e-9)
    return take(track, kind, t, place, seen)


@kernel
def pose_falcon(
    track: Record, resolution: float, limit: float, window: Record, t: int, angles: Vector3, geometry: Record
):
    """`pose` from a Falcon's joint angles [rad] (3), each with its observer. Angles without a solution are rejected.

    An encoder count of a Falcon is taken as `COUNT` at the grip; a device with other encoders has another resolution.
    """
    last = track.reading
    ok, x, y, z = forward_kernel(geometry, angles[0], angles[1], angles[2], last[0], last[1], last[2])
    kind = judge(track, limit, t, x, y, z) if ok else BAD
    if kind == BAD:
        return hold(track)
    if len(window) > 1:
        return take_average(track, kind, t, (x, y, z), window)
    count = geometry.encoder_count * (resolution / COUNT)
    a0, a1, a2 = between(track.axes, kind, angles, count, (t - track.stamp) * 1e-9)
    seen = x, y, z
    if not (a0 == angles[0] and a1 == angles[1] and a2 == angles[2]):
        ok, sx, sy, sz = forward_kernel(geometry, a0, a1, a2, x, y, z)
        if ok:  # at the edge of the reach the estimated angles may have no solution
            seen = sx, sy, sz
    return take(track, kind, t, (x, y, z), seen)
