"""How the candidates of two organs follow while these slide on each other (`physics.contact.organs.following`)."""

import numpy as np

from palpate.compiler.records import floats, put, unpacking, vector
from palpate.nodes.base.kernels import ieee_kernel, kernel
from palpate.physics.bodies.true_patch import sideways
from palpate.physics.contact.organs import rigid_motion as rigid
from palpate.physics.contact.organs.between import take
from palpate.physics.contact.organs.between_rows import Law, clear_row, renew_row, vector3
from palpate.physics.contact.organs.candidates import FACING
from palpate.physics.contact.organs.following import (
    CLOSE,
    COARSER,
    EASE,
    FAR,
    FINEST,
    LEAST,
    MOVED,
    NEAR,
    STEEP,
    TILTED,
    TURNED,
    VERTICES,
    Track,
)
from palpate.physics.contact.organs.pivoting import admit, release
from palpate.physics.geometry.mesh_closest import track_mesh

track_of, law_of = unpacking(Track), unpacking(Law)
ROUNDED = 1e-9  # [1] of two candidates that are due equally, the first one is next
STILL, REACHES = 1e-5, 0.05  # [m] motion after which candidates may be due; [m] from the centre of an organ to them


@ieee_kernel
def follow(own, pair, rub, one, two):
    """Compute candidates again that have slid, of the next ones in turn; fills their gaps. `one`, `two`: both sides.
    Returns the candidate whose compliances were computed again, -1: none; `renew_matrix` or `renew_factor` is due."""
    track = track_of(own.track)
    if len(track.last) == 0 or _rests(own):
        return -1
    count, left, behind = len(track.jumps), VERTICES, _ease(own, track, pair)
    for k in range(count):
        i = (own.turn + k) % count
        if not _slides(own, track, one.place, two.place, i, max(pair.opening[i], 0.0)):
            continue
        if left <= 0:
            own.turn, behind = i, True
            break
        _find_again(own, track, pair, one, two, i)
        left -= track.begins[i + 1] - track.begins[i]
    most, due = 1.0, -1
    for i in range(count):
        late = track.late[i] if pair.active.place[i] >= 0 or pair.opening[i] <= CLOSE else track.late[i] / FAR
        if late > most * (1.0 + ROUNDED):
            most, due = late, i
    if due >= 0:
        _renew(own, track, pair, rub, one, two, due)
        track.late[due] = 0.0
    if due < 0 and not behind:
        _keep_still(own)
    return due


@kernel
def _ease(own, track, pair):
    """Take the next part of the changes of the gaps. Returns whether more are left."""
    more, rest, seen, share = False, floats(own.rest), floats(own.seen), _affordable(own, track, pair)
    for i in range(len(track.pending)):
        if track.pending[i] == 0.0:
            continue
        part = _part(track.pending[i])
        if part < 0.0 and pair.active.force[i] > 0.0:
            part *= share
        elif own.floats:  # without load, what its opening allows
            part = max(part, -max(pair.opening[i], 0.0))
        track.pending[i] -= part
        track.jumps[i] += part
        rest[i] += part
        pair.gap[i] += part
        if own.rides:
            seen[i] += part
        more = more or track.pending[i] != 0.0
    return more


@kernel
def _part(pending):
    """Part of a change of a gap [m] that is taken in a step."""
    return EASE * pending if abs(pending) > LEAST else pending


@kernel
def _affordable(own, track, pair):
    """Share [1] of the changes that close gaps under load. Between organs that forces move they cost at most what the
    contact lost in the last step, so that it generates no energy; a prescribed motion bears all."""
    if not own.floats:
        return 1.0
    cost = 0.0
    for k in range(pair.active.tally[0].active):
        i = pair.active.order[k]
        cost -= pair.active.force[i] * min(_part(track.pending[i]), 0.0)
    return min(1.0, own.room / cost) if cost > 0.0 else 1.0


@kernel
def keep_room(own, pair):
    """After a step between organs that forces move: the energy [J] that the contact lost in it."""
    lost = pair.past[0].dissipated - pair.past[0].generated - own.late
    own.room, own.losses = max(lost - own.losses, 0.0), lost


@kernel
def _rests(own):
    """Whether both organs are where they were when nothing was due."""
    far = 0.0
    for side in range(2):
        turn, kept, before, way, about = own.ride[side].turn, own.still[side], own.still_turn[side], 0.0, 0.0
        for x in range(3):
            way += (kept[x] - (own.ride[side].at[x] if own.rides else own.supports[side, x])) ** 2
            about += (before[x] - turn[x]) ** 2
        far = max(far, np.sqrt(way), REACHES * np.sqrt(about))
    return far < STILL


@kernel
def _keep_still(own):
    for side in range(2):
        for x in range(3):
            own.still[side, x] = own.ride[side].at[x] if own.rides else own.supports[side, x]
            own.still_turn[side, x] = own.ride[side].turn[x]


@kernel
def _in_world(ride, x):
    """Place [m] (3) of a point of an organ."""
    c = ride.centre
    arm = rigid.rotated(ride, (x[0] - c[0], x[1] - c[1], x[2] - c[2]))
    return c[0] + ride.at[0] + arm[0], c[1] + ride.at[1] + arm[1], c[2] + ride.at[2] + arm[2]


@kernel
def _on_organ(ride, x):
    """The point [m] (3) of an organ that is at a place."""
    c = ride.centre
    leg = rigid.rotated_back(ride, (x[0] - c[0] - ride.at[0], x[1] - c[1] - ride.at[1], x[2] - c[2] - ride.at[2]))
    return c[0] + leg[0], c[1] + leg[1], c[2] + leg[2]


@kernel
def _apart(own, track, first, second, i):
    """Distance [m] (3) of the centre of candidate i on the organ on which it stays from that on the other organ, in the
    axes of the other one, so that exchanged organs have the same bits; first, second [m] (m,3)  the centres."""
    fine = track.fine == 0
    x, y = vector3(first, i) if fine else vector3(second, i), vector3(second, i) if fine else vector3(first, i)
    if not own.rides:
        sign, a = 1.0 if fine else -1.0, own.apart
        return x[0] - y[0] + sign * a[0], x[1] - y[1] + sign * a[1], x[2] - y[2] + sign * a[2]
    other = own.ride[1 if fine else 0]
    a, b = _in_world(own.ride[0 if fine else 1], x), _in_world(other, y)
    return rigid.rotated_back(other, (a[0] - b[0], a[1] - b[1], a[2] - b[2]))


@kernel
def _slides(own, track, first, second, i, opening):
    """Whether candidate i slid too far since it was computed; opening [m] >= 0."""
    d, base = _apart(own, track, first, second, i), track.base[i]
    n = vector3(floats(own.opposite) if track.fine == 0 else floats(own.normals), i)
    if own.rides and _tilted(own, i):
        return True
    along, slid = _parts(d, n, base)
    most, closed = FINEST + COARSER * opening, STEEP * abs(along) if opening < NEAR else 0.0
    if slid > most + closed or _parts(d, n, track.origin[i])[1] > most + track.approached[i] + closed:
        return True
    if closed > FINEST:
        put(base, d)
        track.approached[i] += slid
    return False


@kernel
def _tilted(own, i):
    """Whether the directions of candidate i on both organs differ by more than `TILTED`, after a rotation."""
    n, m = rigid.rotated(own.ride[0], vector3(floats(own.normals), i)), vector3(floats(own.opposite), i)
    m = rigid.rotated(own.ride[1], m)
    return (n[0] - m[0]) ** 2 + (n[1] - m[1]) ** 2 + (n[2] - m[2]) ** 2 > TILTED * TILTED


@kernel
def _parts(d, n, base):
    """Parts [m] of d - base (3) along n and across it."""
    x, y, z = d[0] - base[0], d[1] - base[1], d[2] - base[2]
    along = n[0] * x + n[1] * y + n[2] * z
    return along, np.sqrt(max(x * x + y * y + z * z - along * along, 0.0))


@ieee_kernel
def _find_again(own, track, pair, one, two, i):
    """Gap, normal and place of candidate i where both organs are."""
    fine = track.fine == 0
    points, foot = floats(own.first_points) if fine else floats(own.second_points), track.foot[0]
    material, other = own.ride[0 if fine else 1], own.ride[1 if fine else 0]
    sign, away, facing = 1.0 if fine else -1.0, 0.0, 0.0
    n0 = n1 = n2 = f0 = f1 = f2 = 0.0
    for at in range(track.begins[i], track.begins[i + 1]):
        x, m = vector3(points, track.vertices[at]), vector3(track.facing, at)
        if own.rides:
            x = _on_organ(other, _in_world(material, x))
            m = rigid.rotated_back(other, rigid.rotated(material, m))
        else:
            x = (x[0] + sign * own.apart[0], x[1] + sign * own.apart[1], x[2] + sign * own.apart[2])
        track.tracked[0].exists, track.tracked[0].triangle = True, track.last[at]
        track_mesh(
            track.points, track.cells, track.discs, track.star_at, track.star, x[0], x[1], x[2], 0.0,
            track.tracked[0], track.work, foot,
        )  # fmt: skip
        track.last[at], w = track.tracked[0].triangle, track.weights[at]
        track.places[at, 0], track.places[at, 1] = foot.place[0], foot.place[1]
        n, f = foot.normal, foot.point
        away += w * foot.distance
        facing += w * (n[0] * m[0] + n[1] * m[1] + n[2] * m[2])
        n0, n1, n2 = n0 + w * n[0], n1 + w * n[1], n2 + w * n[2]
        f0, f1, f2 = f0 + w * f[0], f1 + w * f[1], f2 + w * f[2]
    size = sign * np.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
    if facing > FACING:  # the edge of an organ
        away = max(away, own.reach)
    if abs(size) > 1e-6:
        _turn(own, other, (n0 / size, n1 / size, n2 / size), i)
    place = two.place if fine else one.place
    place[i, 0], place[i, 1], place[i, 2] = f0, f1, f2
    _set_gap(own, track, pair, one, two, i, away)
    track.late[i] = _late(own, one, two, place, two.centre if fine else one.centre, i)


@kernel
def _turn(own, other, n, i):
    """Set the direction [1] (3) of candidate i, given in the axes of the other organ."""
    if own.rides:
        n = rigid.rotated(other, n)
        put(floats(own.normals)[i], rigid.rotated_back(own.ride[0], n))
        put(floats(own.opposite)[i], rigid.rotated_back(own.ride[1], n))
    else:
        put(floats(own.normals)[i], n)
        put(floats(own.opposite)[i], n)


@kernel
def _set_gap(own, track, pair, one, two, i, away):
    """Set the gap [m] of candidate i for its new place and direction; of one that touches the change is taken in parts
    (`_ease`)."""
    rest, before, n, jump = floats(own.rest), floats(own.before), vector3(floats(own.normals), i), away - pair.gap[i]
    track.pending[i] = jump if pair.active.place[i] >= 0 or pair.opening[i] + jump < 0.0 else 0.0
    jump -= track.pending[i]
    now = pair.gap[i] + jump
    if own.rides:
        rest[i] = before[i] = 0.0
        rigid.place_cell(
            own.ride[0], own.ride[1], floats(own.normals), floats(own.opposite), one.place, two.place,
            floats(own.turns), floats(own.levers), rest, before, pair.gap, i,
        )  # fmt: skip
        rest[i], before[i] = now, pair.gap[i]
        floats(own.seen)[i] += jump
    else:
        x, y, a = vector3(one.place, i), vector3(two.place, i), own.apart
        rest[i] = now - (n[0] * a[0] + n[1] * a[1] + n[2] * a[2])
        before[i] = n[0] * (x[0] - y[0]) + n[1] * (x[1] - y[1]) + n[2] * (x[2] - y[2])
    pair.gap[i] = now
    track.jumps[i] += jump
    d = _apart(own, track, one.place, two.place, i)
    put(track.base[i], d)
    put(track.origin[i], d)
    track.approached[i] = 0.0


@kernel
def _late(own, one, two, place, centre, i):
    """By how much the compliances of candidate i are due; 1: they are. place, centre [m] (m,3)  where it is on the
    other organ, and was for the last ones."""
    normal, across = floats(own.normals), floats(own.opposite)
    moved = turned = about = 0.0
    for x in range(3):
        moved += (place[i, x] - centre[i, x]) ** 2
        turned += (normal[i, x] - one.normal[i, x]) ** 2
        about += (across[i, x] - two.normal[i, x]) ** 2
    return np.sqrt(moved) / MOVED + np.sqrt(max(turned, about)) / TURNED


@ieee_kernel
def _renew(own, track, pair, rub, one, two, i):
    """Compute the compliances of candidate i again, and of its friction."""
    first, second = law_of(own.first_law), law_of(own.second_law)
    clear_row(first, one, i)
    clear_row(second, two, i)
    if track.fine == 0:
        _take_shares(track, two, i)
    else:
        _take_shares(track, one, i)
    put(one.normal[i], vector3(floats(own.normals), i))
    put(two.normal[i], vector3(floats(own.opposite), i))
    if rub.tangents.shape[1] > 0:
        _turn_tangents(own, rub, i)
    area, at = floats(own.areas), one.place if track.fine == 0 else two.place
    renew_row(first, one, i, 1.0, at, area, rub.tangents, pair.first, rub.first)
    renew_row(second, two, i, -1.0, at, area, rub.tangents, pair.second, rub.second)


@kernel
def _take_shares(track, side, i):
    """The weights of candidate i on the surface over which it slides."""
    at = side.begins[i]
    for k in range(track.begins[i], track.begins[i + 1]):
        corners, v, w = track.cells[track.last[k]].corners, track.places[k, 0], track.places[k, 1]
        for c in range(3):
            weight = track.weights[k] * (1.0 - v - w if c == 0 else (v if c == 1 else w))
            if weight > 0.0:
                side.vertices[at], side.shares[at] = corners[c], weight
                at += 1
    side.ends[i] = at
    put(side.centre[i], vector3(side.place, i))


@kernel
def _turn_tangents(own, rub, i):
    """New tangents of candidate i, and its displacements along them."""
    count, one, two, along = rub.tangents.shape[1], floats(own.normals), floats(own.opposite), floats(own.tangents)
    x, y, z = one[i, 0] + two[i, 0], one[i, 1] + two[i, 1], one[i, 2] + two[i, 2]
    size = max(np.sqrt(x * x + y * y + z * z), 1e-12)
    sideways((x / size, y / size, z / size), along)
    for kept in (rub.moved, rub.others):
        for body in range(2):
            u, v = kept[body, i], kept[body, count + i]
            for a in range(2):
                way = 0.0
                for k in range(3):
                    way += (u * rub.tangents[0, i, k] + v * rub.tangents[1, i, k]) * along[a, k]
                kept[body, a * count + i] = way
    for a in range(2):
        put(rub.tangents[a, i], vector(along[a]))


@ieee_kernel
def renew_matrix(pair, i):
    """After `follow`: row and column i of W; -1: none. Returns whether there is one."""
    step, matrix = pair.past[0].step, pair.matrix
    if i < 0 or not step > 0.0:
        return False
    first, second = take(pair, 0, step), take(pair, 1, step)
    for j in range(len(matrix)):
        matrix[i, j] = matrix[j, i] = first * pair.first[i, j] + second * pair.second[i, j]
    return True


@ieee_kernel
def renew_factor(pair, i):
    """The same with the factor of the active candidates, in a contact alone."""
    active = pair.active
    if renew_matrix(pair, i) and active.place[i] >= 0:
        force = active.force[i]
        release(active, i)
        if admit(pair.matrix, active, i):
            active.force[i] = force


@ieee_kernel
def jumped(own, pair):
    """After a step: the work [J] of its forces with changes of the gaps without a motion; keeps the force where the
    region with candidates ends."""
    track, force, work = track_of(own.track), pair.active.force, 0.0
    if len(track.last) == 0:
        return work
    for k in range(pair.active.tally[0].active):
        i = pair.active.order[k]
        work += force[i] * track.jumps[i]
        if track.rim[i]:
            own.ended = max(own.ended, force[i])
    track.jumps[:] = 0.0
    return work
