"""How the candidates of two organs follow while these slide on each other (`physics.contact.organs.following`)."""

import numpy as np

from palpate.compiler.records import floats, put
from palpate.nodes.base.kernels import ieee_kernel, kernel
from palpate.nodes.contact.placed import (
    apart,
    place_cell,
    relate,
    renew_compliance,
    search_cell,
    track_of,
)
from palpate.nodes.contact.reassigned import reassign, settle
from palpate.physics.bodies.floating.turning import times
from palpate.physics.contact.organs.between import take
from palpate.physics.contact.organs.condensed_fields import vector3
from palpate.physics.contact.organs.following import (
    CLOSE,
    COARSER,
    EASED,
    FAR,
    FINEST,
    LEAST,
    NEAR,
    STEEP,
    TILTED,
    VERTICES,
)
from palpate.physics.contact.organs.pivoting import admit, release

ROUNDED = 1e-9  # [1] of two candidates that are due equally, the first one is next
STILL, REACHES = 1e-5, 0.05  # [m] motion after which candidates may be due; [m] from the centre of an organ to them


@ieee_kernel
def follow(own, pair, rub, one, two, dt):
    """Compute candidates again that have slid, of the next ones in turn; fills their gaps. `one`, `two`: both sides.
    Returns the candidate whose compliances were computed again, -1: none; `renew_matrix` or `renew_factor` is due."""
    track = track_of(own.track)
    if len(track.cell) == 0:
        return -1
    if own.fresh >= 0:
        settle(own, track, pair, rub)
    elif _rests(own):
        return -1
    relate(own, track)
    share = dt / (dt + EASED)
    behind, due = _follow_gaps(own, track, pair, one, two, share), _most_due(track, pair)
    found = reassign(own, track, pair, rub, one, two)
    if found >= 0:  # missing force is worse than compliances that are late
        return found
    if due >= 0:
        renew_compliance(own, track, pair, rub, one, two, due)
        track.late[due] = 0.0
    elif not behind and own.looked >= len(track.cell):
        own.looked = 0
        _keep_still(own)
    return due


@kernel
def _follow_gaps(own, track, pair, one, two, share):
    """Find the next candidates that have slid; `share` [1] of the changes that are left is taken in this step. Returns
    whether more are due."""
    count, left, behind, i = len(track.cell), VERTICES, _ease(own, track, pair, share), own.turn
    for _ in range(count):
        if _slides(own, track, pair, one, two, i):
            own.looked = 0
            if left <= 0:
                own.turn = i
                return True
            cell = track.cell[i]
            place_cell(own, track, pair, one, two, i, search_cell(own, track, cell))
            left -= track.begins[cell + 1] - track.begins[cell]
        i = i + 1 if i + 1 < count else 0
    return behind


@kernel
def _most_due(track, pair):
    """The candidate whose compliances are due most, -1: none."""
    most, due = 1.0, -1
    for i in range(len(track.cell)):
        late = track.late[i] if pair.active.place[i] >= 0 or pair.opening[i] <= CLOSE else track.late[i] / FAR
        if late > most * (1.0 + ROUNDED):
            most, due = late, i
    return due


@kernel
def _ease(own, track, pair, share):
    """Take the next part of the changes of the gaps, `share` of them [1]. Returns whether more are left."""
    more, rest, seen, affordable = False, floats(own.rest), floats(own.seen), _affordable(own, track, pair, share)
    for i in range(len(track.pending)):
        if track.pending[i] == 0.0:
            continue
        part = _part(track.pending[i], share)
        if part < 0.0 and pair.active.force[i] > 0.0:
            part *= affordable
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
def _part(pending, share):
    """Part of a change of a gap [m] that is taken in a step."""
    return share * pending if abs(pending) > LEAST else pending


@kernel
def _affordable(own, track, pair, share):
    """Share [1] of the changes that close gaps under load. Between organs that forces move they cost at most what the
    contact lost in the last step, so that it generates no energy; a prescribed motion bears all."""
    if not own.floats:
        return 1.0
    cost = 0.0
    for k in range(pair.active.tally[0].active):
        i = pair.active.order[k]
        cost -= pair.active.force[i] * min(_part(track.pending[i], share), 0.0)
    return min(1.0, own.room / cost) if cost > 0.0 else 1.0


@kernel
def keep_room(own, pair, rub):
    """After a step between organs that forces move: the energy [J] that the contact lost in it."""
    lost = pair.past[0].dissipated - pair.past[0].generated + rub.balance[0].dissipated - own.late
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
def _slides(own, track, pair, one, two, i):
    """Whether candidate i slid too far since it was computed, or an organ turned by too much."""
    fine, opening = track.fine == 0, max(pair.opening[i], 0.0)
    x, y = (one.place, two.place) if fine else (two.place, one.place)
    m, n = vector3(floats(own.normals), i), vector3(floats(own.opposite), i)
    if not fine:
        m, n = n, m
    d, t, base = apart(own.relative, own.offset, vector3(x, i), vector3(y, i)), times(own.relative, m), track.base[i]
    if (t[0] - n[0]) ** 2 + (t[1] - n[1]) ** 2 + (t[2] - n[2]) ** 2 > TILTED * TILTED:
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
def _parts(d, n, base):
    """Parts [m] of d - base (3) along n and across it."""
    x, y, z = d[0] - base[0], d[1] - base[1], d[2] - base[2]
    along = n[0] * x + n[1] * y + n[2] * z
    return along, np.sqrt(max(x * x + y * y + z * z - along * along, 0.0))


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
    if len(track.cell) == 0:
        return work
    for k in range(pair.active.tally[0].active):
        i = pair.active.order[k]
        work += force[i] * track.jumps[i]
        if track.rim[i]:
            own.ended = max(own.ended, force[i])
    track.jumps[:] = 0.0
    return work
