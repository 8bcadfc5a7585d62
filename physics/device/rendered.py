"""How stiff a contact may be shown through a sampled loop, and the damping that makes up for the loop's lag.

A force held over a step T and `d` samples late acts on average t = T (d + 1/2) after the motion that it answers to. A
spring K behind that lag works like a spring with the damping -K t. Two things keep the display from giving out energy:

    K <= b/t + SHARE m/t^2                  the stiffest slope that is shown
    B  = 4 max(0, K t - b/2)                damping on the way out, along the normal, for a shown slope K

b [N s/m] and m [kg] are the device's own. Over a swing in and out B counts for half. It comes as late as the spring,
which the bound on K makes harmless: the phase lost over the lag, t sqrt(K/m), stays below about sqrt(SHARE).

A law that is steeper is followed along a line of the stiffest slope from the point where it became too steep, and
taken up again where it comes down to that line. So what is soft enough is rendered as it is.

J. E. Colgate, G. G. Schenkel, J. Robotic Systems 14 (1997) 37-47, for the bound b > K T (d + 1/2).
"""

from palpate.physics.kernel import kernel

SHARE = 0.01
MOST = 1e12  # [N/m]
LEAP = 0.1  # [N] largest change of force over one step of the position
SPAN = 8.0  # [1] steps of the device's position over which a slope is measured
FORGET = 0.01  # [s] below the line after which it is forgotten
LINE, LAW, CUT, BELOW = range(4)  # of the wall
SLOPE, DEPTH, FROM, AT = range(4)  # of the gauge


@kernel(error_model="numpy")
def stiffest(mass, drag, resolution, lag):
    """The stiffest slope [N/m] that a device of `mass` [kg] and `drag` [N s/m], whose position comes in steps of
    `resolution` [m], is shown behind a lag > 0 [s]."""
    loop = (drag + SHARE * mass / lag) / lag
    return min(loop, LEAP / resolution if resolution > 0.0 else MOST)


@kernel
def soften(wall, force, approach, way, sideways, most, step, dt):
    """The force to render for a contact force [N]: along the way it rises by no more than `most` [N/m].

    Out again by one `step` [m] of the position it falls by no more than that either, for that step of time: the damping
    of the contact would make of the jump a fall that throws the finger back over the next one.

    wall      (4)  the line [N] that bounds the force, the last contact force [N], whether the line holds, and for how
                   long [s] the force has been below it; changed in place
    approach  [m]  since first contact
    way       [m]  into the surface since the last step
    sideways  [m]  in its plane since then, without the swing of a finger that holds still: under a law far above the
                   line each swing would raise the force, and drive the next one
    dt        [s]
    """
    least = max(wall[LAW] + most * (way - sideways), 0.0) if -1.5 * step < way < 0.0 < force else 0.0
    if wall[CUT] != 0.0:
        # Out again as it came, but no faster than the law itself falls.
        change = max(most * way, min(force - wall[LAW], 0.0))
        wall[LINE] = max(wall[LINE] + change + most * sideways, 0.0)
    elif way == 0.0:
        wall[LINE] = force
    else:
        wall[LINE] = wall[LAW] + most * (max(way, 0.0) + sideways)
    wall[LINE] = min(wall[LINE], most * approach)  # part of the first way into contact was through air
    wall[LAW] = force
    if force > wall[LINE]:
        wall[CUT], wall[BELOW] = 1.0, 0.0
        return wall[LINE]
    wall[BELOW] += dt
    if wall[BELOW] > FORGET:
        wall[CUT] = 0.0
    return max(force, min(least, wall[LINE]))


@kernel
def slope(gauge, force, way, span):
    """Slope [N/m] of the rendered force over the last `span` [m], from where contact began at first; 0 without contact.

    gauge  (4)  the slope, the depth since contact began, and the depth [m] and force [N] that it is measured from
    way    [m]  into the surface since the last step
    """
    if not force > 0.0:
        gauge[:] = 0.0
        return 0.0
    gauge[DEPTH] += way
    length = gauge[DEPTH] - gauge[FROM]
    first = gauge[FROM] == 0.0 and gauge[AT] == 0.0
    if length != 0.0 and (abs(length) >= span or (first and length > 0.0)):  # exact positions: span is 0
        gauge[SLOPE] = max((force - gauge[AT]) / length, 0.0)
    if abs(length) >= span:
        gauge[FROM], gauge[AT] = gauge[DEPTH], force
    return gauge[SLOPE]


@kernel
def compensation(stiffness, lag, drag):
    """Damping B [N s/m] of the way out for a rendered slope [N/m] behind a lag [s], on a device with `drag` [N s/m]."""
    return 4.0 * max(stiffness * lag - 0.5 * drag, 0.0)
