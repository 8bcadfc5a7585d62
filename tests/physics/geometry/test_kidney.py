"""The kidney: its size, its smoothness, and meshes of it."""

import subprocess
import sys

import numpy as np
import pytest
from formulas import outward_normal, torus

from palpate.nodes.base.surface import PLACE, surface_mesh, surface_patch
from palpate.physics.geometry.closest import ClosestPoint
from palpate.physics.geometry.kidney import kidney
from palpate.physics.geometry.nurbs_fit import sphere
from palpate.physics.geometry.tessellate import tessellate


def edges(triangles):
    """Directed edges of triangles (3T,2)."""
    return np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])


def volume(mesh):
    a, b, c = (mesh.vertices[mesh.triangles[:, i]] for i in range(3))
    return np.einsum("ij,ij->", a, np.cross(b, c)) / 6


def angles(mesh):
    """The smallest angle of each triangle [rad]."""
    corners = mesh.vertices[mesh.triangles]
    corner_angles = []
    for i in range(3):
        p, q = corners[:, (i + 1) % 3] - corners[:, i], corners[:, (i + 2) % 3] - corners[:, i]
        corner_angles.append(np.arctan2(np.linalg.norm(np.cross(p, q), axis=1), np.einsum("ij,ij->i", p, q)))
    return np.min(corner_angles, axis=0)


@pytest.mark.parametrize("size", [(0.110, 0.060, 0.042), (0.098, 0.051, 0.039)])
def test_the_kidney_has_the_requested_size(size):
    points = kidney(*size)(np.linspace(0, 1, 700)[:, None], np.linspace(0, 1, 700)).reshape(-1, 3)
    np.testing.assert_allclose(np.ptp(points, axis=0), size, atol=2e-5)
    np.testing.assert_allclose(points.max(axis=0) + points.min(axis=0), 0, atol=2e-5)


def test_the_volume_is_in_the_published_range():
    # Emamian et al. 1993: medians 146 cm3 left and 134 cm3 right.
    assert 1.2e-4 < volume(tessellate(kidney(), 20000)) < 1.7e-4


def test_normals_are_continuous_across_the_seam():
    v = np.linspace(0, 1, 301)
    surface = kidney()
    before, after = outward_normal(surface, np.nextafter(1.0, 0.0), v), outward_normal(surface, 0.0, v)
    assert np.abs(before - after).max() < 1e-6
    assert np.abs(surface(1.0 - 1e-12, v) - surface(0.0, v)).max() < 1e-12


@pytest.mark.parametrize("end", [0.0, 1.0])
def test_normals_are_continuous_at_the_poles_from_all_sides(end):
    surface = kidney()
    u = np.linspace(0, 1, 400, endpoint=False)
    at = outward_normal(surface, u, np.full(400, end))
    assert np.abs(at - at[0]).max() < 1e-6
    for away in (1e-9, 1e-8, 1e-7):
        near = outward_normal(surface, u, np.full(400, abs(end - away)))
        assert np.abs(near - at[0]).max() < 1e-6 + 40 * away
    np.testing.assert_allclose(at[0], [2 * end - 1, 0, 0], atol=0.5)


def test_the_curvature_stays_bounded_towards_the_poles():
    surface = kidney()
    u = np.linspace(0, 1, 100, endpoint=False)
    greatest = []
    for v in (1e-6, 1e-4, 1e-2):
        d = np.moveaxis(surface.derivatives(u, np.full(100, v)), 1, 0)
        n = outward_normal(surface, u, np.full(100, v))
        first = np.array([[(d[1] * d[1]).sum(1), (d[1] * d[2]).sum(1)], [(d[1] * d[2]).sum(1), (d[2] * d[2]).sum(1)]])
        second = np.array([[(d[3] * n).sum(1), (d[4] * n).sum(1)], [(d[4] * n).sum(1), (d[5] * n).sum(1)]])
        shape = np.linalg.solve(np.moveaxis(first, -1, 0), np.moveaxis(second, -1, 0))
        greatest.append(np.abs(np.linalg.eigvals(shape)).max())
    assert max(greatest) < 1 / 5e-3


def bend(surface, u, v):
    """Principal curvatures, positive where the surface bends towards its normal [1/m]."""
    _, su, sv, suu, suv, svv = surface.derivatives(u, v)
    n = outward_normal(surface, u, v)
    first = np.array([[su @ su, su @ sv], [su @ sv, sv @ sv]])
    return np.sort(np.linalg.eigvals(np.linalg.solve(first, [[suu @ n, suv @ n], [suv @ n, svv @ n]])).real)


def test_the_kidney_is_concave_at_the_hilum_and_convex_elsewhere():
    surface = kidney()
    outline = surface(np.full(401, 0.5), np.linspace(0, 1, 401))  # the medial border, pole to pole
    hilum = outline[200]
    assert outline[:160, 1].min() < hilum[1] - 5e-3 and outline[240:, 1].min() < hilum[1] - 5e-3
    assert abs(outline[np.argmin(outline[:, 1]), 0]) > 0.015
    assert outward_normal(surface, 0.5, 0.5)[1] < -0.95
    assert bend(surface, 0.5, 0.5)[1] > 1 / 0.05  # concave along the border
    for u in (0.0, 0.25, 0.75):  # lateral, front, back
        assert (bend(surface, u, 0.5) < 1e-9).all()


@pytest.mark.parametrize("count", [1000, 4321, 30000])
@pytest.mark.parametrize("surface", [kidney(), sphere(0.02)], ids=["kidney", "sphere"])
def test_a_mesh_is_closed_oriented_near_uniform_and_on_the_surface(surface, count):
    mesh = tessellate(surface, count)
    number = len(mesh.vertices)
    assert abs(number - count) <= 0.1 * count
    directed = edges(mesh.triangles)
    code = directed[:, 0].astype(np.int64) * number + directed[:, 1]
    back = directed[:, 1].astype(np.int64) * number + directed[:, 0]
    assert len(np.unique(code)) == len(code)
    np.testing.assert_array_equal(np.sort(code), np.sort(back))
    assert number - len(code) // 2 + len(mesh.triangles) == 2
    assert np.array_equal(np.unique(mesh.triangles), np.arange(number))
    assert volume(mesh) > 0
    areas = np.linalg.norm(mesh.face_vectors, axis=1)
    assert areas.max() / areas.min() < 3
    assert np.degrees(angles(mesh).min()) > 30
    some = np.linspace(0, number - 1, 800).astype(int)
    foot, normal, *_ = ClosestPoint(surface).find(mesh.vertices[some])
    assert np.linalg.norm(foot - mesh.vertices[some], axis=1).max() <= 1e-9
    assert (np.einsum("ij,ij->i", normal, mesh.normals[some]) > 0.9).all()


def test_a_finer_mesh_converges_to_the_surface_with_the_square_of_its_edge():
    exact = 4 / 3 * np.pi * 0.02**3
    coarse, fine = (abs(volume(tessellate(sphere(0.02), n)) - exact) for n in (1000, 16000))
    assert 12 < coarse / fine < 20  # 16 times the vertices: 1/4 of the edge length, 1/16 of the error


@pytest.mark.long
def test_a_mesh_of_a_million_vertices_is_closed():
    mesh = tessellate(kidney(), 1_000_000)
    assert abs(len(mesh.vertices) - 1_000_000) <= 100_000
    assert len(mesh.triangles) == 2 * len(mesh.vertices) - 4


def test_impossible_meshes_are_errors():
    with pytest.raises(ValueError, match="at least 12"):
        tessellate(kidney(), 5)
    with pytest.raises(ValueError, match="pole"):
        tessellate(torus(2.0, 1.0), 100)
    with pytest.raises(ValueError, match="positive"):
        kidney(0.1, -0.05, 0.04)


def test_the_default_kidney_is_touched_from_above_at_the_centre_of_the_workspace():
    foot, normal, _, gap = ClosestPoint(surface_patch("kidney", PLACE)).find(np.array([0.0, 0.0, 0.110]))
    assert 4e-3 < gap < 6e-3
    assert normal[2] > 0.99
    assert np.hypot(*foot[:2]) < 1e-3
    assert surface_mesh("kidney", 3000, PLACE).vertices[:, 2].max() == pytest.approx(0.105, abs=2e-4)


def test_the_script_writes_a_mesh_file(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    file = tmp_path / "kidney.ply"
    command = [sys.executable, "-m", "palpate.physics.geometry.kidney", str(file), "--vertices", "1500"]
    subprocess.run(command, check=True, timeout=120)
    mesh = trimesh.load(file, process=False)
    assert mesh.is_watertight and abs(len(mesh.vertices) - 1500) < 150
    assert mesh.extents == pytest.approx([0.110, 0.060, 0.042], rel=0.01)
