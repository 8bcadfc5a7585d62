"""Subdivision of coarse meshes."""

import numpy as np
import pytest

from palpate.nodes.base.surface import surface_mesh
from palpate.physics.geometry.mesh import Mesh, plane
from palpate.physics.geometry.mesh_closest import MeshClosestPoint
from palpate.physics.geometry.refined.contracted import contract_edges
from palpate.physics.geometry.refined.divided import ABOVE, CURVED, FINEST, TURN, refine_mesh
from palpate.physics.geometry.refined.edges import directions
from palpate.physics.geometry.topology import edge_counts
from palpate.studies.organs.zoo import specimen_of

trimesh = pytest.importorskip("trimesh")


def mesh_of(given):
    return Mesh(np.array(given.vertices, dtype=float), np.array(given.faces, dtype=np.int32))


def longest(mesh):
    ends, _ = mesh.edges
    return np.linalg.norm(mesh.vertices[ends[:, 0]] - mesh.vertices[ends[:, 1]], axis=1).max()


def test_a_refined_sphere_is_round_converges_and_stays_closed():
    off = []
    for level in (2, 3):
        fine = refine_mesh(mesh_of(trimesh.creation.icosphere(level, 0.04)), 0.0016, 200_000)
        assert edge_counts(fine.triangles, len(fine.vertices)) == (0, 0) and longest(fine) < 0.0017
        assert (np.einsum("ij,ij->i", fine.face_vectors, fine.vertices[fine.triangles[:, 0]]) > 0).all()
        off.append(np.abs(np.linalg.norm(fine.vertices, axis=1) - 0.04).max())
    middles = trimesh.creation.icosphere(2, 0.04).triangles_center
    assert off[0] < (0.04 - np.linalg.norm(middles, axis=1)).max() / 10 and off[1] < off[0] / 5


def test_the_bend_at_the_edges_of_a_coarse_sphere_falls():
    def bend(mesh):
        unit = mesh.face_vectors / np.linalg.norm(mesh.face_vectors, axis=1)[:, None]
        given = trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False)
        return np.arccos(np.clip(np.einsum("ij,ij->i", *unit[given.face_adjacency.T]), -1, 1)).max()

    coarse = mesh_of(trimesh.creation.icosphere(3, 0.04))
    assert bend(refine_mesh(coarse, 0.0016, 200_000)) < 0.4 * bend(coarse)


def test_a_box_and_a_sheet_keep_their_shape():
    for given in (mesh_of(trimesh.creation.box((0.1, 0.08, 0.05))), plane(0.1, 16)):
        fine = refine_mesh(given, 0.004, 200_000)
        assert longest(fine) <= 0.004 * (1 + 1e-6)
        assert edge_counts(fine.triangles, len(fine.vertices))[1] == 0
        assert fine.areas.sum() == pytest.approx(given.areas.sum(), rel=1e-12)
        assert np.ptp(fine.vertices, axis=0) == pytest.approx(np.ptp(given.vertices, axis=0), abs=1e-15)


def test_a_cylinder_keeps_its_rim_and_its_side_becomes_round():
    given = mesh_of(trimesh.creation.cylinder(0.03, 0.06, sections=24))
    fine = refine_mesh(given, 0.003, 200_000)
    radius = np.hypot(fine.vertices[:, 0], fine.vertices[:, 1])
    middle = np.abs(fine.vertices[:, 2]) < 0.02
    chord = 0.03 * np.cos(np.pi / 24)
    assert np.abs(fine.vertices[:, 2]).max() == pytest.approx(0.03, abs=1e-12)
    assert radius[~middle].min() < chord + 1e-9 or radius.max() < 0.0301
    assert edge_counts(fine.triangles, len(fine.vertices)) == (0, 0)


def test_a_mesh_with_short_edges_is_the_same_object_and_the_number_of_vertices_is_bounded():
    kidney = surface_mesh("kidney", 3000)
    assert longest(kidney) < FINEST * 0.04 and refine_mesh(kidney, 0.04, 200_000) is kidney
    assert len(refine_mesh(kidney, 1e-5, 20_000).vertices) < ABOVE * 20_000 + CURVED


def cone(facets):
    """A cone of 40 x 40 mm: a fan of long triangles on its side, and one below."""
    turn, i = np.linspace(0.0, 2 * np.pi, facets, endpoint=False), np.arange(facets)
    rim = 0.04 * np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], 1)
    j, tip, middle = np.roll(i, -1), np.full(facets, facets), np.full(facets, facets + 1)
    fans = np.concatenate([np.stack([i, j, tip], 1), np.stack([j, i, middle], 1)])
    return Mesh(np.concatenate([rim, [[0, 0, 0.04], [0, 0, 0]]]), fans.astype(np.int32))


def test_a_cone_keeps_its_tip_and_its_straight_sides():
    """The normal of the tip would bend the sides outwards by 3.7 mm."""
    fine = refine_mesh(cone(64), 0.0016, 200_000)
    x, y, z = fine.vertices.T
    side = z > 1e-9
    assert edge_counts(fine.triangles, len(fine.vertices)) == (0, 0) and z.max() == 0.04
    chord = 0.04 * (1.0 - np.cos(np.pi / 64))
    assert np.abs(np.hypot(x, y) - (0.04 - z))[side].max() < 3 * chord


def test_a_fan_of_thousands_of_long_triangles_does_not_explode():
    """Halved edges of 57 mm, 0.1 mm apart, were 486 000 vertices."""
    assert len(refine_mesh(cone(2000), 0.0016, 200_000).vertices) < ABOVE * 200_000


def test_edges_are_shorter_where_the_surface_is_bent_but_noise_of_normals_adds_a_limited_number():
    def turn(mesh):
        ends, _ = mesh.edges
        return np.arccos(np.clip(np.einsum("ij,ij->i", *mesh.normals[ends.T]), -1, 1)).max()

    for radius, count in ((0.01, 20_000), (0.02, 25_000)):
        fine = refine_mesh(mesh_of(trimesh.creation.icosphere(4, radius)), 0.0016, 200_000)
        assert turn(fine) < 1.1 * TURN and len(fine.vertices) < count
        assert np.abs(np.linalg.norm(fine.vertices, axis=1) - radius).max() < TURN**2 / 8 * radius  # sag of an edge
    ball = mesh_of(trimesh.creation.icosphere(6, 0.04))
    steps = Mesh(np.round(ball.vertices / 1e-3) * 1e-3 + 1e-4 * ball.vertices, ball.triangles)  # as of a segmentation
    assert len(refine_mesh(steps, 0.0016, 200_000).vertices) < len(ball.vertices) + CURVED < 4 * len(ball.vertices)


def split(mesh, apart, every=40):
    """The mesh with a vertex at the distance `apart` from an end of every few edges, and thin triangles around it."""
    points, triangles = list(mesh.vertices), mesh.triangles.tolist()
    across = {(a, b): n for n, t in enumerate(triangles) for a, b in zip(t, t[1:] + t[:1], strict=True)}
    touched = set()
    for (a, b), n in list(across.items())[::every]:
        other = across[b, a]
        if {n, other} & touched:
            continue
        touched |= {n, other}
        c, d = (next(v for v in triangles[t] if v not in (a, b)) for t in (n, other))
        along = mesh.vertices[b] - mesh.vertices[a]
        points.append(mesh.vertices[a] + along * (apart / np.linalg.norm(along)))
        m = len(points) - 1
        triangles[n], triangles[other] = [a, m, c], [b, m, d]
        triangles += [[m, b, c], [m, a, d]]
    return Mesh(np.array(points), np.array(triangles, np.int32))


@pytest.mark.parametrize("apart", [1e-7, 1e-6, 1e-5, 1e-4, 3e-4])
def test_thin_triangles_are_not_folded_out_of_the_refined_surface(apart):
    """Their long sides bent apart: normals had errors of 87 degrees, and vertices of 1.8 mm."""
    given = split(mesh_of(trimesh.creation.icosphere(3, 0.04)), apart)
    fine = refine_mesh(given, 0.0016, 200_000)
    out = fine.vertices / np.linalg.norm(fine.vertices, axis=1)[:, None]
    assert np.arccos(np.clip(np.einsum("ij,ij->i", fine.normals, out), -1, 1)).max() < np.deg2rad(1.0)
    assert np.abs(np.linalg.norm(fine.vertices, axis=1) - 0.04).max() < 2e-5
    assert edge_counts(fine.triangles, len(fine.vertices)) == (0, 0)


def test_a_mesh_is_not_contracted_to_nothing():
    needle = Mesh(np.array([[0, 0, 0], [1e-5, 0, 0], [0, 1e-5, 0], [0, 0, 3e-4]]),
                  np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]], np.int32))  # fmt: skip
    assert len(contract_edges(needle, 3.2e-4)[0].triangles) > 0


def test_strips_and_dense_parts_are_not_contracted():
    strips = mesh_of(trimesh.creation.cylinder(0.003, 0.06, sections=128))
    dense = mesh_of(trimesh.creation.icosphere(5, 0.003))
    for given in (strips, dense):
        assert contract_edges(given, 3.2e-4)[0] is given


@pytest.mark.parametrize("turn", [0.0, 0.4])
@pytest.mark.parametrize("voxel, rms, most", [(1.0, 0.1, 1.0), (2.0, 0.3, 3.0)])
def test_a_surface_from_an_image_is_smooth(turn, voxel, rms, most):
    """An ellipsoid: marching cubes give triangles without area, of a corner and of three points on a line, and vertices
    that scatter. Normals of 5 % of the vertices were up to 180 degrees off, and then some 26 degrees."""
    skimage = pytest.importorskip("skimage")
    turned = np.array([[np.cos(turn), -np.sin(turn), 0.0], [np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]])
    axes, grid = np.array([45.0, 30.0, 20.0]), np.stack(np.meshgrid(*[np.arange(-50.0, 50.1, voxel)] * 3), -1)
    level = np.linalg.norm(np.swapaxes(grid, 0, 1) @ turned / axes, axis=-1)
    points, triangles, _, _ = skimage.measure.marching_cubes(level, 1.0, spacing=(voxel, voxel, voxel))
    given = Mesh(1e-3 * (points.astype(float) - 50.0), triangles.astype(np.int32))
    fine = refine_mesh(given, 0.0016, 50_000)

    def outwards(p):
        out = (p @ turned / axes**2) @ turned.T
        return out / np.linalg.norm(out, axis=1)[:, None]

    error = np.degrees(np.arccos(np.clip(np.einsum("ij,ij->i", fine.normals, outwards(fine.vertices)), -1, 1)))
    assert np.sqrt((error**2).mean()) < rms and error.max() < most
    flat = directions(fine.vertices, fine.triangles)
    assert np.einsum("ij,ij->i", flat, outwards(fine.vertices[fine.triangles].mean(axis=1))).min() > 0.75
    assert edge_counts(fine.triangles, len(fine.vertices)) == (0, 0)


@pytest.mark.parametrize(("name", "count"), [("union", 600), ("union", 5000), ("vessel", 600), ("bumpy", 600)])
def test_triangles_at_a_straight_edge_do_not_fold(name, count):
    """A long edge that stays straight among short ones: each round halved the height of the triangles between them."""
    given = specimen_of(name).make(count)
    fine = refine_mesh(given, 0.0016, 200_000)
    middles = fine.vertices[fine.triangles].mean(axis=1)
    nearest = MeshClosestPoint(given).find_along(middles)[2]
    faces = directions(given.vertices, given.triangles)[nearest]
    assert np.einsum("ij,ij->i", faces, directions(fine.vertices, fine.triangles)).min() > 0.7
    assert edge_counts(fine.triangles, len(fine.vertices)) == (0, 0)
