"""The safety limits of each device, in one place. `guard.Guard` applies them to every command.

Commands are forces [N], or torques [N m] of the device's arms. This project chose all numbers for careful use; they are
not from data sheets. The Falcon's torque is that of a motor word of 4096 at 10 000 per N m, the factor of libnifalcon
(FalconKinematicStamper::getForces), which has no limit there. At (0, 0, 0.11) m, 0.4096 N m per arm give 7 to 17 N,
consistent with the specified 9 N. A raw-HID device of joints does not state the lengths of its levers:
0.25 N m is 5 N on a lever of 0.05 m, and 15 rad/s is 1.5 m/s on one of 0.1 m. `tests/drivers/test_limits.py` compares
each number with docs/devices.md.
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
    delay    [1]           samples at 1 kHz between a motion and the resulting force: the controller's `delay`
    ramp     [s]           ramp time of the command after start, homing, or an outage
    each     [1]           whether `command` limits each number (torques), or the vector's length (a force)
    torque   [N m]         largest torque of each joint, if the device measures joints; None: `command`
    turn     [rad/s]       with a joint faster than this, the command goes to zero
    silence  [s]           time without an answer after which the device is lost: the run ends, or waits for it
    """

    command: float
    power: float
    speed: float
    box: Box = EVERYWHERE
    delay: int = 2
    ramp: float = 0.5
    each: bool = False
    torque: float | None = None
    turn: float = math.inf
    silence: float = 0.5


LIMITS = {
    "falcon": Limits(0.4096, 8.0, 1.5, ((-0.09, -0.09, 0.06), (0.09, 0.09, 0.185)), delay=3, each=True),
    "inverse3": Limits(10.0, 10.0, 2.0, delay=2),
    "rawhid": Limits(5.0, 5.0, 1.5, delay=3, torque=0.25, turn=15.0),
}
"""Limits by the name of the driver."""
