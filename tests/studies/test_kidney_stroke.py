"""The kidney of the stroke: its grid, its load, and two solvers at its positions."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

from palpate.messages import Pose
from palpate.nodes.collision import Nurbs
from palpate.studies.accuracy import kidney, reference, sites
from palpate.studies.accuracy.cases import TOUCHES
from palpate.studies.accuracy.kidney import Kidney, along, press_kidney, press_kidney_felupe
from palpate.studies.peers import felupe
from palpate.studies.peers.continuum import CUTS, RADIUS

B, M = 26.2641, 1681.06
"""[N/m], [1/m] of the exponential fingertip."""
FIRST = np.array([0.1, 0.3])
PLACES = np.array([-0.012, 0.0, 0.012])


def test_the_path_lies_on_the_surface_that_the_nodes_touch():
    feet, normals, ahead = along(PLACES)
    node = Nurbs(surface="kidney", position=(0.0, 0.0, 0.0))
    node.start()
    for foot, normal in zip(feet, normals, strict=True):
        found = node.step(Pose(position=tuple(foot + 5e-3 * normal), velocity=(0.0, 0.0, 0.0), dt=1e-3))
        assert found.foot == pytest.approx(tuple(foot), abs=2e-5)
        assert found.normal == pytest.approx(tuple(normal), abs=2e-3)
    assert np.einsum("ij,ij->i", normals, ahead) == pytest.approx(0.0, abs=1e-6)


def test_positions_are_arc_lengths_along_the_path():
    feet, *_ = along(np.linspace(-0.012, 0.012, 2001))
    assert np.linalg.norm(np.diff(feet, axis=0), axis=1).sum() == pytest.approx(0.024, rel=1e-4)


def test_both_routes_apply_the_same_load_to_the_curved_patch():
    """The patch is nearly flat: the second moment of the biweight is R²/4, the force 1 and the moment 0."""
    frame, axes = kidney.cut(Kidney(0.0, 3))
    fem = pytest.importorskip("felupe")
    mesh = felupe.bricks(fem, tuple(axes))
    points = frame.points(np.array(mesh.points))
    unit = felupe.on_bricks(points, felupe.sides(np.array(mesh.points), axes)[-1], kidney.pressure, 2 * CUTS)
    assert unit.sum(axis=0) == pytest.approx((0.0, 0.0, -1.0))
    assert -unit[:, 2] @ points[:, :2] == pytest.approx(0.0, abs=1e-5)
    assert -unit[:, 2] @ (points**2).sum(axis=1) == pytest.approx(RADIUS**2 / 4, rel=0.01)


def test_the_faces_of_the_bricks_point_outwards_and_enclose_the_volume():
    fem = pytest.importorskip("felupe")
    _, axes = kidney.cut(Kidney(0.0, 2))
    mesh = felupe.bricks(fem, tuple(axes))
    cube = np.array(mesh.points)
    faces = np.concatenate(felupe.sides(cube, axes))
    _, at, normal = felupe._on_face(kidney.inside(cube), faces, 4)
    assert np.einsum("fqi,fqi->", at, normal) / 3.0 == pytest.approx(145e-6, rel=0.05)  # [m³] published


@pytest.mark.parametrize("place", [-0.012, 0.012])
def test_two_solvers_with_different_elements_agree_on_coarse_meshes(place):
    pytest.importorskip("felupe")
    tetrahedra, bricks = press_kidney(Kidney(place, 1), FIRST), press_kidney_felupe(Kidney(place, 1), FIRST)
    assert tetrahedra.indentation == pytest.approx(bricks.indentation, rel=0.08)


def test_finer_meshes_converge_to_the_stored_reference_from_below():
    right = sites.load_reference("kidney+00")
    coarse, fine = (press_kidney(Kidney(0.0, n), right.force[:1]).indentation for n in (1, 2))
    assert coarse < fine < right.indentation[:1] + right.band[:1]
    assert fine == pytest.approx(right.indentation[:1], rel=0.05)


@pytest.mark.long
def test_a_parabola_through_three_positions_interpolates_between_them():
    """On one coarse mesh, whose error also varies along the path."""
    at = reference.path_of(TOUCHES["stroke"])
    three = np.array([press_kidney(Kidney(x, 2), FIRST[:1]).indentation for x in at])
    between = np.array([-0.006, 0.006])
    own = np.array([press_kidney(Kidney(x, 2), FIRST[:1]).indentation for x in between])
    assert reference._shares(between, at, True) @ three == pytest.approx(own, rel=1e-3)
    assert np.ptp(three) > 0.02 * three.mean()


def test_the_reference_of_the_stroke_has_friction_and_an_error_bound():
    right = reference.reference_solution(TOUCHES["stroke"])
    assert set(right.values) == {"force", "friction", "indentation", "energy"}
    pressed = right.times > 0.25
    assert (right.band("force", right.times)[pressed] < 0.02 * right.values["force"].max()).all()
    assert right.value("friction", np.array([0.55])) == pytest.approx(
        0.5 * right.value("force", np.array([0.55])), rel=0.2
    )


@pytest.mark.parametrize(("time", "name"), [(0.3, "kidney-12"), (0.9, "kidney+12")])
def test_a_finger_at_rest_divides_the_approach_by_the_force_curve_of_its_position(time, name):
    place = sites.load_reference(name)
    depth = CubicSpline(np.append(0.0, place.force), np.append(0.0, place.indentation))
    static = brentq(lambda f: np.log1p(M * f / B) / M + depth(f) - 5e-3, 1e-6, 1.0, xtol=1e-14)
    assert reference.reference_solution(TOUCHES["stroke"]).value("force", np.array([time])) == pytest.approx(
        static, rel=1e-6
    )
