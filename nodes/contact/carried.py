"""How the contact of two organs follows the motions of their foundations, and answers to those that its forces move."""

import numpy as np

from palpate.compiler.records import floats, integers, lend, nth, put, vector
from palpate.nodes.base.kernels import ieee_kernel, kernel
from palpate.physics.bodies.floating.turning import cross, spin
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
    """Whether an organ rotates with its foundation, from its first message on; makes room for M if forces move one."""
    for support in (first, second):
        if support.count > 0 and nth(support, 0).there:
            own.rides = own.rides or nth(support, 0).rotation.shape[0] > 0
            if nth(support, 0).mobility.shape[0] > 0:
                own.pair.rigid.shape[0] = own.pair.rigid.shape[1]
                own.rub.mobile.shape[0] = 3
    return own.rides


@kernel
def _finger_load(ride, loads, fingers, points, out):
    """Fill `out` [N, N m] (6): force and moment of the fingers' loads about the centre of their organ, in the world;
    points [m] (V,3) of its surface at the start."""
    out[:] = 0.0
    c = ride.centre
    for i in range(min(loads.count, fingers)):
        each = nth(loads, i)
        if not each.there or each.nodes.shape[0] == 0:
            continue
        nodes, forces = integers(each.nodes), floats(each.forces)
        for k in range(len(nodes)):
            at, f = points[nodes[k]], (forces[k, 0], forces[k, 1], forces[k, 2])
            t = cross((at[0] - c[0], at[1] - c[1], at[2] - c[2]), f)
            for x in range(3):
                out[x] += f[x]
                out[3 + x] += t[x]
    force, moment = rigid.rotated(ride, vector(out[:3])), rigid.rotated(ride, vector(out[3:]))
    for x in range(3):
        out[x], out[3 + x] = force[x], moment[x]


@kernel
def _place(ride, given, by):
    """Take the place of an organ from its support; fills its motion `by` [m, rad] (6) since the last one."""
    for x in range(3):
        by[x] = given.displacement[x] - ride.at[x]
        ride.at[x] = given.displacement[x]
    if given.rotation.shape[0] == 0:
        return
    turn, centre, last = floats(given.rotation), floats(given.centre), vector(ride.turn)
    half = (0.5 * (turn[0] + last[0]), 0.5 * (turn[1] + last[1]), 0.5 * (turn[2] + last[2]))
    about = spin(half, (turn[0] - last[0], turn[1] - last[1], turn[2] - last[2]))
    for x in range(3):
        by[3 + x], ride.turn[x], ride.centre[x] = about[x], turn[x], centre[x]
    rigid.orient(ride)


@kernel
def _move(own, first, second, floating):
    """Take the places of the organs that forces move (`floating`), or of all others; fills their motions `own.by`
    (2,6). Returns whether there is one."""
    found = False
    for side, support in enumerate((first, second)):
        own.by[side][:] = 0.0
        if support.count > 0 and nth(support, 0).there and (nth(support, 0).mobility.shape[0] > 0) == floating:
            _place(own.ride[side], nth(support, 0), own.by[side])
            found = True
    return found


@kernel
def _against(own, one, two):
    """Motion [m] (3) of the first organ against the second at the patch, in the axes at the start, by a motion of each
    [m, rad] (6)."""
    x, y, z = rigid.moved_at(own.ride[0], one, vector(own.point))
    a, b, c = rigid.moved_at(own.ride[1], two, vector(own.point))
    return rigid.at_start(own.ride[0], own.ride[1], (x - a, y - b, z - c))


@kernel
def _cells(own, pair):
    """Fill the directions, levers and gaps of the candidates where both organs are."""
    rigid.place_cells(
        own.ride[0], own.ride[1], floats(own.normals), floats(own.one.place), floats(own.two.place),
        floats(own.turns), floats(own.levers), floats(own.rest), pair.gap,
    )  # fmt: skip


@ieee_kernel
def ride_on(own, pair, rub, first, second, loads, others, one_fingers, two_fingers):
    """Move both organs: fills the gaps that they will have at the end of the step by all but the change of its contact
    forces, and M. Then `contact.step_pair`, `rub_on`, `step_rubbing`, and `end_ride`.

    first, second  supports;  loads, others  on the first and the second;  fingers  their numbers
    """
    seen, force, work = floats(own.seen), pair.active.force, 0.0
    # the motion by the forces of the last step, against what that step expected
    _move(own, first, second, True)
    _cells(own, pair)
    for i in range(len(seen)):
        by = pair.gap[i] - seen[i]
        work += force[i] * by
        pair.opening[i] += by
        seen[i] = pair.gap[i]
    own.late += work
    by = _against(own, own.by[0], own.by[1])
    for x in range(3):
        way = by[x] - own.counted[x]
        work += own.held[x] * way
        rub.carried[x] += way
        own.counted[x] = 0.0
    floats(own.carried)[0] -= work
    # prescribed motions in this step
    if _move(own, first, second, False):
        _cells(own, pair)
        put(own.counted, _against(own, own.by[0], own.by[1]))
    # what the foundations expect
    one, two = own.ride[0], own.ride[1]
    for side, support in enumerate((first, second)):
        ride = own.ride[side]
        ride.ahead[:] = 0.0
        if support.count > 0 and nth(support, 0).there and nth(support, 0).mobility.shape[0] > 0:
            given = nth(support, 0)
            if side == 0:
                _finger_load(ride, loads, one_fingers, floats(own.first_points), own.load)
            else:
                _finger_load(ride, others, two_fingers, floats(own.second_points), own.load)
            rigid.expect(ride, floats(given.expected), floats(given.mobility), floats(given.contacts)[0], own.load)
    if len(pair.rigid) > 0 and (rigid.has_changed(one) or rigid.has_changed(two)):
        rigid.build(one, two, floats(own.turns), floats(own.levers), pair.rigid)
        pair.past[0].step = 0.0
    turns, levers, active = floats(own.turns), floats(own.levers), pair.active
    for i in range(len(seen)):
        pair.gap[i] += rigid.opened(one.ahead, 1.0, turns, levers, i, 0) + rigid.opened(
            two.ahead, -1.0, turns, levers, i, 3
        )
    for k in range(active.tally[0].active if len(pair.rigid) > 0 else 0):
        j = active.order[k]
        for i in range(len(seen)):
            pair.gap[i] -= force[j] * pair.rigid[j, i]


@ieee_kernel
def rub_on(own, pair, rub):
    """After the normal contact: the forces of the candidates on both organs `own.push` [N, N m, N m] (9), the centre of
    the patch, and the motion that rubs there."""
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
            push[x] += p * turns[i, x]
            push[3 + x] += p * levers[i, x]
            push[6 + x] += p * levers[i, 3 + x]
            place[x] += 0.5 * p * ((c[x] + one.at[x] + arm[x]) + (e[x] + two.at[x] + leg[x]))
    for x in range(3):
        if total > 0.0:
            own.point[x] = place[x] / total
    if rub.tangents.shape[1] == 0:
        return
    for side in range(2):
        ride, sign = own.ride[side], 1.0 if side == 0 else -1.0
        change, turn = place, own.foot_turn
        for x in range(3):
            change[x] = sign * (push[x] - own.push[x])
            turn[x] = push[3 * side + 3 + x] - own.push[3 * side + 3 + x]
        shift, about = rigid.apply(ride.soft, vector(change), 0), rigid.apply(ride.soft, vector(turn), 3)
        for x in range(3):
            own.by[side][x], own.by[side][3 + x] = ride.ahead[x] + shift[x], ride.ahead[3 + x] + about[x]
    by = _against(own, own.by[0], own.by[1])
    for x in range(3):
        own.counted[x] += by[x]
        rub.carried[x] += own.counted[x]
    if len(rub.mobile) > 0:
        rigid.mobile_at(one, two, vector(own.point), rub.mobile)


@ieee_kernel
def end_ride(own, pair, rub, out, last):
    """After the friction, that of the last step `last` [N] (3) on the second organ: fills the torques of the message
    and adds the friction to its resultant; counts the work of the foundations."""
    one, two, seen, force, work = own.ride[0], own.ride[1], floats(own.seen), pair.active.force, 0.0
    for i in range(len(seen)):
        work += force[i] * (pair.gap[i] - seen[i])
        seen[i] = pair.gap[i]
    for x in range(3):
        own.held[x] = out.friction[x]
        for y in range(len(rub.mobile)):
            own.counted[x] -= rub.mobile[x, y] * (rub.total[y] - last[y])
        work += own.held[x] * own.counted[x]
    floats(own.carried)[0] -= work
    pull = rigid.in_world(one, two, vector(out.friction))
    torques, back = floats(own.torques), (-pull[0], -pull[1], -pull[2])
    about, against = (rigid.torque_at(one, pull, vector(own.point)), rigid.torque_at(two, back, vector(own.point)))
    for x in range(3):
        out.resultant[x] = own.wrench[x] + pull[x]
        torques[0, x], torques[1, x] = own.wrench[3 + x] + about[x], own.wrench[6 + x] + against[x]
        own.push[x], own.push[3 + x], own.push[6 + x] = own.wrench[x], own.wrench[3 + x], own.wrench[6 + x]
    _stray(own, _apart(own))


@kernel
def give_back(own, dissipated, out):
    """Let the foundations take back what the contact has given beyond all that it has `dissipated` [J]: in proportion
    to their inertia, those that forces move."""
    floats(own.surplus)[0] = floats(own.surplus)[1] = 0.0
    if own.pair.rigid.shape[0] == 0:
        return
    more = -dissipated - own.owed
    one, two = own.ride[0].mobility[0, 0], own.ride[1].mobility[0, 0]
    if more > 0.0 and one + two > 0.0:
        own.owed += more
        first = (two if two > 0.0 else one) if one > 0.0 else 0.0
        second = (one if one > 0.0 else two) if two > 0.0 else 0.0
        floats(own.surplus)[0], floats(own.surplus)[1] = (
            more * first / (first + second),
            more * second / (first + second),
        )
    lend(out.surplus, own.surplus)


@kernel
def _apart(own):
    """Motion [m] (3) of the first organ against the second at the patch since the start, in the axes there."""
    one, two, c, e = own.ride[0], own.ride[1], own.ride[0].centre, own.ride[1].centre
    x = rigid.rotated(one, (own.foot[0] - c[0], own.foot[1] - c[1], own.foot[2] - c[2]))
    y = rigid.rotated(two, (own.across[0] - e[0], own.across[1] - e[1], own.across[2] - e[2]))
    d = (
        (c[0] + one.at[0] + x[0]) - (e[0] + two.at[0] + y[0]),
        (c[1] + one.at[1] + x[1]) - (e[1] + two.at[1] + y[1]),
        (c[2] + one.at[2] + x[2]) - (e[2] + two.at[2] + y[2]),
    )
    a, b, f = rigid.at_start(one, two, d)
    return a - (own.foot[0] - own.across[0]), b - (own.foot[1] - own.across[1]), f - (own.foot[2] - own.across[2])
