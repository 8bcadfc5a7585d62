"""Detects a finger that does not come to rest on its friction.

A bristle law is a spring along the surface as long as it sticks. A device that reports late, held by a light hand,
oscillates on a spring that is too stiff for it (`physics.device.stability`), by a bounded amount, because the law slips
at its limit. In windows of `WINDOW` s that end within `STAYS` of where they begin, the friction should be constant
or drift: the RMS of its force about the straight line of least squares is measured, and reported after `LONG` windows
in a row above `LIMIT`.
"""

import math

from palpate.compiler.kernel import ieee_kernel
from palpate.compiler.records import clear
from palpate.physics.arrays import Record, Vector3

WINDOW, LONG = 0.25, 4  # [s]; [1]
STAYS = 0.5e-3  # [m]
LIMIT = 50e-3  # [N] RMS
SUMS = {"count": int, "time": (), "square": (), "power": (), "force": (3,), "cross": (3,), "motion": (3,)}
"""Sums over the steps of a window: their number; time t [s], t², |f|², f, t f, motion [m]."""
UNREST = {"sums": SUMS, "windows": int, "worst": ()}
"""State: the present window; windows in a row; the largest RMS [N] that was reported, 0: none."""


@ieee_kernel
def watch(state: Record, force: Vector3, velocity: Vector3, dt: float):
    """Take the friction force [N] (3) and the tangential velocity [m/s] (3) of a step
    of dt [s]."""
    sums = state.sums
    t, moved = sums.count * dt, 0.0
    sums.count += 1
    sums.time += t
    sums.square += t * t
    for i in range(3):
        sums.power += force[i] * force[i]
        sums.force[i] += force[i]
        sums.cross[i] += t * force[i]
        sums.motion[i] += velocity[i] * dt
        moved += sums.motion[i] * sums.motion[i]
    if sums.count * dt >= WINDOW:
        n = float(sums.count)
        rest, spread = sums.power / n, sums.square / n - (sums.time / n) ** 2
        for i in range(3):
            mean = sums.force[i] / n
            slope = sums.cross[i] / n - mean * sums.time / n
            rest -= mean * mean + (slope * slope / spread if spread > 0.0 else 0.0)
        noise = math.sqrt(max(rest, 0.0))
        state.windows = state.windows + 1 if noise > LIMIT and moved <= STAYS * STAYS else 0
        if state.windows >= LONG:
            state.worst = max(state.worst, noise)
        clear(sums)
