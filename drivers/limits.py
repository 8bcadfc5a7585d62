"""The safety limits of each device: the only place for these numbers. `guard.Guard` applies them to every command.

A row limits the command in the device's own terms: forces [N], or torques [N m] of its arms. All numbers are this
project's choice, so that what a user of the device does with care stays inside: no data sheet was checked for them. The
Falcon's torque is that of a motor word of 4096, at 10 000 a N m: libnifalcon converts with that factor
(FalconKinematicStamper::getForces) and has no limit there. At (0, 0, 0.11) m 0.4096 N m an arm give 7 to 17 N, which
agrees with the 9 N that the device is said to have. `tests/drivers/test_limits.py` holds each to docs/devices.md.
"""

import math
from dataclasses import dataclass

Box = tuple[tuple[float, float, float], tuple[float, float, float]]
EVERYWHERE: Box = ((-math.inf,) * 3, (math.inf,) * 3)


@dataclass(frozen=True)
class Limits:
    """Limits of one device.

    command  [N] or [N m]  largest command: of the force's length, or of each arm's torque
    power    [W]           largest power given to the hand
    speed    [m/s]         faster than this, the command goes to zero
    box      [m]           (low, high) corners in the device's frame; outside, the command goes to zero
    delay    [1]           samples at 1 kHz between a motion and the force that answers it: the controller's `delay`
    ramp     [s]           in which the command comes in after start, homing, or a break
    each     [1]           whether `command` holds for each number (torques), or for the vector's length (a force)
    silence  [s]           without an answer for longer than this the device is lost: the run ends, or waits for it
    """

    command: float
    power: float
    speed: float
    box: Box = EVERYWHERE
    delay: int = 2
    ramp: float = 0.5
    each: bool = False
    silence: float = 0.5


LIMITS = {
    "falcon": Limits(0.4096, 8.0, 1.5, ((-0.09, -0.09, 0.06), (0.09, 0.09, 0.185)), delay=3, each=True),
    "inverse3": Limits(10.0, 10.0, 2.0, delay=2),
    "rawhid": Limits(5.0, 5.0, 1.5, delay=3),
    "spacemouse": Limits(0.0, 0.0, math.inf),
}
"""By the name of the driver."""
