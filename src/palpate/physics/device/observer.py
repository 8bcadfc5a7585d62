"""Position and velocity of a device between the counts of its encoder.

A reading with counts of size q has an error of up to q/2, and its difference quotient grows as ticks become shorter.
The time constants of this observer are in seconds, so its output converges for short ticks. It has two stages.

**Rest.** Readings that stay within a band of two neighbouring counts for `REST` are replaced by their mean since they
entered it, within a count of the last one. A contact of stiffness K against a hand of stiffness k amplifies a position
error by K/k. The gain of a mean falls as 1/t, so an oscillation that the encoder sustains decays. Once the finger has
reversed within the band, the band may be three counts wide; a slow motion without reversal is not rest. A reading
outside the band ends the rest, and the difference between it and the mean fades out. On a rigid body with friction a
finger that stops creeps on and slips several times: an earlier rest and a slow fade shorten this.

**Motion.** With x the estimate and r the reading, or the mean in its place,

    x' = v,    v' = 4 w (p + 3/2 w d - v),    p' = a + w^2 d,    a' = (w^3/4) d,    d = u - x

with the transfer function (6 w^2 s^2 + 4 w^3 s + w^4)/(s + w)^4 from u to x: four poles at w, no lag at constant speed
or constant acceleration, and v is the exact derivative of x. u is the predicted position x + v dt clipped to [r - q/5,
r + q/5], so the quantisation does not disturb a motion that agrees with the readings. The interval is narrower than a
count: with a wider one x would lag behind a finger that reverses, which generates energy at a stiff contact. If the
prediction is m > 1 counts from u, w grows as m^1.5, to follow an impact faster. p never opposes the last change of the
reading; if it would, and at rest, a is 0. After lost samples x is limited to `FAR` counts from the reading, and v is
the mean speed since the last one.

F. Janabi-Sharifi, V. Hayward, C.-S. J. Chen, "Discrete-time adaptive windowing for velocity estimation", IEEE Trans.
Control Systems Technology 8 (2000) 1003-1009, for the encoder's resolution as the bound of the estimate.
"""

import math

from palpate.compiler.kernel import kernel
from palpate.compiler.records import clear
from palpate.physics.arrays import Record

BANDWIDTH = 220.0  # [1/s] least w
FASTEST = 15.0  # [1] largest w over the least
REST = 0.015  # [s] time within the band after which the mean begins to replace the reading
BLEND = 0.03  # [s] time in which the mean replaces the reading completely
FADE = 0.04  # [s] time constant with which the difference of mean and reading decays after a rest
BAND, TURNED_BAND = 1.5, 2.5  # [counts] largest span of the readings of a rest, before and after a reversal
CELL = 0.2  # [counts] distance from the reading within which a position agrees with it
FAR = 4.0  # [counts] largest distance from the reading
AXIS = {
    "position": (), "speed": (), "trend": (), "acceleration": (),  # x, v, p, a
    "low": (), "high": (),  # readings of the band
    "rest": (), "average": (), "fading": (),  # [s] within the band; mean of its readings; difference of a former mean
    "last": (), "direction": (), "turned": bool,  # reading; sign of its last change; whether it changed in the band
}  # fmt: skip
"""State of an axis, in the unit of its readings."""


@kernel
def begin(axis: Record, reading: float):
    """Reset an axis to rest at a reading, in its unit."""
    clear(axis)
    axis.position = axis.low = axis.high = axis.average = axis.last = reading


@kernel
def settle(axis: Record, reading: float, count: float, dt: float):
    """Stage 1: the reading, replaced by the mean at rest, and the weight [1] of the mean; arguments as of `follow`."""
    last = axis.last
    if reading != last:
        way = math.copysign(1.0, reading - last)
        if way * axis.direction < 0.0:
            axis.turned = True
        axis.direction, axis.last = way, reading
    axis.fading *= math.exp(-dt / FADE)
    share = min(max((axis.rest - REST) / BLEND, 0.0), 1.0)
    low, high = min(axis.low, reading), max(axis.high, reading)
    if high - low > (TURNED_BAND if axis.turned else BAND) * count:
        axis.fading = min(max(axis.fading + share * (axis.average - reading), -count), count)
        low, high = min(last, reading), max(last, reading)
        if high - low > BAND * count:
            low = high = reading
        axis.rest = share = 0.0
        axis.turned = False
        axis.average = reading
    else:
        axis.rest += dt
        axis.average += (reading - axis.average) * dt / axis.rest
        share = min(max((axis.rest - REST) / BLEND, 0.0), 1.0)
    axis.low, axis.high = low, high
    return reading + share * min(max(axis.average - reading, -count), count) + axis.fading, share


@kernel
def follow(axis: Record, reading: float, count: float, dt: float):
    """The estimate x after a reading, in its unit: one implicit Euler step of both stages.

    axis        `AXIS`, changed in place
    count       of the encoder, above 0
    dt     [s]  since the last reading, above 0
    """
    seen, share = settle(axis, reading, count, dt)
    x, v = axis.position, axis.speed
    expected = x + v * dt
    free = (1.0 - share) * CELL * count
    wanted = min(max(expected, seen - free), seen + free)
    miss = abs(wanted - expected) / count
    w = BANDWIDTH * min(max(1.0, miss * math.sqrt(miss)), FASTEST)
    # Implicit Euler: stable for any step, and x changes by v dt exactly.
    a, b = 4.0 * w * dt, w * (1.5 + w * dt * (1.0 + 0.25 * w * dt))
    v = (v + a * (axis.trend + axis.acceleration * dt + b * (wanted - x))) / (1.0 + a * (1.0 + b * dt))
    x += v * dt
    axis.acceleration += 0.25 * w * w * w * dt * (wanted - x)
    axis.trend += (axis.acceleration + w * w * (wanted - x)) * dt
    if axis.trend * axis.direction < 0.0:
        axis.trend = axis.acceleration = 0.0
    axis.acceleration *= 1.0 - share
    if not abs(x - reading) <= FAR * count:
        x = min(max(x, reading - FAR * count), reading + FAR * count) if abs(x) < math.inf else reading
        v = (x - axis.position) / dt
        axis.trend = axis.acceleration = 0.0
    axis.position, axis.speed = x, v
    return x
