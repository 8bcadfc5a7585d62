"""Whether a finger that sticks to a surface comes to rest: the limit cycle of a light hand on the spring of friction.

A friction law that sticks is a spring k with a damper d along the surface. The position that it sees comes from an
encoder of count q through an observer, which follows a reversal only after one count, like a backlash of that width,
and it is t late: the delay of the device plus half a step, for which a force is held. For the oscillation A sin(w t) of
a hand of mass m on an arm K with the damping b the describing function of a backlash gives the force amplitude
k A (N' - j N''), with s = 1 - q/A,

    N'  = (pi/2 + arcsin s + s sqrt(1 - s^2))/pi        N'' = (2 q/(pi A)) (1 - q/(2 A))        for A > q/2
    m w^2 = K + k N'

and per radian the loop dissipates A^2/2 times

    D(A) = b w + (d - k t) w N' - k N''

The finger oscillates with the largest A at which D vanishes and above which it is positive. It rests if D > 0 for
all A.

A. Gelb, W. E. Vander Velde, Multiple-Input Describing Functions and Nonlinear System Design, McGraw-Hill 1968.
"""

import math
from typing import NamedTuple

import numpy as np

WIDEST = 300.0  # [1] largest amplitude in counts; an oscillation that is still wider has no limit in this model
RATIO = np.geomspace(0.51, WIDEST, 1500)  # A/q
_S = 1.0 - 1.0 / RATIO
IN_PHASE = (np.pi / 2 + np.arcsin(_S) + _S * np.sqrt(1.0 - _S * _S)) / np.pi
BEHIND = 2.0 / (np.pi * RATIO) * (1.0 - 0.5 / RATIO)


class HeldDevice(NamedTuple):
    """A device in a hand: mass m [kg], stiffness K [N/m] of the arm, damping b [N s/m] of hand and device, delay t [s]
    from a motion to its force, half a step included, and step q [m] of the position, 0: exact."""

    mass: float
    arm: float
    damping: float
    delay: float
    step: float


def oscillation(device: HeldDevice, spring: float, damper: float) -> float:
    """RMS [N] of the force of friction in the limit cycle of a finger that sticks; 0 if the finger rests.

    spring [N/m] > 0, damper [N s/m] >= 0 of the stick. Infinite: the oscillation grows until the finger slips. With an
    exact position only the delay can sustain it.
    """
    if device.step == 0.0:
        return math.inf if device.damping + damper - spring * device.delay < 0.0 else 0.0
    frequency = np.sqrt((device.arm + spring * IN_PHASE) / device.mass)
    dissipated = device.damping * frequency + (damper - spring * device.delay) * frequency * IN_PHASE - spring * BEHIND
    grows = np.flatnonzero(dissipated < 0.0)
    if not len(grows):
        return 0.0
    last = grows[-1]
    if last == len(RATIO) - 1:
        return math.inf
    amplitude = RATIO[last] * device.step
    return float(spring * amplitude * math.hypot(IN_PHASE[last], BEHIND[last]) / math.sqrt(2.0))


def resting_spring(device: HeldDevice, damper: float, most: float) -> float:
    """The largest spring [N/m] up to `most` with which the finger rests, to 1 %; 0 if it rests with none."""
    low, high = 0.0, most
    while high - low > 0.01 * high:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if oscillation(device, middle, damper) > 0.0 else (middle, high)
    return low
