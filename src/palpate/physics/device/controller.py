"""The controller of the haptic display in one kernel: free motion, contact, passivity, limits.

    free     F = -Kp (x - xd) - Kd v                       xd is the position at which free motion began
    contact  F = f_n n - f_t - Kdc v
    then     F <- F - alpha v  while the observed energy is negative (passivity.dissipation)
    then     |F| <= limit, |F_k - F_k-1| <= slew T

The mode changes to contact when the normal force is positive, and back to free when the finger has retreated by more
than the hysteresis beyond the point of zero approach. At a change of mode the difference of the damping and spring
terms of both laws is added to the force and fades out, so the force is continuous.

The rendered contact force is no stiffer than the loop allows (rendered.py). The passivity observer, E <- E - F . dx,
pairs each displacement with the force of `delay` samples before, the force that acted on the hand during it. At a
change of mode positive energy is discarded, and negative energy is kept (at most 10 mJ, so that rounding errors do not
accumulate); otherwise every bounce on a stiff wall would add energy.

Negative energy need not come from this controller: two fingers exchange energy through the tissue. Dissipating it
within one step would be a kick (0.5 mJ at 0.1 m/s: 5 N). So the damping force changes over a motion dx by at most
K |dx|, as a contact would, with K = 0.1 N per encoder count (with exact positions the largest rendered stiffness), and
it is at most

    sqrt(-2 K E)        the force from which it can fall to zero at that slope while it dissipates just -E

Only when the motion turns round it ends at once. After an outage and until contact ends it also rises at most at the
rate `RISE`.

The damping acts on the last difference of positions, the velocity that the observer uses; a filtered velocity lags too
much for a stiff wall. A displacement of about one encoder count is mostly rounding and would make the force noisy:
there the filtered velocity is used, with less damping because of its longer delay.
"""

import math

import numpy as np

from palpate.compiler.kernel import kernel
from palpate.physics.device.passivity import absorbed, clamp, dissipation, slew
from palpate.physics.device.rendered import LEAP, LINE, SPAN, compensation, slope, soften, stiffest

STIFFNESS, DAMPING, CONTACT_DAMPING, HYSTERESIS, MASS, DRAG, LIMIT, SLEW, RESOLUTION, OBSERVE, PASSIVE = range(11)
"""Indices of the gains."""
PLACE, FORCE, IMPULSE, ANCHOR, OFFSET, LOST, ENERGY, MODE, TIMES, WALL, GAUGE, BOOKED, WAY, DRAGGED, BRAKE = range(15)
"""Rows of the state."""
FREE, CONTACT = 0.0, 1.0
SPEED = 3  # state[WAY] = last displacement that the observer counted [m], speed out of the surface [m/s]
SMOOTH = 0.5e-3  # [s] time constant of that speed's filter: one count per step is a high speed at a high rate
FADE = 0.01  # [s] time constant with which the difference of the two laws decays after a change of mode
FILTER_LAG = 8e-3  # [s] settling time of the encoder's observer after a change of speed
RECOVERY = 10.0  # [N/s] by which the rendered force may rise without motion after an outage
CARRIED = 1e-2  # [J] largest negative energy that is kept at a change of mode
HEAD, STARTED = 1, 2  # state[MODE] = mode, index of the newest row of the rings, whether a step has been made,
WITHHELD = 3  # and the fraction of the contact force that is withheld [1]
STILL, TOUCHING, CLOCK, LAST = range(4)  # state[TIMES] = time without movement [s], approach when last touching [m],
# time [s], last step [s]
RISE = 2  # state[ENERGY] = observed energy [J], and the bound on the rise of the added damping [N/s] (0: none)
PUSH, STAND, WHEN = 0, 3, 6  # first columns of force, position and time in the rings


def buffers(delay: int) -> tuple[np.ndarray, np.ndarray]:
    """New state (15,4) and ring buffers (delay + 1, 7) of `haptic`: force [N] (3), position [m] (3) and time [s]."""
    return np.zeros((15, 4)), np.zeros((delay + 1, 7))


@kernel
def fresh(state, past):
    """Reset the state and the rings to those before the first step."""
    state[:, :] = 0.0
    past[:, :] = 0.0


@kernel
def remember(state, past, dt):
    """Append the last step to the ring `past` (d + 1, `PUSH` ... `WHEN`). Returns the row of the step d before it."""
    newest = (int(state[MODE, HEAD]) + 1) % len(past)
    state[MODE, HEAD] = newest
    for i in range(3):
        past[newest, PUSH + i], past[newest, STAND + i] = state[FORCE, i], state[PLACE, i]
    past[newest, WHEN] = state[TIMES, CLOCK]
    state[TIMES, CLOCK] += dt
    return (newest + 1) % len(past)


@kernel
def observe(state, before, x, y, z, dt, resolution):
    """Passivity observer, E <- E - F . dx over the displacement since the last movement, with the force in the row
    `before` of the rings; returns the velocity (vx, vy, vz) [m/s] of that displacement.

    The force is averaged over the time without movement before it (a lost sample, or less than one encoder count). A
    reversal by a single count is ignored: at rest between two counts it would be counted repeatedly, each time under
    the force that responds to it.
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
    """Distance [m] by which a finger at `place` [m] drags a point on a string of length `play` [m], in the plane with
    the normal n [1]. Steady sliding drags it by the whole motion; oscillations smaller than `play` do not move it.

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
    """Rendered normal force [N] for a contact force [N], without and with compensation of the lag [s], see rendered.py.

    before  (7)  row of the rings: an earlier position of the finger and its time
    """
    wx, wy, wz = place[0] - state[PLACE, 0], place[1] - state[PLACE, 1], place[2] - state[PLACE, 2]
    along = wx * n[0] + wy * n[1] + wz * n[2]
    sideways = 0.0
    if force > 0.0:
        sideways = dragged(state[DRAGGED], n, place, SPAN * gains[RESOLUTION])
    else:  # in air n is not valid: it is that of the last contact, or of a sleeping one
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
    """Component i [N] of the spring and damper terms: -Kp (x - xd) - Kd v in free motion, -Kdc v in contact.

    position [m], velocity [m/s] of that component;  gains, state as in `haptic`
    """
    if mode == FREE:
        return -gains[STIFFNESS] * (position - state[ANCHOR, i]) - gains[DAMPING] * velocity
    return -gains[CONTACT_DAMPING] * velocity


@kernel
def switch(gains, state, touching, approach, x, y, z, vx, vy, vz):
    """Update the mode; returns `FREE` or `CONTACT`.

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
        whole = state[MODE, WITHHELD] == 0.0  # an outage does not end a touch
        state[ENERGY, 0] = min(max(state[ENERGY, 0], -CARRIED), 0.0 if whole else state[ENERGY, 0])
        state[MODE, 0] = new
        if new == FREE and whole:
            state[ENERGY, RISE] = 0.0
    return new


@kernel(error_model="numpy")
def brake(gains, state, w, v, way, lag, usual, dt):
    """Force [N] (x, y, z) of the damping, see above; updates state[BRAKE].

    w      [m/s]  (3) of the last displacement, if the observer counted it in this step
    v      [m/s]  (3) filtered
    way    [m]    motion of the finger since the last step
    lag    [s]    of the loop;  usual, dt [s] usual and present step
    gains, state as in `haptic`
    """
    wx, wy, wz = w
    slow = 2.0 * lag / usual  # a damper acting d samples late is stable up to about m / ((1 + 2 d) T)
    stable = most = 0.5 * gains[MASS] / slow
    speed = math.sqrt(wx * wx + wy * wy + wz * wz)
    path = dt * speed
    if path < 1.5 * gains[RESOLUTION]:
        most = 0.5 * gains[MASS] / (slow + FILTER_LAG / dt)
        wx, wy, wz = v
        speed = math.sqrt(wx * wx + wy * wy + wz * wz)
        path = FILTER_LAG * speed
    alpha = 0.0
    if path >= 1.5 * gains[RESOLUTION]:  # smaller displacements are rounding
        alpha = dissipation(state[ENERGY, 0], dt, speed * speed, most)
    resolution = gains[RESOLUTION]
    steepest = LEAP / resolution if resolution > 0.0 else stiffest(gains[MASS], gains[DRAG], resolution, lag)
    bx, by, bz = state[BRAKE, 0], state[BRAKE, 1], state[BRAKE, 2]
    reach = steepest * way
    rise = min(reach, state[ENERGY, RISE] * dt) if state[ENERGY, RISE] > 0.0 else reach
    force = min(alpha * speed, math.sqrt(2.0 * steepest * max(-state[ENERGY, 0], 0.0)))
    force = min(force, math.sqrt(bx * bx + by * by + bz * bz) + rise)
    share = force / speed if speed > 0.0 else 0.0
    tx, ty, tz = -share * wx, -share * wy, -share * wz
    bx, by, bz = slew(tx, ty, tz, bx, by, bz, reach)
    bx, by, bz = clamp(bx, by, bz, stable / dt * speed)
    if bx * wx + by * wy + bz * wz > 0.0:  # the motion turned round
        bx, by, bz = tx, ty, tz
    state[BRAKE, 0], state[BRAKE, 1], state[BRAKE, 2] = bx, by, bz
    return bx, by, bz


@kernel(error_model="numpy")
def haptic(gains, state, past, normal_force, n, friction, approach, position, velocity, dt):
    """One step of the controller, see the equations above: (fx, fy, fz [N], in contact, E [J]). Updates the state.

    gains         (11)   Kp [N/m], Kd [N s/m], Kdc [N s/m], hysteresis [m], mass [kg], drag [N s/m], limit [N],
                         slew [N/s], resolution [m], whether the observer is on, whether the passivity control is on
    normal_force  [N]    f_n along n [1] (3)
    friction      [N]    f_t (3) of the finger on the tissue
    approach      [m]    s1 + s2
    position      [m]    (3)
    velocity      [m/s]  (3) filtered
    dt            [s]    since the last step; nothing changes if it is not positive
    The force is zero if an input is not finite.
    """
    if not 0.0 < dt < math.inf:
        return state[FORCE, 0], state[FORCE, 1], state[FORCE, 2], state[MODE, 0] == CONTACT, state[ENERGY, 0]
    x, y, z = position
    vx, vy, vz = velocity
    if not abs(x + y + z + vx + vy + vz + normal_force + approach) < math.inf:
        state[FORCE, :] = 0.0
        return 0.0, 0.0, 0.0, state[MODE, 0] == CONTACT, state[ENERGY, 0]
    wx, wy, wz = 0.0, 0.0, 0.0
    # 1. first step: set the anchor and all past positions to the present one
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
    # Ignore a single late step: its lag would lower the stiffness, and a hand at rest would lose part of its force.
    last = state[TIMES, LAST]
    usual = last if 0.0 < 3.0 * last < dt else dt
    state[TIMES, LAST] = dt
    lag = (len(past) - 0.5) * usual
    mx, my, mz = x - state[PLACE, 0], y - state[PLACE, 1], z - state[PLACE, 2]
    way = math.sqrt(mx * mx + my * my + mz * mz)
    # 3. rendered contact force: as computed, or what the device can render without generating energy
    touching = normal_force > 0.0
    shown = damped = normal_force
    if gains[PASSIVE] != 0.0:
        shown, damped = render(gains, state, before, normal_force, n, approach, position, lag, dt)
    state[PLACE, 0], state[PLACE, 1], state[PLACE, 2] = x, y, z
    # 4. mode, its spring and damper, and the decaying difference from the former mode
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
    # 5. passivity controller: a damper on the measured velocity w dissipates the generated energy
    if gains[PASSIVE] != 0.0:
        bx, by, bz = brake(gains, state, (wx, wy, wz), velocity, way, lag, usual, dt)
        fx, fy, fz = fx + bx, fy + by, fz + bz
    # 6. limits of force and of its rate
    fx, fy, fz = clamp(fx, fy, fz, gains[LIMIT])
    fx, fy, fz = slew(fx, fy, fz, state[FORCE, 0], state[FORCE, 1], state[FORCE, 2], gains[SLEW] * dt)
    state[FORCE, 0], state[FORCE, 1], state[FORCE, 2] = fx, fy, fz
    return fx, fy, fz, mode == CONTACT, state[ENERGY, 0]
