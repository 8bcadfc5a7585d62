"""Vertices that scatter round a smooth surface."""

import numpy as np
import pytest

from palpate.physics.geometry.mesh import Mesh, plane
from palpate.physics.geometry.refined.divided import refine_mesh
from palpate.physics.geometry.refined.edges import creases
from palpate.physics.geometry.refined.smoothed import smooth_vertices
from palpate.studies.organs.shapes import boxes, star, torus

RING, TUBE = 26e-3, 14e-3


def smooth(mesh):
    return smooth_vertices(mesh, *creases(mesh))


def off_torus(p):
    return np.hypot(np.hypot(p[:, 0], p[:, 1]) - RING, p[:, 2]) - TUBE


def scattered(mesh, size, seed=1):
    moves = np.random.default_rng(seed).normal(scale=size, size=len(mesh.vertices))
    return Mesh(mesh.vertices + moves[:, None] * mesh.normals, mesh.triangles)


def test_vertices_that_scatter_come_nearer_to_the_surface():
    given = scattered(torus(RING, TUBE, 5000), 20e-6)  # 1 % of the edges
    smoothed = smooth(given)
    before, after = (np.sqrt(np.mean(off_torus(each.vertices) ** 2)) for each in (given, smoothed))
    assert before == pytest.approx(20e-6, rel=0.05) and after < 0.6 * before
    normals = [torus_normals(each) for each in (given, smoothed)]
    assert normals[1] < 0.75 * normals[0]


def torus_normals(mesh):
    """Root mean square error [rad] of the refined mesh's normals."""
    fine = refine_mesh(mesh, 1.6e-3, 50_000)
    p = fine.vertices
    out = p - RING * np.column_stack([p[:, :2] / np.linalg.norm(p[:, :2], axis=1)[:, None], np.zeros(len(p))])
    out /= np.linalg.norm(out, axis=1)[:, None]
    return np.sqrt(np.mean(np.sum((fine.normals - out) ** 2, axis=1)))


@pytest.mark.parametrize("count", [600, 1200, 5000, 20_000])
def test_a_smooth_surface_stays_whether_its_mesh_is_coarse_or_fine(count):
    bumps = star(lambda way: 0.03 * (1.0 + 0.05 * np.sin(4 * way[:, 0]) * np.cos(5 * way[:, 1])), count)
    for mesh in (torus(RING, TUBE, count), star(lambda way: np.full(len(way), 0.02), count), bumps):
        assert smooth(mesh) is mesh
        rounded = Mesh(mesh.vertices.astype(np.float32).astype(float), mesh.triangles)
        assert smooth(rounded) is rounded


def test_flat_sides_edges_and_borders_stay():
    box, sheet = boxes(*[(-0.01, 0.01)] * 3, np.ones((1, 1, 1), bool), 3000), plane(0.05, 2500)
    assert smooth(box) is box and smooth(sheet) is sheet
    rough = scattered(sheet, 1e-5)
    smoothed = smooth(rough)
    border = np.abs(sheet.vertices[:, :2]).max(axis=1) > 0.0249
    assert (smoothed.vertices[border] == rough.vertices[border]).all() and border.sum() > 100
    inside = np.abs(sheet.vertices[:, :2]).max(axis=1) < 0.02
    assert smoothed.vertices[inside, 2].std() < 0.7 * rough.vertices[inside, 2].std()


def test_large_steps_are_not_taken_for_scatter():
    ball = star(lambda way: np.full(len(way), 0.02), 5000)
    steps = Mesh(
        np.round(ball.vertices / 1e-3) * 1e-3 + 1e-4 * ball.vertices, ball.triangles
    )  # as of a black and white image
    assert smooth(steps) is steps


def test_no_vertex_moves_far():
    given = scattered(torus(RING, TUBE, 5000), 20e-6)
    moved = np.linalg.norm(smooth(given).vertices - given.vertices, axis=1)
    assert np.median(moved) > 1e-6 and moved.max() < 1.5e-4
