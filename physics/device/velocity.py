"""Velocity from sampled positions: the mean of N backward differences over measured time stamps.

    v_k = (x_k - x_{k-N}) / (t_k - t_{k-N})

which equals N differences averaged where the stamps are even. Its response is in `velocity_response`.
"""

import numpy as np

from palpate.physics.kernel import kernel

HEAD, FILLED, STALE = 0, 1, 2


@kernel
def restart(cursor, times, points, t, x, y, z):
    """Forget the history and begin with one sample."""
    cursor[HEAD], cursor[FILLED], cursor[STALE] = 0, 1, 0
    times[0], points[0, 0], points[0, 1], points[0, 2] = t, x, y, z


@kernel
def push(cursor, times, points, t, x, y, z):
    """Take a sample into the ring buffer: time since the newest sample before it [s].

    A stamp that does not increase (a duplicate or a reordered sample) is left out and gives 0; after as many of them
    in a row as the filter is long, the clock has been set back and the history begins anew.

    cursor  [1]  (3)    int64: place of the newest sample, how many there are, stale stamps in a row
    times   [ns] (N+1)  int64
    points  [m]  (N+1,3)
    """
    length = len(times)
    if cursor[FILLED] == 0:
        restart(cursor, times, points, t, x, y, z)
        return 0.0
    head = cursor[HEAD]
    elapsed = t - times[head]
    if elapsed <= 0:
        cursor[STALE] += 1
        if cursor[STALE] >= length:
            restart(cursor, times, points, t, x, y, z)
        return 0.0
    cursor[STALE] = 0
    head = (head + 1) % length
    cursor[HEAD] = head
    cursor[FILLED] = min(cursor[FILLED] + 1, length)
    times[head], points[head, 0], points[head, 1], points[head, 2] = t, x, y, z
    return elapsed * 1e-9


@kernel
def mean_velocity(cursor, times, points):
    """(vx, vy, vz) [m/s] over the samples in the ring buffer; zero while there are fewer than two."""
    if cursor[FILLED] < 2:
        return 0.0, 0.0, 0.0
    length = len(times)
    head = cursor[HEAD]
    tail = (head - cursor[FILLED] + 1) % length
    span = (times[head] - times[tail]) * 1e-9
    return (
        (points[head, 0] - points[tail, 0]) / span,
        (points[head, 1] - points[tail, 1]) / span,
        (points[head, 2] - points[tail, 2]) / span,
    )


def buffers(order: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Empty state (cursor, times, points) of a filter of `order` differences, at least 1."""
    return np.zeros(3, dtype=np.int64), np.zeros(order + 1, dtype=np.int64), np.zeros((order + 1, 3))
