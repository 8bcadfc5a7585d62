"""The energy that several fingers share through one body, and what the body generates.

One finger lifts another through the body, which so gets energy that it has not put in. With the forces f_i n_i + g_i
on the fingers (g along the surface, without friction), the gaps d_i and the velocities v_i along the surface,

    P <- P - sum over i of (f_i dd_i + g_i . v_i dt)

with means of the forces over the step, is the energy that all fingers have put in and not got back. A passive body
returns no more than it has, P >= 0. What exceeds it has been generated, and is assigned to the fingers that got energy
in this step, in proportion; P begins again at 0. So each part is assigned once.

After an outage a part w_i of the depth is withheld, and returns without motion (`nodes.contact.finger`). This presses
the tissue with the work -f_i dw_i, which no finger has done: it is assigned to this finger at once, and is in P.

Losses remain in P, and would cover what is generated later. Energy that a body of monotonic laws stores under the
forces f_i, with the compressions s1 and indentations s2, is at most sum f_i (s1_i + s2_i), half of it if linear; P is
at most `SLACK` times that, also since viscous tissue still returns energy with less than its force at rest.
"""

import math

from palpate.compiler.kernel import ieee_kernel
from palpate.compiler.records import put, vector
from palpate.physics.arrays import Array, Record, Vector3

SLACK = 2.0  # [1]

END = {"known": bool, "force": (), "gap": (), "lateral": (3,), "withheld": ()}
"""A finger at the end of a step: whether it was there; force [N], gap [m], lateral force [N], withheld depth [m]."""


@ieee_kernel
def energy_given(end: Record, force: float, gap: float, lateral: Vector3, slip: Vector3, withheld: float, dt: float):
    """Energies [J] that a finger has put into the body in the step of dt [s] to this force [N], gap [m], lateral force
    [N] (3) and withheld depth [m], at a velocity `slip` [m/s] (3) along the surface, and that a returning depth has put
    in; 0 in the first step, and for numbers that are not finite. Updates `end`, an `END`."""
    given = returned = 0.0
    if end.known:
        before = end.lateral
        along = 0.0
        for i in range(3):
            along += 0.5 * (before[i] + lateral[i]) * slip[i]
        mean = 0.5 * (end.force + force)
        given, returned = -(mean * (gap - end.gap) + along * dt), mean * (end.withheld - withheld)
        if not abs(given) + abs(returned) < math.inf:
            given = returned = 0.0
    end.known, end.force, end.gap, end.withheld = True, force, gap, withheld
    put(end.lateral, vector(lateral))
    return given, returned


@ieee_kernel
def assign_generated(held: float, given: Array, returned: Array, most: float, generated: Array):
    """P [J] after a step, see above.

    held       [J]      P before it
    given      [J] (k)  energy that each finger has put in, negative if it got some
    returned   [J] (k)  energy that a withheld depth has put in when it returned, negative if it lifted the finger
    most       [J]      sum f_i (s1_i + s2_i)
    generated  [J] (k)  by the body so far, assigned to each finger; increased in place
    """
    got = 0.0
    for i in range(len(given)):
        held += returned[i]
        generated[i] += max(returned[i], 0.0)
    held = max(held, 0.0)  # a depth that is withheld loses energy, which no finger gets
    for i in range(len(given)):
        held += given[i]
        got += max(-given[i], 0.0)
    if held < 0.0 and got > 0.0:
        for i in range(len(given)):
            generated[i] -= held * (max(-given[i], 0.0) / got)
    return min(max(held, 0.0), SLACK * max(most, 0.0))
