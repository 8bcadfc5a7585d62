"""The surfaces of the zoo: their size, orientation and pieces, against closed forms."""

import numpy as np
import pytest
from pytest import approx

from palpate.physics.geometry.topology import edge_counts
from palpate.studies.organs.shapes import directions, join_vertices
from palpate.studies.organs.zoo import COARSE, FINE, MM, USUAL, ZOO, write_mesh


def volume(mesh):
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum()) / 6.0


@pytest.mark.parametrize("name", [name for name, one in ZOO.items() if one.patch != "plane"])
def test_surfaces_are_closed_and_face_outwards(name):
    for count in (COARSE, USUAL):
        mesh = ZOO[name].true(count)
        whole = join_vertices(mesh.vertices, mesh.triangles)
        assert edge_counts(whole.triangles, len(whole.vertices)) == (0, 0)
        assert volume(mesh) > 0.0
        assert 0.7 * count < len(whole.vertices) < 2.2 * count


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("sphere", 4 / 3 * np.pi * 20**3),
        ("ellipsoid", 4 / 3 * np.pi * 45 * 30 * 20),
        ("torus-6", 2 * np.pi**2 * 26 * 6**2),
        ("torus-20", 2 * np.pi**2 * 32 * 20**2),
        ("plate-2", 80 * 80 * 2),
        ("box", 50 * 40 * 30),
        ("l-shape", 60 * 50 * 50 - 30 * 50 * 25),
        ("groove", 60 * 60 * 35 - 8 * 60 * 15),
        ("bowl", np.pi * (40**2 * 37 - 2 / 3 * 25**3)),
        ("dimple", np.pi * (21**2 * 18 - 2 / 3 * 6**3)),
        ("dome", np.pi * (40**2 * 16 + 2 / 3 * 15**3)),
    ],
)
def test_volumes_are_those_of_closed_forms(name, expected):
    assert volume(ZOO[name].make(USUAL)) / MM**3 == approx(expected, rel=0.02)
    assert (
        abs(volume(ZOO[name].make(USUAL)) / MM**3 / expected - 1.0)
        <= abs(volume(ZOO[name].make(COARSE)) / MM**3 / expected - 1.0) + 1e-12
    )


@pytest.mark.parametrize("count", [20_000, pytest.param(FINE, marks=pytest.mark.long)])
def test_the_vertices_of_a_fine_sphere_are_at_its_radius(count):
    mesh = directions(count)
    assert len(mesh.vertices) == approx(count, rel=0.02)
    assert np.linalg.norm(mesh.vertices, axis=1) == approx(np.ones(len(mesh.vertices)), abs=1e-12)


def test_a_reversed_ball_faces_inwards_in_its_file():
    given, true = ZOO["two-balls"].make(COARSE), ZOO["two-balls"].true(COARSE)
    assert volume(given) == approx(0.0, abs=1e-12)
    assert volume(true) == approx(2 * 4 / 3 * np.pi * 0.02**3, rel=0.05)


def test_slivers_and_doubled_vertices_are_as_bad_as_they_claim():
    mesh = ZOO["slivers"].make(COARSE)
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    shortest = np.minimum(
        np.minimum(np.linalg.norm(a - b, axis=1), np.linalg.norm(b - c, axis=1)), np.linalg.norm(c - a, axis=1)
    )
    assert shortest.min() == approx(1e-6, rel=1e-3) and (shortest < 2e-6).sum() > 40
    doubled = ZOO["doubled"].make(COARSE)
    assert len(doubled.vertices) == 3 * len(doubled.triangles)


def test_a_file_is_in_millimetres_far_from_the_origin(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    mesh = trimesh.load(write_mesh("box", COARSE, tmp_path), process=False)
    assert mesh.extents == approx([50.0, 40.0, 30.0])
    assert np.linalg.norm(mesh.centroid) > 500.0
