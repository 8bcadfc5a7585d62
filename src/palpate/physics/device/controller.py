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
change of mode positive energy is discarded, and negative energy is kept; otherwise every bounce on a stiff wall would
add energy.

Negative energy need not come from this controller: another finger, or an organ that moves, may push the hand out
through the tissue. Where something else moves the tissue (`driven`), the controller counts what it has generated, the
work of the force A that the contact asks for less that of the force on the hand,

    G <- G + (F - A) . dx,    E >= min(0, -G)

with A = f_n n - f_t at the end of dx, n the mean of both ends. Fingertip, tissue and friction are passive together, so
that energy below -G has been put in by something else: the hand may have it. The work of the damping reduces G, and a
change of mode sets it to the negative energy that is left. Without `driven` all negative energy counts, also that of a
body that is not passive.

Dissipating energy within one step would be a kick (0.5 mJ at 0.1 m/s: 5 N). So the damping force changes over a motion
dx by at most K |dx|, as the contact does: K is the largest slope of its force so far, at most 0.1 N per encoder count
and the largest rendered stiffness, which it is where no slope is known, and after an outage, in which the force returns
without motion. With exact positions that stiffness is 400 kN/m at 10 kHz, and the damping would be a kick.
The force is at most

    sqrt(-2 K E)        from which it can fall to zero at that slope while it dissipates just -E

Only when the motion turns round it ends at once. After an outage and until contact ends it also rises at most at the
rate `rise`.

The observer counts the motion of the hand. After an outage the position follows the device; this motion raises the
contact's force, but no hand does its work, so only the place of the device counts.

The damping acts on the last difference of positions, the velocity that the observer uses; a filtered velocity lags too
much for a stiff wall. A displacement of about one encoder count is mostly rounding and would make the force noisy:
there the filtered velocity is used, with less damping because of its longer delay.
"""

import math
from typing import Annotated, NamedTuple

import numpy as np

from palpate.compiler.kernel import ieee_kernel, kernel
from palpate.compiler.records import clear, put, vector
from palpate.physics.arrays import Array, Record, Vector3
from palpate.physics.device.passivity import absorbed_energy, clamp, dissipation, slew
from palpate.physics.device.rendered import (
    GAUGE,
    LEAP,
    SPAN,
    SURFACE,
    WALL,
    compensation,
    correct_slope,
    lift,
    rejoin,
    slope,
    soften,
    stiffest,
)

GAINS = {
    "stiffness": (), "damping": (), "contact_damping": (),  # Kp [N/m], Kd, Kdc [N s/m]
    "hysteresis": (), "resolution": (),  # [m]
    "mass": (), "drag": (),  # [kg], [N s/m] of the device
    "limit": (), "slew": (),  # [N], [N/s]
    "observes": bool, "passive": bool,  # whether the observer is on, and the passivity control
    "driven": bool,  # whether something else than this finger moves the tissue
}  # fmt: skip
"""Constants of the controller."""
STATE = {
    "started": bool, "contact": bool,  # whether a step has been made; the mode
    "withheld": (),  # [1] fraction of the contact force that is withheld
    "position": (3,), "force": (3,),  # [m], [N] of the last step
    "behind": (3,),  # [m] from the position to the device, while the position follows it after an outage
    "anchor": (3,), "offset": (3,),  # [m] where free motion began; [N] decaying difference of the two laws
    "touched": (3,), "approach": (),  # [m] position and approach when last touching
    "energy": (), "rise": (),  # [J] observed; [N/s] bound on the rise of the added damping, 0: none
    "impulse": (3,), "still": (),  # [N s] of the force in the time without movement; that time [s]
    "counted": (3,), "displacement": (3,),  # [m] position and last displacement that the observer counted
    "made": (), "normal": (3,),  # [J] G; the normal at that position, 0 without contact
    "outward": (),  # [m/s] speed out of the surface
    "clock": (), "last": (),  # [s] time; last step
    "steepest": (),  # [N/m] largest slope of the contact force since a contact began without negative energy
    "newest": int,  # newest row of the rings
    "wall": WALL, "gauge": GAUGE, "surface": SURFACE,  # of the rendered force
    "dragged": (3,), "brake": (3,),  # [m] point on a string, see `drag_distance`; [N] force of the damping
}  # fmt: skip
"""State of the controller."""


class Past(NamedTuple):
    """Ring buffers of the last d + 1 steps, for a delay of d samples: force [N], position [m], time [s]."""

    force: Annotated[np.ndarray, "<f8", 2]
    position: Annotated[np.ndarray, "<f8", 2]
    time: Annotated[np.ndarray, "<f8", 1]


SMOOTH = 0.5e-3  # [s] time constant of that speed's filter: one count per step is a high speed at a high rate
FADE = 0.01  # [s] time constant with which the difference of the two laws decays after a change of mode
FILTER_LAG = 8e-3  # [s] settling time of the encoder's observer after a change of speed
RECOVERY = 10.0  # [N/s] by which the rendered force may rise without motion after an outage


def rings(delay: int) -> Past:
    """New ring buffers of `haptic` for a delay in samples."""
    return Past(np.zeros((delay + 1, 3)), np.zeros((delay + 1, 3)), np.zeros(delay + 1))


@kernel
def reset(state: Record, past: Past):
    """Reset the state and the rings to those before the first step."""
    clear(state)
    for row in range(len(past.time)):
        past.time[row] = 0.0
        for i in range(3):
            past.force[row, i] = past.position[row, i] = 0.0


@kernel
def remember(state: Record, past: Past, dt: float):
    """Append the last step to the rings. Returns the row of the step d before it."""
    newest = (state.newest + 1) % len(past.time)
    state.newest = newest
    for i in range(3):
        past.force[newest, i], past.position[newest, i] = state.force[i], state.position[i]
    past.time[newest] = state.clock
    state.clock += dt
    return (newest + 1) % len(past.time)


@kernel
def observe(state: Record, force: Array, x: float, y: float, z: float, dt: float, resolution: float):
    """Passivity observer, E <- E - F . dx over the displacement since the last movement, with the force [N] (3) of the
    delayed step; returns the velocity (vx, vy, vz) [m/s] of that displacement.

    The force is averaged over the time without movement before it (a lost sample, or less than one encoder count). A
    reversal by a single count is ignored: at rest between two counts it would be counted repeatedly, each time under
    the force that responds to it.
    """
    for i in range(3):
        state.impulse[i] += force[i] * dt
    state.still += dt
    counted, last = state.counted, state.displacement
    dx, dy, dz = x - counted[0], y - counted[1], z - counted[2]
    length2 = dx * dx + dy * dy + dz * dz
    back = dx * last[0] + dy * last[1] + dz * last[2] < 0.0
    if length2 == 0.0 or (back and length2 < 1.1 * resolution * resolution):
        return 0.0, 0.0, 0.0
    elapsed = state.still
    vx, vy, vz = dx / elapsed, dy / elapsed, dz / elapsed
    state.energy = absorbed_energy(state.energy, state.impulse[0], state.impulse[1], state.impulse[2], vx, vy, vz)
    put(state.impulse, (0.0, 0.0, 0.0))
    state.still = 0.0
    put(counted, (x, y, z))
    put(last, (dx, dy, dz))
    return vx, vy, vz


@ieee_kernel
def admit(state: Record, before: float, force: float, n: Vector3, friction: Vector3):
    """Bound the energy after a displacement by what the controller has generated, G, see above.

    state        `STATE`, after `observe` has counted a displacement; changed in place
    before  [J]  energy before it
    force, n, friction  of the contact, as in `haptic`
    """
    dx, dy, dz = vector(state.displacement)
    last = state.normal
    along, former = n[0] * dx + n[1] * dy + n[2] * dz, last[0] * dx + last[1] * dy + last[2] * dz
    touched = last[0] != 0.0 or last[1] != 0.0 or last[2] != 0.0
    pressed = force * (0.5 * (along + former) if touched else along)
    state.made += before - state.energy - (pressed - (friction[0] * dx + friction[1] * dy + friction[2] * dz))
    state.energy = max(state.energy, min(-state.made, 0.0))
    put(state.normal, n)
    if not force > 0.0:
        put(state.normal, (0.0, 0.0, 0.0))


@ieee_kernel
def drag_distance(point: Array, n: Vector3, place: Vector3, play: float):
    """Distance [m] by which a finger at `place` [m] drags a point on a string of length `play` [m], in the plane with
    the normal n [1]. Steady sliding drags it by the whole motion; oscillations smaller than `play` do not move it.

    point  (3)  [m] the point; changed in place
    """
    wx, wy, wz = place[0] - point[0], place[1] - point[1], place[2] - point[2]
    along = wx * n[0] + wy * n[1] + wz * n[2]
    wx, wy, wz = wx - along * n[0], wy - along * n[1], wz - along * n[2]
    length = math.sqrt(wx * wx + wy * wy + wz * wz)
    slack = min(play / length, 1.0) if length > 0.0 else 0.0
    point[0], point[1], point[2] = place[0] - slack * wx, place[1] - slack * wy, place[2] - slack * wz
    return (1.0 - slack) * length


@ieee_kernel
def render(
    gains: Record,
    state: Record,
    past: Past,
    before: int,
    force: float,
    n: Vector3,
    approach: float,
    compression: float,
    place: Vector3,
    lag: float,
    dt: float,
):
    """Rendered normal force [N] for a contact force [N], without and with compensation of the lag [s], see rendered.py.

    before  row of the rings `past` with an earlier position of the finger and its time
    """
    last = state.position
    wx, wy, wz = place[0] - last[0], place[1] - last[1], place[2] - last[2]
    along = wx * n[0] + wy * n[1] + wz * n[2]
    sideways = 0.0
    if force > 0.0:
        sideways = drag_distance(state.dragged, n, place, SPAN * gains.resolution)
    else:  # in air n is not valid: it is that of the last contact, or of a sleeping one
        put(state.dragged, place)
    most = stiffest(gains.mass, gains.drag, gains.resolution, lag)
    closer = lift(state.surface, compression if force > 0.0 else 0.0, -along, sideways, dt)
    if state.rise > 0.0:  # after an outage the force also rises while the finger rests
        state.wall.line += RECOVERY * dt
    steepness = slope(state.gauge, force, closer - along, sideways, SPAN * gains.resolution, dt)
    least = 0.25 * SPAN * gains.resolution
    correct_slope(state.gauge, force, sideways, most, least)
    state.steepest = max(state.steepest, min(state.gauge.slope, most))
    shown = soften(state.wall, force, approach, -along, sideways + closer, most, gains.resolution, dt)
    shown = rejoin(state.wall, state.gauge, shown, closer - along, most, least, dt)
    elapsed = state.clock - past.time[before]
    if shown == 0.0 or not elapsed > 0.0:
        return shown, shown
    former = past.position[before]
    sx, sy, sz = place[0] - former[0], place[1] - former[1], place[2] - former[2]
    speed = (sx * n[0] + sy * n[1] + sz * n[2]) / elapsed
    state.outward += (speed - state.outward) * -math.expm1(-dt / SMOOTH)
    leaving = max(state.outward - closer / dt, 0.0)
    return shown, max(shown - compensation(min(steepness, most), lag, gains.drag) * leaving, 0.0)


@kernel
def assist(gains: Record, contact: bool, state: Record, i: int, position: float, velocity: float):
    """Component i [N] of the spring and damper terms: -Kp (x - xd) - Kd v in free motion, -Kdc v in contact.

    position [m], velocity [m/s] of that component;  gains, state as in `haptic`
    """
    if not contact:
        return -gains.stiffness * (position - state.anchor[i]) - gains.damping * velocity
    return -gains.contact_damping * velocity


@kernel
def switch(
    gains: Record,
    state: Record,
    touching: bool,
    approach: float,
    x: float,
    y: float,
    z: float,
    vx: float,
    vy: float,
    vz: float,
):
    """Update the mode; returns whether it is contact.

    approach [m] s1 + s2;  x, y, z [m] position;  vx, vy, vz [m/s] velocity;  gains, state as in `haptic`
    """
    contact, touched = state.contact, state.touched
    new = touching
    if touching:
        put(touched, (x, y, z))
        state.approach = approach
    elif contact:
        dx, dy, dz = x - touched[0], y - touched[1], z - touched[2]
        new = not math.sqrt(dx * dx + dy * dy + dz * dz) > state.approach + gains.hysteresis
    if new != contact:
        position, velocity = (x, y, z), (vx, vy, vz)
        for i in range(3):
            old = assist(gains, contact, state, i, position[i], velocity[i])
            state.anchor[i] = position[i]
            state.offset[i] += old - assist(gains, new, state, i, position[i], velocity[i])
        state.contact = new
        if state.withheld == 0.0:  # else there was an outage, which does not end a touch
            state.energy = min(state.energy, 0.0)
            state.made = -state.energy
            if new and state.energy == 0.0:
                state.steepest = 0.0
            if not new:
                state.rise = 0.0
    return new


@ieee_kernel
def brake(gains: Record, state: Record, w: Vector3, v: Vector3, way: float, lag: float, usual: float, dt: float):
    """Force [N] (x, y, z) of the damping, see above; updates `state.brake`.

    w      [m/s]  (3) of the last displacement, if the observer counted it in this step
    v      [m/s]  (3) filtered
    way    [m]    motion of the finger since the last step
    lag    [s]    of the loop;  usual, dt [s] usual and present step
    gains, state as in `haptic`
    """
    wx, wy, wz = w
    slow = 2.0 * lag / usual  # a damper acting d samples late is stable up to about m / ((1 + 2 d) T)
    stable = most = 0.5 * gains.mass / slow
    speed = math.sqrt(wx * wx + wy * wy + wz * wz)
    path = dt * speed
    if path < 1.5 * gains.resolution:
        most = 0.5 * gains.mass / (slow + FILTER_LAG / dt)
        wx, wy, wz = v
        speed = math.sqrt(wx * wx + wy * wy + wz * wz)
        path = FILTER_LAG * speed
    alpha = 0.0
    if path >= 1.5 * gains.resolution:  # smaller displacements are rounding
        alpha = dissipation(state.energy, dt, speed * speed, most)
    resolution = gains.resolution
    steepest = LEAP / resolution if resolution > 0.0 else stiffest(gains.mass, gains.drag, resolution, lag)
    if state.steepest > 0.0 and state.rise == 0.0:  # see above
        steepest = min(steepest, state.steepest)
    bx, by, bz = vector(state.brake)
    reach = steepest * way
    rise = min(reach, state.rise * dt) if state.rise > 0.0 else reach
    force = min(alpha * speed, math.sqrt(2.0 * steepest * max(-state.energy, 0.0)))
    force = min(force, math.sqrt(bx * bx + by * by + bz * bz) + rise)
    share = force / speed if speed > 0.0 else 0.0
    tx, ty, tz = -share * wx, -share * wy, -share * wz
    bx, by, bz = slew(tx, ty, tz, bx, by, bz, reach)
    bx, by, bz = clamp(bx, by, bz, stable / dt * speed)
    if bx * wx + by * wy + bz * wz > 0.0:  # the motion turned round
        bx, by, bz = tx, ty, tz
    put(state.brake, (bx, by, bz))
    return bx, by, bz


@ieee_kernel
def haptic(
    gains: Record,
    state: Record,
    past: Past,
    normal_force: float,
    n: Vector3,
    friction: Vector3,
    approach: float,
    compression: float,
    position: Vector3,
    velocity: Vector3,
    dt: float,
):
    """One step of the controller, see the equations above: (fx, fy, fz [N], in contact, E [J]). Updates the state.

    gains                `GAINS`
    state                `STATE`, changed in place; `behind` is an input
    past                 `Past`, changed in place
    normal_force  [N]    f_n along n [1] (3)
    friction      [N]    f_t (3) of the finger on the tissue
    approach      [m]    s1 + s2 >= 0; of s2 only what another finger does not lift
    compression   [m]    s1
    position      [m]    (3)
    velocity      [m/s]  (3) filtered
    dt            [s]    since the last step; nothing changes if it is not positive
    The force is zero if an input is not finite.
    """
    if not 0.0 < dt < math.inf:
        return state.force[0], state.force[1], state.force[2], state.contact, state.energy
    x, y, z = position
    vx, vy, vz = velocity
    given = x + y + z + vx + vy + vz + normal_force + approach + compression
    along = n[0] + n[1] + n[2] + friction[0] + friction[1] + friction[2]
    if not abs(given + along) < math.inf:
        put(state.force, (0.0, 0.0, 0.0))
        return 0.0, 0.0, 0.0, state.contact, state.energy
    wx, wy, wz = 0.0, 0.0, 0.0
    # 1. first step: set the anchor and all past positions to the present one
    if not state.started:
        state.started = True
        for i in range(3):
            state.anchor[i] = state.position[i] = state.dragged[i] = position[i]
            state.counted[i] = position[i] + state.behind[i]
        for row in range(len(past.time)):
            for i in range(3):
                past.position[row, i] = position[i]
    # 2. passivity observer: the energy that the force has generated since the start, by positions
    before = remember(state, past, dt)
    if gains.observes:
        bx, by, bz = vector(state.behind)
        had = state.energy
        wx, wy, wz = observe(state, past.force[before], x + bx, y + by, z + bz, dt, gains.resolution)
        if gains.driven and (wx, wy, wz) != (0.0, 0.0, 0.0):
            admit(state, had, normal_force, n, friction)
    # Ignore a single late step: its lag would lower the stiffness, and a hand at rest would lose part of its force.
    last = state.last
    usual = last if 0.0 < 3.0 * last < dt else dt
    state.last = dt
    lag = (len(past.time) - 0.5) * usual
    mx, my, mz = x - state.position[0], y - state.position[1], z - state.position[2]
    way = math.sqrt(mx * mx + my * my + mz * mz)
    # 3. rendered contact force: as computed, or what the device can render without generating energy
    touching = normal_force > 0.0
    shown = damped = normal_force
    if gains.passive:
        shown, damped = render(gains, state, past, before, normal_force, n, approach, compression, position, lag, dt)
    put(state.position, (x, y, z))
    # 4. mode, its spring and damper, and the decaying difference from the former mode
    contact = switch(gains, state, touching, approach, x, y, z, vx, vy, vz)
    fade = math.exp(-dt / FADE)
    fx = assist(gains, contact, state, 0, x, vx) + state.offset[0]
    fy = assist(gains, contact, state, 1, y, vy) + state.offset[1]
    fz = assist(gains, contact, state, 2, z, vz) + state.offset[2]
    for i in range(3):
        state.offset[i] *= fade
    if touching:
        given = 1.0 - state.withheld
        share = given * min(shown / normal_force, 1.0)
        damped *= given
        fx += damped * n[0] - share * friction[0]
        fy += damped * n[1] - share * friction[1]
        fz += damped * n[2] - share * friction[2]
    # 5. passivity controller: a damper on the measured velocity w dissipates the generated energy
    if gains.passive:
        follows = vector(state.behind) != (0.0, 0.0, 0.0)  # the velocity of the hand is not known
        slow = (wx, wy, wz) if follows else velocity
        bx, by, bz = brake(gains, state, (wx, wy, wz), slow, way, lag, usual, dt)
        fx, fy, fz = fx + bx, fy + by, fz + bz
    # 6. limits of force and of its rate
    fx, fy, fz = clamp(fx, fy, fz, gains.limit)
    fx, fy, fz = slew(fx, fy, fz, state.force[0], state.force[1], state.force[2], gains.slew * dt)
    put(state.force, (fx, fy, fz))
    return fx, fy, fz, contact, state.energy
