"""The stretch of a surface compared with closed forms and with the singular values of its deformation."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from palpate.physics.geometry.mesh import plane
from palpate.physics.geometry.strain import at_vertices, largest_stretch

SHEET = plane(0.1, 400)


def strain(gradient, mesh=SHEET):
    """Strain of a sheet whose points x move to gradient @ x."""
    moved = mesh.vertices @ np.asarray(gradient).T - mesh.vertices
    return largest_stretch(mesh.vertices, mesh.triangles, moved)


@pytest.mark.parametrize("stretch", [0.5, 0.99, 1.0, 1.001, 1.3, 4.0])
def test_a_uniform_stretch_is_exact(stretch):
    assert strain(stretch * np.eye(3)) == pytest.approx(stretch - 1.0, abs=1e-12)


def test_of_two_stretches_the_larger_counts_in_any_direction():
    for angle in np.linspace(0.0, np.pi, 7):
        turn = Rotation.from_euler("z", angle).as_matrix()
        assert strain(turn @ np.diag([1.2, 0.7, 1.0]) @ turn.T) == pytest.approx(0.2, abs=1e-12)


@given(st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3), st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3))
def test_a_rigid_motion_has_no_strain(turn, way):
    matrix = Rotation.from_rotvec(turn).as_matrix()
    moved = SHEET.vertices @ matrix.T + np.array(way) - SHEET.vertices
    assert np.abs(largest_stretch(SHEET.vertices, SHEET.triangles, moved)).max() < 1e-10


@pytest.mark.parametrize("shear", [0.01, 0.5, 2.0])
def test_simple_shear_has_its_closed_form(shear):
    gradient = np.eye(3)
    gradient[0, 1] = shear
    assert strain(gradient) == pytest.approx(shear / 2 + np.sqrt(1 + shear**2 / 4) - 1.0, abs=1e-10)


def test_the_strain_is_the_largest_singular_value_in_the_plane():
    random = np.random.default_rng(3)
    for _ in range(20):
        gradient = np.eye(3) + 0.4 * random.normal(size=(3, 3))
        assert strain(gradient) == pytest.approx(np.linalg.svd(gradient[:, :2])[1][0] - 1.0, abs=1e-10)


def test_a_triangle_without_area_has_no_strain():
    line = np.array([[0.0, 0, 0], [1e-3, 0, 0], [2e-3, 0, 0], [0, 1e-3, 0]])
    triangles = np.array([[0, 1, 2], [0, 0, 1], [0, 1, 3]])
    printed = largest_stretch(line, triangles, 0.5 * line)
    assert printed == pytest.approx([0.0, 0.0, 0.5])
    mean = at_vertices(printed, line, triangles)
    assert mean == pytest.approx([0.5, 0.5, 0.0, 0.5])


def test_a_vertex_has_the_area_weighted_mean_of_its_triangles():
    points = np.array([[0.0, 0, 0], [3, 0, 0], [0, 1, 0], [-1, 0, 0], [9, 9, 9]])
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    assert at_vertices(np.array([0.4, 0.0]), points, triangles) == pytest.approx([0.3, 0.4, 0.3, 0.0, 0.0])
