"""From raw samples of a device to position and velocity: glitches refused, stale stamps left out.

A sample that would need a speed above the limit is refused and the last good position kept. Where a few samples in a
row agree with one another at their new place, the device has really moved (its encoders were set anew): they are
accepted and the velocity begins again at zero. So does a clock that was set back, after as many stale stamps.

Between its counts the position is the observer's (observer.py). The velocity is the last difference of positions: who
integrates it is where the position is.
"""

import math

from palpate.physics.device.falcon import COUNT, forward_kernel
from palpate.physics.device.observer import begin, follow
from palpate.physics.kernel import kernel

STAMP, FILLED, STALE, REFUSED, REFUSED_STAMP = range(5)  # of the clock
GOOD, POSE, VELOCITY, ODD = range(4)  # rows of the places: last good reading, pose, its velocity, last refused reading
PATIENCE = 4  # samples that must agree before a jump is believed
MOST_STALE = 9  # stamps in a row that do not increase before the clock counts as set back
BAD, TAKEN, ANEW = range(3)
SLACK = 2e-4  # [m] a few encoder counts, which must pass whatever the time between two samples


@kernel
def too_far(limit, elapsed, place, x, y, z):
    """Whether the motion from `place` [m] (3) to (x, y, z) [m] in `elapsed` [ns] is faster than `limit` [m/s]."""
    dx, dy, dz = x - place[0], y - place[1], z - place[2]
    return not math.sqrt(dx * dx + dy * dy + dz * dz) <= limit * elapsed * 1e-9 + SLACK


@kernel
def judge(clock, places, limit, t, x, y, z):
    """What a sample is: BAD, TAKEN, or one with which the history begins ANEW.

    clock   [1]  (5)    int64: stamp of the last good sample [ns], whether there is one, stale stamps in a row, samples
                        refused in a row, stamp of the last refused one [ns]; changed in place
    places  [m]  (4,3)  last good reading, last pose, its velocity [m/s], last refused reading; changed in place
    limit   [m/s]       largest believable speed
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
    """The last pose again, with no time gone by."""
    p, v = places[POSE], places[VELOCITY]
    return p[0], p[1], p[2], v[0], v[1], v[2], 0.0


@kernel
def take(clock, places, kind, t, reading, pose):
    """(x, y, z, vx, vy, vz, dt) after a good sample: its reading [m] (3), and the pose [m] (3) that it gives."""
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
    """Where between the counts of three encoders their readings are: the readings themselves for a count of 0."""
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
    """Take one sample: (x, y, z, vx, vy, vz, dt) of the last good one; dt is 0 where the sample was not taken.

    clock, places, limit, t  as in `judge`
    axes        (3,11) as in `observer.follow`
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
    """`pose` of a Falcon's joint angles [rad] (3), observed one by one. Angles that no position has leave the last good
    one standing."""
    last = places[GOOD]
    ok, x, y, z = forward_kernel(geometry, angles[0], angles[1], angles[2], last[0], last[1], last[2])
    kind = judge(clock, places, limit, t, x, y, z) if ok else BAD
    if kind == BAD:
        return hold(places)
    a0, a1, a2 = between(axes, kind, angles, geometry[COUNT] if resolution > 0.0 else 0.0, (t - clock[STAMP]) * 1e-9)
    seen = x, y, z
    if not (a0 == angles[0] and a1 == angles[1] and a2 == angles[2]):
        ok, sx, sy, sz = forward_kernel(geometry, a0, a1, a2, x, y, z)
        if ok:  # within a count of the reading: at the edge of the reach there may be no place
            seen = sx, sy, sz
    return take(clock, places, kind, t, (x, y, z), seen)
