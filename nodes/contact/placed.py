"""The place of a candidate where both organs are, and its compliances there (`physics.contact.organs.following`)."""

import numpy as np

from palpate.compiler.records import floats, put, unpacking, vector
from palpate.nodes.base.kernels import ieee_kernel, kernel
from palpate.physics.bodies.floating.turning import times
from palpate.physics.bodies.true_patch import sideways
from palpate.physics.contact.organs import rigid_motion as rigid
from palpate.physics.contact.organs.between_rows import Law, clear_row, renew_row
from palpate.physics.contact.organs.candidates import FACING
from palpate.physics.contact.organs.condensed_fields import vector3
from palpate.physics.contact.organs.following import MOVED, SEARCHED, TURNED, Track
from palpate.physics.geometry.mesh_closest import descend_mesh, track_mesh

track_of, law_of = unpacking(Track), unpacking(Law)


@kernel
def relate(own, track):
    """Fill `own.relative` (3,3), M, and `own.offset` (3), d [m]: a point x [m] (3) of the organ on which the candidates
    stay is at M x + d of the other one. In the axes of that, so that exchanged organs have the same bits."""
    fine, out, offset = track.fine == 0, own.relative, own.offset
    if not own.rides:
        for x in range(3):
            for y in range(3):
                out[x, y] = 1.0 if x == y else 0.0
            offset[x] = own.apart[x] if fine else -own.apart[x]
        return
    one, two = own.ride[0 if fine else 1], own.ride[1 if fine else 0]
    c, e = one.centre, two.centre
    for y in range(3):
        column = rigid.rotated_back(two, (one.matrix[0, y], one.matrix[1, y], one.matrix[2, y]))
        for x in range(3):
            out[x, y] = column[x]
    to = rigid.rotated_back(two, (c[0] + one.at[0] - e[0] - two.at[0], c[1] + one.at[1] - e[1] - two.at[1],
                                  c[2] + one.at[2] - e[2] - two.at[2]))  # fmt: skip
    turned = times(out, (c[0], c[1], c[2]))
    for x in range(3):
        offset[x] = e[x] + to[x] - turned[x]


@kernel
def move_by(relative, offset, x):
    """M x + d: a point [m] (3)."""
    y = times(relative, x)
    return y[0] + offset[0], y[1] + offset[1], y[2] + offset[2]


@kernel
def apart(relative, offset, x, y):
    """Distance [m] (3) of a point x [m] (3) of the organ on which the candidates stay from a point y of the other."""
    z = move_by(relative, offset, x)
    return z[0] - y[0], z[1] - y[1], z[2] - y[2]


@ieee_kernel
def search_cell(own, track, cell):
    """The gap [m] of a cell where both organs are, with what is withheld of it, its normal [1] (3) and place [m] (3) on
    the other one in the axes of that; its triangles `track.last` are those of the last search near it."""
    fine = track.fine == 0
    points, foot = floats(own.first_points) if fine else floats(own.second_points), track.foot[0]
    away, facing = 0.0, 0.0
    n0 = n1 = n2 = f0 = f1 = f2 = 0.0
    for at in range(track.begins[cell], track.begins[cell + 1]):
        x = move_by(own.relative, own.offset, vector3(points, track.vertices[at]))
        m = times(own.relative, vector3(track.facing, at))
        _find_foot(track, x, at)
        track.last[at], w = track.tracked[0].triangle, track.weights[at]
        track.places[at, 0], track.places[at, 1] = foot.place[0], foot.place[1]
        n, f = foot.normal, foot.point
        away += w * foot.distance
        facing += w * (n[0] * m[0] + n[1] * m[1] + n[2] * m[2])
        n0, n1, n2 = n0 + w * n[0], n1 + w * n[1], n2 + w * n[2]
        f0, f1, f2 = f0 + w * f[0], f1 + w * f[1], f2 + w * f[2]
    if facing > FACING:  # the edge of an organ
        away = max(away, own.reach)
    return away + own.withheld, (n0, n1, n2), (f0, f1, f2)


@kernel
def _find_foot(track, x, at):
    """Fill `track.foot` and `track.tracked` for a vertex at x [m] (3) of the other organ."""
    tracked, foot, y = track.tracked[0], track.foot[0], vector3(track.searched, at)
    square = (x[0] - y[0]) ** 2 + (x[1] - y[1]) ** 2 + (x[2] - y[2]) ** 2
    tracked.triangle = track.last[at]
    if square < track.sure[at] * track.sure[at] and descend_mesh(
        track.points, track.cells, track.star_at, track.star, x[0], x[1], x[2], tracked, foot
    ):
        return
    tracked.exists, tracked.triangle = True, track.last[at]
    track_mesh(
        track.points, track.cells, track.discs, track.star_at, track.star, x[0], x[1], x[2], 0.0, tracked, track.work,
        foot,
    )  # fmt: skip
    put(track.searched[at], x)
    track.sure[at] = max(0.5 * abs(foot.distance), SEARCHED)


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
    x, y = (one.place, two.place) if track.fine == 0 else (two.place, one.place)
    d = apart(own.relative, own.offset, vector3(x, i), vector3(y, i))
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
    if len(rub.touched) > 0:
        _turn_tangents(own, rub, 0, one.normal, i)
        _turn_tangents(own, rub, 1, two.normal, i)
    area = floats(own.areas)
    renew_row(first, one, i, 1.0, track.inverse, area, rub.tangents[0], pair.first, rub.first)
    renew_row(second, two, i, -1.0, track.inverse, area, rub.tangents[1], pair.second, rub.second)


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
def _turn_tangents(own, rub, body, normal, i):
    """New tangents of candidate i on a body, and its displacements along them."""
    count, tangents, along = len(rub.touched), rub.tangents[body], floats(own.tangents)
    sideways(vector3(normal, i), along)
    for kept in (rub.moved[body], rub.others[body]):
        u, v = kept[i], kept[count + i]
        for a in range(2):
            way = 0.0
            for k in range(3):
                way += (u * tangents[0, i, k] + v * tangents[1, i, k]) * along[a, k]
            kept[a * count + i] = way
    for a in range(2):
        put(tangents[a, i], vector(along[a]))
