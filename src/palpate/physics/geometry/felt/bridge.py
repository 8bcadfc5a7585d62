"""The closing of a body by a ball: its surface, with bridges where no ball of the radius touches it.

The closing of a solid by a ball of radius r is the complement of all balls of this radius that avoid it (J. Serra,
Image Analysis and Mathematical Morphology, Academic Press 1982). A ball that rolls over a groove of width w < 2r with
sharp rims sinks by r - (r² - w²/4)^½. Triangles that a ball touches are those of the body. Over the others lies the
surface of the *plug*,

    c = r - (distance to the surface of centres) = 0,

raised by `RIM` at untouchable triangles, so that it crosses the rims without a step, and lowered by `RIM` from `SHORE`
beyond them, so that it is inside the body where nothing changes. An exact boolean (manifold3d) joins plug and body;
then the points of the plug are moved to the closing.
"""

from functools import partial
from typing import NamedTuple

import numpy as np

from palpate.compiler.exact import einsum
from palpate.physics.errors import MeshError
from palpate.physics.geometry.felt.band import BLOCK, Grid, sample
from palpate.physics.geometry.felt.centres import centre_surface, divide_creases, march, onto_centres, rounded
from palpate.physics.geometry.felt.even import even_normals
from palpate.physics.geometry.felt.hollow import SHORE, Hollow, distance_to, nearest_points
from palpate.physics.geometry.felt.limits import check_grid, check_triangles
from palpate.physics.geometry.felt.rims import divide_near, find_rims, resting, round_rims, unfolded
from palpate.physics.geometry.felt.ripples import are_deep, in_hollows
from palpate.physics.geometry.felt.solid import piece_volumes, solid_of
from palpate.physics.geometry.felt.touchable import SHORT, divide_long_edges, untouchable
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.mesh_closest import MeshClosestPoint
from palpate.physics.geometry.refined.contracted import contract_edges
from palpate.physics.geometry.refined.edge_list import edges_of
from palpate.physics.geometry.refined.flipped import flip_caps
from palpate.physics.geometry.search.corners import weld

STEP = 0.125  # [1] of the radius: step of the grid
FACET = 0.06  # [1] of the radius: longest edge of a bridge, so that a foot hops by little
THINNEST = 5e-6  # [m] below which the short edges of thin triangles of the boolean are contracted
RIM = 10e-6  # [m] by which the plug is at least raised at the rims, and lowered outside
ASIDE = 5e-6  # [m] along the surface from its nearest touchable point, beyond which a point is over a gap
STEEP = 0.02  # [1] of the radius: motion of a point onto a ball on two rims, which sinks fast where they are far apart
OVERLAP = 1e-8  # [m] of a ball with the rims on which it rests
EDGE = 3.0  # [1] `apart` of `divide_creases`: convex parts whose radius is below r/2 are edges


class Felt(NamedTuple):
    """A felt surface.

    mesh       the surface that a ball can touch
    origin     (T,) for each of its triangles the triangle of the body, or the nearest touchable one under a bridge
    touchable  (T',) whether a ball comes within `ripples.SHALLOW` of each triangle of the body, which then bears load
    area       [m²] of the bridges
    depth      [m] of the deepest point of the body below a bridge
    place      [m] (3) of this point
    """

    mesh: Mesh
    origin: np.ndarray
    touchable: np.ndarray
    area: float
    depth: float
    place: np.ndarray


def close_surface(
    mesh: Mesh, radius: float, offset: tuple[float, float, float] = (0.0, 0.0, 0.0), given: Mesh | None = None
) -> Felt | None:
    """The surface of a closed body that a ball of the radius [m] can feel; None: the ball touches every triangle.

    offset  [m] of the grid's origin, which changes the result by less than 20 um
    given   the mesh of a file before it was refined: ripples of its tessellation count as touchable (`ripples`); None:
            every triangle counts

    MeshError: the body has no inside, the boolean fails, or the ball is too small (`limits`).
    """
    check_triangles(mesh, radius)
    fine, part = divide_long_edges(mesh, SHORT * radius)
    body = MeshClosestPoint(mesh)
    hidden = untouchable(fine, body, radius)
    some = np.flatnonzero(hidden)
    deep = are_deep(fine, some, body, radius)
    if given is not None and len(some):
        kept = in_hollows(fine, some, deep, given, radius)
        hidden[some[~kept]], some, deep = False, some[kept], deep[kept]
    if not len(some):
        return None
    if not mesh.closed:
        raise MeshError("it is open")
    touchable = np.zeros(len(mesh.triangles), bool)
    touchable[part[~hidden]] = True
    touchable[part[some[~deep]]] = True
    felt, origin = _bridged(fine, hidden, body, radius, np.asarray(offset))
    under = fine.vertices[np.unique(fine.triangles[hidden])]  # a large triangle may be touchable in part
    return _describe(felt, origin, body, under, touchable)


def _bridged(
    fine: Mesh, hidden: np.ndarray, body: MeshClosestPoint, radius: float, offset: np.ndarray
) -> tuple[Mesh, np.ndarray]:
    """The felt surface, and for each of its triangles that of the body, -1: a bridge.

    fine, hidden  the body with short edges, and whether no ball touches each of its triangles
    """
    mesh, hollow = body.mesh, Hollow(Mesh(fine.vertices, fine.triangles[hidden]))
    plug, centres = _plug(hollow, body, _touched(fine, hidden, radius), radius, offset)
    vertices, triangles, origin = _join(mesh, plug)
    touched = MeshClosestPoint(Mesh(fine.vertices, fine.triangles[~hidden]))
    normals = _normals(vertices, triangles[origin < 0], mesh, hollow, centres, radius)
    bridge = np.unique(triangles[origin < 0])
    bridge = bridge[body.beyond(vertices[bridge], _raised(radius) + RIM)]
    rims = find_rims(vertices[bridge], touched, centres, radius) if len(bridge) else None
    if rims is not None:
        vertices, triangles, normals, part = divide_near(vertices, triangles, normals, rims)
        origin = origin[part]
    flat, rolling = _without_lift(vertices, normals, np.unique(triangles[origin < 0]), body, touched, centres, radius)
    moves, turned = [flat], normals
    if rims is not None:
        *moves, turned, even, share = round_rims(flat, normals, rolling, rims, touched, radius)
        moves = [np.where(moved != flat, rounded(moved), flat) for moved in moves]
        triangles = flip_caps(moves[0], triangles, _still(flat, moves[0], triangles))
        turned = even_normals(moves[0], turned, triangles, even, share)
    vertices, normals = unfolded(vertices, normals, moves, turned, triangles)
    return Mesh(vertices, np.ascontiguousarray(triangles, np.int32), normals), origin


def _touched(fine: Mesh, hidden: np.ndarray, radius: float) -> np.ndarray:
    """Corners [m] (n,3,3) of the touchable triangles, moved by the radius along their normals."""
    vector = fine.face_vectors[~hidden]
    length = np.linalg.norm(vector, axis=1)
    out = (radius * vector / np.maximum(length, 1e-300)[:, None])[length > 0.0]
    return fine.vertices[fine.triangles[~hidden][length > 0.0]] + out[:, None]


def _plug(
    hollow: Hollow, body: MeshClosestPoint, touched: np.ndarray, radius: float, offset: np.ndarray
) -> tuple[Mesh, MeshClosestPoint]:
    """The plug, and the surface of centres."""
    step = STEP * radius
    points, triangles, centres = _march_plug(hollow, body, touched, radius, offset)
    # at an edge of the body the plug has one as well, which marching cubes cut off
    points, feet, good = _settle(points, centres, hollow, radius)
    points, triangles = divide_creases(
        partial(nearest_points, centres), points, feet, triangles, good, radius, step, EDGE
    )
    # where the plug ends inside the body, its edges may stay long
    near, off = np.ones(len(points), bool), np.flatnonzero(~good)
    near[off] = body.find_sorted(points[off])[3] > -step
    plug, _ = divide_long_edges(Mesh(points, np.ascontiguousarray(triangles, np.int32)), FACET * radius, near)
    some = np.flatnonzero(np.concatenate([near, np.ones(len(plug.vertices) - len(near), bool)]))
    plug.vertices[some] = _settle(plug.vertices[some], centres, hollow, radius)[0]
    return Mesh(rounded(plug.vertices), plug.triangles), centres


def _march_plug(
    hollow: Hollow, body: MeshClosestPoint, touched: np.ndarray, radius: float, offset: np.ndarray
) -> tuple[np.ndarray, np.ndarray, MeshClosestPoint]:
    """Vertices [m] (V,3) and triangles (T,3) of the plug from marching cubes, and the surface of centres."""
    step = STEP * radius
    reach = radius + 4.0 * step  # of the plug; the centres of balls that touch it are within r of it
    margin = reach + radius + hollow.size + 2.0 * BLOCK * step
    grid = Grid.round_box(hollow.low - margin + offset, hollow.high + margin + step, step)
    check_grid(grid.shape, 2.0 * (margin - hollow.size) / step, radius)
    distances = sample(grid, lambda at: body.find_sorted(at)[3], radius, hollow.within, margin)
    touched = touched[hollow.within(touched.mean(axis=1), margin - radius)]
    centres = centre_surface(body, distances, grid, radius, touched)
    away = sample(grid, lambda at: distance_to(centres, at), radius, hollow.within, reach)
    closing = np.where(distances >= radius, step, radius - away)
    # raised at the rims, lowered outside, and ended inside the body
    index = np.argwhere(np.isfinite(away) & (np.abs(closing) < 2.0 * step))
    level = np.where(np.isfinite(away), closing, step)
    level[tuple(index.T)] -= _lift(hollow, grid.points(index), radius, step)
    return *march(np.clip(level, -2.0 * step, 2.0 * step), grid, 0.0), centres


def _settle(
    points: np.ndarray, centres: MeshClosestPoint, hollow: Hollow, radius: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points [m] (n,3) moved to the level of the plug, their nearest centres [m] (n,3), and which are on it (n): not
    where the plug ends inside the body."""
    step = STEP * radius
    feet, length = nearest_points(centres, points)
    shift = _lift(hollow, points, radius, step) - (radius - length)
    good = np.abs(shift) <= 0.5 * step
    share = np.where(good, shift, 0.0) / np.maximum(length, 1e-12)
    return points + share[:, None] * (feet - points), feet, good


def _without_lift(
    points: np.ndarray, normals: np.ndarray, plug: np.ndarray, body: MeshClosestPoint, touched: MeshClosestPoint,
    centres: MeshClosestPoint, radius: float,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Points [m] and normals (V,3) of body and plug, with the points `plug` (n) of the plug moved to the closing, and
    with the directions from there to the centre of the ball.

    touched  the part of the body that the ball touches
    """
    at, moved, facing = points[plug], points.copy(), normals.copy()
    feet, normal, triangle, _ = touched.find_along(at)
    # the centre where the ball rests on both rims, else the nearer one of where it rests on a triangle next to the
    # point, and near a facet of the surface of centres, which is a chord
    rolling, good = onto_centres(body, nearest_points(centres, at)[0], radius, STEP * radius)
    up = touched.mesh.face_vectors[triangle]
    length = np.linalg.norm(up, axis=1)
    on_body = feet + (radius / np.maximum(length, 1e-300))[:, None] * up
    aside = at - feet
    aside -= (einsum("ij,ij->i", aside, up) / np.maximum(length, 1e-300) ** 2)[:, None] * up
    over = np.flatnonzero(np.linalg.norm(aside, axis=1) > ASIDE)
    on_rims, _, free = resting(feet[over], normal[over], rolling[over], touched, radius, OVERLAP)
    out = at - np.stack([rolling, on_body])
    away = np.where(np.stack([good, length > 0.0]), np.linalg.norm(out, axis=2), np.inf)
    out = out[away.argmin(axis=0), np.arange(len(at))]
    out[over[free]] = at[over[free]] - on_rims[free]
    away = np.linalg.norm(out, axis=1)
    most = np.full(len(at), 2.0 * _raised(radius))
    most[over[free]] = STEEP * radius
    near = np.abs(away - radius) <= most
    plug, at, out, away = plug[near], at[near], out[near], away[near, None]
    moved[plug] = rounded(at + (radius / away - 1.0) * out)
    facing[plug] = -out / away
    return moved, facing


def _lift(hollow: Hollow, points: np.ndarray, radius: float, step: float) -> np.ndarray:
    """Height [m] (n) of the plug over the closing at points [m] (n,3), by their distance from untouchable triangles.
    Between `SHORE` and the radius it is constant."""
    away, shore = np.full(len(points), SHORE), hollow.within(points, SHORE)
    away[shore] = hollow.distance(points[shore], SHORE)
    beyond = ~hollow.within(points, radius)
    away[beyond] = hollow.about(points[beyond], radius + 3.0 * step)
    x, y = np.clip(away / SHORE, 0.0, 1.0), np.clip((away - radius) / (3.0 * step), 0.0, 1.0)
    return _raised(radius) * (1.0 - 2.0 * x * x * (3.0 - 2.0 * x)) - 3.0 * step * y


def _raised(radius: float) -> float:
    """Height [m] of the plug over the closing at untouchable triangles: `RIM`, and the sagitta of an edge, one step of
    the grid long, of the surface of centres, by which it would begin below the rims and leave strips of the walls."""
    return RIM + 0.125 * STEP * STEP * radius


def _join(mesh: Mesh, plug: Mesh) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices and triangles of the union of both, without the voids inside, and for each of its triangles that of the
    body, -1: of the plug."""
    from manifold3d import Manifold  # its package is an extra

    name = Manifold.reserve_ids(2)
    # piece by piece, because pieces of a body may overlap
    whole = weld(mesh.vertices)[mesh.triangles]
    label, volume = piece_volumes(mesh.vertices, whole)
    joined = solid_of(plug.vertices, plug.triangles, name=name + 1)
    for part in (np.flatnonzero(label == number) for number in np.flatnonzero(volume > 0.0)):
        used, corner = np.unique(whole[part], return_inverse=True)
        joined = solid_of(mesh.vertices[used], corner.reshape(-1, 3), faces=part, name=name) + joined
    found = joined.to_mesh64()
    points, triangles = np.asarray(found.vert_properties)[:, :3], np.asarray(found.tri_verts).astype(np.int64)
    run = np.repeat(np.asarray(found.run_original_id), np.diff(np.asarray(found.run_index)) // 3)
    origin = np.where(run == name, np.asarray(found.face_id).astype(np.int64), -1)
    label, volume = piece_volumes(points, triangles)
    outer = (volume > 0.0)[label]
    used, corner = np.unique(triangles[outer], return_inverse=True)
    points = points[used]
    own = _own(points, mesh) >= 0
    points = np.where(own[:, None], points, rounded(points))
    corner = corner.reshape(-1, 3)
    # a thin triangle folds where its corners are moved by different lengths
    thick, becomes = contract_edges(
        Mesh(points, np.ascontiguousarray(corner, np.int32)), THINNEST, np.flatnonzero(own)
    )  # fmt: skip
    corner = becomes[corner]
    return thick.vertices, thick.triangles, origin[outer][(corner != np.roll(corner, 1, axis=1)).all(axis=1)]


def _still(points: np.ndarray, moved: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """The ends (K,2), lower first, of edges that have not moved as a whole."""
    ends, _, _ = edges_of(triangles, len(points))
    return ends[(moved == points).all(axis=1)[ends].any(axis=1)]


def _own(points: np.ndarray, mesh: Mesh) -> np.ndarray:
    """The vertex of the mesh at each point (n), -1: none."""
    same = weld(np.concatenate([mesh.vertices, points]))[len(mesh.vertices) :]
    return np.where(same < len(mesh.vertices), same, -1)


def _normals(
    points: np.ndarray, bridges: np.ndarray, mesh: Mesh, hollow: Hollow, centres: MeshClosestPoint, radius: float
) -> np.ndarray:
    """Normals (V,3): towards the centre of the ball on bridges and their shores, else those of the body."""
    own = _own(points, mesh)
    normal = np.where((own >= 0)[:, None], mesh.normals[own], 0.0)
    bridge = np.zeros(len(points), bool)
    bridge[bridges] = True
    near = np.flatnonzero(bridge | (own < 0) | (hollow.distance(points, SHORE) < SHORE))
    out = centres.find_along(points[near])[0] - points[near]
    length = np.linalg.norm(out, axis=1)
    good = np.abs(length - radius) < 10.0 * RIM + (STEP * radius) ** 2 / radius
    normal[near[good]] = out[good] / length[good, None]
    return normal


def _middles(mesh: Mesh, triangles: np.ndarray) -> np.ndarray:
    return np.asarray(mesh.vertices[mesh.triangles[triangles]].mean(axis=1))


def _describe(felt: Mesh, origin: np.ndarray, body: MeshClosestPoint, under: np.ndarray, touchable: np.ndarray) -> Felt:
    """The felt surface; `under` [m] (n,3): the points of the body that no ball touches."""
    mesh = body.mesh
    kept, of_plug = np.flatnonzero(touchable), np.flatnonzero(origin < 0)
    bridged = of_plug[body.beyond(_middles(felt, of_plug), 2.0 * RIM)]
    unknown = np.flatnonzero((origin < 0) | ~touchable[origin])  # also the edge of a wall at a rim
    floor = MeshClosestPoint(Mesh(mesh.vertices, mesh.triangles[kept]))
    origin[unknown] = kept[floor.find_sorted(_middles(felt, unknown))[2]]
    area = 0.5 * float(np.linalg.norm(felt.face_vectors[bridged], axis=1).sum())
    depth, deepest = MeshClosestPoint(felt).farthest(under)
    return Felt(felt, origin.astype(np.int32), touchable, area, depth, under[deepest])
