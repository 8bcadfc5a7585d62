"""The felt surface: bridges over gaps and grooves against the closed form of a rolling ball."""

import itertools
from functools import cache

import numpy as np
import pytest
from pytest import approx

from palpate.nodes.base.felt import WIDTH
from palpate.nodes.base.surface import OPEN, SURFACES, surface_mesh
from palpate.physics.errors import MeshError
from palpate.physics.geometry.felt.bridge import close_surface
from palpate.physics.geometry.felt.solid import piece_volumes
from palpate.physics.geometry.felt.touchable import divide_long_edges, untouchable
from palpate.physics.geometry.mesh import Mesh, heights
from palpate.physics.geometry.mesh_closest import MeshClosestPoint
from palpate.physics.geometry.refined.divided import refine_mesh
from palpate.physics.geometry.topology import edge_counts
from palpate.studies.organs.gaps import HIGH, LONG, slots_of
from palpate.studies.organs.shapes import star
from palpate.studies.organs.zoo import COARSE, GAPPED, USUAL, mesh_of

R = 8e-3
TOP = 6e-3  # [m] of the bodies
NEAR = 8e-6  # [m]


def prism(profile, length=0.02, longest=2e-3):
    """A prism along x over a simple polygon (n,2) of (y, z) [m], counter-clockwise seen from +x; edges [m] up to
    `longest`."""
    import manifold3d

    solid = manifold3d.Manifold.extrude(manifold3d.CrossSection([np.asarray(profile) * 1e3]), 1e3 * length)
    made = solid.to_mesh64()
    y, z, x = 1e-3 * np.asarray(made.vert_properties)[:, :3].T
    triangles = np.asarray(made.tri_verts).astype(np.int32)
    coarse = Mesh(np.stack([x - 0.5 * length, y, z], axis=1), triangles)
    return divide_long_edges(coarse, longest)[0]


def groove(width, depth=9e-3):
    w = 0.5 * width
    return prism(
        [(-0.02, -TOP), (0.02, -TOP), (0.02, TOP), (w, TOP), (w, TOP - depth), (-w, TOP - depth), (-w, TOP),
         (-0.02, TOP)]
    )  # fmt: skip


def cut(gap, half=0.02):
    """A block in two pieces, `gap` [m] apart."""
    one, other = (prism([(y, -TOP), (y + half, -TOP), (y + half, TOP), (y, TOP)]) for y in (-half - gap / 2, gap / 2))
    return Mesh(
        np.concatenate([one.vertices, other.vertices]),
        np.concatenate([one.triangles, other.triangles + len(one.vertices)]).astype(np.int32),
    )


@cache
def felt_groove(width):
    return close_surface(groove(width), R)


@cache
def felt_cut(gap):
    return close_surface(cut(gap), R)


def dips(felt, y, x=0.3e-3):
    """Depth [m] of the felt surface below the top at places y."""
    return TOP - heights(felt.mesh, np.stack([np.full(len(y), x), y], axis=1))


def rolls(width, y):
    """Depth [m] of a ball of radius R that rests on two rims this far apart."""
    return np.sqrt(R * R - y * y) - np.sqrt(R * R - 0.25 * width * width)


@cache
def felt_block(name, offset=0.0):
    """The felt surface of a body of the search as the product makes it, and a grid that begins elsewhere [m]."""
    body = refine_mesh(GAPPED[name].make(COARSE), 1.6e-3, 50_000)
    return close_surface(body, R, (offset, 0.7 * offset, 0.3 * offset))


@cache
def lacking(half):
    """Distances [m] (n) and the part of a biweight patch of radius R, so far from the middle of a gap, that is over it,
    over that in the middle: by sums over the patch."""
    x = (np.arange(1600) + 0.5) / 1600 * 2.0 * R - R
    line = np.clip(1.0 - (x[:, None] ** 2 + x**2) / R**2, 0.0, None) ** 2
    cumulated = np.concatenate([[0.0], np.cumsum(line.sum(axis=0))])
    edges, y = np.linspace(-R, R, 1601), np.linspace(0.0, R + half, 4000)
    over = np.interp(y + half, edges, cumulated) - np.interp(y - half, edges, cumulated)
    return y, over / over[0]


def rounded(width, y):
    """Depth [m] of a surface that sinks at the distances y [m] from the middle of a gap by as much of the depth of the
    ball there as the patch lacks support; at a steep rim, like the ball."""
    if width > 2.0 * R * np.sin(np.pi / 3.0):
        return np.where(np.abs(y) < 0.5 * width, rolls(width, np.minimum(np.abs(y), 0.5 * width)), 0.0)
    return rolls(width, 0.0) * np.interp(np.abs(y), *lacking(0.5 * width))


def slide(width, path):
    """Signed distance [m] (n) and y of the normal [1] (n) of points (n,2), whose y is positive, from the surface of
    `rounded`: the nearest of all points of the line."""
    at = np.linspace(0.0, 0.02, 20_000)
    line = np.stack([at, -rounded(width, at)], axis=1)
    away = path[:, None] - line[None]
    nearest = np.linalg.norm(away, axis=2).argmin(axis=1)
    tangent = np.gradient(line[:, 0]), np.gradient(line[:, 1])
    y, z = -tangent[1][nearest], tangent[0][nearest]
    foot = away[np.arange(len(path)), nearest]
    return (foot[:, 0] * y + foot[:, 1] * z) / np.hypot(y, z), y / np.hypot(y, z)


@pytest.mark.parametrize("width", [0.5e-3, 4e-3, 12e-3, 15.8e-3])
def test_a_ball_sinks_into_a_groove_as_far_as_its_rims_allow(width):
    felt = felt_groove(width)
    y = np.linspace(-0.49, 0.49, 15) * width
    steep = 0.5 * width / np.sqrt(R * R - 0.25 * width * width)  # change of the depth over that of the width
    np.testing.assert_allclose(dips(felt, y), rounded(width, y), atol=NEAR + steep * 15e-6)
    assert rounded(width, 0.0) == approx(rolls(width, 0.0), abs=1e-9)  # the middle is that of the ball
    outside = np.array([-0.019, -0.0185, 0.0185, 0.019])
    np.testing.assert_allclose(dips(felt, outside), 0.0, atol=1e-12)
    assert 2e-3 < felt.depth < 9e-3
    assert felt.mesh.closed


def test_a_gap_that_closes_converges_to_the_uncut_body():
    for gap in (2e-3, 0.2e-3, 0.05e-3):
        felt = felt_cut(gap)
        y = np.array([-3e-3, -1e-3, -0.4 * gap, 0.0, 0.4 * gap, 1e-3, 3e-3])
        over = np.abs(y) < 0.5 * gap
        ball = np.where(over, rolls(gap, np.where(over, y, 0)), 0.0)  # rims of narrow gaps stay
        np.testing.assert_allclose(dips(felt, y), rounded(gap, y) if gap > 0.3e-3 else ball, atol=NEAR)
        assert (dips(felt, y) < gap * gap / (8.0 * R) + NEAR).all()
        _, normal, _, _ = MeshClosestPoint(felt.mesh).find(np.stack([0 * y, y, 0 * y + TOP + 2e-3], axis=1))
        assert (np.abs(normal[:, 1]) <= 0.5 * gap / R + 0.02).all()


@pytest.mark.parametrize("gap", [0.5e-3, 2e-3])
def test_the_normal_turns_at_a_rim_by_what_the_patch_loses_of_its_support(gap):
    """A slide at 200 mm/s over 2 mm changed the force on the hand by 0.22 N in a millisecond, by a turn of 7 degrees
    within one triangle. The first parabola at the rim turned it by 1/(2 R) per length, and tilted it by 0.06. Over 0.5
    mm the bridge was 10 um too high, and its normal 0.0045 off within 0.2 mm: in a slide through a deep press the foot
    ran 20 % too fast and too slow by turns."""
    y = np.linspace(-2.0 * gap, 2.0 * gap, 161)
    high = TOP - dips(felt_cut(gap), y)
    _, normal, _, _ = MeshClosestPoint(felt_cut(gap).mesh).find(np.stack([np.full(len(y), 0.3e-3), y, high], axis=1))
    fine = np.linspace(-3.0 * gap, 3.0 * gap, 4001)
    tilt, right = np.arcsin(normal[:, 1]), np.interp(y, fine, np.gradient(rounded(gap, fine), fine))  # up to 0.009
    np.testing.assert_allclose(tilt, right, atol=5e-4)
    reach = 10
    slope = np.arctan((high[reach:] - high[:-reach]) / (y[reach] - y[0]))
    mean = 0.5 * (tilt[reach:] + tilt[:-reach])
    np.testing.assert_allclose(slope, -mean, atol=5e-3)  # so the depth changes as the normal says


@pytest.mark.parametrize(
    ("name", "offset"),
    [
        ("groove-8", 0.0),
        pytest.param("groove-8", 0.37e-3, marks=pytest.mark.long),
        pytest.param("groove-4", 0.0, marks=pytest.mark.long),
    ],
)
def test_no_point_of_a_rim_is_above_the_surface(name, offset):
    """Where the boolean left thin triangles at a rim, single vertices stayed on it, 0.2 mm above the rounded surface: a
    finger that slid over the rim lost half of its force in a millisecond."""
    width = 1e-3 * float(name.partition("-")[2])
    felt = felt_block(name, offset).mesh
    x, y = np.meshgrid(np.linspace(-0.3 * LONG, 0.3 * LONG, 121), np.linspace(-0.8, 0.8, 161) * width)
    low = 0.5 * HIGH - heights(felt, np.stack([x.ravel(), y.ravel()], axis=1))
    off = low - rounded(width, y.ravel())
    assert off.min() > -NEAR and off.max() < 25e-6


@pytest.mark.parametrize(
    ("name", "radius"),
    [("comb", 10e-3), ("comb", 6e-3), ("groove-8", R), pytest.param("groove-4", R, marks=pytest.mark.long)],
)
def test_each_vertex_between_rims_is_on_the_rounded_ball(name, radius):
    """With a patch of 10 mm, a ball that leant on two points of one rim put vertices of slots of 1.5 mm 19 um too high,
    and slopes of 0.05 between them: a finger at 148 mm/s lost 2 % of its force in a tick of any length. With one of
    6 mm thin triangles along the rims left vertices 41 um too high."""
    felt = close_surface(refine_mesh(GAPPED[name].make(COARSE), 1.6e-3, 50_000), radius).mesh
    middles, width = slots_of(name)
    half = 0.5 * width
    far = min([radius, *(0.5 * (b - a - width) for a, b in itertools.pairwise(sorted(middles)))])  # half way, or r
    x, y, z = felt.vertices.T
    middle = np.array(middles)[np.abs(y[:, None] - middles).argmin(axis=1)]
    off = np.abs(y - middle)
    over = (np.abs(x) < 0.3 * LONG) & (z > 0.25 * HIGH) & (np.abs(middle) < 9e-3) & (off < half + 0.5 * far)
    u = np.linspace(-1.0, 1.0, 200_001)
    part = np.cumsum((1.0 - u * u) ** 2.5)
    support = np.interp((off + half) / far, u, part) - np.interp((off - half) / far, u, part)
    support /= np.interp(half / far, u, part) - np.interp(-half / far, u, part)
    deep = radius - np.sqrt(radius**2 - half**2)
    error = z[over] - (0.5 * HIGH - deep * support[over])
    assert over.sum() > 1000
    assert np.abs(error).max() < 0.5e-6
    there = np.flatnonzero(over[felt.triangles].all(axis=1))
    mean = felt.normals[felt.triangles[there]].sum(axis=1)
    across = np.linalg.norm(np.cross(felt.face_vectors[there], mean), axis=1)
    sizes = np.linalg.norm(felt.face_vectors[there], axis=1) * np.linalg.norm(mean, axis=1)
    assert (across[sizes > 0.0] / sizes[sizes > 0.0]).max() < 0.05  # sine of the angle between a facet and its normals


@pytest.mark.parametrize("x", [-6e-3, 0.3e-3, 6e-3])
def test_a_jagged_rim_has_no_spikes(x):
    """Thin triangles of the boolean folded where their corners sank by different lengths, and stayed where they were,
    80 um above the rim; the slope then changes by 0.5 within 0.05 mm."""
    y = np.arange(-4e-3, 4e-3, 0.05e-3)
    slope = np.diff(heights(felt_block("fissure").mesh, np.stack([np.full(len(y), x), y], axis=1))) / 0.05e-3
    assert np.abs(np.diff(slope)).max() < 0.15
    assert np.abs(slope - np.interp(y[1:], [-4e-3, 4e-3], [0.1, -0.1])).max() < 0.25  # that of the ellipsoid


@pytest.mark.parametrize("high", [0.7e-3, -2.8e-3])
def test_a_slide_over_a_wide_groove_turns_as_the_rounded_surface_does(high):
    """Bones 0.7 mm above the top and 2.8 mm below it; steps of 200 mm/s at 1 kHz."""
    width, step = 8e-3, 0.2e-3
    y = np.arange(1.5e-3, 8e-3, step)
    right, tilt = slide(width, np.stack([y, np.full(len(y), high)], axis=1))
    for x in np.linspace(-0.2, 0.2, 9) * LONG:
        path = np.stack([np.full(len(y), x), y, np.full(len(y), 0.5 * HIGH + high)], axis=1)
        _, normal, _, gap = MeshClosestPoint(felt_block("groove-8").mesh).find(path)
        np.testing.assert_allclose(gap, right, atol=NEAR)
        np.testing.assert_allclose(normal[:, 1], tilt, atol=2e-3)
        assert 0.85 < np.abs(np.diff(normal[:, 1])).max() / np.abs(np.diff(tilt)).max() < 1.4  # facets


def test_where_every_point_can_be_touched_there_is_no_other_surface():
    ball = star(lambda u: np.full(len(u), 0.02), 2000)
    assert close_surface(ball, R) is None
    wide = groove(30e-3, depth=1e-3)
    felt = close_surface(wide, R)  # only the corners at the floor are rounded
    np.testing.assert_allclose(dips(felt, np.array([0.0, 5e-3])), 1e-3, atol=1e-9)


@pytest.mark.parametrize("surface", [name for name in SURFACES if name not in OPEN])
def test_a_finger_touches_every_point_of_the_built_in_surfaces(surface):
    mesh = surface_mesh(surface, 3000)
    assert not untouchable(mesh, MeshClosestPoint(mesh), 0.5 * WIDTH).any()


def test_the_walls_and_the_floor_of_a_groove_bear_no_load():
    body, felt = groove(4e-3), felt_groove(4e-3)
    middle = body.vertices[body.triangles].mean(axis=1)
    inside = (np.abs(middle[:, 1]) < 2e-3 + 1e-9) & (middle[:, 2] > TOP - 9e-3 - 1e-9) & (middle[:, 2] < TOP - 1e-9)
    inside &= np.abs(middle[:, 0]) < 0.006  # at its ends the ball touches the floor from the side
    on_top = (middle[:, 2] > TOP - 1e-9) & (np.abs(middle[:, 1]) > 2e-3)
    assert inside.any() and not felt.touchable[inside].any() and felt.touchable[on_top].all()
    assert felt.touchable[felt.origin].all()


def test_the_bridge_is_the_same_for_another_grid_and_a_turned_body():
    body, width = groove(4e-3), 4e-3
    y = np.linspace(-0.45, 0.45, 7) * width
    usual = dips(felt_groove(width), y)
    np.testing.assert_allclose(dips(close_surface(body, R, (0.31e-3, 0.57e-3, 0.13e-3)), y), usual, atol=NEAR)
    a, b = 0.6, -0.4
    turn = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]]) @ np.array(
        [[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]]
    )
    felt = close_surface(Mesh(body.vertices @ turn.T, body.triangles), R)
    back = felt._replace(mesh=Mesh(felt.mesh.vertices @ turn, felt.mesh.triangles))
    np.testing.assert_allclose(dips(back, y), usual, atol=NEAR)


def test_closing_twice_is_closing_once():
    once = felt_cut(2e-3)
    twice = close_surface(once.mesh, R)
    y = np.linspace(-2e-3, 2e-3, 9)
    after = dips(twice, y) if twice is not None else dips(once, y)
    np.testing.assert_allclose(after, dips(once, y), atol=NEAR)


def test_a_wider_ball_never_feels_a_lower_surface():
    y = np.linspace(-1.9e-3, 1.9e-3, 9)
    narrow, wide = dips(close_surface(groove(4e-3), 5e-3), y), dips(felt_groove(4e-3), y)
    assert (wide <= narrow + NEAR).all() and wide[4] < narrow[4] - 1e-4


def test_between_two_balls_the_finger_rests_on_both():
    ball = star(lambda u: np.full(len(u), 0.015), 4000)
    away = 0.0155
    pair = Mesh(
        np.concatenate([ball.vertices - (0, away, 0), ball.vertices + (0, away, 0)]),
        np.concatenate([ball.triangles, ball.triangles + len(ball.vertices)]).astype(np.int32),
    )
    felt = close_surface(pair, R)
    lowest = np.sqrt((0.015 + R) ** 2 - away**2) - R  # of a ball over both
    z = heights(felt.mesh, np.array([[0.2e-3, 0.0]]))
    assert z == approx(lowest, abs=0.1e-3)  # facets of the balls: up to 60 um


def test_a_valley_whose_triangles_all_reach_its_rims_is_bridged_by_a_cylinder():
    """As a file of CAD has it: a ball touches a part of each of its triangles."""
    length, floor = 0.04, 0.01
    body = prism([(-0.02, 0.0), (0.02, 0.0), (0.02, 0.03), (0.0, floor), (-0.02, 0.03)], length, longest=1.0)
    felt = close_surface(body, R)
    assert len(body.triangles) < 20 and felt.touchable.all()
    assert felt.depth == approx(R * (np.sqrt(2.0) - 1.0), rel=0.01)
    assert felt.place[1:] == approx([0.0, floor], abs=1e-9)
    assert felt.area == approx(0.5 * np.pi * R * length, rel=0.05)  # less the strips next to the rims


@pytest.mark.parametrize("count", [USUAL, COARSE])
def test_in_a_corner_the_normals_of_the_bridge_are_towards_the_axis_of_the_ball(count):
    """It is tangent to both faces, and a point of a face just beyond is nearly as near to it: as a rim, about which the
    ball turns, it turned the normals of all points within 8 mm by up to 0.31 rad."""
    given = mesh_of("l-shape", count)
    felt = close_surface(refine_mesh(given, 1.6e-3, 50_000), R, given=given).mesh
    x, y, z = felt.vertices.T
    inner = np.flatnonzero((np.abs(y) < 14e-3) & (np.minimum(x, z) > -1e-4) & (np.maximum(x, z) < 7e-3))
    assert len(inner) > 500
    toward = np.stack([R - x, np.zeros(len(x)), R - z], axis=1)[inner]
    toward /= np.linalg.norm(toward, axis=1)[:, None]
    angle = np.arccos(np.clip(np.einsum("ij,ij->i", toward, felt.normals[inner]), -1.0, 1.0))
    assert angle.max() < 0.05


def test_an_open_sheet_with_a_groove_is_refused():
    body = groove(4e-3)
    lower = body.vertices[body.triangles].mean(axis=1)[:, 2] > -TOP + 1e-9
    with pytest.raises(MeshError, match="open"):
        close_surface(Mesh(body.vertices, body.triangles[lower]), R)


def check_folds(mesh):
    """A finger sticks at a triangle of a bridge that does not face the centre of its ball, or at a surface inside."""
    _, volume = piece_volumes(mesh.vertices, mesh.triangles)
    assert edge_counts(mesh.triangles, len(mesh.vertices)) == (0, 0)
    assert len(volume) == 1, volume  # the bridge joins what is near
    facing = np.einsum("ij,ij->i", mesh.face_vectors, mesh.normals[mesh.triangles].sum(axis=1) / 3.0)
    size = np.linalg.norm(mesh.face_vectors, axis=1)
    folded = (facing < 0.0) & (size > 1e-12)
    assert 0.5 * size[folded].sum() < 0.1e-6, folded.sum()  # [m²] slivers at edges; it was 30e-6


MORE = ("cut-0.2", "cut-0.5", "cut-2", "groove-1", "groove-2", "groove-8")
"""Other widths of the gap of `cut-0.05` and of the grooves `groove-4` and `groove-16`."""


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.long] * (name in MORE))
        for name in GAPPED
        if name not in ("block", "union", "overlap")
    ],
)
def test_a_felt_surface_has_no_fold_and_no_inner_piece(name):
    felt = close_surface(GAPPED[name].make(COARSE), R)
    if felt is None:
        assert name in ("groove-16", "unfissured")
    else:
        check_folds(felt.mesh)


def test_triangles_that_share_no_vertex_are_bridged_as_those_that_do():
    body = groove(4e-3)
    corners = body.vertices[body.triangles].reshape(-1, 3)
    apart = Mesh(corners, np.arange(len(corners), dtype=np.int32).reshape(-1, 3))
    y = np.linspace(-1.5e-3, 1.5e-3, 7)
    assert apart.closed
    np.testing.assert_allclose(dips(close_surface(apart, R), y), dips(felt_groove(4e-3), y), atol=1e-9)


def test_bodies_that_overlap_feel_like_their_union():
    """With refined triangles, which folded at the seam."""
    felt = [
        close_surface(refine_mesh(GAPPED[name].make(COARSE), 2e-3, 50_000), R).mesh for name in ("overlap", "union")
    ]
    for one, other in (felt, felt[::-1]):
        check_folds(one)
        away = MeshClosestPoint(one).find_along(other.vertices)[3]
        assert np.abs(away).max() < 0.1e-3  # facets of the balls at their seam
