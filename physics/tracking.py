"""From raw samples of a device to position and velocity: glitches refused, stale stamps left out.

A sample that would need a speed above the limit is refused and the last good position kept. Where a few samples in a
row agree with one another at their new place, the device has really moved (its encoders were set anew): they are
accepted and the velocity begins again at zero.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from palpate.physics.falcon import forward_kernel
from palpate.physics.velocity import FILLED, HEAD, mean_velocity, push, restart

REFUSED = 3  # place in the cursor: samples refused in a row
PATIENCE = 4  # samples that must agree before a jump is believed
SLACK = 2e-4  # [m] a few encoder counts, which must pass whatever the time between two samples


@numba.njit(cache=True)
def too_far(limit, elapsed, place, x, y, z):
    """Whether the way from a place takes more than the limit's speed; the time is in ns."""
    dx, dy, dz = x - place[0], y - place[1], z - place[2]
    return not math.sqrt(dx * dx + dy * dy + dz * dz) <= limit * elapsed * 1e-9 + SLACK


@numba.njit(cache=True)
def track(cursor, times, points, limit, t, x, y, z):
    """Take one sample: (x, y, z, vx, vy, vz, dt) of the last good one; dt is 0 where the sample was not taken.

    cursor  [1]   (4)      as in `velocity.push`, and the samples refused in a row
    times   [ns]  (N+2)    the filter's ring, and the stamp of the last refused sample
    points  [m]   (N+2,3)  the same
    limit   [m/s] ()       largest believable speed
    """
    ring, places, last = times[:-1], points[:-1], points[-1]
    if not abs(x + y + z) < math.inf:
        return hold(cursor, ring, places)
    head = cursor[HEAD]
    elapsed = t - times[head]
    if cursor[FILLED] > 0 and elapsed > 0:
        if too_far(limit, elapsed, points[head], x, y, z):
            agrees = cursor[REFUSED] > 0 and not too_far(limit, t - times[-1], last, x, y, z)
            cursor[REFUSED] = cursor[REFUSED] + 1 if agrees else 1
            times[-1], last[0], last[1], last[2] = t, x, y, z
            if cursor[REFUSED] < PATIENCE:
                return hold(cursor, ring, places)
            restart(cursor, ring, places, t, x, y, z)
            cursor[REFUSED] = 0
            return x, y, z, 0.0, 0.0, 0.0, elapsed * 1e-9
        cursor[REFUSED] = 0
    dt = push(cursor, ring, places, t, x, y, z)
    head = cursor[HEAD]
    vx, vy, vz = mean_velocity(cursor, ring, places)
    return points[head, 0], points[head, 1], points[head, 2], vx, vy, vz, dt


@numba.njit(cache=True)
def hold(cursor, ring, places):
    """The last good sample again, with no time gone by."""
    head = cursor[HEAD]
    vx, vy, vz = mean_velocity(cursor, ring, places)
    return places[head, 0], places[head, 1], places[head, 2], vx, vy, vz, 0.0


@numba.njit(cache=True)
def track_falcon(cursor, times, points, geometry, limit, t, t0, t1, t2):
    """`track` for a Falcon's joint angles [rad]; angles that no position has leave the last good one standing."""
    head = cursor[HEAD]
    ok, x, y, z = forward_kernel(geometry, t0, t1, t2, points[head, 0], points[head, 1], points[head, 2])
    if not ok:
        return hold(cursor, times[:-1], points[:-1])
    return track(cursor, times, points, limit, t, x, y, z)


def buffers(order: int, x: float, y: float, z: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Empty state (cursor, times, points) of `track` for a filter of `order` differences; it holds one position [m]
    until the first good sample comes."""
    points = np.zeros((order + 2, 3))
    points[0] = x, y, z
    return np.zeros(4, dtype=np.int64), np.zeros(order + 2, dtype=np.int64), points
