"""The pose of a device after an outage: it moves from its last place to the present one at a bounded speed.

While a device, its connection or its process is silent, its hand continues to move. Without this rule the finger would
then jump by the whole distance in one step, through the organ or deep into it, and damping would turn the jump into a
force spike. A place p with velocity v follows the device, which was at q - w T and moves to q with the velocity w in a
step of T. With the distance e = q - w T - p at its begin,

    u = w + e r/(1 + r T),  r = min(1/LAG, speed/|e|),      v' = (u - v)/T, |v'| <= LARGEST,      p' = v

so that it moves at most `speed` faster than the device, begins and ends without a jump of the velocity, and is exact
again after it has come within `NEAR`. From a distance d this takes about d/speed + 8 LAG. As r T/(1 + r T) < 1, it does
not pass the device in a long step either, as where few samples arrive.
"""

import math

from palpate.compiler.kernel import kernel
from palpate.compiler.records import put, vector
from palpate.physics.arrays import Record, Vector3

CATCH_UP = {"active": bool, "place": (3,), "velocity": (3,)}  # [m], [m/s]
"""State of a pose that follows the device after an outage."""
LAG = 30e-3  # [s] time constant of the approach; that of a hand that follows a pointer (device.Mouse)
LARGEST = 30.0  # [m/s²] acceleration: 30 mm/s in a step of 1 ms
NEAR = 10e-6  # [m] distance at which it has caught up; an encoder count is 60 um


@kernel
def begin(state: Record, x: float, y: float, z: float):
    """Begin at rest at the last place [m]."""
    state.active = True
    put(state.place, (x, y, z))
    put(state.velocity, (0.0, 0.0, 0.0))


@kernel
def catch_up(state: Record, at: Vector3, moves: Vector3, speed: float, dt: float):
    """(x, y, z, vx, vy, vz) [m], [m/s] after a step of dt [s] towards the device.

    at, moves  [m], [m/s] (3) its place and velocity;  speed [m/s] largest speed relative to it
    """
    p, v = vector(state.place), vector(state.velocity)
    x, y, z = at[0] - moves[0] * dt - p[0], at[1] - moves[1] * dt - p[1], at[2] - moves[2] * dt - p[2]
    away = math.sqrt(x * x + y * y + z * z)
    rate = min(1.0 / LAG, speed / away) if away > 0.0 else 1.0 / LAG
    rate /= 1.0 + rate * dt
    ax, ay, az = moves[0] + rate * x - v[0], moves[1] + rate * y - v[1], moves[2] + rate * z - v[2]
    change = math.sqrt(ax * ax + ay * ay + az * az)
    if away <= NEAR and change <= LARGEST * dt:
        state.active = False
        return at[0], at[1], at[2], moves[0], moves[1], moves[2]
    share = min(1.0, LARGEST * dt / change) if change > 0.0 else 1.0
    vx, vy, vz = v[0] + share * ax, v[1] + share * ay, v[2] + share * az
    put(state.velocity, (vx, vy, vz))
    put(state.place, (p[0] + vx * dt, p[1] + vy * dt, p[2] + vz * dt))
    q = vector(state.place)
    return q[0], q[1], q[2], vx, vy, vz
