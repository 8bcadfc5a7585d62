"""Rims that bend by less than 40 degrees: those of cuts are found, on smooth organs none."""

import numpy as np
import pytest

from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.mesh_closest import MeshClosestPoint
from palpate.physics.geometry.refined.divided import refine_mesh
from palpate.physics.geometry.refined.rims import CHAIN, find_rims
from palpate.studies.organs.zoo import specimen_of

trimesh = pytest.importorskip("trimesh")
skimage = pytest.importorskip("skimage")
pytest.importorskip("manifold3d")

HALF = np.array([45e-3, 35e-3, 25e-3])
MM = 1e-3


def mesh_of(given):
    return Mesh(np.array(given.vertices, dtype=float), np.array(given.faces, dtype=np.int32))


def even(level):
    ball = trimesh.creation.icosphere(level, 1.0)
    return Mesh(ball.vertices * HALF, ball.faces.astype(np.int32))


def rotation(seed):
    return trimesh.transformations.random_rotation_matrix(np.random.default_rng(seed).uniform(size=3))[:3, :3]


def marched(voxel, mask=False):
    """A turned ellipsoid by marching cubes, of distances or of a mask."""
    axis = np.arange(-50 * MM, 50 * MM, voxel)
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1) @ rotation(1)
    level = np.linalg.norm(grid / HALF, axis=-1)
    level = (level > 1.0).astype(float) if mask else level
    points, triangles, *_ = skimage.measure.marching_cubes(level, 0.5 if mask else 1.0, allow_degenerate=False)
    found = Mesh(voxel * points.astype(float) - 50 * MM, triangles.astype(np.int32))
    inwards = np.einsum("ij,ij->", found.face_vectors, found.vertices[found.triangles[:, 0]]) < 0
    return Mesh(found.vertices, np.ascontiguousarray(found.triangles[:, ::-1])) if inwards else found


def cut(mesh, seed, bend):
    """The larger part of a mesh cut by a random plane that meets it at about this angle [rad]; normal, offset."""
    from palpate.physics.geometry.felt.solid import mesh_of_solid, solid_of

    normal = np.random.default_rng(seed).normal(size=3)
    normal /= np.linalg.norm(normal)
    offset = np.cos(bend) * float((mesh.vertices @ normal).max())  # the angle changes along the rim
    solid = solid_of(mesh.vertices, mesh.triangles).trim_by_plane(tuple(-normal), -offset)
    return mesh_of_solid(solid), normal, offset


def bulge(part, normal, offset, longest=1.6 * MM):
    """The largest distance [m] of the refined wall from its plane, and tilt [rad] of its triangles."""
    fine = refine_mesh(part, longest, 100_000)
    wall = (np.abs(part.vertices @ normal - offset) < 1e-8)[part.triangles].all(axis=1)
    middles = fine.vertices[fine.triangles].mean(axis=1)
    near = np.flatnonzero(np.abs(middles @ normal - offset) < 6 * MM)
    near = near[wall[MeshClosestPoint(part).find_along(middles[near])[2]]]
    facing = fine.face_vectors[near]
    area = np.linalg.norm(facing, axis=1)
    tilt = np.arccos(np.clip(facing @ normal / np.maximum(area, 1e-300), -1, 1))
    return np.abs(middles[near] @ normal - offset).max(), np.sqrt((tilt**2 * area).sum() / area.sum())


SMOOTH = {
    **{f"even {level}": lambda level=level: even(level) for level in (1, 2, 3, 4)},
    **{f"grey {voxel}": lambda voxel=voxel: marched(voxel * MM) for voxel in (2, 3, 6)},
    "mask": lambda: marched(2 * MM, mask=True),
    "torus": lambda: specimen_of("torus-14").make(600),
    "bumpy": lambda: specimen_of("bumpy").make(1500),
    "kidney": lambda: specimen_of("kidney-mesh").make(600),
    "cylinder": lambda: mesh_of(trimesh.creation.cylinder(0.03, 0.06, sections=24)),
}


@pytest.mark.parametrize("name", SMOOTH)
def test_smooth_and_stepped_organs_get_no_rims_below_40_degrees(name):
    given = SMOOTH[name]()
    faces = trimesh.Trimesh(given.vertices, given.triangles, process=False)
    shallow = {
        tuple(sorted(e)) for e in faces.face_adjacency_edges[faces.face_adjacency_angles < np.deg2rad(39.9)].tolist()
    }
    assert not shallow & set(map(tuple, find_rims(given).tolist()))


@pytest.mark.parametrize(
    "bend, most, tilted", [(0.25, 0.6, 0.19), (0.5, 0.05, 0.01), (0.9, 0.05, 0.01), (1.5, 0.05, 0.01)]
)
@pytest.mark.parametrize("make", [lambda: even(4), lambda: marched(2 * MM)], ids=["even", "marched"])
def test_a_flat_cut_stays_flat_at_any_angle(make, bend, most, tilted):
    """It bulged by up to 5 mm: where the rim bent by less than 40 degrees, or the wall consisted of thin triangles, and
    by 0.1 to 0.3 mm because edges at the rim were contracted to vertices next to it. Below 0.3 rad a part of the rim
    bends by less than 8 degrees."""
    for seed in (3, 4):
        away, tilt = bulge(*cut(make(), seed, bend))
        assert away < most * MM and tilt < tilted


def test_the_rim_of_a_shallow_cut_is_found_whole_and_turns_with_the_body():
    part, normal, offset = cut(even(4), 5, 0.45)
    on = np.abs(part.vertices @ normal - offset) < 1e-8
    faces = trimesh.Trimesh(part.vertices, part.triangles, process=False)
    wall = on[part.triangles].all(axis=1)
    rim = wall[faces.face_adjacency].sum(axis=1) == 1
    assert 0.3 < np.median(faces.face_adjacency_angles[rim]) < 0.6
    known = set(map(tuple, np.sort(faces.face_adjacency_edges[rim], axis=1).tolist()))
    found = set(map(tuple, find_rims(part).tolist()))
    assert len(known) > 10 * CHAIN and len(found & known) > 0.95 * len(known) and len(found - known) < 0.02 * len(known)
    turned = Mesh(np.ascontiguousarray(part.vertices @ rotation(2)), part.triangles)
    assert set(map(tuple, find_rims(turned).tolist())) == found


def test_a_rim_between_two_curved_sides_is_one_and_stays_sharp():
    """A lens: two caps of a sphere that meet at 35 degrees."""
    from palpate.physics.geometry.felt.solid import mesh_of_solid, solid_of

    radius = 60 * MM
    ball = trimesh.creation.icosphere(5, radius)
    apart = radius * np.sin(np.deg2rad(17.5))  # from the middle, along x: both balls form a waist, bent by 35 degrees
    one, other = (solid_of(ball.vertices + (x, 0.0, 0.0), ball.faces) for x in (-apart, apart))
    body = mesh_of_solid(one + other)
    rims = find_rims(body)
    assert len(rims) > 100 and (np.abs(body.vertices[rims][..., 0]) < 2 * MM).all()
    fine = refine_mesh(body, 1.6 * MM, 100_000)
    waist = np.hypot(fine.vertices[:, 1], fine.vertices[:, 2])[np.abs(fine.vertices[:, 0]) < 0.2 * MM]
    assert np.abs(waist - radius * np.cos(np.deg2rad(17.5))).max() < 0.2 * MM
