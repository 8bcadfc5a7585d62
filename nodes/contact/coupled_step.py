"""Kernels of contacts that share organs on foundations, on the state of a `contact.Coupled`
(`physics.contact.organs.coupled`)."""

import numpy as np

from palpate.compiler.dot import dot
from palpate.compiler.records import floats, integers, longs, nth, put, unpacking, vector
from palpate.nodes.base.kernels import ieee_kernel, kernel
from palpate.nodes.contact.carried import against, end_ride, press_on, ride_on
from palpate.nodes.contact.followed import follow, jumped, keep_room, renew_matrix
from palpate.nodes.contact.organs.body_side import pair_of, rub_of, side_of, spread_forces
from palpate.nodes.contact.organs.withheld import joins_run, leaps, withhold
from palpate.physics.bodies.floating.turning import cross
from palpate.physics.contact.organs import between as contact
from palpate.physics.contact.organs import coupled
from palpate.physics.contact.organs import rigid_motion as rigid
from palpate.physics.contact.organs.pivoting import ActiveSet, add_rows, complement, refactor
from palpate.physics.contact.organs.rubbing import begin_rubbing, end_rubbing, pull_of, solve_rubbing
from palpate.physics.contact.organs.rubbing_patch import open_by_friction

active_of = unpacking(ActiveSet)
RENEWED = 16  # candidates with new compliances after which the matrix is computed again


@ieee_kernel
def repeat_loads(own, k, side, loads, out, aside):
    """Fill the openings `out` [m] (m), and the displacements `aside` (2m), of contact k by all other loads on one of
    its bodies: those that it names, and those of the other contacts in their last step. Returns whether a load is on an
    unknown vertex."""
    m, picks = own.members[k], integers(own.picks)
    body = side_of(m.one if side == 0 else m.two)
    row, moved = floats(m.opened if side == 0 else m.again)[0, 0], floats(m.slid)
    out[:] = 0.0
    aside[:] = 0.0
    for i in range(picks.shape[2]):
        if picks[k, side, i] < 0:
            break
        each = nth(loads, picks[k, side, i])
        if not each.there or each.nodes.shape[0] == 0:
            continue
        nodes = integers(each.nodes)
        for v in nodes:
            if not 0 <= v < len(body.corners):
                return True
        _add_load(body, nodes, floats(each.forces), row, moved, out, aside)
    bodies = integers(own.touched)
    for other in range(len(bodies)):
        for s in range(2):
            if other == k or bodies[other, s] != bodies[k, side]:
                continue
            given = own.members[other].one if s == 0 else own.members[other].two
            count = int(own.loaded[other, s])
            if count > 0:
                _add_load(body, integers(given.nodes)[:count], floats(given.forces)[:count], row, moved, out, aside)
    return False


@kernel
def _add_load(body, nodes, forces, row, moved, out, aside):
    """Add the openings and displacements of the candidates by a load."""
    up = (0.0, 0.0, 1.0)
    contact.open_by(
        nodes, forces, up, body.corners, body.weights, body.response, body.gathered, body.touched, row, row[:0]
    )
    for i in range(len(out)):
        out[i] += row[i]
    if len(aside) > 0:
        contact.open_by(
            nodes, forces, up, body.corners, body.weights, body.aside, body.gathered, body.touched, moved, row[:0]
        )
        for i in range(len(aside)):
            aside[i] += moved[i]


@kernel
def finger_load(own, k, side, loads):
    """Fill the force and moment [N, N m] (6) `load` of contact k of the fingers' loads on one of its organs, about the
    centre of the organ, in the world."""
    m, picks = own.members[k], integers(own.picks)
    ride, points = m.ride[side], floats(m.first_points if side == 0 else m.second_points)
    out, c = m.load, ride.centre
    out[:] = 0.0
    for i in range(picks.shape[2]):
        if picks[k, side, i] < 0:
            break
        each = nth(loads, picks[k, side, i])
        if not each.there or each.nodes.shape[0] == 0:
            continue
        nodes, forces = integers(each.nodes), floats(each.forces)
        for n in range(len(nodes)):
            at, f = points[nodes[n]], (forces[n, 0], forces[n, 1], forces[n, 2])
            t = cross((at[0] - c[0], at[1] - c[1], at[2] - c[2]), f)
            for x in range(3):
                out[x] += f[x]
                out[3 + x] += t[x]
    force, moment = rigid.rotated(ride, vector(out[:3])), rigid.rotated(ride, vector(out[3:]))
    for x in range(3):
        out[x], out[3 + x] = force[x], moment[x]


@kernel
def expect(own, k, loads, supports):
    """Take what the foundations of both organs of contact k expect."""
    sides = integers(own.sides)
    for side in range(2):
        ride, at = own.members[k].ride[side], sides[k, side]
        ride.ahead[:] = 0.0
        if at >= 0 and nth(supports, at).there and nth(supports, at).mobility.shape[0] > 0:
            given = nth(supports, at)
            finger_load(own, k, side, loads)
            rigid.expect(ride, floats(given.expected), floats(given.mobility), own.members[k].load)


@kernel
def take_back(own):
    """Remove from the motions `free`, which the foundations expect if all forces stay, those by the forces that the
    contacts sent in the last step, with the directions and moments that they had there."""
    sides, wrench = integers(own.sides), own.wrench
    for k in range(len(sides)):
        m = own.members[k]
        for side in range(2):
            if sides[k, side] < 0:
                continue
            for x in range(3):
                wrench[x] = m.sent[x] if side == 0 else -m.sent[x]
                wrench[3 + x] = m.sent[3 + 3 * side + x]
            coupled.add_motion(m.ride[side], wrench, -1.0, own.organs[sides[k, side]].free)


@kernel
def push_all(own):
    """Fill `pushed`, the motions of all organs by the normal forces of all contacts."""
    sides = integers(own.sides)
    for k in range(len(sides)):
        for side in range(2):
            if sides[k, side] >= 0:
                coupled.clear_wrench(own.organs[sides[k, side]].pushed)
    for k in range(len(sides)):
        m = own.members[k]
        pair, turns, levers = pair_of(m.pair), floats(m.turns), floats(m.levers)
        for side in range(2):
            if sides[k, side] < 0:
                continue
            organ, wrench = own.organs[sides[k, side]], own.wrench
            coupled.clear_wrench(wrench)
            for n in range(pair.active.tally[0].active):
                i = pair.active.order[n]
                coupled.add_push(wrench, pair.active.force[i], turns, levers, i, side)
            coupled.add_motion(m.ride[side], wrench, 1.0, organ.pushed)


@kernel
def motion_of(own, k, side, out):
    """Fill `out` [m, rad] (6): the motion in this step of an organ of contact k."""
    at = integers(own.sides)[k, side]
    for x in range(6):
        out[x] = 0.0
        if at >= 0:
            organ = own.organs[at]
            out[x] = organ.free[x] + organ.pushed[x] + organ.rubbed[x]


@ieee_kernel
def build(own):
    """Fill the matrix of all contacts."""
    matrix, sides, starts = floats(own.matrix), integers(own.sides), longs(own.starts)
    matrix[:] = 0.0
    for k in range(len(sides)):
        m, at = own.members[k], starts[k]
        for side in range(2):
            if sides[k, side] < 0:
                continue
            ride = m.ride[side]
            rigid.keep_built(ride)
            for other in range(len(sides)):
                for s in range(2):
                    if sides[other, s] == sides[k, side]:
                        n = own.members[other]
                        coupled.add_block(
                            ride.soft,
                            side,
                            floats(m.turns),
                            floats(m.levers),
                            s,
                            floats(n.turns),
                            floats(n.levers),
                            matrix,
                            at,
                            starts[other],
                        )
        # last, so that exchanged bodies have the same bits
        alone = floats(m.pair.matrix)
        for i in range(len(alone)):
            for j in range(len(alone)):
                matrix[at + i, at + j] += alone[i, j]


@ieee_kernel
def build_row(own, k, i):
    """Fill row and column of the matrix of all contacts for candidate i of contact k, which is free: it moved to
    another cell (`reassigned`)."""
    matrix, sides, starts, m = floats(own.matrix), integers(own.sides), longs(own.starts), own.members[k]
    row, at, alone = matrix[starts[k] + i], starts[k], floats(m.pair.matrix)
    row[:] = 0.0
    for side in range(2):
        for other in range(len(sides)):
            for s in range(2):
                if sides[k, side] >= 0 and sides[other, s] == sides[k, side]:
                    n, turns, levers = own.members[other], floats(m.turns), floats(m.levers)
                    soft, begin = m.ride[side].soft, starts[other]
                    coupled.add_row(soft, side, turns, levers, i, s, floats(n.turns), floats(n.levers), row[begin:])
    for j in range(len(alone)):
        row[at + j] += alone[i, j]
    for j in range(len(row)):
        matrix[j, at + i] = row[j]


@ieee_kernel
def fill_gaps(own):
    """Fill the gaps of all candidates with the forces so far. Returns how far [m] those that bear are from zero, or
    others below."""
    gap, sides, starts, off = floats(own.gap), integers(own.sides), longs(own.starts), 0.0
    for k in range(len(sides)):
        m = own.members[k]
        pair, turns, levers, at = pair_of(m.pair), floats(m.turns), floats(m.levers), starts[k]
        motion_of(own, k, 0, m.by[0])
        motion_of(own, k, 1, m.by[1])
        for i in range(len(pair.free)):
            gap[at + i] = pair.free[i] + coupled.opening_of(m.by[0], m.by[1], turns, levers, i)
        add_rows(pair.matrix, pair.active, 1.0, gap[at : starts[k + 1]])
        for i in range(len(pair.free)):
            off = max(off, abs(gap[at + i]) if pair.active.force[i] > 0.0 else -gap[at + i])
    return off


@ieee_kernel
def solve_normal(own, most):
    """Solve for the normal forces of all contacts, after `fill_gaps`. Returns the candidates that are left."""
    active, gap, matrix = active_of(own.active), floats(own.gap), floats(own.matrix)
    add_rows(matrix, active, -1.0, gap)
    left = complement(matrix, gap, active, most)
    hand_out(own, active)
    push_all(own)
    return left


@kernel
def hand_out(own, active):
    """Give each contact its active candidates and their forces."""
    starts = longs(own.starts)
    for k in range(len(starts) - 1):
        pair, count = pair_of(own.members[k].pair), 0
        pair.active.force[:] = 0.0
        pair.active.place[:] = -1
        for n in range(active.tally[0].active):
            i = active.order[n] - starts[k]
            if 0 <= i < len(pair.free):
                pair.active.order[count], pair.active.place[i] = i, count
                pair.active.force[i] = active.force[active.order[n]]
                count += 1
        pair.active.tally[0].active = count


@kernel
def join_all(own):
    """Where the contacts join a run, after `withhold`: take the forces that their bodies bear as those of the last
    step, which the foundations have felt."""
    starts, active, count = longs(own.starts), active_of(own.active), 0
    for k in range(len(starts) - 1):
        m = own.members[k]
        pair = pair_of(m.pair)
        for n in range(pair.active.tally[0].active):
            i = starts[k] + pair.active.order[n]
            active.order[count], active.place[i], active.force[i] = i, count, pair.active.force[pair.active.order[n]]
            count += 1
        press_on(m, pair)
        for x in range(9):
            m.sent[x] = m.wrench[x]
    active.tally[0].active = count


@kernel
def _rub_by(own, k, pull, sign):
    """Add the motion of both organs of contact k by `sign` times a friction `pull` [N] (3) on the first."""
    m, sides, wrench = own.members[k], integers(own.sides), own.wrench
    along = (sign * pull[0], sign * pull[1], sign * pull[2])
    for side in range(2):
        if sides[k, side] < 0:
            continue
        force = along if side == 0 else (-along[0], -along[1], -along[2])
        torque = rigid.torque_at(m.ride[side], force, vector(m.point))
        for x in range(3):
            wrench[x], wrench[3 + x] = force[x], torque[x]
        coupled.add_motion(m.ride[side], wrench, 1.0, own.organs[sides[k, side]].rubbed)


@ieee_kernel
def rub(own, k, dt):
    """Solve for the friction of contact k. Returns its change over the normal force [1]."""
    m = own.members[k]
    pair, rubs = pair_of(m.pair), rub_of(m.rub)
    # the motion without this friction, whose answer is in its mobility
    _rub_by(own, k, own.pulls[k], -1.0)
    press_on(m, pair)
    motion_of(own, k, 0, m.by[0])
    motion_of(own, k, 1, m.by[1])
    by = against(m, m.by[0], m.by[1])
    for x in range(3):
        own.ways[k, 1, x] = by[x]
        rubs.carried[x] = own.ways[k, 0, x] + m.counted[x] + by[x]
    rigid.mobile_at(m.ride[0], m.ride[1], vector(m.point), rubs.mobile)
    x, y, z = vector(own.pulls[k])
    own.bears[k] = solve_rubbing(pair, rubs, dt)
    put(own.pulls[k], pull_of(rubs, rubs.answer) if own.bears[k] > 0.0 else (0.0, 0.0, 0.0))
    _rub_by(own, k, own.pulls[k], 1.0)
    a, b, c = own.pulls[k, 0] - x, own.pulls[k, 1] - y, own.pulls[k, 2] - z
    return np.sqrt(a * a + b * b + c * c) / max(own.bears[k], contact.LEAST_FORCE)


@ieee_kernel
def begin(own, loads, supports, dt):
    """Place all contacts, and fill the motion of the organs without the normal forces of this step."""
    sides, changed = integers(own.sides), False
    joins = joins_run(own.members[own.place].steps, supports)
    for k in range(len(sides)):
        m = own.members[k]
        pair, rubs = pair_of(m.pair), rub_of(m.rub)
        leapt = leaps(m, 0, supports, sides[k, 0])
        leapt = leaps(m, 1, supports, sides[k, 1]) or leapt
        ride_on(m, pair, rubs, supports, sides[k, 0], supports, sides[k, 1])
        withhold(m, pair, rubs, joins, leapt, dt)
        if renew_matrix(pair, follow(m, pair, rubs, side_of(m.one), side_of(m.two), dt)):
            own.renewed += 1
        expect(own, k, loads, supports)
        put(own.ways[k, 0], vector(rubs.carried))
        put(own.pulls[k], vector(m.held))
        own.bears[k] = 0.0
        if len(rubs.touched) > 0:
            open_by_friction(rubs, floats(m.others))
            begin_rubbing(rubs)
        if contact.begin_step(pair, floats(m.others), dt):
            changed = True
        for side in range(2):
            if sides[k, side] >= 0:
                organ, ride = own.organs[sides[k, side]], m.ride[side]
                changed = changed or rigid.has_changed(ride)
                for x in range(6):
                    organ.free[x], organ.pushed[x], organ.rubbed[x] = ride.ahead[x], 0.0, 0.0
    if joins:
        join_all(own)
    take_back(own)
    push_all(own)
    for k in range(len(sides)):
        if own.members[k].rub.touched.shape[0] > 0:
            _rub_by(own, k, own.pulls[k], 1.0)
    if changed or own.renewed > RENEWED:
        own.renewed = 0
        build(own)
        refactor(floats(own.matrix), active_of(own.active))
    else:
        for k in range(len(sides)):
            if own.members[k].fresh >= 0:
                build_row(own, k, own.members[k].fresh)


@ieee_kernel
def solve(own, dt):
    """Solve for all forces. Returns the number of candidates that are left."""
    sides, left, slid = integers(own.sides), 0, 0.0
    for sweep in range(coupled.SWEEPS):
        if fill_gaps(own) <= coupled.SETTLED and sweep > 0 and slid <= coupled.SETTLED:
            break
        left, slid = solve_normal(own, contact.MOST), 0.0
        for k in range(len(sides)):
            if own.members[k].rub.touched.shape[0] > 0:
                slid = max(slid, rub(own, k, dt))
    return left


@ieee_kernel
def finish(own, k, dt):
    """Move the bodies of contact k by its forces, and keep them for the next step. Returns the force [N] (3) on the
    first organ."""
    m = own.members[k]
    pair, rubs, turns, levers = pair_of(m.pair), rub_of(m.rub), floats(m.turns), floats(m.levers)
    motion_of(own, k, 0, m.by[0])
    motion_of(own, k, 1, m.by[1])
    for i in range(len(pair.gap)):
        pair.gap[i] += coupled.opening_of(m.by[0], m.by[1], turns, levers, i)
    contact.end_step(pair, dt)
    press_on(m, pair)
    by = against(m, m.by[0], m.by[1])
    for x in range(3):
        m.counted[x] += by[x]
    if len(rubs.touched) > 0:
        end_rubbing(pair, rubs, own.bears[k], dt)
    whole = end_ride(m, pair, rubs)
    # work of the friction on the late motion, which it counts, and with a change of the gaps without a motion
    m.late -= jumped(m, pair) + dot(vector(m.held), vector(own.ways[k, 0]))
    keep_room(m, pair, rubs)
    first = spread_forces(pair, side_of(m.one), rubs.force[0], 1.0)
    second = spread_forces(pair, side_of(m.two), rubs.force[1], -1.0)
    own.loaded[k, 0], own.loaded[k, 1] = first, second
    return whole
