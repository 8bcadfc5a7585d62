"""How free candidates move to cells of the finer surface that a contact enters which wanders over it
(`physics.contact.organs.following`)."""

from palpate.compiler.records import floats, longs, put
from palpate.nodes.base.kernels import ieee_kernel, kernel
from palpate.nodes.contact.placed import (
    between_points,
    clear_compliance,
    place_cell,
    renew_compliance,
    search_cell,
)
from palpate.physics.contact.organs.between_rows import vector3
from palpate.physics.contact.organs.following import BETTER, CLOSE, NEARER, SCANNED

PARKED = 1.0  # [m] added to the gap of a candidate in the step in which it moves, so that it does not touch


@ieee_kernel
def reassign(own, track, pair, rub, one, two):
    """Move a candidate from a coarse cell to a fine part of it, or a free one to a cell next to another one, if it is
    nearer to the other organ there; of the next ones in turn. Returns the candidate, -1: none; its compliances were
    computed, and `settle` is due in the next step."""
    i, least = _farthest(pair, track)
    most, cell, beside, divides = BETTER * pair.gap[i] if i >= 0 else 0.0, -1, -1, False
    for _ in range(min(SCANNED, len(track.cell))):
        k = own.outer
        own.outer = k + 1 if k + 1 < len(track.cell) else 0
        own.looked += 1
        if _is_coarse(track, pair, k, least):
            i, cell, beside, divides = k, track.child[track.cell[k]], k, True
            break
        if track.rim[k] and i >= 0:
            near, gap = _nearest(own, track, one, two, k, most)
            if near >= 0:
                cell, beside, most = near, k, gap
    if cell < 0:
        return -1
    # the search begins at the triangle of the neighbour
    triangle = track.last[track.begins[track.cell[beside]]]
    for at in range(track.begins[cell], track.begins[cell + 1]):
        track.last[at] = triangle
    found = search_cell(own, track, cell)
    if not (divides or found[0] < BETTER * pair.gap[i]):
        return -1
    own.fresh, own.looked = i, 0
    clear_compliance(own, one, two, i)
    _enter(own, track, one if track.fine == 0 else two, i, cell)
    pair.opening[i], track.pending[i] = PARKED, 0.0
    place_cell(own, track, pair, one, two, i, found)
    renew_compliance(own, track, pair, rub, one, two, i)
    pair.gap[i] += PARKED
    floats(own.seen)[i] = pair.gap[i]
    track.late[i] = track.jumps[i] = 0.0
    return i


@kernel
def _farthest(pair, track):
    """The free candidate with the largest gap of the undeformed organs, that does not touch soon, -1: none; the
    smallest gap [m]."""
    found, most, least = -1, 0.0, pair.gap[0]
    for i in range(len(track.cell)):
        least = min(least, pair.gap[i])
        if pair.gap[i] > most and _is_free(track, pair, i):
            found, most = i, pair.gap[i]
    return found, least


@kernel
def _is_free(track, pair, i):
    """Whether a candidate may move: it does not touch, also not soon."""
    return pair.active.place[i] < 0 and pair.opening[i] > CLOSE and track.pending[i] == 0.0


@kernel
def _is_coarse(track, pair, i, least):
    """Whether candidate i leaves its cell for a part of it; least [m]: the smallest gap."""
    cell = track.cell[i]
    if track.child[cell] < 0 or not pair.gap[i] - least < NEARER * track.beyond[cell]:
        return False
    return _is_free(track, pair, i)


@kernel
def _is_open(track, cell):
    """Whether a candidate may move to a cell: to one without parts, where there is none yet."""
    parent = track.parent[cell]
    return track.slot[cell] < 0 and track.child[cell] < 0 and (parent < 0 or track.slot[parent] < 0)


@kernel
def _nearest(own, track, one, two, i, most):
    """The cell next to candidate i with the smallest gap, in the plane of the candidate, and this [m]; -1: none is
    below `most` [m]."""
    found = -1
    for k in range(track.near_at[track.cell[i]], track.near_at[track.cell[i] + 1]):
        if _is_open(track, track.near[k]):
            gap = _gap_next(own, track, one, two, i, track.near[k])
            if gap < most:
                found, most = track.near[k], gap
    return found, most


@kernel
def _gap_next(own, track, one, two, i, cell):
    """Gap [m] of a cell next to candidate i if the other organ were flat."""
    fine = track.fine == 0
    n, sign = vector3(floats(own.opposite) if fine else floats(own.normals), i), 1.0 if fine else -1.0
    d = between_points(own, track, vector3(track.place, cell), vector3(two.place if fine else one.place, i))
    return sign * (n[0] * d[0] + n[1] * d[1] + n[2] * d[2])


@kernel
def _enter(own, track, side, i, cell):
    """Let candidate i leave its cell for another one; `side`: of the finer surface."""
    left = track.cell[i]
    track.slot[left], track.slot[cell], track.cell[i] = -1, i, cell
    side.begins[i], side.ends[i] = track.begins[cell], track.begins[cell + 1]
    put(side.place[i], vector3(track.place, cell))
    put(side.centre[i], vector3(track.place, cell))
    floats(own.areas)[i] = track.area[cell]
    # ends of the region, and borders of candidates, each once
    met, strips, count = longs(own.borders), floats(own.strips), 0
    for a in range(len(track.cell)):
        track.rim[a] = 0
        for k in range(track.near_at[track.cell[a]], track.near_at[track.cell[a] + 1]):
            b = track.slot[track.near[k]]
            if _is_open(track, track.near[k]):
                track.rim[a] = 1
            if b > a:
                met[count, 0], met[count, 1], strips[count] = a, b, track.strips[k]
                count += 1
    own.met = count


@ieee_kernel
def settle(own, track, pair, rub):
    """The step after a candidate moved: let both bodies be at rest there under the present loads. If it overlaps, its
    gap begins at zero, and what is left is taken in parts."""
    i, rest, seen, active = own.fresh, floats(own.rest), floats(own.seen), pair.active
    for body in range(2):
        moved, rows = floats(own.others)[body, i], pair.first if body == 0 else pair.second
        for k in range(active.tally[0].active):
            moved += active.force[active.order[k]] * rows[active.order[k], i]
        pair.moved[body, i] = moved
    if rub.tangents.shape[1] > 0:
        _settle_along(pair, rub, i)
    opening = pair.gap[i] + (pair.moved[0, i] + pair.moved[1, i])
    if opening < 0.0:
        track.pending[i] = opening
        rest[i] -= opening
        pair.gap[i] -= opening
        if own.rides:
            seen[i] -= opening
    pair.opening[i] = max(opening, 0.0)
    own.fresh = -1


@kernel
def _settle_along(pair, rub, i):
    """The same for the displacements along the surface, also by the friction of the last step."""
    size, active = rub.tangents.shape[1], pair.active
    for body in range(2):
        drags, sign = rub.first if body == 0 else rub.second, 1.0 if body == 0 else -1.0
        for a in range(2):
            at = a * size + i
            moved = rub.others[body, at]
            for k in range(active.tally[0].active):
                j = active.order[k]
                moved += active.force[j] * drags[j, at]
                for b in range(2):
                    along = 0.0
                    for x in range(3):
                        along += rub.force[j, x] * rub.tangents[b, j, x]
                    moved += sign * along * drags[(b + 1) * size + j, at]
            rub.moved[body, at] = moved
