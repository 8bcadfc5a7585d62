"""Hard cases of surfaces: thin sheets, folds, corners, poles and worthless triangles."""

import itertools

import numpy as np
from formulas import foot_row
from hypothesis import given, settings
from hypothesis import strategies as st
from pytest import approx
from scipy.spatial.transform import Rotation

from palpate.physics.geometry.closest import ClosestPoint, track
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.mesh_closest import MeshClosestPoint, track_mesh
from palpate.physics.geometry.nurbs_fit import sphere
from palpate.physics.geometry.proxy import FADES, follow, follow_mesh, memory

CORNERS = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))
FACES = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6],
                  [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]], np.int32)  # fmt: skip


def slab(width, thickness):
    """Its top lies at z = 0."""
    return Mesh(CORNERS * (width, width, thickness) - (0, 0, thickness / 2), FACES)


def nearest(mesh, path, proxy):
    """Gap [m] (k), normals and foot points (k,3) along a path: by the proxy, or by the nearest point alone."""
    closest, rows = MeshClosestPoint(mesh), []
    (*state, nearest), kept = closest.scratch(), memory()
    for p in path:
        if proxy:
            follow_mesh(*closest.tables.arrays, tuple(p.tolist()), 1e-4, *state, nearest, kept, 1e-3)
        else:
            track_mesh(*closest.tables.arrays, *p.tolist(), 1e-4, *state, nearest)
        rows.append(foot_row(nearest))
    rows = np.array(rows)
    return rows[:, 8], rows[:, 3:6], rows[:, :3]


def press(mesh, proxy, mass=0.1, push=3.0, stiffness=300.0, dt=1e-3, speed=0.0):
    """Height [m] of a ball under a push onto a slab that answers in proportion to the depth."""
    closest, (*state, nearest) = MeshClosestPoint(mesh), MeshClosestPoint(mesh).scratch()
    kept, z, v, line = memory(), 1e-3, -speed, []
    for _ in range(400):
        if proxy:
            follow_mesh(*closest.tables.arrays, (1e-4, 2e-4, z), 1e-4, *state, nearest, kept, 1e-3)
        else:
            track_mesh(*closest.tables.arrays, 1e-4, 2e-4, z, 1e-4, *state, nearest)
        force = stiffness * max(-nearest.distance, 0.0) * nearest.normal[2]
        v += dt * (force - push - 5.0 * v) / mass
        z += dt * v
        line.append(z)
    return np.array(line)


def test_a_penalty_ball_tunnels_through_a_sheet_and_the_proxy_does_not():
    """A push of 3 N against 300 N/m goes 10 mm deep; the sheet is 6 mm thick. Past its middle the nearest point is on
    the back: the force turns over and pushes the ball out there. The proxy keeps to the side that the ball met, and the
    ball rests where force and push balance."""
    mesh = slab(0.1, 6e-3)
    assert press(mesh, proxy=False)[-1] < -0.05
    held = press(mesh, proxy=True)
    assert held[-1] == approx(-10e-3, rel=0.02) and held.min() > -20e-3


@settings(deadline=None, max_examples=40)
@given(st.floats(1e-3, 20e-3), st.floats(0.05, 5.0), st.integers(0, 2**31))
def test_at_any_speed_a_sheet_has_one_side(thickness, speed, seed):
    """Sheets of 1 to 20 mm met in steps of up to 5 mm, turned anyhow: until the ball is far through, the normal is
    that of the side it met, and the depth is the way it has gone, to within the hysteresis of 0.1 mm."""
    turned = Rotation.random(random_state=seed)
    mesh = slab(0.2, thickness)
    mesh = Mesh(turned.apply(mesh.vertices), mesh.triangles)
    z = np.arange(2e-3, -0.9 * thickness, -speed * 1e-3)
    path = turned.apply(np.column_stack([np.full(len(z), 1e-4), np.full(len(z), 2e-4), z]))
    gap, normal, _ = nearest(mesh, path, proxy=True)
    assert gap == approx(z, abs=1e-4 + 1e-9)
    assert (normal @ turned.apply((0.0, 0.0, 1.0)) > 0.999).all()


def fold(gap):
    """Two flaps of a sheet that lie over one another, `gap` apart, joined at one edge."""
    x = np.array([0.0, 0.04])
    lower = np.array([[a, b, 0.0] for a in x for b in (-0.02, 0.02)])
    upper = lower * (1, 1, 0) + (0, 0, gap)
    points = np.concatenate([lower, upper])
    strip = [[0, 2, 3], [0, 3, 1], [4, 7, 6], [4, 5, 7], [0, 1, 5], [0, 5, 4]]
    return Mesh(points, np.array(strip, np.int32))


def test_the_nearest_point_jumps_across_a_fold_and_the_foot_that_is_followed_does_not():
    """A finger in the cleft between two flaps, moved past the middle and back by less than an encoder count. The
    nearest point changes sides each time, and with it the direction of the force; the tracked foot has a hysteresis."""
    mesh = fold(6e-3)
    z = 3e-3 + 3e-5 * (np.arange(60) % 2 * 2 - 1)
    path = np.column_stack([np.full(60, 0.03), np.zeros(60), z])
    every = MeshClosestPoint(mesh).find(path)[0]
    assert (np.abs(np.diff(every[:, 2])) > 5e-3).all()
    gap, normal, foot = nearest(mesh, path, proxy=False)
    assert (np.abs(np.diff(foot[:, 2])) < 1e-9).all() and np.abs(np.diff(normal, axis=0)).max() < 1e-9
    assert np.abs(np.diff(gap)).max() <= 6e-5 * (1 + 1e-9)


@settings(deadline=None, max_examples=40)
@given(st.lists(st.tuples(*[st.floats(-0.03, 0.03)] * 3), min_size=2, max_size=5), st.integers(0, 2**31))
def test_over_edges_and_corners_the_gap_changes_no_faster_than_the_finger_moves(points, seed):
    """Any path around, into and through a box with sharp edges, in the frame of the box and in a rotated one. Only a
    finger beyond the box that rests is let go, at `FADES`."""
    points = np.array(points)
    path = np.concatenate([np.linspace(a, b, 40) for a, b in itertools.pairwise(points)])
    mesh = slab(0.03, 0.02)
    gap, normal, foot = nearest(mesh, path, proxy=True)
    way = np.linalg.norm(np.diff(path, axis=0), axis=1)
    assert np.isfinite(foot).all() and np.linalg.norm(normal, axis=1) == approx(np.ones(len(path)))
    change = np.diff(gap)
    assert (change >= -way - 1e-9).all() and (change <= np.maximum(way, FADES * 1e-3) + 1e-9).all()
    # A turned scene can take the other one of two equally near points, so only the distance is compared.
    turned, shift = Rotation.random(random_state=seed), np.array([0.3, -0.2, 0.1])
    moved = Mesh(turned.apply(mesh.vertices) + shift, mesh.triangles)
    outside = MeshClosestPoint(mesh).find(path)[3]
    assert MeshClosestPoint(moved).find(turned.apply(path) + shift)[3] == approx(outside, abs=1e-12)


@settings(deadline=None, max_examples=10)
@given(st.floats(-np.pi, np.pi), st.floats(-3e-3, 10e-3))
def test_across_the_pole_and_the_seam_of_a_patch_the_foot_is_the_exact_one(azimuth, height):
    """A path over the pole of a sphere, where the patch's parameters are singular, and over its seam."""
    surface = sphere(0.02)
    closest = ClosestPoint(surface)
    scratch = closest.scratch()
    for lat in np.linspace(-0.3, 0.3, 31):
        up = np.array([np.sin(lat) * np.cos(azimuth), np.sin(lat) * np.sin(azimuth), np.cos(lat)])
        track(*closest.tables, *((0.02 + height) * up).tolist(), 1e-4, *scratch)
        nearest = scratch[3]
        assert nearest.distance == approx(height, abs=1e-9) and nearest.normal == approx(up, abs=1e-6)


def test_across_the_pole_the_proxy_follows_a_finger_inside():
    surface = sphere(0.02)
    closest, kept = ClosestPoint(surface), memory()
    scratch = closest.scratch()
    for lat in np.linspace(-0.5, 0.5, 101):
        depth = 2e-3 if lat > -0.49 else -1e-3
        p = (0.02 - depth) * np.array([np.sin(lat), 0.0, np.cos(lat)])
        follow(*closest.tables, tuple(p.tolist()), 1e-4, *scratch, kept, 1e-3)
        assert scratch[3].distance == approx(-depth, abs=2e-9)


@settings(deadline=None, max_examples=40)
@given(st.lists(st.floats(-15, 0), min_size=1, max_size=8), st.integers(0, 2**31))
def test_degenerate_triangles_change_nothing(sizes, seed):
    """Slivers, needles and triangles of one point on the faces of a box. The usual cross product gives the normal 0/0;
    here the distance is that of the box without these triangles, and each normal has length 1."""
    rng, mesh = np.random.default_rng(seed), slab(0.03, 0.02)
    points, extra = [*mesh.vertices], []
    for size in sizes:
        face = mesh.vertices[mesh.triangles[rng.integers(12)]]
        a = rng.dirichlet((1, 1, 1)) @ face
        b = a + 10.0**size * (face[1] - a)
        extra.append([len(points), len(points) + 1, len(points) + rng.integers(2)])
        points += [a, b]
    spoilt = Mesh(np.array(points), np.concatenate([mesh.triangles, np.array(extra, np.int32)]))
    edges = spoilt.vertices[spoilt.triangles[-1]]
    usual = np.cross(edges[1] - edges[0], edges[2] - edges[0])
    assert not np.linalg.norm(usual) > 1e-12
    path = rng.uniform(-0.02, 0.02, (50, 3)) * 1.5 + (0, 0, 0.02)
    foot, normal, _, gap = MeshClosestPoint(spoilt).find(path)
    clean = MeshClosestPoint(mesh).find(path)[3]
    assert np.isfinite(foot).all() and np.linalg.norm(normal, axis=1) == approx(np.ones(50))
    assert np.abs(gap) == approx(np.abs(clean), abs=1e-9)
