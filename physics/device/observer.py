"""Position and velocity of a device between the counts of its encoder.

A reading that comes in counts q is off by up to q/2, and its differences are counts divided by ever shorter ticks. This
observer works in seconds instead, so that its output converges as the ticks become shorter. With u the place that the
reading asks for and d = u - x,

    x' = v,    v' = 3 w (p + w d - v),    p' = (w^2/3) d

which is (3 w^2 s + w^3)/(s + w)^3 from u to x: three poles at w, no lag at constant speed, and v is the exact
derivative of x. What u is depends on whether the finger moves or rests:

    moves   the place that the observer expects, moved into the cell [r - q/2, r + q/2] of the reading r where it is
            outside: as long as the reading agrees, there is no error, and no count is felt
    rests   the line of least squares through all readings since the first that lies within `BAND` counts of it

A finger rests once its readings have stayed on one line for `REST` that rises by less than a count; or have swung
about any line, more often than a hand can: then the loop vibrates, and they may go on to lie `WIDE` counts away. From
then on the line yields only to readings that leave it, and slowly, because a spring K against a hand k turns an error
of x into K/k times its motion: that loop is stable only if the line is slower than the hand. p never points against
the last change of the reading: within a count the finger may have turned, but only a count shows it. w grows with
|d|/q above 1, and farther than `LOST` counts from the reading x begins anew at it.

F. Janabi-Sharifi, V. Hayward, C.-S. J. Chen, "Discrete-time adaptive windowing for velocity estimation", IEEE Trans.
Control Systems Technology 8 (2000) 1003-1009, for the line with the encoder's resolution as its bound.
"""

import math

import numpy as np

from palpate.physics.kernel import kernel

BANDWIDTH = 400.0  # [1/s] least w
FASTEST = 4.0  # [1] largest w over the least
REST = 0.1  # [s]
BLEND = 0.01  # [s] in which u goes from the reading to the line
BAND, WIDE = 1.25, 6.0  # [counts] from the line, at rest and while the loop vibrates
LOST = 50.0  # [counts] from the reading, where the observer begins anew
REVERSALS = 4.0  # within `REST` that make a vibration: 20 Hz
PULL, TURN = 4.5, 30.0  # [1/s], [1/s^2] gains of the line's place and slope at rest
STOP = 5.0  # [1/s] decay of the slope at rest, where nothing vibrates
PLACE, SPEED, TREND, LINE, SLOPE, HELD, SHARE, LAST, WAY, TURNS, WIDTH = range(11)


@kernel
def begin(axis, reading):
    """Forget the past: at rest at the reading."""
    axis[:] = 0.0
    axis[PLACE] = axis[LINE] = axis[LAST] = reading


@kernel
def rest_line(axis, reading, count, dt):
    """Take a reading into the line of rest: its place, and its share [1]; arguments as of `follow`."""
    if reading != axis[LAST]:
        way = math.copysign(1.0, reading - axis[LAST])
        axis[TURNS] += way * axis[WAY] < 0.0
        axis[WAY], axis[LAST] = way, reading
    axis[HELD] += dt
    line = axis[LINE] + axis[SLOPE] * dt
    error = reading - line
    rests = axis[SHARE] > 0.0
    width = axis[WIDTH]
    if not rests:
        width = WIDE if axis[TURNS] >= REVERSALS * axis[HELD] / REST - 1.0 else BAND
    if not abs(error) <= width * count:
        axis[LINE], axis[SLOPE] = reading, axis[TREND]
        axis[HELD] = axis[SHARE] = axis[TURNS] = axis[WIDTH] = 0.0
    elif rests:
        error -= min(max(error, -0.5 * count), 0.5 * count)
        axis[LINE] = line + min(PULL * dt, 1.0) * error
        axis[SLOPE] += min(TURN * dt, 1.0 / dt) * error
        if width == BAND:
            axis[SLOPE] *= math.exp(-STOP * dt)
        axis[SHARE] = min(axis[SHARE] + dt / BLEND, 1.0)
    else:  # least squares over n readings
        n = axis[HELD] / dt + 1.0
        axis[LINE] = line + min((4.0 * n - 2.0) / (n * (n + 1.0)), 1.0) * error
        axis[SLOPE] += min(6.0 / (n * (n + 1.0)), 1.0) * error / dt
        axis[WIDTH] = max(axis[WIDTH], abs(error) / count)
        if axis[HELD] >= REST:
            still = axis[WIDTH] <= BAND and abs(axis[SLOPE]) * REST < count  # no motion that the encoder shows
            if still or axis[TURNS] >= REVERSALS - 1.0:
                axis[SHARE], axis[WIDTH], axis[SLOPE] = min(dt / BLEND, 1.0), BAND if still else WIDE, 0.0
            else:
                axis[HELD] = axis[TURNS] = axis[WIDTH] = 0.0
    return axis[LINE], axis[SHARE]


@kernel
def follow(axis, reading, count, dt):
    """The place after a reading, in its unit.

    axis   (11)  place x, speed v, trend p; the line's place and slope, for how long [s] the readings have stayed on it,
                 its share [1] in u; the last reading, the sign of its last change, changes of that sign, and how far
                 [counts] readings lie from the line; changed in place
    count        of the encoder, above 0
    dt     [s]   since the last reading, above 0
    """
    line, share = rest_line(axis, reading, count, dt)
    x, v = axis[PLACE], axis[SPEED]
    expected = x + v * dt
    wanted = min(max(expected, reading - 0.5 * count), reading + 0.5 * count)
    wanted += share * (line - wanted)
    # Implicit Euler: stable whatever the step, and x changes by v dt exactly.
    w = BANDWIDTH * min(max(1.0, abs(wanted - expected) / count), FASTEST)
    a, b = 3.0 * w * dt, w + w * w * dt / 3.0
    v = (v + a * (axis[TREND] + b * (wanted - x))) / (1.0 + a * (1.0 + b * dt))
    x += v * dt
    axis[PLACE], axis[SPEED] = x, v
    axis[TREND] += w * w / 3.0 * dt * (wanted - x)
    if axis[TREND] * axis[WAY] < 0.0:
        axis[TREND] = 0.0
    if not abs(x - reading) <= LOST * count:
        begin(axis, reading)
    return axis[PLACE]


def buffers() -> np.ndarray:
    """Fresh state (3,11) of three axes."""
    return np.zeros((3, 11))
