"""The controller of the display in one kernel: free motion, contact, passivity, limits.

    free     F = -Kp (x - xd) - Kd v                       xd is where the free motion began
    contact  F = f_n n - f_t - Kdc v
    then     F <- F - alpha v  while the observed energy is negative (passivity.dissipation)
    then     |F| <= limit, |F_k - F_k-1| <= slew T

Contact begins with a normal force and ends when the finger has drawn back by more than the hysteresis beyond the
point where the approach was zero. At a switch the difference of the two laws' damping and spring parts is added and
fades out, so the force is continuous.

The observer keeps two accounts, E <- E - F . dx: one for a loop without delay, which is reported, and one that pairs
each way with the force of `delay` samples before, which is what the hand has really received when position or force
travels that long. The controller acts on the smaller one. At a switch a credit is dropped and a debt is kept (of at
most 10 mJ, so that rounding errors do not pile up): else each bounce of a stiff wall would leave its leak behind.

The velocity v of that damping is the last difference of positions: it is the one that the energy is counted with, and
a filtered one comes too late for a stiff wall. A way of hardly more than one encoder count is mostly rounding, though,
and the damping would make noise of it: there the filtered velocity stands in, with less damping for its longer delay.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from palpate.physics.passivity import absorbed, clamp, dissipation, slew

STIFFNESS, DAMPING, CONTACT_DAMPING, HYSTERESIS, MASS, LIMIT, SLEW, RESOLUTION, OBSERVE, PASSIVE = range(10)  # gains
PLACE, FORCE, IMPULSE, LAGGED, ANCHOR, OFFSET, LOST, ENERGY, MODE, TIMES = range(10)  # rows of the state
FREE, CONTACT = 0.0, 1.0
FADE = 0.01  # [s] in which the difference of the two laws dies down after a switch
FILTER_LAG = 8.0  # [1] samples, twice the delay of the velocity filter
CARRIED = 1e-2  # [J] largest debt carried over a switch
HEAD, STARTED = 1, 2  # state[MODE] = mode, place of the oldest force in the ring, whether there was a step before
# state[ENERGY] = the two accounts [J]; state[TIMES] = time without movement [s], approach when last touching [m]


def buffers(delay: int) -> tuple[np.ndarray, np.ndarray]:
    """Fresh state (10,3) and ring of past forces [N] (delay + 1, 3) of `haptic`."""
    return np.zeros((10, 3)), np.zeros((delay + 1, 3))


@numba.njit(cache=True)
def observe(state, past, x, y, z, dt):
    """Book the way since the last movement on both accounts; the velocity (vx, vy, vz) [m/s] of that way.

    The force is averaged over the time without movement before it (a lost sample, or less than one encoder count).
    """
    newest = int(state[MODE, HEAD])
    oldest = (newest + 1) % len(past)
    for i in range(3):
        past[newest, i] = state[FORCE, i]
        state[IMPULSE, i] += past[newest, i] * dt
        state[LAGGED, i] += past[oldest, i] * dt
    state[MODE, HEAD] = oldest
    state[TIMES, 0] += dt
    dx, dy, dz = x - state[PLACE, 0], y - state[PLACE, 1], z - state[PLACE, 2]
    if dx == 0.0 and dy == 0.0 and dz == 0.0:
        return 0.0, 0.0, 0.0
    vx, vy, vz = dx / state[TIMES, 0], dy / state[TIMES, 0], dz / state[TIMES, 0]
    for account, row in ((0, IMPULSE), (1, LAGGED)):
        state[ENERGY, account] = absorbed(
            state[ENERGY, account], state[row, 0], state[row, 1], state[row, 2], vx, vy, vz
        )
    state[IMPULSE, :], state[LAGGED, :], state[TIMES, 0] = 0.0, 0.0, 0.0
    return vx, vy, vz


@numba.njit(cache=True)
def assist(gains, mode, state, i, position, velocity):
    """Component i of the part of the law that is not contact: spring and damper in free motion, damper in contact."""
    if mode == FREE:
        return -gains[STIFFNESS] * (position - state[ANCHOR, i]) - gains[DAMPING] * velocity
    return -gains[CONTACT_DAMPING] * velocity


@numba.njit(cache=True)
def switch(gains, state, touching, approach, x, y, z, vx, vy, vz):
    """Change between free motion and contact where it is due; the mode."""
    mode = state[MODE, 0]
    if touching:
        new = CONTACT
        state[LOST, 0], state[LOST, 1], state[LOST, 2], state[TIMES, 1] = x, y, z, approach
    elif mode == CONTACT:
        dx, dy, dz = x - state[LOST, 0], y - state[LOST, 1], z - state[LOST, 2]
        away = math.sqrt(dx * dx + dy * dy + dz * dz) > state[TIMES, 1] + gains[HYSTERESIS]
        new = FREE if away else CONTACT
    else:
        new = FREE
    if new != mode:
        position, velocity = (x, y, z), (vx, vy, vz)
        for i in range(3):
            old = assist(gains, mode, state, i, position[i], velocity[i])
            state[ANCHOR, i] = position[i]
            state[OFFSET, i] += old - assist(gains, new, state, i, position[i], velocity[i])
        for i in range(2):
            state[ENERGY, i] = min(max(state[ENERGY, i], -CARRIED), 0.0)
        state[MODE, 0] = new
    return new


@numba.njit(cache=True)
def haptic(gains, state, past, normal_force, n, friction, approach, position, velocity, dt):
    """One step: (fx, fy, fz, in contact, energy). The state is changed in place.

    gains         (10)   Kp [N/m], Kd [N s/m], Kdc [N s/m], hysteresis [m], mass [kg], limit [N], slew [N/s],
                         resolution [m], whether the energy is observed, whether it is acted upon
    normal_force  [N]    f_n along n [1] (3)
    friction      [N]    f_t (3) of the finger on the tissue
    approach      [m]    s1 + s2
    position      [m]    (3)
    velocity      [m/s]  (3) filtered
    dt            [s]    since the last step; when it is not positive nothing changes
    An input that is not finite gives no force.
    """
    if not 0.0 < dt < math.inf:
        return state[FORCE, 0], state[FORCE, 1], state[FORCE, 2], state[MODE, 0] == CONTACT, state[ENERGY, 0]
    x, y, z = position
    vx, vy, vz = velocity
    if not abs(x + y + z + vx + vy + vz + normal_force + approach) < math.inf:
        state[FORCE, :] = 0.0
        return 0.0, 0.0, 0.0, state[MODE, 0] == CONTACT, state[ENERGY, 0]
    wx, wy, wz = 0.0, 0.0, 0.0
    if state[MODE, STARTED] == 0.0:
        state[MODE, STARTED] = 1.0
        state[ANCHOR, 0], state[ANCHOR, 1], state[ANCHOR, 2] = x, y, z
    elif gains[OBSERVE] != 0.0:
        wx, wy, wz = observe(state, past, x, y, z, dt)
    state[PLACE, 0], state[PLACE, 1], state[PLACE, 2] = x, y, z
    touching = normal_force > 0.0
    mode = switch(gains, state, touching, approach, x, y, z, vx, vy, vz)
    fade = math.exp(-dt / FADE)
    fx = assist(gains, mode, state, 0, x, vx) + state[OFFSET, 0]
    fy = assist(gains, mode, state, 1, y, vy) + state[OFFSET, 1]
    fz = assist(gains, mode, state, 2, z, vz) + state[OFFSET, 2]
    for i in range(3):
        state[OFFSET, i] *= fade
    if touching:
        fx += normal_force * n[0] - friction[0]
        fy += normal_force * n[1] - friction[1]
        fz += normal_force * n[2] - friction[2]
    if gains[PASSIVE] != 0.0:
        debt = min(state[ENERGY, 0], state[ENERGY, 1])
        lag = 2.0 * len(past) - 1.0  # a damper acting d samples late is stable up to about m / ((1 + 2 d) T)
        way = dt * math.sqrt(wx * wx + wy * wy + wz * wz)
        if way < 1.5 * gains[RESOLUTION]:
            wx, wy, wz, lag = vx, vy, vz, lag + FILTER_LAG
        alpha = dissipation(debt, dt, wx * wx + wy * wy + wz * wz, gains[MASS] / lag)
        fx, fy, fz = fx - alpha * wx, fy - alpha * wy, fz - alpha * wz
    fx, fy, fz = clamp(fx, fy, fz, gains[LIMIT])
    fx, fy, fz = slew(fx, fy, fz, state[FORCE, 0], state[FORCE, 1], state[FORCE, 2], gains[SLEW] * dt)
    state[FORCE, 0], state[FORCE, 1], state[FORCE, 2] = fx, fy, fz
    return fx, fy, fz, mode == CONTACT, state[ENERGY, 0]
