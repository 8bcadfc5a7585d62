"""How free candidates move to cells of the finer surface that a contact enters which wanders over it
(`physics.contact.organs.following`)."""

from palpate.compiler.dot import dot
from palpate.compiler.records import floats, longs, put
from palpate.nodes.base.kernels import ieee_kernel, kernel
from palpate.nodes.contact.placed import (
    apart,
    clear_compliance,
    place_cell,
    renew_compliance,
    search_cell,
)
from palpate.physics.contact.organs.between_rows import measure_row
from palpate.physics.contact.organs.condensed_fields import vector3
from palpate.physics.contact.organs.following import BETTER, CLOSE, NEARER, SCANNED

PARKED = 1.0  # [m] added to the gap of a candidate in the step in which it moves, so that it does not touch


@ieee_kernel
def reassign(own, track, pair, rub, one, two):
    """Move a candidate from a coarse cell to a fine part of it, or a free one to a cell next to another one, if it is
    nearer to the other organ there; of the next ones in turn. Returns the candidate, -1: none; its compliances were
    computed, and `settle` is due in the next step."""
    i, least = _farthest(pair, track.pending)
    most, cell, neighbour, divides = BETTER * pair.gap[i] if i >= 0 else 0.0, -1, -1, False
    fine, count = track.fine == 0, len(track.cell)
    feet, normals = two.place if fine else one.place, floats(own.opposite) if fine else floats(own.normals)
    for _ in range(min(SCANNED, count)):
        k = own.outer
        own.outer = k + 1 if k + 1 < count else 0
        own.looked += 1
        at = track.cell[k]
        if (
            track.child[at] >= 0
            and pair.gap[k] - least < NEARER * track.beyond[at]
            and pair.opening[k] > CLOSE
            and _is_free(pair, track.pending, k)
        ):
            i, cell, neighbour, divides = k, track.child[at], k, True
            break
        if track.rim[k] == 0 or i < 0:
            continue
        n, f = vector3(normals, k), vector3(feet, k)
        for e in range(track.near_at[at], track.near_at[at + 1]):
            near = track.near[e]
            if not _is_open(track.slot, track.child, track.parent, near):
                continue
            # gap if the other organ were flat
            d = apart(own.relative, own.offset, vector3(track.place, near), f)
            gap = (1.0 if fine else -1.0) * (n[0] * d[0] + n[1] * d[1] + n[2] * d[2]) + own.withheld
            if gap < most:
                cell, neighbour, most = near, k, gap
    if cell < 0:
        return -1
    # search all of the other surface, from the triangle of the neighbour on
    triangle = track.last[track.begins[track.cell[neighbour]]]
    for at in range(track.begins[cell], track.begins[cell + 1]):
        track.last[at], track.sure[at] = triangle, 0.0
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
def _farthest(pair, pending):
    """The free candidate with the largest gap of the undeformed organs, -1: none; the smallest gap [m]."""
    found, most, least = -1, 0.0, pair.gap[0]
    for i in range(len(pending)):
        least = min(least, pair.gap[i])
        if pair.gap[i] > most and _is_free(pair, pending, i):
            found, most = i, pair.gap[i]
    return found, least


@kernel
def _is_free(pair, pending, i):
    """Whether a candidate may move: it bears no force, and is apart."""
    return pair.active.place[i] < 0 and pair.opening[i] > 0.0 and pending[i] == 0.0


@kernel
def _is_open(slot, child, parent, cell):
    """Whether a candidate may move to a cell: to one without parts and without a candidate."""
    return slot[cell] < 0 and child[cell] < 0 and (parent[cell] < 0 or slot[parent[cell]] < 0)


@kernel
def _enter(own, track, side, i, cell):
    """Let candidate i leave its cell for another one; `side`: of the finer surface."""
    left = track.cell[i]
    track.slot[left], track.slot[cell], track.cell[i] = -1, i, cell
    side.begins[i], side.ends[i] = track.begins[cell], track.begins[cell + 1]
    put(side.place[i], vector3(track.place, cell))
    put(side.centre[i], vector3(track.place, cell))
    floats(own.areas)[i] = track.area[cell]
    measure_row(track.inverse, side.place, floats(own.areas), i)
    # ends of the region, and borders of candidates, each once
    met, strips, count = longs(own.borders), floats(own.strips), 0
    for a in range(len(track.cell)):
        track.rim[a] = 0
        for k in range(track.near_at[track.cell[a]], track.near_at[track.cell[a] + 1]):
            b = track.slot[track.near[k]]
            if _is_open(track.slot, track.child, track.parent, track.near[k]):
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
    if len(rub.touched) > 0:
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
    size, active = len(rub.touched), pair.active
    for body in range(2):
        drags, force, tangents = rub.first if body == 0 else rub.second, rub.force[body], rub.tangents[body]
        for a in range(2):
            at = a * size + i
            moved = rub.others[body, at]
            for k in range(active.tally[0].active):
                j = active.order[k]
                moved += active.force[j] * drags[j, at]
                for b in range(2):
                    moved += dot(force[j], tangents[b, j]) * drags[(b + 1) * size + j, at]
            rub.moved[body, at] = moved
