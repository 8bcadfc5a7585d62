"""Thinned meshes: the remaining vertices, and the integration of a patch over them."""

import numpy as np
import pytest
import scipy.spatial
from pressing import Spreader
from pytest import approx

from palpate.nodes.base.surface import surface_mesh
from palpate.physics.contact.spread import kernel_values
from palpate.physics.geometry.mesh import Mesh, plane
from palpate.physics.geometry.thinned import LEAST, thin_mesh
from palpate.physics.geometry.topology import edge_counts

SPACING, RADIUS = 1e-3, 8e-3


def fine(count=40_000, surface="sphere"):
    return surface_mesh(surface, count)


@pytest.mark.parametrize(("surface", "count"), [("kidney", 10_000), ("sphere", 10_000), ("plane", 10_000)])
def test_the_shipped_meshes_are_not_thinned(surface, count):
    mesh = surface_mesh(surface, count)
    assert thin_mesh(mesh, SPACING) is mesh and thin_mesh(mesh, 0.0) is mesh


def test_the_remaining_vertices_are_spaced_and_cover_a_closed_surface():
    counts = []
    for count in (20_000, 60_000):
        mesh = fine(count)
        thin = thin_mesh(mesh, SPACING)
        tree = scipy.spatial.cKDTree(thin.vertices)
        assert tree.query(mesh.vertices)[0].max() < SPACING
        assert tree.query(thin.vertices, k=2)[0][:, 1].min() >= SPACING
        assert edge_counts(thin.triangles, len(thin.vertices)) == (0, 0)
        assert len(thin.triangles) == 2 * len(thin.vertices) - 4  # topology of a sphere
        assert thin.areas.sum() == approx(mesh.areas.sum(), rel=2e-3)
        assert (np.einsum("ij,ij->i", thin.normals, thin.vertices) > 0.99 * 21e-3).all()
        counts.append(len(thin.vertices))
    assert max(counts) < 1.25 * min(counts)


@pytest.mark.parametrize(("thick", "spacing"), [(0.01, 1e-3), (0.1, 0.7e-3), (1.0, 1e-3)])
def test_a_closed_surface_of_uneven_triangles_has_no_holes(thick, spacing):
    points = np.random.default_rng(1).normal(size=(30_000, 3))
    points *= 21e-3 / np.linalg.norm(points, axis=1)[:, None]
    triangles = scipy.spatial.ConvexHull(points).simplices
    corners = points[triangles]
    inward = np.einsum("tj,tj->t", np.cross(*np.diff(corners, axis=1).swapaxes(0, 1)), corners[:, 0]) < 0
    triangles[inward] = triangles[inward][:, [0, 2, 1]]
    mesh = Mesh(points * (1.0, 1.0, thick), triangles.astype(np.int32))
    thin = thin_mesh(mesh, spacing)
    assert len(thin.vertices) < 0.5 * len(mesh.vertices)
    assert edge_counts(thin.triangles, len(thin.vertices)) == (0, 0)
    assert len(thin.triangles) == 2 * len(thin.vertices) - 4


def test_both_sides_of_a_sheet_thinner_than_the_spacing_remain_separate():
    ball = fine()
    mesh = Mesh(ball.vertices * (1.0, 1.0, 0.01), ball.triangles)  # 0.4 mm thick
    thin = thin_mesh(mesh, SPACING)
    middle = np.hypot(*thin.vertices[:, :2].T) < 15e-3
    up = thin.vertices[:, 2] > 0
    assert (thin.normals[middle & up, 2] > 0.9).all() and (thin.normals[middle & ~up, 2] < -0.9).all()
    assert thin.areas[middle & up].sum() == approx(thin.areas[middle & ~up].sum(), rel=0.05)


def test_a_mesh_with_a_fine_region_is_thinned_there_without_loss_of_area():
    sheet = plane(0.1, 40_000)  # 0.5 mm
    x, y = sheet.vertices[:, :2].T / 0.05
    graded = Mesh(np.column_stack([0.05 * np.sign(x) * np.abs(x) ** 1.7, 0.05 * y, 0 * x]), sheet.triangles)
    thin = thin_mesh(graded, SPACING)
    assert len(thin.vertices) < 0.6 * len(graded.vertices)
    assert edge_counts(thin.triangles, len(thin.vertices))[1] == 0
    assert (thin.normals[:, 2] > 0.99).all()
    for foot in np.random.default_rng(2).uniform(-0.04, 0.04, (30, 2)):
        whole, kept = (
            mesh.areas @ kernel_values("biweight", np.linalg.norm(mesh.vertices[:, :2] - foot, axis=1) / RADIUS)
            for mesh in (graded, thin)
        )
        assert kept == approx(whole, rel=0.03)


def test_a_small_body_keeps_its_shape():
    ball = fine()
    mesh = Mesh(0.05 * ball.vertices, ball.triangles)  # 2.1 mm across
    thin = thin_mesh(mesh, SPACING)
    assert 0.7 * LEAST < len(thin.vertices) < 1.5 * LEAST
    assert thin.areas.sum() == approx(mesh.areas.sum(), rel=0.01)


def moments(mesh, feet):
    """Centre [m] (3) and RMS distance [m] from it of a force spread around each foot."""
    spreader, found = Spreader(mesh, RADIUS), []
    for foot in feet:
        normal = tuple(foot / np.linalg.norm(foot))
        count = spreader.spread(tuple(foot), normal, (0.0, 0.0, -1.0))
        at, weights = mesh.vertices[spreader.nodes[:count]], spreader.weights[:count]
        centre = weights @ at
        found.append([*centre, np.sqrt(weights @ np.square(at - centre).sum(axis=1))])
    return np.array(found)


def test_centre_and_width_of_a_patch_converge_with_second_order():
    rng = np.random.default_rng(5)
    feet = rng.normal(size=(40, 3))
    feet *= 21e-3 / np.linalg.norm(feet, axis=1)[:, None]
    mesh = fine()
    whole = moments(mesh, feet)
    errors = []
    for spacing in (2e-3, 1e-3):
        wrong = moments(thin_mesh(mesh, spacing), feet) - whole
        errors.append([np.sqrt((wrong[:, :3] ** 2).sum(axis=1).mean()), np.sqrt((wrong[:, 3] ** 2).mean())])
    errors = np.array(errors) / RADIUS
    assert (errors[-1] < 1e-3).all()
    assert (np.log2(errors[0] / errors[1]) > 1.7).all()  # order of convergence
