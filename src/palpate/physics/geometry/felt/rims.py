"""Rounded rims of bridges: the finger that rolls over them feels no kink.

The closing by a ball of radius r has a kink at each sharp rim of a bridge: there the ball turns about the rim by the
angle θ between the normal n_1 of the body and the direction n_2 to the centre at which the ball also touches the other
rim (θ ~ w/(2r) over a gap w). A point that follows the surface takes this turn at once, with a change of direction and
of depth rate. A pulp is soft: it sinks by as much of the dip of the ball as its patch lacks support. In a gap of half
the width a, between rims at the same height, the ball sinks at the distance y from the middle by

    d(y) = (r² - y²)^½ - (r² - a²)^½ + (θ - β) (a² - y²)/(2a),        sin β = a/r,

below the body continued over the gap, whose curvature is (θ - β)/a. The line integral (1 - y²/R²)^(5/2) of the biweight
patch over the gap, over that in the middle, is

    B(y) = (Φ((y + a)/R) - Φ((y - a)/R)) / (2 Φ(a/R)),        Φ(u) = integral_0^u (1 - v²)^(5/2) dv,

and the surface is that of the body, continued over the gap, less d(0) B(y). So at the distance s from a rim it sinks
perpendicular to the chord between the rims by

    d(0) B(a + s)                       on the body, up to R = r, or half of the way to the next rim,
    d(0) B(a - s) - d(a - s)            on the bridge, up to a = min(r θ, w/2),

which is 0 in the middle. Slope and curvature are equal on both sides of a rim, also on a curved body. Over gaps of 2, 4
and 8 mm (r = 8 mm) a rim sinks by 0.06, 0.22 and 0.65 mm and its normal tilts by 0.005, 0.03 and 0.16. Full finite
elements of a pad (0.1 to 0.38 N) tilt by 0.13 to 0.16 there over 8 mm.

The curvature κ matters below the surface: in the depth d the foot moves 1/(1 - κ d) times as far as the bone. Beyond a
rim, it is at most 1/(222 mm), 1/(74 mm) and 1/(30 mm), and adds to that of the body. (With a parabola up to 1.5 mm over
a gap of 3 mm it was 1/(16 mm) and began at once: 8 mm deep in an ellipsoid with a fissure the foot moved from one tick
to the next twice as far as the bone, the limit of `geometry.proxy`, and viscous beams answered with 0.5 N.)
"""

from typing import NamedTuple

import numpy as np

from palpate.compiler.exact import arctan2, einsum
from palpate.physics.geometry.felt.hollow import nearest_points
from palpate.physics.geometry.felt.in_ball import SLACK
from palpate.physics.geometry.mesh_closest import MeshClosestPoint
from palpate.physics.geometry.refined.divided import divide_triangles
from palpate.physics.geometry.refined.edge_list import edges_of
from palpate.physics.nearest import nearest, tree_of

WIDEST = 0.25  # [1] of the radius: distance from a rim of points of a bridge by which it is found
LEAST = 0.02  # [1] of the radius: a below which a rim stays, that of a gap of 0.3 mm
FINEST, EVEN = 0.4, 0.2  # [1] of a, and of R: longest edge across a rim
MADE_EVEN = 0.1  # [1] of R: length over which normals are made even
AWAY = 0.5  # [1] cosine to the direction away from the gap from which another rim lies on this side
ENDS = 0.25  # [1] of the radius, or a: length from its end over which a rim becomes sharp
LESS = (0.75, 0.5, 0.25)  # [1] shares of its motion that a vertex takes in turn where triangles would fold
UNFOLDED = 24  # rounds, because a point that stays may fold its neighbours
HALVINGS = 7  # of an edge at most
CORNER = 0.7  # [1] cosine between normals below which two rims meet at an edge of the body, where they stay
CLEAR = 2.2  # [1] distance from an edge of the body over that of an end up to which rims stay
STEEP = np.pi / 3.0  # [1] tilt from which a rim is an edge of the body, over a gap of 1.7 r
SAME_SIDE = (0.3, 0.6)  # [1] cosine between a normal and that of the rim from which a vertex moves, and moves fully
APART = 0.03  # [1] of the radius: distance of points of a rim
AHEAD = 0.1  # [1] of the radius: beyond a centre, where the other rim is nearer
EXACT = 1e-6  # [m] by which a ball may overlap what it rests on
SAME = 1e-3  # [1] of the radius: distance between points of a body below which they are on one rim
ACROSS = 0.25  # [1] sine of the angle to a rim above which a line leads away from the body
ROUNDS = 16  # each halves the distance from the other rim


class Rims(NamedTuple):
    """Points on rims [m] (n,3), normals of the body and of the bridge there and the direction of the rim [1] (n,3), and
    a and R [m] (n)."""

    points: np.ndarray
    body: np.ndarray
    bridge: np.ndarray
    along: np.ndarray
    reach: np.ndarray
    far: np.ndarray


def find_rims(points: np.ndarray, touched: MeshClosestPoint, centres: MeshClosestPoint, radius: float) -> Rims | None:
    """The rims next to points [m] (n,3) of bridges; None: no rim is to be rounded.

    touched  the part of the body that the ball touches;  centres  of the ball
    """
    foot, away = nearest_points(touched, points)
    near = np.flatnonzero(away < WIDEST * radius)
    if not len(near):
        return None
    place = np.round(foot[near] / (APART * radius)).astype(np.int64)
    near = near[np.sort(np.unique(place, axis=0, return_index=True)[1])]
    foot = foot[near]
    body = touched.find_along(foot)[1]
    centre, other, good = resting(foot, body, nearest_points(centres, points[near])[0], touched, radius)
    bridge = (centre - foot) / radius
    tilt = _tilt(body, bridge)
    wide = np.linalg.norm(other - foot, axis=1)
    reach = np.minimum(radius * tilt, 0.5 * wide)
    good &= (reach > LEAST * radius) & (tilt < STEEP)
    # where the ball is tangent to the body it comes close to points beyond, about which it would turn away from the gap
    good &= einsum("ij,ij->i", other - foot, bridge - body) > 0.0
    if not good.any():
        return None
    foot, body, bridge, reach = foot[good], body[good], bridge[good], reach[good]
    one, other = tree_of(foot).query_pairs(CLEAR * min(float(reach.max()), ENDS * radius), output_type="ndarray").T
    meet = einsum("ij,ij->i", body[one], body[other]) < CORNER
    inner = np.ones(len(foot), bool)
    inner[one[meet]] = inner[other[meet]] = False
    if not inner.any():
        return None
    foot, body, bridge, reach = foot[inner], body[inner], bridge[inner], reach[inner]
    far = _before_next_rim(foot, body, bridge, radius)
    bridge, reach, far = _along_rims(foot, body, bridge, reach, far)
    along = np.cross(body, bridge)
    along /= np.linalg.norm(along, axis=1)[:, None]
    return Rims(foot, body, bridge, along, reach, far)


def _tilt(body: np.ndarray, bridge: np.ndarray) -> np.ndarray:
    """θ [1] (n), the angle between two normals [1] (n,3)."""
    half = np.minimum(0.5 * np.linalg.norm(bridge - body, axis=1), 1.0)
    return np.asarray(2.0 * arctan2(half, np.sqrt(1.0 - half * half)))


def _before_next_rim(points: np.ndarray, body: np.ndarray, bridge: np.ndarray, radius: float) -> np.ndarray:
    """R [m] (n): the radius, or half of the distance of another rim that lies away from the gap."""
    one, other = tree_of(points).query_pairs(2.0 * radius, output_type="ndarray").T
    one, other = np.concatenate([one, other]), np.concatenate([other, one])
    out, back = points[other] - points[one], body - bridge
    length = np.linalg.norm(out, axis=1)
    behind = einsum("ij,ij->i", out, back[one]) > AWAY * length * np.linalg.norm(back, axis=1)[one]
    far = np.full(len(points), radius)
    np.minimum.at(far, one[behind], 0.5 * length[behind])
    return far


def _along_rims(
    points: np.ndarray, body: np.ndarray, bridge: np.ndarray, reach: np.ndarray, far: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Normals of the bridge [1] (n,3), a and R [m] (n) as means over the points of the same rim within a, because where
    a ball rests on three rims its other one changes from point to point."""
    pairs = tree_of(points).query_pairs(reach.max(), output_type="ndarray")
    pairs = pairs[np.lexsort(pairs.T)]  # scipy's order depends on the processor
    one, other = np.concatenate([pairs, pairs[:, ::-1], np.repeat(np.arange(len(points)), 2).reshape(-1, 2)]).T
    away = np.linalg.norm(points[one] - points[other], axis=1)
    weight = np.clip(1.0 - (away / reach[one]) ** 2, 0.0, 1.0) ** 2
    for side in (body, bridge):
        weight *= einsum("ij,ij->i", side[one], side[other]) > CORNER
    total = np.bincount(one, weight, len(points))
    mean = np.stack([np.bincount(one, weight * bridge[other, k], len(points)) for k in range(3)], axis=1)
    mean = mean / np.linalg.norm(mean, axis=1)[:, None]
    half, patch = (np.bincount(one, weight * each[other], len(points)) / total for each in (reach, far))
    return mean, half, patch


def resting(
    rim: np.ndarray,
    body: np.ndarray,
    centre: np.ndarray,
    touched: MeshClosestPoint,
    radius: float,
    exact: float = EXACT,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centres [m] (n,3) of balls that touch these points of rims [m] (n,3) and another one, from centres near them; the
    other ones [m] (n,3); and whether they were found (n). exact [m] by which they may overlap what they rest on."""
    centre, over = centre.copy(), centre - rim
    over -= einsum("ij,ij->i", over, body)[:, None] * body
    over /= np.maximum(np.linalg.norm(over, axis=1), 1e-12)[:, None]
    query, found = centre + AHEAD * radius * over, np.zeros(len(rim), bool)
    left, last = np.arange(len(rim)), rim.copy()
    for _ in range(ROUNDS):
        other, distance = nearest_points(touched, query[left])
        free = found[left] & (distance > radius - exact)  # it rests on both
        left, other = left[~free], other[~free]
        if not len(left):
            break
        hub, axis = 0.5 * (rim[left] + other), other - rim[left]
        length = np.linalg.norm(axis, axis=1)
        axis /= np.maximum(length, 1e-12)[:, None]
        two = (length > SAME * radius) & (length < 1.999 * radius)
        # a point of the same rim: the nearest centre may lie ahead along it, but the ball touches it from across
        leads = touched.beyond(rim[left] + SAME * radius * axis, ACROSS * SAME * radius)
        along, two = two & ~leads, two & leads
        some, t = left[along], axis[along]
        for each, begin in ((centre, rim), (query, rim), (over, np.zeros_like(rim))):
            each[some] -= einsum("ij,ij->i", each[some] - begin[some], t)[:, None] * t
        last[left], found[left] = other, two
        out = centre[left] - hub
        out -= einsum("ij,ij->i", out, axis)[:, None] * axis
        out /= np.maximum(np.linalg.norm(out, axis=1), 1e-12)[:, None]
        rest = hub + np.sqrt(np.maximum(radius * radius - 0.25 * length * length, 0.0))[:, None] * out
        on = query[left] + np.where(along, 0.0, AHEAD * radius)[:, None] * over[left]
        query[left] = np.where(two[:, None], rest, on)
    return query, last, found & (nearest_points(touched, query)[1] > radius - SLACK)


def divide_near(
    points: np.ndarray, triangles: np.ndarray, normals: np.ndarray, rims: Rims
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The surface with edges near rims that are short across them: points, triangles, normals; the triangle of which
    each is a part."""
    tree, origin, tested = tree_of(rims.points), np.arange(len(triangles)), 0
    shortest = min(FINEST * rims.reach.min(), EVEN * rims.far.min())
    farthest = max(rims.reach.max(), rims.far.max())
    for _ in range(HALVINGS):
        ends, of, _ = edges_of(triangles, len(points))
        edge = points[ends[:, 1]] - points[ends[:, 0]]
        length = np.linalg.norm(edge, axis=1)
        long = np.flatnonzero((length > shortest) & (ends[:, 1] >= tested))  # others were tested in the round before
        middle, most = 0.5 * (points[ends[long, 0]] + points[ends[long, 1]]), farthest + length[long].max(initial=0.0)
        away, which = (each[:, 0] for each in nearest(tree, middle, most=most))
        along = rims.along[which]
        across = np.linalg.norm(edge[long] - einsum("ij,ij->i", edge[long], along)[:, None] * along, axis=1)
        near = np.zeros(len(long), bool)
        for reach, most in ((rims.reach[which], FINEST), (rims.far[which], EVEN)):
            near |= (away < reach + 0.5 * length[long]) & (across > most * reach)
        long = long[near]
        if not len(long):
            break
        number = np.full(len(ends), -1)
        number[long] = len(points) + np.arange(len(long))
        new, out = (0.5 * (each[ends[long, 0]] + each[ends[long, 1]]) for each in (points, normals))
        tested = len(points)
        points = np.concatenate([points, new])
        normals = np.concatenate([normals, out / np.maximum(np.linalg.norm(out, axis=1), 1e-12)[:, None]])
        triangles, part = divide_triangles(triangles, number[of])
        origin = origin[part]
    return points, triangles, normals, origin


def round_rims(
    points: np.ndarray, normals: np.ndarray, rolling: np.ndarray, rims: Rims, touched: MeshClosestPoint, radius: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Points [m] (V,3) of the surface with rounded rims, on the ball of the rim and as far from it as they were, its
    normals [1] (V,3), and the length [m] (V) over which these are to be made even, and by which share [1] (V).

    rolling  [1] (V,3) directions from points of bridges to the centre of the ball
    touched  the part of the body that the ball touches, whose normals next to a rim are not those of walls
    radius   [m] of the ball
    """
    spacing = APART * radius
    most = max(rims.reach.max(), rims.far.max()) + 2.0 * spacing
    away, which = (each[:, 0] for each in nearest(tree_of(rims.points), points, most=most))
    near = np.flatnonzero(away < np.maximum(rims.reach, rims.far)[which] + spacing)
    which = which[near]
    first, second, along = (each[which] for each in (rims.body, rims.bridge, rims.along))
    reach, far = rims.reach[which], rims.far[which]
    out = points[near] - rims.points[which]
    over = einsum("ij,ij->i", out, second - first) > 0.0
    part = einsum("ij,ij->i", out, along)
    across = np.sqrt(np.maximum(einsum("ij,ij->i", out, out) - part * part, 0.0))
    # 1 on rims, 0 beyond their ends, on the other side of a thin body, and on other faces at a corner
    up = first + second
    up /= np.maximum(np.linalg.norm(up, axis=1), 1e-12)[:, None]
    low, high = SAME_SIDE
    there = np.clip((einsum("ij,ij->i", normals[near], up) - low) / (high - low), 0.0, 1.0)
    past = np.clip(1.0 - np.maximum(np.abs(part) - spacing, 0.0) / np.minimum(reach, ENDS * radius), 0.0, 1.0)
    there *= past * past * (3.0 - 2.0 * past)
    close = there * (1.0 - np.clip(across / np.minimum(reach, ENDS * radius), 0.0, 1.0) ** 2)
    # of the triangle of both rims and the centre: towards the other rim, and away from the body
    sine = np.minimum(reach / radius, 1.0)[:, None]
    cosine, tangent = np.sqrt(1.0 - sine * sine), np.cross(along, second)
    chord, rise = cosine * tangent + sine * second, cosine * second - sine * tangent
    towards = einsum("ij,ij->i", out, chord)
    sink, slope = _sink(np.where(over, towards, across), over, _tilt(first, second), reach, far, radius)
    moved, facing = points.copy(), normals.copy()
    moved[near] -= (there * sink)[:, None] * rise
    # near a rim, where the nearest centre is any between both normals, the bridge is on the ball of the rim
    flat = out - part[:, None] * along - radius * second
    length = np.linalg.norm(flat, axis=1)
    settled = moved.copy()
    settled[near] += (close * np.where(over, radius / length - 1.0, 0.0))[:, None] * flat
    own = np.where(over[:, None], -flat / length[:, None], touched.find_along(points[near])[1])
    steady = np.where(over, close, there * (1.0 - np.clip(across / far, 0.0, 1.0) ** 2))
    rest = np.where((over & (there > 0.0))[:, None], rolling[near], normals[near])
    own = rest + steady[:, None] * (own - rest)
    new = own + (there * slope * einsum("ij,ij->i", own, rise))[:, None] * chord
    facing[near] = new / np.maximum(np.linalg.norm(new, axis=1), 1e-12)[:, None]
    length, share = np.zeros(len(points)), np.zeros(len(points))
    length[near], share[near] = MADE_EVEN * far, there
    return settled, moved, facing, length, share


def _sink(
    s: np.ndarray, over: np.ndarray, tilt: np.ndarray, half: np.ndarray, patch: np.ndarray, radius: float
) -> tuple[np.ndarray, np.ndarray]:
    """Sinking [m] (n) and its slope towards the other rim [1] (n) at distances s [m] (n) from rims, on the bridge or on
    the body; tilt [1] (n) is θ, half [m] (n) is a, patch [m] (n) is R."""
    y = np.where(over, half - np.clip(s, 0.0, half), half + s)
    height, at = np.sqrt(np.maximum(radius * radius - half * half, 0.0)), np.minimum(y, half)
    bend = (tilt - arctan2(half, height)) / half
    arc = np.sqrt(radius * radius - at * at)
    ball = arc - height + 0.5 * bend * (half * half - at * at)  # 0 on the body
    deep, scale = radius - height + 0.5 * bend * half * half, 2.0 * _supported(half / patch)[0]
    (ahead, first), (behind, second) = _supported((y + half) / patch), _supported((y - half) / patch)
    slope = deep * (second - first) / (scale * patch) - np.where(over, at / arc + bend * at, 0.0)
    return deep * (ahead - behind) / scale - ball, slope


def _supported(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Φ [1] (n), and its derivative."""
    v = np.clip(u, -1.0, 1.0)
    square = 1.0 - v * v
    root = np.sqrt(square)
    part = v * (33.0 - v * v * (26.0 - 8.0 * v * v)) * root
    return (part + 15.0 * arctan2(v, root)) / 48.0, square * square * root


def unfolded(
    points: np.ndarray, normals: np.ndarray, moves: list[np.ndarray], turned: np.ndarray, triangles: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Moved points [m] and turned normals (V,3). Where a triangle would face away from its normals, its vertices take
    the next one of the moved points [m] (V,3), then `LESS` of the motion, and at last stay as they were: a vertex that
    stayed at once would fold its neighbours, and these theirs."""
    stages = np.stack([*moves, *(points + share * (moves[-1] - points) for share in LESS), points])
    last = len(stages) - 1
    changed = ((stages != points).any(axis=0) | (turned != normals)).any(axis=1)
    triangles = triangles[changed[triangles].any(axis=1)]  # no other one can fold
    stage, kept, each = np.zeros(len(points), np.int64), np.zeros(len(points), bool), np.arange(len(points))
    for both in (False, True):  # first the points alone, since the normals of what stays are those of its surroundings
        tested = triangles
        for _ in range(UNFOLDED):
            a, b, c = (stages[stage[tested[:, k]], tested[:, k]] for k in range(3))
            facing = np.where(kept[tested][..., None], normals[tested], turned[tested])
            back = einsum("ij,ij->i", np.cross(b - a, c - a), facing.sum(axis=1)) < 0.0
            ends = np.unique(tested[back])
            ends = ends[(stage[ends] < last) | (both & ~kept[ends])]
            if not len(ends):
                break
            kept[ends] |= both & (stage[ends] == last)
            stage[ends] = np.minimum(stage[ends] + 1, last)
            changed[:] = False
            changed[ends] = True
            tested = triangles[changed[triangles].any(axis=1)]  # the others are as they were
    return stages[stage, each], np.where(kept[:, None], normals, turned)
