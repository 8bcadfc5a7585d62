"""Closest points of triangle meshes compared with brute force and closed forms, also on hard meshes."""

import numpy as np
import pytest
from formulas import foot_row

from palpate.physics.bodies.stretch import neighbours
from palpate.physics.contact.spread import TABLES, spreader
from palpate.physics.geometry.felt.bearing import Bearing
from palpate.physics.geometry.kidney import kidney
from palpate.physics.geometry.mesh import Mesh, once_per_mesh, plane
from palpate.physics.geometry.mesh_closest import MeshClosestPoint, track_mesh
from palpate.physics.geometry.nurbs_fit import sphere
from palpate.physics.geometry.search.corners import weld
from palpate.physics.geometry.tessellate import tessellate
from palpate.physics.geometry.topology import edge_counts, outward

CUBE = Mesh(
    np.array([[x, y, z] for x in (-1.0, 1) for y in (-1.0, 1) for z in (-1.0, 1)]) * 0.02,
    np.array(
        [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4]]
        + [[1, 5, 7], [1, 7, 3]],
        dtype=np.int32,
    ),
)


def cube_distance(points, half=0.02):
    q = np.abs(points) - half
    return np.linalg.norm(np.maximum(q, 0), axis=1) + np.minimum(q.max(axis=1), 0)


def brute(mesh, points):
    """Distance to the nearest of all triangles, from the plane and the three edges of each."""
    best = np.full(len(points), np.inf)
    for a, b, c in mesh.vertices[mesh.triangles]:
        for p, q in ((a, b), (b, c), (c, a)):
            square = (q - p) @ (q - p)
            t = np.clip((points - p) @ (q - p) / square, 0, 1) if square > 0 else np.zeros(len(points))
            best = np.minimum(best, np.linalg.norm(points - p - t[:, None] * (q - p), axis=1))
        n = np.cross(b - a, c - a)
        if n @ n > 0:
            sides = [(points - p) @ np.cross(n, q - p) >= 0 for p, q in ((a, b), (b, c), (c, a))]
            height = np.abs((points - a) @ n) / np.linalg.norm(n)
            best = np.where(np.all(sides, axis=0), np.minimum(best, height), best)
    return best


def follow(mesh, path, hysteresis=1e-4):
    closest = MeshClosestPoint(mesh)
    *state, foot = closest.scratch()
    results = []
    for p in np.asarray(path, dtype=float):
        track_mesh(*closest.tables.arrays, *p, hysteresis, *state, foot)
        results.append(foot_row(foot))
    return np.array(results)


def excess(distance, path):
    return (np.abs(np.diff(distance)) - np.linalg.norm(np.diff(path, axis=0), axis=1)).max()


def wander(rng, size, steps):
    t = np.linspace(0, 1, steps)[:, None]
    a, b = rng.normal(size=(2, 5, 3)) * size / 2
    return np.sin(2 * np.pi * t * np.arange(1, 6)) @ a + np.cos(2 * np.pi * t * np.arange(1, 6)) @ b


def test_the_search_agrees_with_brute_force():
    rng = np.random.default_rng(1)
    soup = Mesh(rng.normal(size=(60, 3)), rng.integers(0, 60, (90, 3)).astype(np.int32))
    points = rng.normal(size=(400, 3)) * 2
    foot = MeshClosestPoint(soup).find(points)[0]
    np.testing.assert_allclose(np.linalg.norm(points - foot, axis=1), brute(soup, points), atol=1e-12)
    closed = tessellate(kidney(), 300)
    points = rng.uniform(-0.08, 0.08, (400, 3))
    np.testing.assert_allclose(np.abs(MeshClosestPoint(closed).find(points)[3]), brute(closed, points), atol=1e-14)


def test_the_distance_from_a_cube_is_exact_and_signed_at_faces_edges_and_corners():
    points = np.random.default_rng(2).uniform(-0.05, 0.05, (5000, 3))
    np.testing.assert_allclose(MeshClosestPoint(CUBE).find(points)[3], cube_distance(points), atol=1e-15)


def test_the_sign_is_right_next_to_the_tip_of_a_needle():
    # The nearest face alone would give the wrong sign here: the case of Baerentzen & Aanaes.
    tip = Mesh(
        np.array([[0, 0, 0], [1, -0.1, -0.1], [1, 0.1, -0.1], [1, 0, 0.2]]) * 0.02,
        np.array([[0, 2, 1], [0, 3, 2], [0, 1, 3], [1, 2, 3]], dtype=np.int32),
    )
    closest = MeshClosestPoint(tip)
    points = np.random.default_rng(3).uniform((-0.002, -0.003, -0.003), (0.01, 0.003, 0.003), (3000, 3))
    inside = np.ones(3000, dtype=bool)
    for a, b, c in tip.vertices[tip.triangles]:
        inside &= (points - a) @ np.cross(b - a, c - a) < 0
    assert inside.sum() > 50
    np.testing.assert_array_equal(closest.find(points)[3] < 0, inside)


def test_a_fine_sphere_has_the_distance_of_the_sphere():
    rng = np.random.default_rng(4)
    points = rng.normal(size=(1000, 3)) * 0.02
    exact = np.linalg.norm(points, axis=1) - 0.02
    errors = [np.abs(MeshClosestPoint(tessellate(sphere(0.02), n)).find(points)[3] - exact).max() for n in (500, 8000)]
    assert errors[1] < 1e-5
    assert 10 < errors[0] / errors[1] < 24  # second order


@pytest.mark.parametrize("mesh", [CUBE, tessellate(kidney(), 1500)], ids=["cube", "kidney"])
@pytest.mark.parametrize("seed", range(2))
def test_the_distance_never_changes_faster_than_the_point_moves(mesh, seed):
    path = wander(np.random.default_rng(seed), 0.03, 4000)
    feet = follow(mesh, path)
    assert excess(feet[:, 8], path) <= 1e-12
    np.testing.assert_allclose(feet[:, 8], MeshClosestPoint(mesh).find(path)[3], atol=1e-13)


def test_the_followed_foot_is_at_most_the_hysteresis_farther_than_the_nearest():
    path = wander(np.random.default_rng(5), 0.02, 4000)
    for hysteresis in (0.0, 1e-4, 1e-3):
        feet = follow(tessellate(kidney(), 1500), path, hysteresis)
        own = np.linalg.norm(path - feet[:, :3], axis=1)
        assert (own - np.abs(feet[:, 8])).max() <= hysteresis + 1e-12


def test_tremor_between_two_faces_keeps_the_foot():
    path = np.array([0, 0, 0.005]) + np.array([1e-5, 0, 0]) * (-1.0) ** np.arange(40)[:, None]
    feet = follow(Mesh(CUBE.vertices * (0.25, 1, 1), CUBE.triangles), path)
    assert np.ptp(feet[:, 0]) == 0.0
    np.testing.assert_allclose(feet[:, 8], -0.005 + 1e-5, atol=1e-15)


def test_the_normal_rotates_smoothly_along_the_surface():
    mesh = tessellate(kidney(), 3000)
    t = np.linspace(0, 2 * np.pi, 4000)
    path = np.stack([0.04 * np.cos(t), 0.02 * np.sin(t), np.full(4000, 0.025)], axis=1)
    normal = follow(mesh, path)[:, 3:6]
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1, rtol=1e-12)
    assert np.linalg.norm(np.diff(normal, axis=0), axis=1).max() < 0.02


@pytest.mark.parametrize("spoil", ["duplicates", "slivers", "points", "unreferenced", "split vertices"])
def test_bad_triangles_change_neither_distance_nor_sign(spoil):
    mesh = tessellate(kidney(), 400)
    v, t = mesh.vertices, mesh.triangles
    if spoil == "duplicates":
        t = np.concatenate([t, t[::3], t[::5][:, [1, 2, 0]]])
    elif spoil == "slivers":
        # A vertex on an edge: the triangle on one side is split, and a sliver without area closes the gap.
        a, b, c = t[7]
        v = np.concatenate([v, [(v[a] + v[b]) / 2]])
        t = np.concatenate([t[:7], t[8:], [[a, len(v) - 1, c], [len(v) - 1, b, c], [a, b, len(v) - 1]]])
    elif spoil == "points":
        t = np.concatenate([[[3, 3, 3], t[9][[0, 0, 1]]], t, [t[5][[1, 0, 1]], t[7][[2, 2, 2]]]])
    elif spoil == "unreferenced":
        v = np.concatenate([v, [[0.0, 0, 0.03], [9, 9, 9]]])
    else:
        v, t = v[t].reshape(-1, 3), np.arange(t.size).reshape(-1, 3)
    points = np.random.default_rng(6).uniform(-0.06, 0.06, (3000, 3))
    foot, normal, _, gap = MeshClosestPoint(Mesh(v, t.astype(np.int32))).find(points)
    np.testing.assert_allclose(gap, MeshClosestPoint(mesh).find(points)[3], atol=1e-12)
    assert np.isfinite(foot).all()
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1, rtol=1e-12)


def test_a_mesh_of_degenerate_triangles_only_is_a_set_of_segments():
    v = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, 1e-15, 0], [0, 0, 0]])
    mesh = Mesh(v, np.array([[0, 1, 2], [0, 0, 0], [0, 3, 0]], dtype=np.int32))
    foot, normal, _, gap = MeshClosestPoint(mesh).find(np.array([[0.3, 0.4, 0], [-3, 4, 0], [0.7, 0, 0]]))
    np.testing.assert_allclose(gap, [0.4, 5, 0], atol=1e-12)
    np.testing.assert_allclose(foot, [[0.3, 0, 0], [0, 0, 0], [0.7, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1)


def test_an_open_sheet_continues_flat_beyond_its_border():
    sheet = MeshClosestPoint(plane(0.1, 100))
    points = np.random.default_rng(7).uniform(-0.1, 0.1, (500, 3))
    foot, normal, _, gap = sheet.find(points)
    np.testing.assert_allclose(gap, points[:, 2], atol=1e-15)
    np.testing.assert_allclose(foot, np.column_stack([np.clip(points[:, :2], -0.05, 0.05), 0 * gap]), atol=1e-15)
    np.testing.assert_allclose(normal, np.tile([0, 0, 1], (500, 1)), atol=1e-12)


def test_the_weights_give_the_foot_point():
    mesh = tessellate(kidney(), 500)
    feet = follow(mesh, wander(np.random.default_rng(8), 0.04, 200), 0.0)
    corners = mesh.vertices[mesh.triangles[feet[:, 9].astype(int)]]
    v, w = feet[:, 6:7], feet[:, 7:8]
    assert (v >= 0).all() and (w >= 0).all() and (v + w <= 1 + 1e-12).all()
    foot = (1 - v - w) * corners[:, 0] + v * corners[:, 1] + w * corners[:, 2]
    np.testing.assert_allclose(foot, feet[:, :3], atol=1e-15)


def test_any_distance_gives_finite_answers():
    points = np.array([[1e300, 0, 0], [-1e8, 1e8, 1e-300], [0, 0, 0]])
    for array in MeshClosestPoint(tessellate(kidney(), 100)).find(points):
        assert np.isfinite(array).all()


@pytest.mark.parametrize(
    ("vertices", "triangles", "text"),
    [
        (np.zeros((3, 3)), np.zeros((0, 3)), "no triangles"),
        (np.zeros((3, 3)), [[0, 1, 5]], "vertex 5"),
        (np.full((3, 3), np.nan), [[0, 1, 2]], "finite"),
    ],
)
def test_an_invalid_mesh_is_an_error(vertices, triangles, text):
    with pytest.raises(ValueError, match=text):
        MeshClosestPoint(Mesh(vertices, np.asarray(triangles, dtype=np.int32))).find(np.zeros(3))


def test_vertex_normals_of_a_sphere_are_radial_and_areas_sum_to_its_area():
    mesh = tessellate(sphere(0.02), 8000)
    np.testing.assert_allclose(mesh.normals, mesh.vertices / 0.02, atol=2e-3)
    assert mesh.areas.sum() == pytest.approx(4 * np.pi * 0.02**2, rel=1e-3)


def test_equal_vertices_are_welded_and_others_are_not():
    rng = np.random.default_rng(9)
    base = rng.normal(size=(200, 3))
    pick = rng.integers(0, 200, 1000)
    representative = weld(base[pick])
    np.testing.assert_array_equal(base[pick][representative], base[pick])
    assert len(np.unique(representative)) == len(np.unique(pick))


def test_triangles_are_oriented_outwards_and_a_cavity_stays_a_cavity():
    rng = np.random.default_rng(10)
    for shuffled in (
        CUBE.triangles[:, ::-1],
        np.where(rng.random(12)[:, None] < 0.5, CUBE.triangles, CUBE.triangles[:, ::-1]),
    ):
        mesh = Mesh(CUBE.vertices, outward(CUBE.vertices, shuffled))
        outside = np.einsum("ij,ij->i", mesh.face_vectors, mesh.vertices[mesh.triangles].mean(axis=1))
        assert (outside > 0).all()
    hollow = np.concatenate([CUBE.vertices, CUBE.vertices / 2])
    shell = np.concatenate([CUBE.triangles, CUBE.triangles[:, ::-1] + 8])
    np.testing.assert_array_equal(outward(hollow, shell[:, ::-1]), shell)


def test_an_open_sheet_is_oriented_like_most_of_its_triangles():
    sheet = plane(0.1, 400)
    mixed = sheet.triangles.copy()
    mixed[::3] = mixed[::3, ::-1]
    assert (Mesh(sheet.vertices, outward(sheet.vertices, mixed)).face_vectors[:, 2] > 0).all()
    assert (Mesh(sheet.vertices, outward(sheet.vertices, mixed[:, ::-1])).face_vectors[:, 2] < 0).all()


def test_borders_and_shared_edges_are_counted():
    assert edge_counts(CUBE.triangles, 8) == (0, 0)
    assert edge_counts(CUBE.triangles[1:], 8) == (3, 0)
    fin = np.concatenate([CUBE.triangles, [[0, 1, 8]]])
    assert edge_counts(fin, 9) == (2, 1)


def test_tables_of_a_mesh_are_computed_once_for_each_argument():
    calls = []

    @once_per_mesh
    def table(mesh, size, shift=0.0):
        calls.append((size, shift))
        return size * len(mesh.vertices) + shift

    one, other = plane(0.1, 100), plane(0.1, 400)
    assert [table(one, 2), table(one, 2), table(one, 3), table(one, 2, shift=1.0), table(other, 2)] == [
        200, 200, 300, 201.0, 800
    ]  # fmt: skip
    assert calls == [(2, 0.0), (3, 0.0), (2, 1.0), (2, 0.0)]
    assert neighbours(one) is neighbours(one) and neighbours(one) is not neighbours(other)


def test_a_spreader_that_starts_again_has_its_tables_and_separate_results():
    mesh = plane(0.1, 400)
    first, again, wider = spreader(mesh, 8e-3), spreader(mesh, 8e-3), spreader(mesh, 9e-3)
    for name in TABLES:
        assert getattr(first, name) is getattr(again, name) or name in ("radius", "kind")
    assert first.near is not wider.near and first.forces is not again.forces
    part = Bearing(mesh.areas * np.linspace(0.0, 1.0, len(mesh.vertices)), -mesh.normals)
    covered = spreader(mesh, 8e-3, bearing=part)
    assert covered.near["area"].sum() == pytest.approx(0.5 * first.near["area"].sum(), rel=0.1)
    assert (covered.near["normal"] == -first.near["normal"]).all()


def test_neighbours_are_the_vertices_of_common_triangles():
    edges = neighbours(CUBE)
    for vertex in range(len(CUBE.vertices)):
        with_it = CUBE.triangles[(CUBE.triangles == vertex).any(axis=1)]
        mine = edges.others[edges.first[vertex] : edges.first[vertex + 1]]
        assert mine.tolist() == sorted(set(with_it.ravel().tolist()) - {vertex})
        lengths = np.linalg.norm(CUBE.vertices[mine] - CUBE.vertices[vertex], axis=1)
        assert edges.spans[edges.first[vertex] : edges.first[vertex + 1]] == pytest.approx(lengths)
