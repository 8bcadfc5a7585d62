"""Kernels of one fingertip in series with a body, on its state; `Series` has one, `Joint` one per finger."""

import math

from palpate.compiler.records import vector
from palpate.nodes.base.absence import FALL
from palpate.nodes.base.kernels import ieee_kernel, kernel
from palpate.physics.bodies.place_energy import limit_tangential, on_hand
from palpate.physics.contact.end_rate import COURSE, advance
from palpate.physics.contact.terminal import LEAST_FREE, free_recovery, law_at

FAR = 2e-3  # [m] distance beyond which an idle contact sleeps; at 1 kHz and 2 m/s it wakes one step before contact
STILL = 1e-9  # [m] indentation below which an unloaded body counts as at rest
LATE = 1.5  # [1] a law older than this number of steps is stale; a longer step than this number of usual ones has a gap
AGREE = 1e-6  # [m] difference of the indentations of contact and body below which they are synchronized again
GONE = 2.0 * FALL  # [s] time in which the force falls to zero when the body is missing
KNOWN = 10e-3  # [s] duration of a gap in which the hand may brake: 0.4 m/s at 40 m/s^2
REST = 1e3  # [s] duration after which any body is at rest
RETURN, CATCH_UP = 0.03, 20e-3  # [s], [m/s] of the approach that is withheld after an outage (`regained`)
LEAP, AHEAD = 1e-4, 6.0  # [m], [1] motion of a foot, and over that of the finger, beyond which it leapt
NOTHING = (0.0, 0.0, 0.0)

FINGER = {
    "compression": (), "indentation": (), "settled": bool,  # [m]; whether the indentation is known
    "idle": bool, "previous": (), "in_step": bool, "withheld": (),  # previous [m] of the body's law; withheld [m]
    "law": (5,), "step": (), "relaxation": (), "hears": bool,  # of the body's last message; whether it has sent one
    "apart": bool,  # whether the finger has not pressed the body since it is missing
    "usual": (), "depth": (), "rate": (), "length": (),  # [s] [m] [m/s] [s] of the motion so far
    "foot": (3,), "leapt": bool,  # [m] of the last step; whether it leapt then, see `leaps`
    "sampled": int,  # [ns] time of the last sample of the approach; -1: unknown
    "course": COURSE,  # of the compression (`physics.contact.end_rate`)
    "aside": (3,),  # tangential over normal force [1]
    "deepest": (3,), "deepest_time": int,  # greatest compression [m], force [N] then; time [ns]
}  # fmt: skip
"""State of a fingertip."""


def begin(finger) -> None:
    """The state before the first step."""
    finger["in_step"], finger["usual"], finger["deepest_time"], finger["sampled"] = True, math.inf, -1, -1
    finger["course"]["ahead"] = 1.0


@kernel
def in_range(law, step, relaxation):
    """Whether a body's law is valid; `check_law` explains why it is not."""
    k, n, c, free, previous = law
    return (
        k > 0.0
        and 1.0 <= n <= 3.0
        and c >= 0.0
        and free >= LEAST_FREE
        and step >= 0.0
        and relaxation >= 0.0
        and -math.inf < k + c + free + previous + step + relaxation < math.inf
    )


@kernel
def depth_of(proximity):
    """Signed approach [m] of the finger, negative above the undeformed surface."""
    return proximity.approach - proximity.separation


@kernel
def regained(withheld, dt):
    """What is left [m] of a withheld approach w after a step of dt [s]. With R = `RETURN` and V = `CATCH_UP`

        w' = -(w/R + V) above V R,    w' = -2 sqrt(w V/R) below

    so that the rate falls to zero at the end: a rate that ends at V leaves a step of the viscous force."""
    if withheld > RETURN * CATCH_UP:
        return max((withheld - CATCH_UP * dt) / (1.0 + dt / RETURN), 0.0)
    root = max(math.sqrt(withheld) - math.sqrt(CATCH_UP / RETURN) * dt, 0.0)
    return root * root


@kernel
def leaps(finger, proximity, dt):
    """Keep the foot; whether it leapt in this step of dt [s].

    Under a finger that indents the undeformed surface it moves slowly (`geometry.proxy`). Above that it follows the
    nearest point at once, and tissue that something else lifts may touch the finger there. The law of the next step is
    that of the new place: its indentation has leapt, and a viscous fingertip would answer to that with a kick. So the
    finger begins there again, as after an outage.
    """
    slip, foot = proximity.slip, proximity.foot
    moved = abs(depth_of(proximity) - finger.depth) + dt * math.sqrt(slip[0] ** 2 + slip[1] ** 2 + slip[2] ** 2)
    square = 0.0
    for x in range(3):
        square += (foot[x] - finger.foot[x]) ** 2
        finger.foot[x] = foot[x]
    above = finger.compression > 0.0 and not proximity.approach > 0.0
    return above and square > (LEAP + AHEAD * moved) ** 2


@ieee_kernel
def step_length(finger, proximity, dt):
    """Length [s] of the step for the damping: `dt` since the last sample, except after a gap in which the finger
    approached.

    An implicit step over a gap applies the mean rate at the final depth, although a finger that has hit the tissue may
    be at rest by then. So the rate at the end is extrapolated from the mean rates v, v_0 of this step and the one
    before, of lengths T and T_0: v_end = v + (v - v_0) T/(T + T_0) within [0, v]. The step has the length that the same
    motion takes at v_end. A gap that begins before contact, where v_0 is unknown because this node may sleep, ends at
    rest. After a gap longer than `KNOWN`, v_end is multiplied by KNOWN/T, since a fast hand may have braked: too low a
    force for one step does less harm than a force spike.
    """
    depth = depth_of(proximity)
    rate = (depth - finger.depth) / dt
    rate_before, dt_before = finger.rate, finger.length
    if finger.usual == math.inf:
        finger.usual = dt  # the nominal step; a sample that follows a late one comes sooner, which is not usual
    finger.depth, finger.rate, finger.length = depth, rate, dt
    if dt <= LATE * finger.usual or not rate > 0.0:
        return dt
    end = 0.0 if finger.idle else min(rate + (rate - rate_before) * dt / (dt + dt_before), rate)
    end *= min(1.0, KNOWN / dt)
    return min(dt * rate / end, REST) if end > 0.0 else REST


@ieee_kernel
def law_now(finger, law, step, relaxation, age, dt, moved, length):
    """K, n, c, s_free, s_prev of the body's law for a step of `dt` [s] with the effective length `length` [s].

    law   K, n, c, s_free, s_prev of the last message
    step  [s] for which the law was computed; 0: for any step
    age   [s] of the message
    moved [s] since the last sample of the approach; not `dt` if another finger had newer ones
    """
    k, n, c, free, previous = law
    own = finger.indentation
    fresh = moved <= LATE * dt and age <= LATE * dt and step <= LATE * dt and (dt <= LATE * step or step == 0.0)
    finger.in_step = fresh and (finger.in_step or not finger.settled or abs(own - previous) <= AGREE)
    if not finger.settled or (finger.in_step and length == dt):
        return law
    k, free = law_at(length, own, law, step, relaxation)
    return k, n, c, free, own


@ieee_kernel
def pressing(finger, proximity, there, law, step, relaxation, time, dt, moved):
    """Returns whether a force must be solved for, and approach [m], length of the step [s] and law for it.

    The approach is signed: a body that another finger lifts is touched before the finger reaches its undeformed
    surface. A contact with a body that is missing ends, and none begins.

    there  whether the body has sent its law
    law, step [s], relaxation [s], time [ns]  of that message
    dt, moved  [s] since the last step and since the last sample, see `nodes.base.samples`
    """
    leapt = leaps(finger, proximity, dt)
    length = step_length(finger, proximity, moved) if moved > 0.0 else dt
    depth = depth_of(proximity)
    if there:
        finger.settled, finger.leapt = finger.settled and not finger.leapt, leapt
        for i in range(5):
            finger.law[i] = law[i]
        finger.step, finger.relaxation, finger.hears, finger.apart = step, relaxation, True, False
        age = (proximity.time - time) * 1e-9 if proximity.time >= 0 and time >= 0 else dt
        law = law_now(finger, law, step, relaxation, age, dt, moved, length)
        finger.previous = law[4]
        # effective approach: the whole approach, reduced for some time after the body was missing, or the foot leapt
        if not finger.settled and proximity.tick > 0:
            finger.withheld = depth - finger.compression - finger.previous
        elif finger.withheld > 0.0:
            finger.withheld = regained(finger.withheld, dt)
        finger.withheld = max(finger.withheld, 0.0)
        return True, depth - finger.withheld, length, law
    finger.settled, finger.in_step = False, True
    heard = finger.law
    k, n, c, free, previous = heard[0], heard[1], heard[2], heard[3], heard[4]
    k, free = law_at(REST, previous, (k, n, c, free, previous), finger.step, finger.relaxation)
    lifted = min(free, 0.0)
    finger.withheld += max(depth - lifted, 0.0) * dt / GONE
    felt = depth - finger.withheld
    finger.apart = finger.apart or not (finger.hears and felt > lifted + STILL)
    if finger.apart:
        return False, 0.0, length, law
    return True, felt, math.inf, (k, n, c, free, previous)


@kernel
def start_of(finger):
    """Compression [m] at the start of the step, from which a step of second order begins."""
    return finger.course.ahead * finger.compression


@ieee_kernel
def settle(finger, proximity, there, gradient, shape, sloped, damping, thickness, pressed, solved, dt):
    """The contact of this step: force [N], indentation [m], rates of compression and indentation [m/s], force along
    the surface [N] (3).

    gradient [N] (3), shape [1/m] (9)  of the body's energy along the surface, valid if `sloped`
    damping    [s/m] of the fingertip;  thickness [m] of its soft tissue
    pressed    whether `solved` (force, compression, indentation) is from this step
    """
    before, start, lateral = finger.compression, start_of(finger), NOTHING
    force = indentation = rate = 0.0
    if pressed:
        force, finger.compression, indentation = solved
    else:
        finger.compression = free_recovery(start, 0.0, damping, dt)
    advance(finger.course, finger.compression, dt)
    if there:
        rate = (indentation - finger.previous) / dt
        finger.indentation, finger.settled = indentation, True
        if force > 0.0 and sloped:
            slip = proximity.slip
            motion = dt * (math.sqrt(slip[0] ** 2 + slip[1] ** 2 + slip[2] ** 2) + abs(finger.rate) + abs(rate))
            lateral = on_hand(gradient, shape, -proximity.gap, vector(proximity.normal))
            reached = max(proximity.approach, finger.compression)  # above the undeformed surface: the compression
            lateral = limit_tangential(lateral, force, motion, reached, finger.aside)
    if not force > 0.0:
        finger.aside[0] = finger.aside[1] = finger.aside[2] = 0.0
    if finger.compression > thickness > 0.0:
        deepest = finger.deepest
        if (finger.compression, force, proximity.time) > (deepest[0], deepest[1], finger.deepest_time):
            deepest[0], deepest[1], finger.deepest_time = finger.compression, force, proximity.time
    finger.idle = force == 0.0 and before == finger.compression and abs(indentation) < STILL
    return force, indentation, (finger.compression - start) / dt, rate, lateral


@kernel
def at_rest(finger, proximity, there, law, step, relaxation):
    """Whether a step would change nothing: finger idle and farther than `FAR` from a body at rest."""
    if not finger.idle or not there or not proximity.separation > FAR:
        return False
    return abs(law[3]) < STILL and abs(law[4]) < STILL and in_range(law, step, relaxation)
