"""Position and velocity between the steps of an encoder: a straight line over as many samples as lie near one.

A position that comes in steps jumps to and fro between two of them at rest, and what differences it (the damping of a
contact) makes a great speed of each jump. Over the last n samples, the most that stay within a step of the chord from
the first to the last, the line of least squares gives the place of the newest sample, never further from it than half a
step, and its velocity. At rest and in even motion n is large and a jump counts for about 4/n; where the motion bends, n
falls to 1 and the sample counts as it is.

F. Janabi-Sharifi, V. Hayward, C.-S. J. Chen, "Discrete-time adaptive windowing for velocity estimation", IEEE Trans.
Control Systems Technology 8 (2000) 1003-1009.
"""

import numpy as np

from palpate.physics.kernel import kernel

REST = 8  # [1] a window from which the velocity is taken, too
LENGTH = 16  # [1] longest window, in differences
HEAD, FILLED, WINDOW = range(3)


@kernel
def straight(ring, head, n, tolerance):
    """Whether the last n + 1 samples lie within the tolerance [m] of the chord of the first and the last."""
    size = len(ring)
    first, last = ring[(head - n) % size], ring[head]
    for i in range(1, n):
        between = ring[(head - i) % size]
        part = (between[0] - first[0]) / (last[0] - first[0])
        away = 0.0
        for j in range(1, 4):
            error = between[j] - first[j] - part * (last[j] - first[j])
            away += error * error
        if away > tolerance * tolerance:
            return False
    return True


@kernel
def settle(cursor, ring, t, x, y, z, step):
    """Take a sample: (x, y, z, vx, vy, vz, n), its place [m] and velocity [m/s] on the line, and the window n.

    cursor  (3)    int64: place of the newest sample, how many there are, the window
    ring    (m,4)  times [s], rising, and places [m] (3)
    step    [m]    of the position
    """
    size = len(ring)
    head = (cursor[HEAD] + 1) % size
    cursor[HEAD] = head
    cursor[FILLED] = min(cursor[FILLED] + 1, size)
    ring[head, 0], ring[head, 1], ring[head, 2], ring[head, 3] = t, x, y, z
    n = min(cursor[WINDOW] + 1, cursor[FILLED] - 1)
    while n > 1 and not straight(ring, head, n, step):
        n -= 1
    cursor[WINDOW] = n
    if n < 2:
        return x, y, z, 0.0, 0.0, 0.0, n
    # Least squares about the newest sample: sums of a = time and b = place, both relative to it.
    a = aa = 0.0
    b = (0.0, 0.0, 0.0)
    ab = (0.0, 0.0, 0.0)
    for i in range(1, n + 1):
        row = ring[(head - i) % size]
        s = row[0] - t
        dx, dy, dz = row[1] - x, row[2] - y, row[3] - z
        a, aa = a + s, aa + s * s
        b = (b[0] + dx, b[1] + dy, b[2] + dz)
        ab = (ab[0] + s * dx, ab[1] + s * dy, ab[2] + s * dz)
    spread = (n + 1) * aa - a * a
    vx, vy, vz = (
        ((n + 1) * ab[0] - a * b[0]) / spread,
        ((n + 1) * ab[1] - a * b[1]) / spread,
        ((n + 1) * ab[2] - a * b[2]) / spread,
    )
    m = n + 1
    half = 0.5 * step
    ex, ey, ez = (b[0] - vx * a) / m, (b[1] - vy * a) / m, (b[2] - vz * a) / m
    ex, ey, ez = min(max(ex, -half), half), min(max(ey, -half), half), min(max(ez, -half), half)
    return x + ex, y + ey, z + ez, vx, vy, vz, n


@kernel
def smooth(cursor, ring, line, t, sample, step):
    """A sample of `tracking.track`, (x, y, z, vx, vy, vz, dt), on the line; the velocity from a window of `REST` on.

    line  (7)     what `settle` told of the last sample that was taken (dt > 0), n below 0: none; changed in place
    t     [ns]    of the sample
    step  [m]     of the position; 0: exact
    """
    x, y, z, vx, vy, vz, dt = sample
    if step > 0.0 and dt > 0.0:
        line[0], line[1], line[2], line[3], line[4], line[5], line[6] = settle(cursor, ring, t * 1e-9, x, y, z, step)
    if line[6] >= REST:
        return line[0], line[1], line[2], line[3], line[4], line[5], dt
    if line[6] >= 0.0:
        return line[0], line[1], line[2], vx, vy, vz, dt
    return x, y, z, vx, vy, vz, dt


def buffers() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Empty state of `smooth`: cursor, ring and line."""
    cursor, ring, line = np.zeros(3, dtype=np.int64), np.zeros((LENGTH + 1, 4)), np.zeros(7)
    forget(cursor, line)
    return cursor, ring, line


def forget(cursor: np.ndarray, line: np.ndarray) -> None:
    """Begin anew."""
    cursor[:], line[:] = 0, -1.0
