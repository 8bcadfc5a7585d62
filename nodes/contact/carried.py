"""How the contact of two organs follows their motions with their foundations."""

import numpy as np

from palpate.compiler.records import floats, nth, put, vector
from palpate.nodes.base.kernels import ieee_kernel, kernel
from palpate.physics.bodies.floating.turning import spin
from palpate.physics.contact.organs import rigid_motion as rigid


@kernel
def carry(own, pair, rub, normal, first, second):
    """Move both bodies with their foundations: fills the gaps without deformation and the motion that rubs. Returns the
    motion [m] (3) of the first body against the second in this step. A support that is missing stays."""
    if first.count > 0 and nth(first, 0).there:
        put(own.supports[0], vector(nth(first, 0).displacement))
    if second.count > 0 and nth(second, 0).there:
        put(own.supports[1], vector(nth(second, 0).displacement))
    x, y, z = vector(own.apart)
    for k in range(3):
        own.apart[k] = own.supports[0][k] - own.supports[1][k]
    moved = own.apart[0] - x, own.apart[1] - y, own.apart[2] - z
    rest, (x, y, z) = floats(own.rest), vector(own.apart)
    for i in range(len(rest)):
        pair.gap[i] = rest[i] + (normal[i, 0] * x + normal[i, 1] * y + normal[i, 2] * z)
    _stray(own, (x, y, z))
    for k in range(3):
        rub.carried[k] += moved[k]
    return moved


@kernel
def _stray(own, apart):
    """Keep how far the foundations slid and approached: `apart` [m] (3) of the first against the second."""
    x, y, z = apart
    along = own.normal[0] * x + own.normal[1] * y + own.normal[2] * z
    aside = np.sqrt(max(x * x + y * y + z * z - along * along, 0.0))
    own.strays[0], own.strays[1] = max(own.strays[0], aside), max(own.strays[1], -along)


@kernel
def begins_to_ride(own, first, second):
    """Whether an organ rotates with its motion, from its first message on."""
    for support in (first, second):
        if support.count > 0 and nth(support, 0).there:
            own.rides = own.rides or nth(support, 0).rotation.shape[0] > 0
    return own.rides


@kernel
def _place(ride, given):
    """Take the place of an organ from its support."""
    put(ride.at, vector(given.displacement))
    if given.rotation.shape[0] > 0:
        put(ride.turn, vector(floats(given.rotation)))
        put(ride.centre, vector(floats(given.centre)))
        rigid.orient(ride)


@kernel
def _move(own, first, i, second, j, floating):
    """Take the places of the organs that forces move (`floating`), or of all others, from message i of an input and
    message j of another, -1: it has none. Returns whether there is one."""
    found = False
    if i >= 0 and nth(first, i).there and (nth(first, i).mobility.shape[0] > 0) == floating:
        _place(own.ride[0], nth(first, i))
        found = True
    if j >= 0 and nth(second, j).there and (nth(second, j).mobility.shape[0] > 0) == floating:
        _place(own.ride[1], nth(second, j))
        found = True
    return found


@kernel
def _between(own, x, y):
    """Distance [m] (3) of a point x of the first organ from y of the second [m] (3), given at the start."""
    a, b = rigid.placed(own.ride[0], x), rigid.placed(own.ride[1], y)
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@kernel
def against(own, one, two):
    """Motion [m] (3) of the first organ against the second at the patch, by a motion of each [m, rad] (6)."""
    x, y, z = rigid.moved_at(own.ride[0], one, vector(own.point))
    a, b, c = rigid.moved_at(own.ride[1], two, vector(own.point))
    return x - a, y - b, z - c


@kernel
def _place_of(ride):
    """Displacement [m] and rotation [rad] of an organ (2,3)."""
    return vector(ride.at), vector(ride.turn)


@kernel
def _beyond(own, side, before):
    """Work [J] of the force and moment that the contact sent to an organ, by its motion from the place `before` beyond
    the one that the contact expected."""
    ride, by, (at, turn), work = own.ride[side], own.by[side], before, 0.0
    about = spin(turn, (ride.turn[0] - turn[0], ride.turn[1] - turn[1], ride.turn[2] - turn[2]))
    for x in range(3):
        force = own.sent[x] if side == 0 else -own.sent[x]
        work += force * (ride.at[x] - at[x] - by[x]) + own.sent[3 + 3 * side + x] * (about[x] - by[3 + x])
    return work


@kernel
def _cells(own, pair):
    """Fill the directions, levers and gaps of the candidates where both organs are."""
    rigid.place_cells(
        own.ride[0], own.ride[1], floats(own.normals), floats(own.opposite), floats(own.one.place),
        floats(own.two.place), floats(own.turns), floats(own.levers), floats(own.rest), floats(own.before), pair.gap,
    )  # fmt: skip


@ieee_kernel
def ride_on(own, pair, rub, first, i, second, j):
    """Move both organs with their foundations, as of message i of an input of supports and message j of another, -1: it
    has none: fills the gaps of the bodies without deformation, and the motion that rubs."""
    seen, work = floats(own.seen), 0.0
    x, y = rigid.placed_back(own.ride[0], vector(own.point)), rigid.placed_back(own.ride[1], vector(own.point))
    one, two = _place_of(own.ride[0]), _place_of(own.ride[1])
    # the motion by the forces of the last step, against what that step expected
    if _move(own, first, i, second, j, True) or own.floats:
        work = _beyond(own, 0, one) + _beyond(own, 1, two)
        _cells(own, pair)
        for k in range(len(seen)):
            pair.opening[k] += pair.gap[k] - seen[k]
            seen[k] = pair.gap[k]
    own.late += work
    floats(own.carried)[0] -= work
    moved = _between(own, x, y)
    for k in range(3):
        rub.carried[k] += moved[k] - own.counted[k]
        own.counted[k] = own.given[k] = 0.0
    # prescribed motions in this step
    if _move(own, first, i, second, j, False):
        _cells(own, pair)
        after = _between(own, x, y)
        put(own.given, (after[0] - moved[0], after[1] - moved[1], after[2] - moved[2]))
        put(own.counted, vector(own.given))
    elif not own.floats:
        _cells(own, pair)
    for side in range(2):
        for k in range(3):
            put(rub.axes[side, k], vector(own.ride[side].matrix[k]))


@ieee_kernel
def press_on(own, pair):
    """After the normal contact: its force and moments on both organs `own.wrench` [N, N m, N m] (9), and the centre of
    the patch."""
    one, two, active, turns, levers = own.ride[0], own.ride[1], pair.active, floats(own.turns), floats(own.levers)
    at, across, push, place = floats(own.one.place), floats(own.two.place), own.wrench, own.middle
    push[:], place[:] = 0.0, 0.0
    total = 0.0
    for k in range(active.tally[0].active):
        i = active.order[k]
        p, c, e = active.force[i], one.centre, two.centre
        total += p
        arm = rigid.rotated(one, (at[i, 0] - c[0], at[i, 1] - c[1], at[i, 2] - c[2]))
        leg = rigid.rotated(two, (across[i, 0] - e[0], across[i, 1] - e[1], across[i, 2] - e[2]))
        for x in range(3):
            push[x] += p * turns[x, i]
            push[3 + x] += p * levers[x, i]
            push[6 + x] += p * levers[3 + x, i]
            place[x] += 0.5 * p * ((c[x] + one.at[x] + arm[x]) + (e[x] + two.at[x] + leg[x]))
    for x in range(3):
        if total > 0.0:
            own.point[x] = place[x] / total


@ieee_kernel
def end_ride(own, pair, rub):
    """After the friction: fills torques and normal on the second body of the message, counts the work of the
    foundations, and returns force [N] (3) on the first organ in the world."""
    one, two, seen, force, work = own.ride[0], own.ride[1], floats(own.seen), pair.active.force, 0.0
    for i in range(len(seen)):
        work += force[i] * (pair.gap[i] - seen[i])
        seen[i] = pair.gap[i]
    put(own.held, vector(rub.pull))
    for x in range(3):
        work += own.held[x] * own.counted[x]
        own.counted[x] -= own.given[x]
    floats(own.carried)[0] -= work
    along = vector(rub.pull)
    torques, back = floats(own.torques), (-along[0], -along[1], -along[2])
    about, turned = (rigid.torque_at(one, along, vector(own.point)), rigid.torque_at(two, back, vector(own.point)))
    for x in range(3):
        torques[0, x], torques[1, x] = own.wrench[3 + x] + about[x], own.wrench[6 + x] + turned[x]
        own.sent[x], own.sent[3 + x], own.sent[6 + x] = own.wrench[x] + along[x], torques[0, x], torques[1, x]
    _face(own, pair)
    _stray(own, _apart(own))
    return vector(own.sent[:3])


@kernel
def _face(own, pair):
    """Keep the mean normal of the patch in the axes of the second organ, without force the last one."""
    active, opposite, out, x, y, z = pair.active, floats(own.opposite), floats(own.across_normal), 0.0, 0.0, 0.0
    for k in range(active.tally[0].active):
        i = active.order[k]
        p = active.force[i]
        x, y, z = x + p * opposite[i, 0], y + p * opposite[i, 1], z + p * opposite[i, 2]
    size = np.sqrt(x * x + y * y + z * z)
    if size > 0.0:
        put(out, (x / size, y / size, z / size))


@kernel
def _apart(own):
    """Motion [m] (3) of the first organ against the second at the patch since the start, in the axes of the first."""
    a, b, f = rigid.rotated_back(own.ride[0], _between(own, vector(own.foot), vector(own.across)))
    return a - (own.foot[0] - own.across[0]), b - (own.foot[1] - own.across[1]), f - (own.foot[2] - own.across[2])
