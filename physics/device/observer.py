"""Position and velocity of a device between the counts of its encoder.

A reading in counts q is off by up to q/2, and its differences are counts divided by ever shorter ticks. This observer
works in seconds instead, so its output converges as the ticks become shorter. It has two stages.

**Rest.** Readings that stay within a band of two neighbouring counts for `REST` are replaced by their mean since they
entered it, within a count of the last one. A spring K against a hand k turns an error of the place into K/k times its
motion. The gain of a mean falls as 1/t, so a loop that the encoder keeps swinging comes to rest. Once the finger has
turned round within the band, the band may be three counts wide; a slow motion that does not turn is no rest. A reading
outside the band ends the rest, and the difference between it and the mean fades out.

**Motion.** With x the estimate and r the reading, or the mean in its place,

    x' = v,    v' = 3 w (p + w d - v),    p' = (w^2/3) d,    d = u - x

which is (3 w^2 s + w^3)/(s + w)^3 from u to x: three poles at w, no lag at constant speed, and v is the exact
derivative of x. u is the place x + v dt that the observer expects, moved into [r - q/4, r + q/4] where it is outside:
a motion that agrees with the readings feels no count. The interval is half as wide as a count's cell: a wider one lets
x lag behind a finger that turns round, which gives energy to a stiff contact. Where the expected place is m > 1 counts
from u, w grows as m^1.5: a finger that hits a wall is followed faster. p never points against the last change of the
reading. Whatever was lost before it, x is within `FAR` counts of the reading: there it goes on at the mean speed since
the last one.

F. Janabi-Sharifi, V. Hayward, C.-S. J. Chen, "Discrete-time adaptive windowing for velocity estimation", IEEE Trans.
Control Systems Technology 8 (2000) 1003-1009, for the encoder's resolution as the bound of the estimate.
"""

import math

from palpate.physics.kernel import kernel

BANDWIDTH = 400.0  # [1/s] least w
FASTEST = 8.0  # [1] largest w over the least
REST = 0.025  # [s] within the band until the mean begins to count
BLEND = 0.03  # [s] in which it replaces the reading
FADE = 0.02  # [s] in which its difference from the reading dies down after a rest
BAND, TURNED_BAND = 1.5, 2.5  # [counts] that readings of a rest span at most, before and after the finger turns round
CELL = 0.25  # [counts] from the reading within which a place agrees with it
FAR = 4.0  # [counts] at most from the reading
PLACE, SPEED, TREND, LOW, HIGH, HELD, MEAN, AWAY, LAST, WAY, TURNED = range(11)


@kernel
def begin(axis, reading):
    """Forget the past: at rest at the reading."""
    axis[:] = 0.0
    axis[PLACE] = axis[LOW] = axis[HIGH] = axis[MEAN] = axis[LAST] = reading


@kernel
def settle(axis, reading, count, dt):
    """The reading, or at rest the mean in its place, and the share [1] of the mean; arguments as of `follow`."""
    last = axis[LAST]
    if reading != last:
        way = math.copysign(1.0, reading - last)
        if way * axis[WAY] < 0.0:
            axis[TURNED] = 1.0
        axis[WAY], axis[LAST] = way, reading
    axis[AWAY] *= math.exp(-dt / FADE)
    share = min(max((axis[HELD] - REST) / BLEND, 0.0), 1.0)
    low, high = min(axis[LOW], reading), max(axis[HIGH], reading)
    if high - low > (TURNED_BAND if axis[TURNED] != 0.0 else BAND) * count:
        axis[AWAY] = min(max(axis[AWAY] + share * (axis[MEAN] - reading), -count), count)
        low, high = min(last, reading), max(last, reading)
        if high - low > BAND * count:
            low = high = reading
        axis[HELD] = axis[TURNED] = share = 0.0
        axis[MEAN] = reading
    else:
        axis[HELD] += dt
        axis[MEAN] += (reading - axis[MEAN]) * dt / axis[HELD]
        share = min(max((axis[HELD] - REST) / BLEND, 0.0), 1.0)
    axis[LOW], axis[HIGH] = low, high
    return reading + share * min(max(axis[MEAN] - reading, -count), count) + axis[AWAY], share


@kernel
def follow(axis, reading, count, dt):
    """The place after a reading, in its unit.

    axis   (11)  place x, speed v, trend p; the lowest and highest reading of the band, for how long [s] it has held
                 them, their mean, and what of a former mean's difference fades out; the last reading, the sign of its
                 last change, whether that sign has changed within the band; changed in place
    count        of the encoder, above 0
    dt     [s]   since the last reading, above 0
    """
    seen, share = settle(axis, reading, count, dt)
    x, v = axis[PLACE], axis[SPEED]
    expected = x + v * dt
    free = (1.0 - share) * CELL * count
    wanted = min(max(expected, seen - free), seen + free)
    # Implicit Euler: stable whatever the step, and x changes by v dt exactly.
    miss = abs(wanted - expected) / count
    w = BANDWIDTH * min(max(1.0, miss * math.sqrt(miss)), FASTEST)
    a, b = 3.0 * w * dt, w + w * w * dt / 3.0
    v = (v + a * (axis[TREND] + b * (wanted - x))) / (1.0 + a * (1.0 + b * dt))
    x += v * dt
    axis[TREND] += w * w / 3.0 * dt * (wanted - x)
    if axis[TREND] * axis[WAY] < 0.0:
        axis[TREND] = 0.0
    if not abs(x - reading) <= FAR * count:
        x = min(max(x, reading - FAR * count), reading + FAR * count) if abs(x) < math.inf else reading
        v = (x - axis[PLACE]) / dt
        axis[TREND] = 0.0
    axis[PLACE], axis[SPEED] = x, v
    return x
