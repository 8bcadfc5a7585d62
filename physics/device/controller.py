"""The controller of the display in one kernel: free motion, contact, passivity, limits.

    free     F = -Kp (x - xd) - Kd v                       xd is where the free motion began
    contact  F = f_n n - f_t - Kdc v
    then     F <- F - alpha v  while the observed energy is negative (passivity.dissipation)
    then     |F| <= limit, |F_k - F_k-1| <= slew T

Contact begins with a normal force and ends when the finger has drawn back by more than the hysteresis beyond the
point where the approach was zero. At a switch the difference of the two laws' damping and spring parts is added and
fades out, so the force is continuous.

The contact force that is shown is no stiffer than the loop allows (rendered.py). The observer, E <- E - F . dx, pairs
each way with the force of `delay` samples before, which is what the hand has really received when position or force
travels that long. At a switch a credit is dropped and a debt is kept (of at most 10 mJ, so that rounding errors do not
pile up): else each bounce of a stiff wall would leave its leak behind. A whole debt paid within one step is a blow
(0.5 mJ at 0.1 m/s: 5 N), which keeps a stiff wall stable, but after an outage would be felt: until contact ends the
force of the added damping then rises by no more than RISE.

The velocity v of that damping is the last difference of positions: it is the one that the energy is counted with, and
a filtered one comes too late for a stiff wall. A way of hardly more than one encoder count is mostly rounding, though,
and the damping would make noise of it: there the filtered velocity stands in, with less damping for its longer delay.
"""

import math

import numpy as np

from palpate.physics.device.passivity import absorbed, clamp, dissipation, slew
from palpate.physics.device.rendered import LINE, SPAN, compensation, slope, soften, stiffest
from palpate.physics.kernel import kernel

STIFFNESS, DAMPING, CONTACT_DAMPING, HYSTERESIS, MASS, DRAG, LIMIT, SLEW, RESOLUTION, OBSERVE, PASSIVE = range(11)
"""Places in the gains."""
PLACE, FORCE, IMPULSE, ANCHOR, OFFSET, LOST, ENERGY, MODE, TIMES, WALL, GAUGE, BOOKED, WAY, DRAGGED = range(14)
"""Rows of the state."""
FREE, CONTACT = 0.0, 1.0
SPEED = 3  # state[WAY] = last way booked [m], speed out of the surface [m/s]
SMOOTH = 0.5e-3  # [s] of that speed: at a high rate one count within one step is a great speed
FADE = 0.01  # [s] in which the difference of the two laws dies down after a switch
FILTER_LAG = 8e-3  # [s] for which the observer between the counts of an encoder may be off after a change of speed
RECOVERY = 10.0  # [N/s] by which the rendered force may rise without motion after an outage
CARRIED = 1e-2  # [J] largest debt carried over a switch
HEAD, STARTED = 1, 2  # state[MODE] = mode, newest place in the rings, whether there was a step before,
WITHHELD = 3  # and the part of the contact force that is withheld [1]
STILL, TOUCHING, CLOCK = range(3)  # state[TIMES] = time without movement [s], approach when last touching [m], time [s]
BRAKE, RISE = 1, 2  # state[ENERGY] = observed energy [J], force of the added damping [N], its bound [N/s] (0: none)
PUSH, STAND, WHEN = 0, 3, 6  # columns of the rings, which each begin there


def buffers(delay: int) -> tuple[np.ndarray, np.ndarray]:
    """Fresh state (14,4) and rings (delay + 1, 7) of `haptic`: forces [N] (3), places [m] (3) and their times [s]."""
    return np.zeros((14, 4)), np.zeros((delay + 1, 7))


@kernel
def fresh(state, past):
    """Make a state and rings those before the first step."""
    state[:, :] = 0.0
    past[:, :] = 0.0


@kernel
def remember(state, past, dt):
    """Take the last step into the rings `past` (d + 1, columns `PUSH` ... `WHEN`); row of the one d steps before it."""
    newest = (int(state[MODE, HEAD]) + 1) % len(past)
    state[MODE, HEAD] = newest
    for i in range(3):
        past[newest, PUSH + i], past[newest, STAND + i] = state[FORCE, i], state[PLACE, i]
    past[newest, WHEN] = state[TIMES, CLOCK]
    state[TIMES, CLOCK] += dt
    return (newest + 1) % len(past)


@kernel
def observe(state, before, x, y, z, dt, resolution):
    """Book the way since the last movement under the force in a row of the rings; the velocity (vx, vy, vz) [m/s] of
    that way.

    The force is averaged over the time without movement before it (a lost sample, or less than one encoder count). A
    way back of a single count is none: at rest between two counts it would be booked again and again, always under
    the force that answers to it.
    """
    for i in range(3):
        state[IMPULSE, i] += before[PUSH + i] * dt
    state[TIMES, STILL] += dt
    dx, dy, dz = x - state[BOOKED, 0], y - state[BOOKED, 1], z - state[BOOKED, 2]
    length2 = dx * dx + dy * dy + dz * dz
    back = dx * state[WAY, 0] + dy * state[WAY, 1] + dz * state[WAY, 2] < 0.0
    if length2 == 0.0 or (back and length2 < 1.1 * resolution * resolution):
        return 0.0, 0.0, 0.0
    elapsed = state[TIMES, STILL]
    vx, vy, vz = dx / elapsed, dy / elapsed, dz / elapsed
    state[ENERGY, 0] = absorbed(state[ENERGY, 0], state[IMPULSE, 0], state[IMPULSE, 1], state[IMPULSE, 2], vx, vy, vz)
    state[IMPULSE, :], state[TIMES, STILL] = 0.0, 0.0
    state[BOOKED, 0], state[BOOKED, 1], state[BOOKED, 2] = x, y, z
    state[WAY, 0], state[WAY, 1], state[WAY, 2] = dx, dy, dz
    return vx, vy, vz


@kernel(error_model="numpy")
def dragged(point, n, place, play):
    """How far [m] a finger at `place` [m] drags a point in the plane of normal n [1], as on a string of the length
    `play` [m]: one that slides drags it by its whole motion, one that swings by less than that does not.

    point  (4)  [m] the point; changed in place
    """
    wx, wy, wz = place[0] - point[0], place[1] - point[1], place[2] - point[2]
    along = wx * n[0] + wy * n[1] + wz * n[2]
    wx, wy, wz = wx - along * n[0], wy - along * n[1], wz - along * n[2]
    length = math.sqrt(wx * wx + wy * wy + wz * wz)
    slack = min(play / length, 1.0) if length > 0.0 else 0.0
    point[0], point[1], point[2] = place[0] - slack * wx, place[1] - slack * wy, place[2] - slack * wz
    return (1.0 - slack) * length


@kernel(error_model="numpy")
def render(gains, state, before, force, n, approach, place, lag, dt):
    """Normal force [N] to show for a contact force [N]: no stiffer than the lag [s] allows, damped for what it lags.

    before  (7)  row of the rings: where the finger was, and when
    """
    wx, wy, wz = place[0] - state[PLACE, 0], place[1] - state[PLACE, 1], place[2] - state[PLACE, 2]
    along = wx * n[0] + wy * n[1] + wz * n[2]
    sideways = 0.0
    if force > 0.0:
        sideways = dragged(state[DRAGGED], n, place, SPAN * gains[RESOLUTION])
    else:  # in air there is no plane: n is that of the last contact, or of a contact that sleeps
        state[DRAGGED, 0], state[DRAGGED, 1], state[DRAGGED, 2] = place[0], place[1], place[2]
    most = stiffest(gains[MASS], gains[DRAG], gains[RESOLUTION], lag)
    if state[ENERGY, RISE] > 0.0:  # after an outage the force also rises while the finger rests
        state[WALL, LINE] += RECOVERY * dt
    shown = soften(state[WALL], force, approach, -along, sideways, most, gains[RESOLUTION], dt)
    steepness = slope(state[GAUGE], shown, -along, SPAN * gains[RESOLUTION])
    elapsed = state[TIMES, CLOCK] - before[WHEN]
    if shown == 0.0 or not elapsed > 0.0:
        return shown, shown
    sx, sy, sz = place[0] - before[3], place[1] - before[4], place[2] - before[5]
    speed = (sx * n[0] + sy * n[1] + sz * n[2]) / elapsed
    state[WAY, SPEED] += (speed - state[WAY, SPEED]) * -math.expm1(-dt / SMOOTH)
    leaving = max(state[WAY, SPEED], 0.0)
    return shown, max(shown - compensation(min(steepness, most), lag, gains[DRAG]) * leaving, 0.0)


@kernel
def assist(gains, mode, state, i, position, velocity):
    """Component i [N] of the part of the law that is not contact: spring and damper in free motion, damper in contact.

    position [m], velocity [m/s] of that component;  gains, state as in `haptic`
    """
    if mode == FREE:
        return -gains[STIFFNESS] * (position - state[ANCHOR, i]) - gains[DAMPING] * velocity
    return -gains[CONTACT_DAMPING] * velocity


@kernel
def switch(gains, state, touching, approach, x, y, z, vx, vy, vz):
    """Change between free motion and contact where it is due; the mode, `FREE` or `CONTACT`.

    approach [m] s1 + s2;  x, y, z [m] position;  vx, vy, vz [m/s] velocity;  gains, state as in `haptic`
    """
    mode = state[MODE, 0]
    if touching:
        new = CONTACT
        state[LOST, 0], state[LOST, 1], state[LOST, 2], state[TIMES, TOUCHING] = x, y, z, approach
    elif mode == CONTACT:
        dx, dy, dz = x - state[LOST, 0], y - state[LOST, 1], z - state[LOST, 2]
        away = math.sqrt(dx * dx + dy * dy + dz * dz) > state[TIMES, TOUCHING] + gains[HYSTERESIS]
        new = FREE if away else CONTACT
    else:
        new = FREE
    if new != mode:
        position, velocity = (x, y, z), (vx, vy, vz)
        for i in range(3):
            old = assist(gains, mode, state, i, position[i], velocity[i])
            state[ANCHOR, i] = position[i]
            state[OFFSET, i] += old - assist(gains, new, state, i, position[i], velocity[i])
        whole = state[MODE, WITHHELD] == 0.0  # an outage ends no touch
        state[ENERGY, 0] = min(max(state[ENERGY, 0], -CARRIED), 0.0 if whole else state[ENERGY, 0])
        state[MODE, 0] = new
        if new == FREE and whole:
            state[ENERGY, RISE] = 0.0
    return new


@kernel(error_model="numpy")
def haptic(gains, state, past, normal_force, n, friction, approach, position, velocity, dt):
    """One step: (fx, fy, fz, in contact, energy). The state is changed in place.

    gains         (11)   Kp [N/m], Kd [N s/m], Kdc [N s/m], hysteresis [m], mass [kg], drag [N s/m], limit [N],
                         slew [N/s], resolution [m], whether the energy is observed, whether it is acted upon
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
    # 1. start: anchor, last place and all past places are where the device is
    if state[MODE, STARTED] == 0.0:
        state[MODE, STARTED] = 1.0
        for i in range(3):
            state[ANCHOR, i] = state[PLACE, i] = state[BOOKED, i] = state[DRAGGED, i] = position[i]
        for row in range(len(past)):
            for i in range(3):
                past[row, STAND + i] = position[i]
    # 2. passivity observer: the energy that the force has generated since the start, by positions
    before = past[remember(state, past, dt)]
    if gains[OBSERVE] != 0.0:
        wx, wy, wz = observe(state, before, x, y, z, dt, gains[RESOLUTION])
    lag = (len(past) - 0.5) * dt
    # 3. the tissue's force: as computed, or what the device can render without generating energy
    touching = normal_force > 0.0
    shown = damped = normal_force
    if gains[PASSIVE] != 0.0:
        shown, damped = render(gains, state, before, normal_force, n, approach, position, lag, dt)
    state[PLACE, 0], state[PLACE, 1], state[PLACE, 2] = x, y, z
    # 4. free, near or in contact; assistance of the mode, what is left of the former one fades
    mode = switch(gains, state, touching, approach, x, y, z, vx, vy, vz)
    fade = math.exp(-dt / FADE)
    fx = assist(gains, mode, state, 0, x, vx) + state[OFFSET, 0]
    fy = assist(gains, mode, state, 1, y, vy) + state[OFFSET, 1]
    fz = assist(gains, mode, state, 2, z, vz) + state[OFFSET, 2]
    for i in range(3):
        state[OFFSET, i] *= fade
    if touching:
        given = 1.0 - state[MODE, WITHHELD]
        share = given * min(shown / normal_force, 1.0)
        damped *= given
        fx += damped * n[0] - share * friction[0]
        fy += damped * n[1] - share * friction[1]
        fz += damped * n[2] - share * friction[2]
    # 5. passivity controller: a damper that takes up the generated energy, along the measured velocity w
    if gains[PASSIVE] != 0.0:
        slow = 2.0 * lag / dt  # a damper acting d samples late is stable up to about m / ((1 + 2 d) T)
        way = dt * math.sqrt(wx * wx + wy * wy + wz * wz)
        if way < 1.5 * gains[RESOLUTION]:
            wx, wy, wz, slow = vx, vy, vz, slow + FILTER_LAG / dt
            way = FILTER_LAG * math.sqrt(wx * wx + wy * wy + wz * wz)
        alpha = 0.0
        if way >= 1.5 * gains[RESOLUTION]:  # less is rounding
            alpha = dissipation(state[ENERGY, 0], dt, wx * wx + wy * wy + wz * wz, 0.5 * gains[MASS] / slow)
        if state[ENERGY, RISE] > 0.0:
            speed = math.sqrt(wx * wx + wy * wy + wz * wz)
            brake = min(alpha * speed, state[ENERGY, BRAKE] + state[ENERGY, RISE] * dt)
            alpha = brake / speed if speed > 0.0 else 0.0
            state[ENERGY, BRAKE] = brake
        fx, fy, fz = fx - alpha * wx, fy - alpha * wy, fz - alpha * wz
    # 6. limits of force and of its rate
    fx, fy, fz = clamp(fx, fy, fz, gains[LIMIT])
    fx, fy, fz = slew(fx, fy, fz, state[FORCE, 0], state[FORCE, 1], state[FORCE, 2], gains[SLEW] * dt)
    state[FORCE, 0], state[FORCE, 1], state[FORCE, 2] = fx, fy, fz
    return fx, fy, fz, mode == CONTACT, state[ENERGY, 0]
