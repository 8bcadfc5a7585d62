"""Position and velocity of a device from its raw samples: rejects outliers and stale time stamps.

A sample that implies a speed above the limit is rejected, and the last good position is kept. If several consecutive
samples agree at a new position, the device has moved (its encoders were reset): they are accepted, and the velocity
restarts at zero. A clock that was set back is likewise accepted after several stale stamps.

The observer (observer.py) estimates the position between encoder counts. The velocity is the last difference of
positions, so that its integral is the position.
"""

import math

from palpate.compiler.kernel import kernel
from palpate.physics.device.falcon import COUNT, forward_kernel
from palpate.physics.device.observer import begin, follow

STAMP, FILLED, STALE, REFUSED, REFUSED_STAMP = range(5)  # of the clock
GOOD, POSE, VELOCITY, ODD = range(4)  # rows of the places: last good reading, pose, its velocity, last refused reading
PATIENCE = 4  # consecutive samples that must agree before a jump is accepted
MOST_STALE = 9  # stamps in a row that do not increase before the clock counts as set back
BAD, TAKEN, ANEW = range(3)
SLACK = 2e-4  # [m] a few encoder counts, allowed for any time between two samples


@kernel
def too_far(limit, elapsed, place, x, y, z):
    """Whether the motion from `place` [m] (3) to (x, y, z) [m] in `elapsed` [ns] is faster than `limit` [m/s]."""
    dx, dy, dz = x - place[0], y - place[1], z - place[2]
    return not math.sqrt(dx * dx + dy * dy + dz * dz) <= limit * elapsed * 1e-9 + SLACK


@kernel
def judge(clock, places, limit, t, x, y, z):
    """Classify a sample: `BAD`, `TAKEN`, or `ANEW`, which restarts the history.

    clock   [1]  (5)    int64: stamp of the last good sample [ns], whether it exists, consecutive stale stamps,
                        consecutive rejected samples, stamp of the last rejected one [ns]; changed in place
    places  [m]  (4,3)  last good reading, last pose, its velocity [m/s], last rejected reading; changed in place
    limit   [m/s]       largest plausible speed
    t       [ns]        stamp of the sample at x, y, z [m]
    """
    if not abs(x + y + z) < math.inf:
        return BAD
    if clock[FILLED] == 0:
        return ANEW
    elapsed = t - clock[STAMP]
    if elapsed <= 0:
        clock[STALE] += 1
        return ANEW if clock[STALE] >= MOST_STALE else BAD
    clock[STALE] = 0
    if too_far(limit, elapsed, places[GOOD], x, y, z):
        agrees = clock[REFUSED] > 0 and not too_far(limit, t - clock[REFUSED_STAMP], places[ODD], x, y, z)
        clock[REFUSED] = clock[REFUSED] + 1 if agrees else 1
        clock[REFUSED_STAMP] = t
        places[ODD, 0], places[ODD, 1], places[ODD, 2] = x, y, z
        return ANEW if clock[REFUSED] >= PATIENCE else BAD
    clock[REFUSED] = 0
    return TAKEN


@kernel
def hold(places):
    """Repeat the last pose, with dt = 0."""
    p, v = places[POSE], places[VELOCITY]
    return p[0], p[1], p[2], v[0], v[1], v[2], 0.0


@kernel
def take(clock, places, kind, t, reading, pose):
    """(x, y, z, vx, vy, vz, dt) after a good sample with its reading [m] (3) and the estimated pose [m] (3)."""
    dt = max((t - clock[STAMP]) * 1e-9, 0.0) if clock[FILLED] else 0.0
    for i in range(3):
        moves = kind == TAKEN and dt > 0.0
        places[VELOCITY, i] = (pose[i] - places[POSE, i]) / dt if moves else 0.0
        places[GOOD, i], places[POSE, i] = reading[i], pose[i]
    clock[STAMP], clock[FILLED], clock[STALE], clock[REFUSED] = t, 1, 0, 0
    p, v = places[POSE], places[VELOCITY]
    return p[0], p[1], p[2], v[0], v[1], v[2], dt


@kernel
def between(axes, kind, readings, count, dt):
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
def pose(clock, places, axes, resolution, limit, t, place):
    """Process one sample: (x, y, z, vx, vy, vz, dt) of the last good one; dt is 0 if the sample was rejected.

    clock, places, limit, t  as in `judge`
    axes        (3,12) as in `observer.follow`
    resolution  [m]    step of the device's position; 0: exact
    place       [m]    (3)
    """
    kind = judge(clock, places, limit, t, place[0], place[1], place[2])
    if kind == BAD:
        return hold(places)
    seen = between(axes, kind, place, resolution, (t - clock[STAMP]) * 1e-9)
    return take(clock, places, kind, t, place, seen)


@kernel
def pose_falcon(clock, places, axes, resolution, limit, t, angles, geometry):
    """`pose` from a Falcon's joint angles [rad] (3), each with its observer. Angles without a solution are rejected."""
    last = places[GOOD]
    ok, x, y, z = forward_kernel(geometry, angles[0], angles[1], angles[2], last[0], last[1], last[2])
    kind = judge(clock, places, limit, t, x, y, z) if ok else BAD
    if kind == BAD:
        return hold(places)
    a0, a1, a2 = between(axes, kind, angles, geometry[COUNT] if resolution > 0.0 else 0.0, (t - clock[STAMP]) * 1e-9)
    seen = x, y, z
    if not (a0 == angles[0] and a1 == angles[1] and a2 == angles[2]):
        ok, sx, sy, sz = forward_kernel(geometry, a0, a1, a2, x, y, z)
        if ok:  # at the edge of the reach the estimated angles may have no solution
            seen = sx, sy, sz
    return take(clock, places, kind, t, (x, y, z), seen)
