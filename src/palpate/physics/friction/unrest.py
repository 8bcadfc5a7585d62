"""Detects a finger that does not come to rest on its friction.

A bristle law is a spring along the surface as long as it sticks. A device that reports late, held by a light hand,
oscillates on a spring that is too stiff for it (`physics.device.stability`), by a bounded amount, because the law slips
at its limit. In windows of `WINDOW` s that end within `STAYS` of where they begin, the friction should be constant
or drift: the RMS of its force about the straight line of least squares is measured, and reported after `LONG` windows
in a row above `LIMIT`.
"""

import math

from palpate.compiler.kernel import kernel

WINDOW, LONG = 0.25, 4  # [s]; [1]
STAYS = 0.5e-3  # [m]
LIMIT = 50e-3  # [N] RMS
COUNT, TIME, SQUARE, POWER, PULL, CROSS, MOVED, WINDOWS, WORST = 0, 1, 2, 3, 4, 7, 10, 13, 14
ROOM = 15
"""Indices and size of the state: number of steps; sums of time t [s], of t², of |f|², of f (3), of t f (3), of the
motion [m] (3); windows in a row; the largest RMS [N] that was reported, 0: none."""


@kernel(error_model="numpy")
def watch(state, force, velocity, dt):
    """Take the friction force [N] (3) and the tangential velocity [m/s] (3) of a step
    of dt [s]."""
    t, moved = state[COUNT] * dt, 0.0
    state[COUNT] += 1.0
    state[TIME] += t
    state[SQUARE] += t * t
    for i in range(3):
        state[POWER] += force[i] * force[i]
        state[PULL + i] += force[i]
        state[CROSS + i] += t * force[i]
        state[MOVED + i] += velocity[i] * dt
        moved += state[MOVED + i] * state[MOVED + i]
    if state[COUNT] * dt >= WINDOW:
        n = state[COUNT]
        rest, spread = state[POWER] / n, state[SQUARE] / n - (state[TIME] / n) ** 2
        for i in range(3):
            mean = state[PULL + i] / n
            slope = state[CROSS + i] / n - mean * state[TIME] / n
            rest -= mean * mean + (slope * slope / spread if spread > 0.0 else 0.0)
        noise = math.sqrt(max(rest, 0.0))
        state[WINDOWS] = state[WINDOWS] + 1.0 if noise > LIMIT and moved <= STAYS * STAYS else 0.0
        if state[WINDOWS] >= LONG:
            state[WORST] = max(state[WORST], noise)
        _begin(state)


@kernel
def _begin(state):
    for i in range(WINDOWS):
        state[i] = 0.0
