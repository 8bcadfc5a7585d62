"""The place of a candidate where both organs are, and its compliances there (`physics.contact.organs.following`)."""

import numpy as np

from palpate.compiler.records import floats, put, unpacking, vector
from palpate.nodes.base.kernels import ieee_kernel, kernel
from palpate.physics.bodies.true_patch import sideways
from palpate.physics.contact.organs import rigid_motion as rigid
from palpate.physics.contact.organs.between_rows import Law, clear_row, renew_row, vector3
from palpate.physics.contact.organs.candidates import FACING
from palpate.physics.contact.organs.following import MOVED, TURNED, Track
from palpate.physics.geometry.mesh_closest import track_mesh

track_of, law_of = unpacking(Track), unpacking(Law)


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
def apart(own, track, first, second, i):
    """Distance [m] (3) of the centre of candidate i on the organ on which it stays from that on the other organ, in the
    axes of the other one, so that exchanged organs have the same bits; first, second [m] (m,3)  the centres."""
    fine = track.fine == 0
    return between_points(own, track, vector3(first if fine else second, i), vector3(second if fine else first, i))


@kernel
def between_points(own, track, x, y):
    """The same for points [m] (3) of the organ on which the candidates stay, and of the other one."""
    fine = track.fine == 0
    if not own.rides:
        sign, a = 1.0 if fine else -1.0, own.apart
        return x[0] - y[0] + sign * a[0], x[1] - y[1] + sign * a[1], x[2] - y[2] + sign * a[2]
    other = own.ride[1 if fine else 0]
    a, b = _in_world(own.ride[0 if fine else 1], x), _in_world(other, y)
    return rigid.rotated_back(other, (a[0] - b[0], a[1] - b[1], a[2] - b[2]))


@ieee_kernel
def search_cell(own, track, cell):
    """The gap [m] of a cell where both organs are, its normal [1] (3) and place [m] (3) on the other one in the axes of
    that; its triangles `track.last` are those of the last search near it."""
    fine = track.fine == 0
    points, foot = floats(own.first_points) if fine else floats(own.second_points), track.foot[0]
    material, other = own.ride[0 if fine else 1], own.ride[1 if fine else 0]
    sign, away, facing = 1.0 if fine else -1.0, 0.0, 0.0
    n0 = n1 = n2 = f0 = f1 = f2 = 0.0
    for at in range(track.begins[cell], track.begins[cell + 1]):
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
    if facing > FACING:  # the edge of an organ
        away = max(away, own.reach)
    return away, (n0, n1, n2), (f0, f1, f2)


@kernel
def place_cell(own, track, pair, one, two, i, found):
    """Set gap, direction and place of candidate i: `found` of `search_cell`."""
    away, n, f = found
    fine = track.fine == 0
    size = (1.0 if fine else -1.0) * np.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
    if abs(size) > 1e-6:
        _turn(own, own.ride[1 if fine else 0], (n[0] / size, n[1] / size, n[2] / size), i)
    place = two.place if fine else one.place
    put(place[i], f)
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
    d = apart(own, track, one.place, two.place, i)
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
def clear_compliance(own, one, two, i):
    """Before the shares of candidate i change on a surface."""
    clear_row(law_of(own.first_law), one, i)
    clear_row(law_of(own.second_law), two, i)


@ieee_kernel
def renew_compliance(own, track, pair, rub, one, two, i):
    """Compute the compliances of candidate i again, and of its friction."""
    first, second = law_of(own.first_law), law_of(own.second_law)
    clear_compliance(own, one, two, i)
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
    at, cell = side.begins[i], track.cell[i]
    for k in range(track.begins[cell], track.begins[cell + 1]):
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
