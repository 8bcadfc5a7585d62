"""Largest stiffness that a sampled loop can render, and the damping that compensates the lag of the loop.

A force that is held over a step T and `d` samples late lags the motion by t = T (d + 1/2) on average. A spring K with
that lag acts like a spring with the damping -K t. Two measures prevent the display from generating energy:

    K <= b/t + SHARE m/t^2                  the largest rendered stiffness
    B  = 4 max(0, K t - b/2)                damping while the finger moves out of the surface, for a rendered slope K

with the damping b [N s/m] and mass m [kg] of the device. Over a full oscillation B counts half, as it acts in one
direction only. It lags as much as the spring, which the bound on K makes harmless: the phase lag t sqrt(K/m) stays
below about sqrt(SHARE).

A steeper law is replaced by a line of the largest stiffness from the point where it became too steep, until the law
falls below that line. A softer law is rendered unchanged.

In a single tick the force also changes without motion: by the viscosity of a finger whose speed varies, or since
something else presses on it. Then it may rise while the finger moves out, and the line begins. The line follows each
fall of the force and no such rise, so that on a soft tissue it would fall away from the law, tick by tick, in a slow
retreat. It therefore returns to the law within `FORGET`, under two conditions:

    the law is not steep     by its slope over some steps of the position, not over a tick
    F <= sqrt(2 K W)         with the work W = sum F ds of the rendered force on the hand since contact began

A slope alone does not show whether a law is steep: where the finger turns round, viscosity makes it small or negative.
A spring of the largest stiffness K that pushes with a force F holds the energy F²/2K, which is W along the line, so
that a line that replaces a steep law stays. A law F ~ s^n with n >= 1 that is nowhere steeper than K takes F s/(n + 1)
>= F²/2K, and is not limited. W alone would let a law that is soft at first and then steep, as that of a fingertip on a
rigid body, return too far. The work of friction does not count: a slide on a hard surface would pay for an oscillation.

Nor does a steep slope show a steep law: where the finger gains speed, viscosity adds to it, and a finger that then
stops within a few steps measures no other. A law that stiffens with depth is in a retreat at most as steep as the
secant to the turn before it. At that turn the finger had no speed, and the viscosity of a retreat lowers the force, so
that a measured secant is never too small. Where it is not steep it replaces a slope that is, and the next slope is
measured from there. Depth does not explain a force above that of the turn, nor one after a slide longer than the
retreat: these replace nothing.

Exact positions have no steps, and a slope over a tick is not that of a law. In a slide the place changes the force, and
its change over a motion along the normal of 2 % of the way was taken for a slope of 60 kN/m, whose damping changed the
force on the hand by twice what the contact did. There the slope is a fit over the ticks within `FORGET`, in which a
motion counts by the part of it that is along the normal: a slide keeps the slope that was found before. A motion that
is shorter than those that the fit knows makes it forget these by the ratio of the lengths only: in a hold the finger
creeps, and the fit would know little of the press, so that any slide after it would make the slope.

Tissue that rises under a finger, because another finger or organ leaves it or pushes it there, raises the force without
the hand. This counts as motion of the finger as well: what moves the surface pays for it. A finger compresses itself by
at most the distance that it moves in or slides; what its compression grows beyond that, averaged over `CALM` so that
oscillations of the finger cancel, is by the surface. Where it grows while the finger moves out, the surface has moved
by the sum. (Where a whole organ moves, positions are those in the organ.)

J. E. Colgate, G. G. Schenkel, J. Robotic Systems 14 (1997) 37-47, for the bound b > K T (d + 1/2).
"""

import math

from palpate.compiler.kernel import ieee_kernel, kernel
from palpate.compiler.records import clear
from palpate.physics.arrays import Record

SHARE = 0.01
MOST = 1e12  # [N/m]
LEAP = 0.1  # [N] largest change of force over one step of the position
SPAN = 8.0  # [1] steps of the device's position over which a slope is measured
FORGET = 0.01  # [s] time below the line after which it is dropped, and in which it returns to the law
CALM = 0.02  # [s] time constant of the mean of the surface's motion
FASTEST = 1.0  # [m/s] at which each motion counts in that mean
WALL = {"line": (), "law": (), "cut": bool, "below": ()}
"""The line [N] that bounds the force, the last contact force [N], whether the line is active, and the time [s] that the
force has been below it."""
GAUGE = {
    "slope": (), "depth": (), "mark": (), "mark_force": (), "rise": (), "square": (), "paid": (), "shown": (),
    "turn": (), "turn_force": (), "retreat": (), "slid": (),
}  # fmt: skip
"""The slope [N/m], the depth since contact began [m], the depth [m] and force [N] from which the slope is measured, the
means of `fit_slope` [N m], [m²], the work of the rendered force since contact began [J], and this force [N]; the depth
[m] and force [N] at the last turn outwards; since then the least depth [m] and the length of the slide [m]."""
SURFACE = {"compression": (), "growth": (), "way": (), "sideways": ()}
"""Compression [m] of the fingertip, and means [m] of its growth in a step and of the finger's motion, of `lift`."""


@ieee_kernel
def stiffest(mass: float, drag: float, resolution: float, lag: float):
    """The largest rendered stiffness b/t + SHARE m/t² [N/m] of a device of `mass` m [kg], `drag` b [N s/m] and position
    `resolution` [m], for a lag t > 0 [s]; a step of the position changes the force by at most `LEAP`."""
    loop = (drag + SHARE * mass / lag) / lag
    return min(loop, LEAP / resolution if resolution > 0.0 else MOST)


@kernel
def soften(
    wall: Record, force: float, approach: float, way: float, sideways: float, most: float, step: float, dt: float
):
    """The rendered force [N] for a contact force [N]: it rises by at most `most` [N/m] along the motion.

    When the finger moves out by one `step` [m] of the position, the force also falls at most at that slope in this time
    step: the damping of the contact would otherwise turn the jump into a force drop that throws the finger back in.

    wall           `WALL`, changed in place
    approach  [m]  since first contact
    way       [m]  motion into the surface since the last step
    sideways  [m]  motion along the surface since then, without the oscillation of a finger at rest: under a law far
                   above the line it would raise the force and sustain itself
    dt        [s]
    """
    least = max(wall.law + most * (way - sideways), 0.0) if -1.5 * step < way < 0.0 < force else 0.0
    if wall.cut:
        # Outwards along the same slope, but not faster than the law falls.
        change = max(most * way, min(force - wall.law, 0.0))
        wall.line = max(wall.line + change + most * sideways, 0.0)
    elif way == 0.0:
        wall.line = force
    else:
        wall.line = wall.law + most * (max(way, 0.0) + sideways)
    wall.line = min(wall.line, most * max(approach, 0.0))  # part of the first step into contact was through air
    wall.law = force
    if force > wall.line:
        wall.cut, wall.below = True, 0.0
        return wall.line
    wall.below += dt
    if wall.below > FORGET:
        wall.cut = False
    return max(force, min(least, wall.line))


@kernel
def bounded(value: float, most: float):
    """The value within [-most, most]."""
    return max(-most, min(value, most))


@kernel
def lift(surface: Record, compression: float, way: float, sideways: float, dt: float):
    """Motion [m] of the surface towards the finger in this step, never negative.

    surface          `SURFACE`, changed in place
    compression [m]  of the fingertip; 0 without contact
    way         [m]  motion into the surface since the last step
    sideways    [m]  motion along the surface since then
    dt          [s]
    """
    if not compression > 0.0:
        clear(surface)
        return 0.0
    if surface.compression > 0.0:  # a part of the first step of a contact was through air
        share, most = -math.expm1(-dt / CALM), FASTEST * dt  # a wrong number in an input is soon forgotten
        surface.growth += (bounded(compression - surface.compression, most) - surface.growth) * share
        surface.way += (bounded(way, most) - surface.way) * share
        surface.sideways += (bounded(sideways, most) - surface.sideways) * share
    surface.compression = compression
    return max(surface.growth - surface.way - surface.sideways, 0.0) if surface.growth > 0.0 else 0.0


@kernel
def fit_slope(gauge: Record, change: float, way: float, sideways: float, dt: float):
    """Slope [N/m] of the contact force by least squares over the steps within `FORGET`, for exact positions.

    gauge        `GAUGE`, changed in place
    change  [N]  of the force in this step
    way, sideways, dt  as of `slope`
    """
    square = way * way
    if square > 0.0:
        length = min(math.sqrt(square / gauge.square), 1.0) if gauge.square > 0.0 else 1.0
        share = length * square / (square + sideways * sideways) * -math.expm1(-dt / FORGET)
        gauge.rise += (change * way - gauge.rise) * share
        gauge.square += (square - gauge.square) * share
    return max(gauge.rise / gauge.square, 0.0) if gauge.square > 0.0 else 0.0


@kernel
def slope(gauge: Record, force: float, way: float, sideways: float, span: float, dt: float):
    """Slope [N/m] of the contact force over the last `span` [m], at first since contact began, or of `fit_slope` for
    a span of 0; 0 without contact.

    gauge          `GAUGE`, changed in place
    way       [m]  motion into the surface since the last step
    sideways  [m]  motion along the surface since then
    dt        [s]
    """
    if not force > 0.0:
        clear(gauge)
        return 0.0
    gauge.depth += way
    length = gauge.depth - gauge.mark
    first = gauge.mark == 0.0 and gauge.mark_force == 0.0
    if span == 0.0:
        gauge.slope = fit_slope(gauge, force - gauge.mark_force, way, sideways, dt)
    elif length != 0.0 and (abs(length) >= span or (first and length > 0.0)):
        gauge.slope = max((force - gauge.mark_force) / length, 0.0)
    if abs(length) >= span:
        gauge.mark, gauge.mark_force = gauge.depth, force
    return gauge.slope


@kernel
def is_steep(gauge: Record, force: float, most: float, least: float):
    """Whether the law is steeper than `most` [N/m] over its last span, or from there on if that is `least` [m] or more;
    also in the first `least` of a contact, where that is not known.

    gauge, force  as of `slope`, which has seen this step
    """
    length = gauge.depth - gauge.mark
    if length == 0.0 or abs(length) < least:
        return gauge.slope > most or (gauge.mark == 0.0 and gauge.mark_force == 0.0)
    return gauge.slope > most or (force - gauge.mark_force) / length > most


@kernel
def correct_slope(gauge: Record, force: float, sideways: float, most: float, least: float):
    """Replace a slope steeper than `most` [N/m] by that to the last turn of a retreat, which is at least the law's.

    gauge, force, sideways  as of `slope`, which has seen this step; `gauge` is changed in place
    least  [m]  motion that is a retreat, and as of `is_steep`; 0 for exact positions, whose slope is that of 10 ms
    """
    depth = gauge.depth
    if depth >= gauge.turn or depth - gauge.retreat >= least:
        gauge.turn = gauge.retreat = depth
        gauge.turn_force, gauge.slid = force, 0.0
        return
    gauge.slid += sideways
    if depth < gauge.retreat:
        gauge.retreat = depth
        length, fall = gauge.turn - depth, gauge.turn_force - force
        measured = length >= max(least, gauge.slid) and 0.0 <= fall <= most * length
        if measured and least > 0.0 and is_steep(gauge, force, most, least):
            gauge.slope, gauge.mark, gauge.mark_force = fall / length, depth, force


@kernel
def rejoin(wall: Record, gauge: Record, shown: float, way: float, most: float, least: float, dt: float):
    """The rendered force [N]: the line returns to a law that is not steep, as far as the hand has paid for it.

    wall, gauge  `WALL` after `soften` and `GAUGE` after `slope`, changed in place
    least  [m]   as of `is_steep`
    shown  [N]   of `soften`
    way, most    as of `soften`
    dt     [s]
    """
    gauge.paid += gauge.shown * way
    law = min(wall.law, math.sqrt(2.0 * most * max(gauge.paid, 0.0)))
    if wall.cut and shown < law and not is_steep(gauge, wall.law, most, least):
        wall.line += (law - wall.line) * -math.expm1(-dt / FORGET)
        shown = wall.line
    gauge.shown = shown
    return shown


@kernel
def compensation(stiffness: float, lag: float, drag: float):
    """B = 4 max(0, K t - b/2) [N s/m], damping of outward motion for a rendered slope K [N/m], lag t [s], drag b
    [N s/m]."""
    return 4.0 * max(stiffness * lag - 0.5 * drag, 0.0)
