"""From raw samples of a device to position and velocity: glitches refused, stale stamps left out.

A sample that would need a speed above the limit is refused and the last good position kept. Where a few samples in a
row agree with one another at their new place, the device has really moved (its encoders were set anew): they are
accepted and the velocity begins again at zero.
"""

import math

import numpy as np

from palpate.physics.device.between import begin, settle
from palpate.physics.device.falcon import forward_kernel
from palpate.physics.device.velocity import FILLED, HEAD, mean_velocity, push, restart
from palpate.physics.device.window import smooth
from palpate.physics.kernel import kernel

REFUSED = 3  # place in the cursor: samples refused in a row
PATIENCE = 4  # samples that must agree before a jump is believed
BAD, TAKEN, ANEW = range(3)
SLACK = 2e-4  # [m] a few encoder counts, which must pass whatever the time between two samples


@kernel
def too_far(limit, elapsed, place, x, y, z):
    """Whether the motion from `place` [m] (3) to (x, y, z) [m] in `elapsed` [ns] is faster than `limit` [m/s]."""
    dx, dy, dz = x - place[0], y - place[1], z - place[2]
    return not math.sqrt(dx * dx + dy * dy + dz * dz) <= limit * elapsed * 1e-9 + SLACK


@kernel
def judge(cursor, times, points, limit, t, x, y, z):
    """What a sample is: BAD, TAKEN, or one with which the history begins ANEW.

    cursor  [1]   (4)      as in `velocity.push`, and the samples refused in a row
    times   [ns]  (N+2)    the filter's ring, and the stamp of the last refused sample
    points  [m]   (N+2,3)  the same
    limit   [m/s] ()       largest believable speed
    """
    head = cursor[HEAD]
    elapsed = t - times[head]
    if not abs(x + y + z) < math.inf:
        return BAD
    if cursor[FILLED] == 0:
        return ANEW
    if elapsed > 0:
        last = points[-1]
        if too_far(limit, elapsed, points[head], x, y, z):
            agrees = cursor[REFUSED] > 0 and not too_far(limit, t - times[-1], last, x, y, z)
            cursor[REFUSED] = cursor[REFUSED] + 1 if agrees else 1
            times[-1], last[0], last[1], last[2] = t, x, y, z
            if cursor[REFUSED] < PATIENCE:
                return BAD
            cursor[REFUSED] = 0
            return ANEW
        cursor[REFUSED] = 0
    return TAKEN


@kernel
def take(cursor, times, points, kind, t, x, y, z):
    """(x, y, z, vx, vy, vz, dt) after a good sample; dt is 0 where no time has passed."""
    ring, places = times[:-1], points[:-1]
    if kind == ANEW and cursor[FILLED] > 0:
        dt = (t - times[cursor[HEAD]]) * 1e-9
        restart(cursor, ring, places, t, x, y, z)
        return x, y, z, 0.0, 0.0, 0.0, dt
    dt = push(cursor, ring, places, t, x, y, z)
    head = cursor[HEAD]
    vx, vy, vz = mean_velocity(cursor, ring, places)
    return points[head, 0], points[head, 1], points[head, 2], vx, vy, vz, dt


@kernel
def between(cell, step, kind, elapsed, x, y, z):
    """A good reading, or where between the steps of the device it rests; time [ns] since the last."""
    if kind == ANEW:
        begin(cell, x, y, z)
    if kind == ANEW or not (step > 0.0 and elapsed > 0):
        return x, y, z
    return settle(cell, x, y, z, step, elapsed * 1e-9)


@kernel
def track(cursor, times, points, cell, step, limit, t, x, y, z):
    """Take one sample: (x, y, z, vx, vy, vz, dt) of the last good one; dt is 0 where the sample was not taken.

    cursor, times, points, limit  as in `judge`
    cell    [m]  (6,3)  as in `between.settle`
    step    [m]  ()     of the device's position; 0: exact
    """
    kind = judge(cursor, times, points, limit, t, x, y, z)
    if kind == BAD:
        return hold(cursor, times[:-1], points[:-1])
    x, y, z = between(cell, step, kind, t - times[cursor[HEAD]], x, y, z)
    return take(cursor, times, points, kind, t, x, y, z)


@kernel
def hold(cursor, ring, places):
    """The last good sample again, with no time gone by."""
    head = cursor[HEAD]
    vx, vy, vz = mean_velocity(cursor, ring, places)
    return places[head, 0], places[head, 1], places[head, 2], vx, vy, vz, 0.0


@kernel
def track_falcon(cursor, times, points, cell, step, geometry, limit, t, t0, t1, t2):
    """`track` for a Falcon's joint angles [rad], `cell` and `step` in rad; angles that no position has leave the last
    good one standing."""
    head = cursor[HEAD]
    ok, x, y, z = forward_kernel(geometry, t0, t1, t2, points[head, 0], points[head, 1], points[head, 2])
    if not ok:
        return hold(cursor, times[:-1], points[:-1])
    kind = judge(cursor, times, points, limit, t, x, y, z)
    if kind == BAD:
        return hold(cursor, times[:-1], points[:-1])
    a0, a1, a2 = between(cell, step, kind, t - times[head], t0, t1, t2)
    if not (a0 == t0 and a1 == t1 and a2 == t2):
        ok, sx, sy, sz = forward_kernel(geometry, a0, a1, a2, x, y, z)
        if ok:  # within half a count of the reading: at the edge of the reach there may be no place
            x, y, z = sx, sy, sz
    return take(cursor, times, points, kind, t, x, y, z)


@kernel
def pose(cursor, times, points, cell, window, ring, line, resolution, limit, t, place):
    """`track` of a place [m] (3) at the device's resolution [m], then `window.smooth`; `window`, `ring`, `line` as
    there."""
    sample = track(cursor, times, points, cell, resolution, limit, t, place[0], place[1], place[2])
    return smooth(window, ring, line, t, sample, resolution)


@kernel
def pose_falcon(cursor, times, points, cell, window, ring, line, resolution, limit, t, angles, falcon):
    """`track_falcon` of angles [rad] (3), then `window.smooth` at the resolution [m]; `falcon`: the step of the angles
    [rad] and the geometry."""
    count = falcon[0] if resolution > 0.0 else 0.0
    sample = track_falcon(cursor, times, points, cell, count, falcon[1], limit, t, angles[0], angles[1], angles[2])
    return smooth(window, ring, line, t, sample, resolution)


def buffers(order: int, x: float, y: float, z: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Empty state (cursor, times, points) of `track` for a filter of `order` differences; it holds one position [m]
    until the first good sample comes."""
    points = np.zeros((order + 2, 3))
    points[0] = x, y, z
    return np.zeros(4, dtype=np.int64), np.zeros(order + 2, dtype=np.int64), points
