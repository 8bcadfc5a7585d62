"""The area of contact of two surfaces, with its edge between the centres of cells, compared with closed forms."""

import numpy as np
import pytest
from pytest import approx
from scipy.spatial import Delaunay

from palpate.physics.bodies.between_bodies import mean_inverse
from palpate.physics.contact.organs import between
from palpate.physics.contact.organs.borders import borders, contact_area
from palpate.physics.geometry.mesh import Mesh

SOFTNESS = (1.0 - 0.45**2) / (np.pi * 19e3)
RADIUS = 10.5e-3


def scattered(step, seed=0, half=11e-3):
    """A plane mesh with vertices on a scattered grid, and its areas."""
    count = int(1.2 * half / step)
    i, j = np.meshgrid(np.arange(-count, count), np.arange(-count, count))
    at = np.stack([i + 0.5 * (j % 2) + 0.23, 0.5 * np.sqrt(3) * j + 0.11], axis=-1).reshape(-1, 2)
    at = step * (at + 0.3 * np.random.default_rng(seed).uniform(-0.5, 0.5, at.shape))
    triangles = Delaunay(at).simplices
    edges = np.linalg.norm(at[triangles] - at[np.roll(triangles, 1, axis=1)], axis=2)
    return Mesh(np.c_[at, 0.0 * at[:, 0]], triangles[edges.max(axis=1) < 2.0 * step].astype(np.int32))


def pressed(mesh, gap, compliance, depths):
    """Areas [m²] and numbers of active cells at depths [m], each vertex a cell."""
    size = len(mesh.vertices)
    met = borders(mesh, np.arange(size), mesh.vertices, mesh.areas)
    made, found = between.pair(gap, compliance, np.zeros((size, size)), (0.0, 0.0)), []
    for depth in depths:
        between.step_pair(made, np.stack([np.full(size, -depth), np.zeros(size)]), 1e-3, 10_000)
        found.append((contact_area(made, mesh.areas, met.cells, met.area), made.active.tally[0]["active"]))
    return np.array(found).T


@pytest.mark.parametrize("step", [1e-3, 1.5e-3])
def test_the_area_of_two_balls_is_that_of_hertz_and_changes_smoothly(step):
    mesh = scattered(step)
    gap = np.sum(mesh.vertices**2, axis=1) / (2.0 * RADIUS) + 0.25 * mesh.areas / np.pi / RADIUS
    depths = np.linspace(0.2e-3, 4.5e-3, 150)
    softness = 2.0 * SOFTNESS * mean_inverse(mesh.vertices, mesh.areas)
    area, active = pressed(mesh, gap, softness, depths)
    off = np.abs(area / (np.pi * RADIUS * depths) - 1.0)
    assert off[active >= 7].max() < 0.05 and off[active >= 40].max() < 0.03
    slowly, _ = pressed(mesh, gap, softness, np.linspace(1e-3, 1.2e-3, 400))
    assert np.abs(np.diff(slowly)).max() < 0.2 * mesh.areas.mean()  # no step by a whole cell


def test_the_edge_on_a_foundation_of_springs_is_where_the_gap_is_closed():
    """A gap that is linear in x: all cells at x < depth/slope touch. The borders are lines, so the area is exact but
    for the triangles by which cells are divided."""
    mesh, slope = scattered(1e-3, seed=3, half=8e-3), 0.1
    x = mesh.vertices[:, 0]
    depths = slope * np.linspace(-4e-3, 4e-3, 60)
    area, _ = pressed(mesh, slope * (x - x.min()), np.diag(1e-6 / mesh.areas), depths - slope * x.min())
    rows, whole = mesh.vertices[mesh.triangles][..., :2], 0.5 * np.linalg.norm(mesh.face_vectors, axis=1)

    def below(edge):
        """Area of the mesh at x < edge, by clipping of each triangle at 40 lines."""
        line = (np.arange(40) + 0.5) / 40
        u, v = (a.ravel() for a in np.meshgrid(line, line))
        u, v = np.where(u + v > 1.0, 1.0 - u, u), np.where(u + v > 1.0, 1.0 - v, v)
        at = rows[:, 0, None, 0] + u * (rows[:, 1, None, 0] - rows[:, 0, None, 0])
        at = at + v * (rows[:, 2, None, 0] - rows[:, 0, None, 0])
        return float((whole * (at < edge).mean(axis=1)).sum())

    expected = np.array([below(depth / slope) for depth in depths])
    wide = np.ptp(mesh.vertices[:, 1])
    assert np.abs(area - expected).max() < 0.1e-3 * wide  # 10 % of a cell


def test_borders_divide_cells_into_triangles_of_their_areas():
    mesh = scattered(1e-3)
    middles = scattered(2.3e-3, seed=1).vertices
    groups = np.linalg.norm(mesh.vertices[:, None] - middles[None], axis=2).argmin(axis=1)
    for cell in (np.arange(len(mesh.vertices)), groups):
        area = np.bincount(cell, mesh.areas)
        centres = np.stack(
            [np.bincount(cell, mesh.areas * mesh.vertices[:, i]) / area for i in range(3)], axis=1
        )  # fmt: skip
        met = borders(mesh, cell, centres, area)
        inside = np.linalg.norm(centres, axis=1) < 6e-3
        total = np.bincount(met.cells[:, 0], met.area, len(area)) + np.bincount(met.cells[:, 1], met.area, len(area))
        assert total[inside].sum() == approx(area[inside].sum(), rel=0.05)
        assert total[inside] == approx(area[inside], rel=0.25)


def test_rigid_surfaces_have_a_finite_area():
    """They close no overlap, and where both just meet the gap is zero as well."""
    mesh = scattered(2e-3)
    size = len(mesh.vertices)
    made = between.pair(np.zeros(size), np.zeros((size, size)), np.zeros((size, size)), (0.0, 0.0))
    made.active.force[: size // 2] = 1.0
    made.active.order[: size // 2] = np.arange(size // 2)
    made.active.tally["active"] = size // 2
    met = borders(mesh, np.arange(size), mesh.vertices, mesh.areas)
    assert 0.0 < contact_area(made, mesh.areas, met.cells, met.area) < mesh.areas.sum()


def test_vertices_without_a_cell_have_no_border():
    mesh = scattered(2e-3)
    cell = np.where(mesh.vertices[:, 0] < 0.0, 0, -1)
    met = borders(mesh, cell, np.zeros((1, 3)), np.ones(1))
    assert len(met.cells) == len(met.area) == 0
