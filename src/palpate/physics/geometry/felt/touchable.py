"""Which triangles of a surface a ball can touch.

A ball of radius r touches the surface at x, with the outward normal n, if no other part of the body is within r of its
centre x + r n. The test at the middle of a triangle is enough where edges are short; larger triangles are divided.
"""

import numpy as np

from palpate.compiler.exact import einsum
from palpate.compiler.fields import blank_record, element_type
from palpate.compiler.kernel import kernel
from palpate.compiler.records import vector
from palpate.physics.arrays import Array, Indices, Matrix, Record
from palpate.physics.geometry.felt.in_ball import (
    SLACK,
    any_above,
    fill_margins,
    gather_vertices,
    is_above,
    nearest_at,
    nearest_below,
    nodes_near,
    vertices_near,
)
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.mesh_closest import STACK, MeshClosestPoint, _on_triangle
from palpate.physics.geometry.pseudonormal import signed_distance
from palpate.physics.geometry.refined.divided import divide_triangles
from palpate.physics.geometry.refined.edge_list import edges_of
from palpate.physics.geometry.search.foot import FOOT
from palpate.physics.geometry.search.morton import morton_order

TOGETHER = 16  # balls that share a search
FEW = 512  # nodes of a search of which all vertices are tested first
BALLS = element_type({"centre": (3,), "middle": (3,), "normal": (3,), "hidden": int})
"""A ball that would touch the middle [m] of a triangle with this normal [1]: its centre [m], and 1 if it cannot."""
SHORT = 1 / 3  # [1] of the radius: longest edge of a triangle whose middle represents it


def divide_long_edges(mesh: Mesh, longest: float, within: np.ndarray | None = None) -> tuple[Mesh, np.ndarray]:
    """The same flat triangles with edges of at most `longest` [m], and for each the triangle of `mesh` (T,).

    within  (V,) vertices between which edges are divided; None: all
    """
    points, triangles, origin = mesh.vertices, mesh.triangles.astype(np.int64), np.arange(len(mesh.triangles))
    while True:
        ends, of, _ = edges_of(triangles, len(points))
        long = np.linalg.norm(points[ends[:, 0]] - points[ends[:, 1]], axis=1) > longest
        if within is not None:
            long &= within[ends].all(axis=1)
            within = np.concatenate([within, np.ones(int(long.sum()), bool)])
        if not long.any():
            return Mesh(points, np.ascontiguousarray(triangles, np.int32)), origin
        number = np.full(len(ends), -1)
        number[long] = len(points) + np.arange(long.sum())
        points = np.concatenate([points, 0.5 * (points[ends[long, 0]] + points[ends[long, 1]])])
        triangles, part = divide_triangles(triangles, number[of])
        origin = origin[part]


def untouchable(mesh: Mesh, closest: MeshClosestPoint, radius: float) -> np.ndarray:
    """Whether no ball of the radius [m] touches the middle of each triangle (T,) of a mesh with edges of at most
    `SHORT` of the radius; `closest` finds the nearest points of the whole body."""
    length = np.linalg.norm(mesh.face_vectors, axis=1)
    facing = np.flatnonzero(length > 0.0)
    hidden = np.zeros(len(mesh.triangles), bool)
    middle = einsum("tkc,k->tc", mesh.vertices[mesh.triangles[facing]], np.full(3, 1.0 / 3.0))
    hidden[facing] = hides(closest, middle, mesh.face_vectors[facing] / length[facing, None], radius)
    return hidden


def hides(
    closest: MeshClosestPoint, points: np.ndarray, normals: np.ndarray, radius: float, slack: float = SLACK
) -> np.ndarray:
    """Whether a part of a body is inside the ball of the radius [m] that touches it at each point [m] (n,3) with this
    unit normal (n,3), by more than `slack` [m], or the centre of the ball is inside the body: (n,)."""
    hidden = np.zeros(len(points), bool)
    if not len(points):
        return hidden
    order = morton_order(points)
    balls = np.zeros(len(points), BALLS)
    middle, normal = points[order], normals[order]
    balls["middle"], balls["normal"], balls["centre"] = middle, normal, middle + radius * normal
    tables = closest.tables
    count, nodes = len(tables.points), np.empty(len(tables.discs), np.int64)
    margin = np.zeros(count)
    fill_margins(tables.points, tables.cells, margin)
    closed = closest.mesh.closed  # a sheet has no inside
    _fill(*tables.arrays, balls, radius, (radius - slack) ** 2, closed, nodes, np.empty(STACK, np.int64),
          blank_record(FOOT), np.full(count, -1), np.empty((4, count)), np.empty((2, count + 1), np.int64),
          np.full(len(tables.cells), -1), margin)  # fmt: skip
    hidden[order] = balls["hidden"] > 0
    return hidden


@kernel
def _fill(
    points: Record, cells: Record, discs: Record, star_at: Indices, star: Indices, balls: Record, radius: float,
    enough: float, closed: bool, nodes: Indices, work: Indices, foot: Record, seen: Indices, around: Matrix,
    some: Indices, tested: Indices, margin: Array,
):  # fmt: skip
    """Fill in whether each ball is hidden. First the triangle is tested that hid the ball before. Neighbouring balls
    share the search down to `LEVELS` above the leaves, and the vertices below. On a convex surface none of these is
    above their tangent planes. Elsewhere, the triangles at those are tested that are near the ball (`vertices_near`).

    enough [m²]  squared distance from a centre within which a part hides it
    seen (V), around (4,V), some (2,V+1), tested (T)  workspaces, seen and tested of -1;  margin (V)  of `fill_margins`
    """
    last = -1
    for begin in range(0, len(balls), TOGETHER):
        group, size, close, few = balls[begin : begin + TOGETHER], -1, 0, False
        for number in range(len(group)):
            ball = group[number]
            if last >= 0 and is_above(points, cells, last, ball, radius):
                square, _, _, _ = _on_triangle(points, cells, last, ball.centre[0], ball.centre[1], ball.centre[2])
                if square < enough:
                    ball.hidden = 1
                    continue
            if size < 0:
                size = nodes_near(discs, group, radius, nodes, work)
                few = size <= FEW
                if few:
                    close = gather_vertices(
                        points, cells, len(discs) // 4, nodes[:size], begin, seen, margin, around, some
                    )
            if few and not any_above(around, close, ball, radius):
                last = -1
                continue
            if few:
                count = vertices_near(around, close, ball, radius, some)
                near = some[1, :count]
                best, least = nearest_at(
                    points, cells, star_at, star, ball, radius, enough, near, begin + number, tested
                )
            else:
                best, least = nearest_below(points, cells, discs, ball, radius, enough, nodes[:size], work)
            last = -1
            if best >= 0:
                p0, p1, p2 = vector(ball.centre)
                hidden = least < enough
                last = best if hidden else -1
                if closed and not hidden:
                    _, v, w, place = _on_triangle(points, cells, best, p0, p1, p2)
                    away = signed_distance(points, cells, star_at, star, best, v, w, place, p0, p1, p2, foot)
                    hidden = away < 0.0
                ball.hidden = 1 if hidden else 0
