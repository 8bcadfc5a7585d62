"""Ripples of refined and scattered surfaces get no bridge; gaps of any width do."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from palpate.physics.geometry.felt.bridge import close_surface
from palpate.physics.geometry.felt.ripples import SHALLOW, are_deep, in_hollows
from palpate.physics.geometry.felt.touchable import SHORT, divide_long_edges, untouchable
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.mesh_closest import MeshClosestPoint
from palpate.physics.geometry.refined.divided import refine_mesh
from palpate.physics.geometry.topology import outward
from palpate.studies.organs.gaps import cut_mesh, plane_of
from palpate.studies.organs.shapes import star

R = 8e-3  # [m]
REFINE, MOST = 1.6e-3, 60_000
HALF = np.array([45e-3, 35e-3, 25e-3])  # [m] half axes


def hull(points, seed):
    """The convex hull of random points on the ellipsoid, turned."""
    unit = np.random.default_rng(seed).normal(size=(points, 3))
    found = ConvexHull(unit / np.linalg.norm(unit, axis=1)[:, None] * HALF)
    turned = Rotation.random(random_state=seed).apply(found.points)
    return Mesh(turned, outward(turned, found.simplices.astype(np.int32)))


def slivers(columns=63, rows=6):
    """An ellipsoid of rows of long triangles, which are thin at its poles."""
    down, turn = np.meshgrid(np.linspace(0.0, np.pi, rows + 1)[1:-1], np.arange(columns) * 2 * np.pi / columns,
                             indexing="ij")  # fmt: skip
    points = np.stack([np.sin(down) * np.cos(turn), np.sin(down) * np.sin(turn), np.cos(down)], axis=-1)
    points = np.concatenate([points.reshape(-1, 3), [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]]) * HALF
    return Mesh(points, outward(points, ConvexHull(points).simplices.astype(np.int32)))


def touched(mesh):
    """A refined mesh, its triangles as they are tested, and which of them are untouchable."""
    body = refine_mesh(mesh, REFINE, MOST)
    fine, _ = divide_long_edges(body, SHORT * R)
    closest = MeshClosestPoint(body)
    return body, fine, closest, untouchable(fine, closest, R)


@pytest.mark.parametrize(
    "make", [slivers, *(lambda n=n, seed=seed: hull(n, seed) for n, seed in ((8, 1), (32, 2), (64, 3), (200, 4)))]
)
def test_a_coarse_convex_body_is_never_bridged(make):
    given = make()
    body, _, _, hidden = touched(given)
    bare = divide_long_edges(given, SHORT * R)[0]
    assert not untouchable(bare, MeshClosestPoint(given), R).any()  # no part of a convex body is in front of a triangle
    assert hidden.any()  # but of the refined one
    assert close_surface(body, R, given=given) is None


def test_scatter_of_a_segmentation_is_not_bridged():
    """Marching cubes on slanted voxels of 5.5 mm: vertices scatter on both sides of the ellipsoid."""
    skimage = pytest.importorskip("skimage")
    voxel, turn = float(np.sqrt(8e-3 * np.pi)) * 0.035, Rotation.random(random_state=1000).as_matrix()
    grid = np.stack(np.meshgrid(*[voxel * np.arange(-12, 13)] * 3, indexing="ij"), axis=-1)
    level = 25e-3 * (np.linalg.norm(grid @ turn / HALF, axis=-1) - 1.0)
    points, triangles, *_ = skimage.measure.marching_cubes(level, 0.0, allow_degenerate=False)
    points = voxel * (points.astype(float) - 12)
    given = Mesh(points, outward(points, triangles.astype(np.int32)))
    body, _, _, hidden = touched(given)
    bare = divide_long_edges(given, SHORT * R)[0]
    assert hidden.any() and untouchable(bare, MeshClosestPoint(given), R).any()
    assert close_surface(body, R, given=given) is None


def notched(deep, wide=3e-3):
    """A block with a groove of steep walls."""
    y = [-0.02, -0.5 * wide, 0.5 * wide, 0.02]
    outline = [(y[0], -6e-3), (y[3], -6e-3), (y[3], 0.0), (y[2], 0.0), (y[2], -deep), (y[1], -deep), (y[1], 0.0),
               (y[0], 0.0)]  # fmt: skip
    import manifold3d

    solid = manifold3d.Manifold.extrude(manifold3d.CrossSection([1e3 * np.array(outline)]), 20.0).to_mesh64()
    across, up, along = 1e-3 * np.asarray(solid.vert_properties)[:, :3].T
    return Mesh(np.stack([along, across, up], axis=1), np.asarray(solid.tri_verts).astype(np.int32))


def dished(deep, wide=1.5e-3, size=12e-3):
    """A ball with a smooth dish, `deep` below it, in which the finger touches the rim only."""

    def radius(unit):
        out = np.arccos(np.clip(unit[:, 2], -1.0, 1.0)) * size / (0.5 * wide)
        return size - deep * np.clip(1.0 - out * out, 0.0, 1.0) ** 2

    return star(radius, 40_000)


def kept_of(fine, hidden, closest, given):
    """Which of the untouchable triangles are in hollows of the body (T,)."""
    some = np.flatnonzero(hidden)
    kept = np.zeros(len(hidden), bool)
    kept[some] = in_hollows(fine, some, are_deep(fine, some, closest, R), given, R)
    return kept


@pytest.mark.parametrize(("make", "deep", "bridged"), [
    (dished, 0.7e-4, False), (dished, 4e-4, True), (notched, 0.5e-4, True), (notched, 4e-4, True),
])  # fmt: skip
def test_what_is_shallow_and_flat_is_a_ripple_and_what_is_deep_or_steep_is_not(make, deep, bridged):
    body = make(deep)
    fine, _ = divide_long_edges(body, SHORT * R)
    closest = MeshClosestPoint(body)
    hidden = untouchable(fine, closest, R)
    assert hidden.any()
    assert kept_of(fine, hidden, closest, body).any() == bridged
    if not bridged:  # each point is so near to a ball that fits
        normal = fine.face_vectors[hidden] / np.linalg.norm(fine.face_vectors[hidden], axis=1)[:, None]
        middle = fine.vertices[fine.triangles[hidden]].mean(axis=1)
        assert (closest.find(middle + (R + SHALLOW) * normal)[3] > R - 21e-6).all()


def test_what_is_shallow_bears_load_below_a_bridge_as_well():
    """The margin of a dish is connected with its deep middle. Where a cut crossed a ripple, all of it bore no load."""
    body = dished(4e-4)
    closest = MeshClosestPoint(body)
    hidden = untouchable(body, closest, R)
    felt = close_surface(body, R, given=body)
    assert not (~felt.touchable & ~hidden).any()
    vector = body.face_vectors / np.linalg.norm(body.face_vectors, axis=1)[:, None]
    middle = body.vertices[body.triangles].mean(axis=1)
    away = closest.find(middle + (R + SHALLOW) * vector)[3]  # of the centre of a ball within 0.1 mm of the triangle
    shallow, deep = hidden & (away > R), hidden & (away < R - 21e-6)
    assert shallow.sum() > 5 and deep.sum() > 20
    assert felt.touchable[shallow].all() and not felt.touchable[deep].any()


@pytest.mark.parametrize(
    "make", [slivers, pytest.param(lambda: hull(64, 3), marks=pytest.mark.long)], ids=["slivers", "hull"]
)
def test_a_cut_of_a_coarse_body_is_bridged(make):
    """Its walls are 0.05 mm apart. Ripples elsewhere stay without a bridge."""
    given = cut_mesh(make(), 0.05e-3, 1)
    _, fine, closest, hidden = touched(given)
    kept = kept_of(fine, hidden, closest, given)
    normal, offset = plane_of(make(), 1)
    middle = fine.vertices[fine.triangles].mean(axis=1)
    wall = np.abs(np.abs(middle @ normal - offset) - 0.025e-3) < 1e-9
    assert wall.sum() > 1000 and kept[wall & hidden].all()
    assert hidden[wall].mean() > 0.98
    assert kept[~wall].sum() < 0.8 * hidden[~wall].sum()
