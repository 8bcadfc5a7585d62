"""The proxy (god object): the foot point of a tool inside a body, on the side where the tool entered.

When a tool is more than halfway through a thin body, the nearest point of the surface jumps to the other side. The
proxy remains on the side of entry: C. B. Zilles, J. K. Salisbury, IROS 1995; D. C. Ruspini, K. Kolarov, O. Khatib, The
haptic display of complex graphical environments, SIGGRAPH 1997.

The *target* is the nearest point while the tool is outside. After the tool has entered from outside, the target is

* the nearest point if its normal is not reversed against that of the foot;
* else the local minimum of the distance next to the last target, under the same condition;
* else none: the foot does not move, and the gap is measured along its normal.

This ends when the tool is outside as seen from the side of entry, or far beyond the other side, or when its tissue
touches neither the side of entry nor the nearest point; the gap rises to the true one first, by the motion of the tool
or at `FADES`, also if it turns round meanwhile, unless it enters the body. A tool that starts inside, or jumps, has no
side of entry: its foot is the nearest point. The other side may be nearer by the hysteresis of the search before the
foot changes; until then the gap is the distance of the foot, not of the other side. This is decided by the direction to
the nearest point, because the bottom of a notch belongs to two faces; when it changes, the gap continues at its last
rate, and reaches that of the target as slowly as after a leap. Past the border of a sheet the gap is the distance.

**The foot follows its target no faster than the tool moves.** Near a centre of curvature (1 - d kappa = 0), in a
groove, at a rim and over the edges of a coarse mesh the nearest point leaps. When the tool moves by dp at the approach
e (tissue thickness minus gap), the foot moves by at most `AHEAD` |dp|, and if that is more than `EASY` times the part
of dp along the surface (the larger one of those at the foot and at its target), no faster than `FASTEST`. The normal
turns by at most |dp|/max(`SUDDEN` e, `SHARPEST`), and at a depth d = -gap by at most the second limit of the foot over
d: a patch that rolls in front of its foot loads other tissue as one that slides. Both cover the same share of the
distance to the target, along the chord. A foot that trails its target follows its motion, and catches up no faster than
`FASTEST`: twice the speed of a fast tool is that of a patch at 83 % of the radius of a ball, but in a groove nothing
moves that fast. It covers at most the larger share of (its largest motion)/`LANDING` and dt/`ARRIVES` of the distance,
so that it does not stop abruptly, and a foot that starts to trail reaches these speeds within `LANDING` or `ARRIVES`,
because the tissue resists a patch at once; if its target leaps back behind it, it first stops in that time, on its way.
A foot that was at its target when that leapt does not stop either: it coasts on, less and less within that time, and so
does the rate of the gap at each leap.
The gap is that of the target, but within

    g + n.dp - REGAIN |dp|  <=  gap  <=  g + |dp|,

g and n being the last gap and normal (`BENT` in place of `REGAIN` if the foot does not trail). So the force F(e) n
changes by at most (F' + F/(SUDDEN e)) |dp|, F' = dF/de; the approach is at most that of the target, except on the way
out of a thin body; and it grows without work of the hand by at most `REGAIN` or `BENT` times |dp|. The rate of the gap
is also continuous, because a viscous body responds to it: while the foot trails a target that leapt, the gap changes by
n.dp, as for a foot at rest, and then as that of the target; and it covers the larger share of |dp|/`LANDING` and
dt/`ARRIVES` of the difference to it, and of the rates that the motion of the tool allows, less while the foot starts.
The rate of a gap that rises to the true one begins with the last one, and reaches that of the tool and ends within
these lengths or times, too, as does that of a gap whose target ends. A foot that the nearest point does not outrun is
the nearest point exactly.
"""

import numpy as np

from palpate.compiler.fields import blank_record
from palpate.compiler.kernel import kernel
from palpate.compiler.records import put, vector
from palpate.physics.arrays import Array, Indices, Record, Tensor, Vector3
from palpate.physics.geometry.closest import FAR, track
from palpate.physics.geometry.mesh_closest import _descend, _on_triangle, track_mesh
from palpate.physics.geometry.newton import newton
from palpate.physics.geometry.nurbs import normal_of
from palpate.physics.geometry.phong import smooth_foot
from palpate.physics.geometry.pseudonormal import face_normal, signed_distance
from palpate.physics.geometry.search.foot import set_values, values_of
from palpate.physics.geometry.search.trailing import begin_again, keep_step, next_pace, rest, rise, stay, trail

JUMP = 6e-3  # [m] Motion in a step above which the tool has no side of entry: 6 m/s at 1 kHz, 3 m/s at 500 Hz
TURNED = -0.3
"""[1] Cosine between normals below which a foot is on the other side; a little below 0, for rims at right angles."""
OTHER_FACE = 0.8
"""[1] Cosine between the normal of the foot and the direction to the nearest point (the normal there, on a NURBS
surface) below which that is on another face than the foot, which stays until that is nearer by the hysteresis. With the
gap of that face and the foot of this one, the gap of a tool in a block changed by all of its motion along the top, and
not at all 0.1 mm later: viscous tissue lost and regained 40 % of the force."""
OUTSIDE = -0.5  # [1] The same for the direction from the nearest point to a tool that is outside
AHEAD = 6.0  # [1] Limit of the foot's motion over the tool's, reached in a ball at a depth of 83 % of its radius
EASY, FASTEST = 2.0, 0.1
"""[1], [m/s] A foot that moves more than `EASY` times as far as the tool moves along the surface, moves no faster than
`FASTEST`: viscous tissue resists a patch that moves over it, twofold at the radius of the patch over its retardation
time, 0.4 m/s."""
LANDING, ARRIVES = 1e-3, 5e-3
"""[m], [s] Largest motion of the foot (of the gap: of the tool), or time, in which one that trails its target covers
63 % of the distance."""
SUDDEN, SHARPEST = 1.0 / 6.0, 1e-3
"""[1], [m] The normal turns by at most the tool's motion over `SUDDEN` times the approach, and over `SHARPEST`."""
REGAIN, BENT = 0.2, 0.5
"""[1] Limit of the growth of the approach without work of the tool, over the tool's motion: while the foot trails its
target, and else, where interpolated normals of a mesh differ from the direction of the nearest point by up to 45°."""
BORDER_EXCESS = 1e-6  # [1] Relative excess of the distance over the gap from which the tool is past a border
ROUNDING = 1e-7  # [m] Motion of a foot that counts as none
STILL = 1e-9  # [m] Motion of a tool below which it counts as this; rounding of the nearest point
FAR_BEYOND = 20e-3  # [m] Distance from the body at which the side of entry is forgotten
FADES = 5e-3  # [m/s] Speed at which the gap of a tool that leaves rises while it rests: 75 N/s of a fingertip at 9 N
OUT, IN, LEAVES = range(3)
"""Side of a tool: outside, inside, leaving a thin body."""
MEMORY = {
    "started": bool, "side": int, "gap": (), "tool": (3,), "foot": (3,), "normal": (3,), "place": (2,),
    "triangle": int, "shown": int, "border": bool, "thickness": (),
    "behind": (), "passed": bool, "kept": bool, "off": (), "pace": (), "step": (3,), "turned": (3,), "coast": (3,),
    "drift": (), "rising": (), "excess": (), "gains": (),
}  # fmt: skip
"""
started    whether a last step exists
side       `OUT`, `IN` or `LEAVES`
gap, tool, foot, normal  of the last step: gap [m], tool [m], foot [m], normal [1]
place      u and v of the target; on a mesh the weights of the smooth foot [1]
triangle   of the target on a mesh;  shown: that of the smooth foot
border     whether the surface has a border;  thickness: of the tissue before the tool [m]
behind     distance of the foot from its target [m]
passed     whether the nearest point is on another side
kept       whether the gap of the target is that of the foot: the nearest point is on another face
off        gap of the target minus gap [m]
pace       share of its greatest speed that a foot has reached since its target leapt, or -1: it trails for another
           reason
step, turned  motion of the foot [m], and change of its normal [1]
coast      motion [m] that is left to a foot that was at its target when that leapt
drift      change of the gap [m] in a step beyond that of a foot at rest: what is left of it since the last leap, or
           since the gap began to rise
gains      share [1] that the gap covers of what it might in a step: it grows since the target leapt, or became that of
           another face
excess     change of the gap [m] in the last step beyond that of a foot at rest
rising     share [1] of the tool's motion by which the gap of one that leaves a thin body rises
"""


def memory(border: bool = False, thickness: float = 0.0) -> Record:
    """Memory of a tool before its first step, for a surface with or without a border, and a tool with soft tissue of
    this thickness [m]."""
    return blank_record(MEMORY, border=border, thickness=thickness)


@kernel
def _tool_motion(p: Vector3, memory: Record):
    """Motion of the tool since the last step [m]; inf at the first step and after a jump."""
    square = 0.0
    for k in range(3):
        square += (p[k] - memory.tool[k]) ** 2
    return np.sqrt(square) if memory.started and square <= JUMP * JUMP else np.inf


@kernel
def _at_border(p: Vector3, along: float, foot: Record):
    """Past the border of a sheet (the distance exceeds its part `along` the normal), the gap is the distance. Returned:
    whether it is past."""
    a, b, c = p[0] - foot.point[0], p[1] - foot.point[1], p[2] - foot.point[2]
    distance = np.sqrt(a * a + b * b + c * c)
    past = distance > abs(along) * (1.0 + BORDER_EXCESS) + ROUNDING
    if past:
        put(foot.normal, (a / distance, b / distance, c / distance))
        foot.distance = distance
    return past


@kernel
def _tool_turn(foot: Record, memory: Record):
    a, b = foot.normal, memory.normal
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] < TURNED


@kernel
def _outside(p: Vector3, foot: Record, memory: Record):
    """Whether the tool is outside as seen from the side of entry, or far away."""
    if not foot.distance > ROUNDING or foot.distance > FAR_BEYOND:  # on the surface no direction is known
        return foot.distance > ROUNDING
    along = square = 0.0
    for k in range(3):
        along += (p[k] - foot.point[k]) * memory.normal[k]
        square += (p[k] - foot.point[k]) ** 2
    return along >= OUTSIDE * np.sqrt(square)


@kernel
def _regular(foot: Record, moved: float, p: Vector3, memory: Record):
    """Whether the nearest point is the target; updates the side of the tool."""
    if moved == np.inf:
        memory.side = OUT
        return True
    if memory.side == OUT:
        turned = _tool_turn(foot, memory)
        if memory.gap > 0.0 and (foot.distance <= 0.0 or (turned and memory.gap <= moved)):
            memory.side = IN
            return not turned
        return True
    apart = memory.gap >= memory.thickness and foot.distance >= memory.thickness and foot.distance > 0.0
    if apart or (memory.side == LEAVES and foot.distance > 0.0) or _outside(p, foot, memory):
        memory.side = OUT
        return True
    memory.side = IN
    return foot.distance <= 0.0 and not _tool_turn(foot, memory)


@kernel
def _keep_side(p: Vector3, nearest: Vector3, foot: Record):
    """The gap is that of the foot if the nearest point, in the direction `nearest` [1] (3), is on another face.
    Returned: whether it is."""
    n, q = foot.normal, foot.point
    other = n[0] * nearest[0] + n[1] * nearest[1] + n[2] * nearest[2] < OTHER_FACE
    if other:
        foot.distance = -np.sqrt((p[0] - q[0]) ** 2 + (p[1] - q[1]) ** 2 + (p[2] - q[2]) ** 2)
    return other


@kernel
def _direction(points: Record, cells: Record, t: int, p: Vector3):
    """Direction [1] (3) from a tool inside to the nearest point of a triangle: its normal above a face. On an edge of a
    notch, where each of two faces is as near, that of neither."""
    square, v, w, _ = _on_triangle(points, cells, t, p[0], p[1], p[2])
    if not square > ROUNDING * ROUNDING:
        return face_normal(points, cells, t)
    i, j, k = vector(cells[t].corners)
    a, b, c = points[i].position, points[j].position, points[k].position
    u, size = 1.0 - v - w, np.sqrt(square)
    return (
        (u * a[0] + v * b[0] + w * c[0] - p[0]) / size,
        (u * a[1] + v * b[1] + w * c[1] - p[1]) / size,
        (u * a[2] + v * b[2] + w * c[2] - p[2]) / size,
    )


@kernel
def _held_gap(p: Vector3, memory: Record):
    """The gap [m] if the foot does not move: the last one, changed by the tool's motion along the last normal."""
    gap = memory.gap
    for k in range(3):
        gap += (p[k] - memory.tool[k]) * memory.normal[k]
    return gap


@kernel
def _moved_gap(target: float, moved: float, memory: Record):
    """The last gap [m], changed by the motion of the target."""
    if memory.off == 0.0:
        return target
    return memory.gap + min(max(target - (memory.gap + memory.off), -moved), moved)


@kernel
def _ways(p: Vector3, foot: Record, memory: Record):
    """Turn [1] of the normal and way [m] of the foot to the target `foot`; motion [m] of the tool along its normal."""
    turn = move = along = 0.0
    for k in range(3):
        turn += (foot.normal[k] - memory.normal[k]) ** 2
        move += (foot.point[k] - memory.foot[k]) ** 2
        along += (p[k] - memory.tool[k]) * foot.normal[k]
    return np.sqrt(turn), np.sqrt(move), along


@kernel
def _next_gap(start: float, target: float, held: float, share: float, moved: float, dt: float, memory: Record):
    """The gap [m]: from `start` a part of the difference to the target, changed by at most the motion of the tool;
    while a foot starts, by this share of both.

    held  [m] of the foot at rest, if the foot starts: its last rate does not lead beyond the target
    """
    part = min(max(moved / LANDING, dt / ARRIVES), 1.0)
    gap = start + share * part * (target - start) if start != target else target
    if target < held:
        gap = max(gap, held + part * (target - held))
    low, high = memory.gap - moved, memory.gap + moved
    if share < 1.0:
        gap = min(max(gap, start + share * (low - start)), start + share * (high - start))
    return min(max(gap, low), high)


@kernel
def _approach(p: Vector3, moved: float, held: float, other: bool, dt: float, foot: Record, memory: Record):
    """Move the last foot towards the target `foot`, as far as the motion of the tool allows, into `foot`.

    moved [m] of the tool;  held [m] the gap if the foot does not move;  dt [s]
    other  whether the gap of the target is that of another face than in the last step
    """
    deep, behind, target, least = memory.thickness - memory.gap, memory.behind, foot.distance, -np.inf
    if other:
        memory.drift = memory.excess
    start = held + memory.drift if other and deep > 0.0 else _moved_gap(target, moved, memory)
    memory.behind, pace, memory.pace, trails, catches = 0.0, memory.pace, 0.0, False, 1.0
    if deep > 0.0:
        turn, move, along = _ways(p, foot, memory)
        aside = np.sqrt(max(moved * moved - min((held - memory.gap) ** 2, along * along), 0.0))
        easy = max(EASY * aside, FASTEST * dt)
        longest, motion = min(AHEAD * moved, easy) + STILL, max(move - behind, 0.0)
        most = longest
        ramp = max(moved / LANDING, dt / ARRIVES)
        fade = 1.0 - abs(pace)
        leaps = motion > AHEAD * moved + STILL
        pace = next_pace(leaps, pace, behind / move if leaps else behind, ramp, memory)
        if leaps:
            most *= pace
        elif behind > 0.0:
            most = min(most, motion + abs(pace) * FASTEST * dt + STILL)
        most_turned = (moved + STILL) / max(SUDDEN * deep, SHARPEST)
        if memory.gap < 0.0:
            most_turned = min(most_turned, (easy + STILL) / -memory.gap)
        share = min(most / move if move > most else 1.0, most_turned / turn if turn > most_turned else 1.0)
        if behind > 0.0:  # the motion of the target, and a part of the distance
            part = min(max(most / LANDING, dt / ARRIVES), 1.0)
            share = min(share, (motion + behind * part) / max(move, STILL))
        regains = (REGAIN if share < 1.0 else BENT) * moved
        if (1.0 - share) * move > ROUNDING:
            memory.pace, trails = pace, True
            fade = max(1.0 - pace, 0.0) / fade if pace > 0.0 and fade > 0.0 else 0.0
            trail(share, fade, ramp * FASTEST * dt, longest, most_turned, memory, foot)
            if pace > 0.0:
                catches = begin_again(leaps or other, ramp, memory)
                start = held + memory.drift
                regains = max(regains, min(-memory.drift, BENT * moved))
        least = held - regains
    begins = trails and memory.pace > 0.0
    gap = max(_next_gap(start, target, held if begins else -np.inf, catches, moved, dt, memory), least)
    if not trails:
        rest(memory)
        if deep > 0.0:
            keep_step(memory, foot)
            memory.drift = gap - held
    memory.off = target - gap if abs(target - gap) > ROUNDING else 0.0
    memory.excess = gap - held
    foot.distance = gap


@kernel
def _end(p: Vector3, moved: float, inside: bool, exists: bool, kept: bool, dt: float, foot: Record, memory: Record):
    """Move the foot to its target, if it exists, and store the step.

    inside  whether the tool was inside in the last step;  kept: whether the gap is that of the foot (`memory.kept`)
    exists  whether `foot` is the target; else no target exists. Returned: whether the foot moves to one
    """
    if moved < np.inf:
        held, rises = _held_gap(p, memory), max(moved, FADES * dt)
        leaves = exists and inside and memory.side == OUT and foot.distance > memory.gap + rises + ROUNDING
        if leaves:  # a thin body: the gap rises to the true one first
            memory.side = IN if memory.passed else LEAVES
            if memory.rising == 0.0:
                memory.drift = memory.excess
            memory.excess = rise(rises - held + memory.gap, max(moved / LANDING, dt / ARRIVES), memory)
            least = max(memory.gap - moved - held, -BENT * moved)
            memory.excess = max(min(memory.excess, memory.gap + rises - held), least)
            held += memory.excess
        if exists and not leaves:
            memory.rising = 0.0
            _approach(p, moved, held, kept != memory.kept, dt, foot, memory)
        else:
            drift, memory.off = memory.drift, 0.0
            if leaves:
                memory.behind = memory.pace = 0.0
            else:  # the rate of the gap fades, as the tool's motion allows
                fades = memory.excess * (1.0 - min(max(moved / LANDING, dt / ARRIVES), 1.0))
                least = max(memory.gap - moved, held - BENT * moved)
                memory.excess = min(max(held + fades, least), memory.gap + moved) - held
                held += memory.excess
            stay(memory, held, foot)
            rest(memory)
            memory.drift, memory.rising = (drift, memory.rising) if leaves else (0.0, 0.0)
            exists = False
    else:
        memory.off = memory.rising = memory.excess = 0.0
        rest(memory)
    memory.started, memory.gap, memory.kept = True, foot.distance, kept
    for k in range(3):
        memory.tool[k], memory.foot[k], memory.normal[k] = p[k], foot.point[k], foot.normal[k]
    return exists


@kernel
def _limit_motion(x: float):
    return min(max(x, -FAR), FAR)


@kernel
def follow(
    data: Array,
    layout: Record,
    first: Indices,
    samples: Record,
    clusters: Record,
    links: Indices,
    spacing: Record,
    point: Vector3,
    hysteresis: float,
    tracked: Record,
    work: Array,
    d: Tensor,
    foot: Record,
    memory: Record,
    dt: float,
):
    """The foot of a tool at `point` [m] (3) on a NURBS surface: arguments and result as of `track`; dt [s]."""
    p = (_limit_motion(point[0]), _limit_motion(point[1]), _limit_motion(point[2]))
    moved, inside = _tool_motion(p, memory), memory.side != OUT
    # 1. the nearest point; past the border of a sheet the gap is the distance
    track(
        data, layout, first, samples, clusters, links, spacing, p[0], p[1], p[2], hysteresis, tracked, work, d, foot
    )  # fmt: skip
    if memory.border:
        along = 0.0
        for k in range(3):
            along += (p[k] - foot.point[k]) * foot.normal[k]
        _at_border(p, along, foot)
    kept = False
    if inside and foot.distance <= 0.0:
        kept = _keep_side(p, vector(tracked.normal), foot)
    # 2. if its normal is reversed: the local minimum next to the last target, or none
    exists = _regular(foot, moved, p, memory)
    memory.passed = not exists
    if not exists:
        nearest = values_of(foot)
        u, v, _ = newton(data, layout, first, p[0], p[1], p[2], memory.place[0], memory.place[1], work, d[0])
        n0, n1, n2 = normal_of(data, layout, u, v, d[0])
        q0, q1, q2 = vector(d[0, 0])
        put(foot.point, (q0, q1, q2))
        put(foot.normal, (n0, n1, n2))
        foot.place[0], foot.place[1] = u, v
        foot.distance = (p[0] - q0) * n0 + (p[1] - q1) * n1 + (p[2] - q2) * n2
        exists = not _tool_turn(foot, memory)
        if (foot.distance if exists else _held_gap(p, memory)) > 0.0:
            memory.side, exists = OUT, True
            set_values(foot, nearest)
        elif not exists:
            foot.place[0], foot.place[1] = memory.place[0], memory.place[1]
        tracked.place[0], tracked.place[1] = foot.place[0], foot.place[1]
    # 3. move the foot to the target at limited speed
    if not _end(p, moved, inside, exists, kept, dt, foot, memory):
        foot.place[0], foot.place[1] = memory.place[0], memory.place[1]
    memory.place[0], memory.place[1] = foot.place[0], foot.place[1]


@kernel
def follow_mesh(
    points: Record,
    cells: Record,
    discs: Record,
    star_at: Indices,
    star: Indices,
    point: Vector3,
    hysteresis: float,
    tracked: Record,
    work: Record,
    foot: Record,
    memory: Record,
    dt: float,
):
    """The foot of a tool at `point` [m] (3) on a triangle mesh: arguments and result as of `track_mesh`;
    dt [s]."""
    p = (_limit_motion(point[0]), _limit_motion(point[1]), _limit_motion(point[2]))
    moved, inside = _tool_motion(p, memory), memory.side != OUT
    # 1. the nearest point; past the border of a sheet the gap is the distance
    track_mesh(points, cells, discs, star_at, star, p[0], p[1], p[2], hysteresis, tracked, work, foot)
    past, shown = False, tracked.triangle
    if memory.border:
        _, v, w, place = _on_triangle(points, cells, tracked.triangle, p[0], p[1], p[2])
        along = signed_distance(points, cells, star_at, star, tracked.triangle, v, w, place, p[0], p[1], p[2], foot)
        past = _at_border(p, along, foot)
    if not past:
        shown, foot.place[0], foot.place[1] = smooth_foot(
            points, cells, tracked.triangle, foot.place[0], foot.place[1], p, foot
        )
    kept = False
    if inside and foot.distance <= 0.0 and tracked.nearest != tracked.triangle:
        kept = _keep_side(p, _direction(points, cells, tracked.nearest, p), foot)
    # 2. if its normal is reversed: the local minimum next to the last target, or none
    exists = _regular(foot, moved, p, memory)
    memory.passed = not exists
    if not exists:
        nearest, local, first = values_of(foot), tracked.triangle, shown
        t, _ = _descend(points, cells, star_at, star, p[0], p[1], p[2], memory.triangle)
        _, v, w, place = _on_triangle(points, cells, t, p[0], p[1], p[2])
        foot.distance = signed_distance(points, cells, star_at, star, t, v, w, place, p[0], p[1], p[2], foot)
        tracked.triangle = t
        shown, foot.place[0], foot.place[1] = smooth_foot(points, cells, t, v, w, p, foot)
        exists = foot.distance <= 0.0 and not _tool_turn(foot, memory)
        if not exists and _held_gap(p, memory) > 0.0:
            memory.side, tracked.triangle, shown, exists = OUT, local, first, True
            set_values(foot, nearest)
        elif not exists:
            tracked.triangle = memory.triangle
    # 3. move the foot to the target at limited speed
    if not _end(p, moved, inside, exists, kept, dt, foot, memory):
        tracked.triangle, shown = memory.triangle, memory.shown
        foot.place[0], foot.place[1] = memory.place[0], memory.place[1]
    foot.triangle = cells[shown].origin
    memory.triangle, memory.shown = tracked.triangle, shown
    memory.place[0], memory.place[1] = foot.place[0], foot.place[1]
