"""Spreading of the contact force over the nodes of a surface."""

import math

import numpy as np
import pytest
from formulas import PLANE_INTEGRALS
from hypothesis import given, settings
from hypothesis import strategies as st
from pressing import Spreader
from pytest import approx
from scipy.integrate import quad
from scipy.optimize import brentq

from palpate.launch.testing import FakeBus
from palpate.messages import Contact, Friction
from palpate.nodes.spread import Kernel
from palpate.physics.contact.spread import FACES, KERNELS, OFF, kernel_values, nearest_triangle
from palpate.physics.geometry.mesh import Mesh, plane
from palpate.physics.geometry.mesh_closest import MeshClosestPoint, nearest_weights
from palpate.studies.organs.shapes import boxes

UP = (0.0, 0.0, 1.0)
kernels = pytest.mark.parametrize("name", KERNELS)


def spread(spreader, foot, force=(0.3, -0.2, -2.0), normal=UP):
    count = spreader.spread(tuple(foot), normal, force)
    return spreader.nodes[:count].copy(), spreader.weights[:count].copy(), spreader.forces[:count].copy()


def bumpy(count, seed):
    """A closed wavy sphere of about 50 mm with irregular triangles."""
    from scipy.spatial import ConvexHull

    points = np.random.default_rng(seed).normal(size=(count, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    faces = ConvexHull(points).simplices
    corner = points[faces]
    flip = np.einsum("ij,ij->i", np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), corner[:, 0]) < 0
    faces[flip] = faces[flip][:, ::-1]
    return Mesh(points * (25e-3 + 3e-3 * np.sin(5 * points[:, :1])), faces.astype(np.int32))


@kernels
def test_kernels_are_one_at_the_foot_zero_at_the_radius_and_have_their_plane_integral(name):
    assert kernel_values(name, [0.0, 1.0, 1.5]) == approx([1, 0, 0], abs=1e-15)
    assert (np.diff(kernel_values(name, np.linspace(0, 1, 100))) < 0).all()
    whole = quad(lambda q: 2 * math.pi * q * float(kernel_values(name, q)), 0, 1, epsabs=1e-13)[0]
    assert whole == approx(PLANE_INTEGRALS[KERNELS.index(name)], rel=1e-10)


@kernels
@settings(max_examples=40, deadline=None)
@given(st.integers(0, 3), st.floats(-0.06, 0.06), st.floats(-0.06, 0.06), st.floats(1e-4, 0.03))
def test_the_nodal_forces_sum_to_the_force(name, seed, x, y, radius):
    mesh = bumpy(300, seed) if seed else plane(0.1, 900)
    force = np.array([0.3, -0.2, -2.0])
    _, weights, forces = spread(Spreader(mesh, radius, name), (x, y, 0.02 if seed else 0.0), tuple(force))
    assert forces.sum(axis=0) == approx(force, abs=1e-12)
    assert (weights >= 0).all() and weights.sum() == approx(1, abs=1e-12)


@kernels
def test_the_weights_equal_those_of_a_brute_force_sum(name):
    mesh = bumpy(800, 5)
    spreader = Spreader(mesh, 7e-3, name)
    for at in range(0, 800, 90):
        foot, normal = mesh.vertices[at] + 1e-4, mesh.normals[at]
        d = np.linalg.norm(mesh.vertices - foot, axis=1)
        faces = np.clip(mesh.normals @ normal / FACES, 0.0, 1.0)
        w = mesh.areas * kernel_values(name, d / 7e-3) * faces**2 * (3.0 - 2.0 * faces)
        dense = np.zeros(800)
        nodes, weights, _ = spread(spreader, foot, normal=tuple(normal))
        dense[nodes] = weights
        assert dense == approx(w / w.sum(), abs=1e-14)


@pytest.mark.parametrize(("name", "bound"), [("biweight", 1.8e-6), ("wendland", 0.04e-6)])
def test_the_residual_first_moment_is_small(name, bound):
    mesh = plane(0.04, 41**2)
    spreader = Spreader(mesh, 6e-3, name)
    worst = 0.0
    for x in np.linspace(-0.5e-3, 0.5e-3, 21):
        for y in np.linspace(-0.5e-3, 0.5e-3, 21):
            nodes, weights, _ = spread(spreader, (x, y, 0.0))
            worst = max(worst, np.linalg.norm(weights @ (mesh.vertices[nodes] - [x, y, 0.0])))
    assert 0.5 * bound < worst < bound


@kernels
def test_the_forces_move_continuously_with_the_foot(name):
    mesh = plane(0.04, 41**2)
    spreader = Spreader(mesh, 6e-3, name)
    before = None
    for x in np.linspace(0, 3e-3, 3001):
        dense = np.zeros(len(mesh.vertices))
        nodes, weights, _ = spread(spreader, (x, 0.37e-3, 0.0))
        dense[nodes] = weights
        # A step of 1 um changes a weight at most by the kernel's steepest slope; Hertz's falls like a square root.
        step = 1e-6 / 6e-3
        allowed = math.sqrt(2.0 * step) if name == "hertz" else 2.5 * step
        assert before is None or np.abs(dense - before).max() < allowed * weights.max()
        before = dense


def test_the_forces_move_continuously_with_a_normal_that_turns_at_the_edge_of_a_box():
    """A rounding error in the normal loaded the side of the box fully."""
    box = boxes((-0.02, 0.02), (-0.02, 0.02), (-0.02, 0.02), np.ones((1, 1, 1), bool), 4000)
    spreader, before = Spreader(box, 8e-3), None
    side, top = (np.abs(box.vertices[:, axis] - 0.02) < 1e-9 for axis in (0, 2))
    for angle in np.linspace(-0.2, np.pi / 2 + 0.2, 1801):
        dense = np.zeros(len(box.vertices))
        nodes, weights, _ = spread(spreader, (0.02, 0.0, 0.02), normal=(np.sin(angle), 0.0, np.cos(angle)))
        dense[nodes] = weights
        assert dense[side & ~top].sum() == 0.0 or angle > 0.0
        assert dense[side].sum() == approx(dense[top].sum()) or abs(angle - np.pi / 4) > 1e-9
        assert before is None or np.abs(dense - before).sum() < 4.0 * (np.pi / 2 + 0.4) / 1800
        before = dense


def test_the_back_of_a_thin_body_is_not_loaded():
    top = plane(0.04, 441)
    below = Mesh(top.vertices - [0, 0, 1e-3], top.triangles[:, ::-1])
    both = Mesh(np.concatenate([top.vertices, below.vertices]), np.concatenate([top.triangles, below.triangles + 441]))
    nodes, _, _ = spread(Spreader(both, 6e-3), (0.0, 0.0, 0.0))
    assert len(nodes) and (nodes < 441).all()
    nodes, _, _ = spread(Spreader(both, 6e-3), (0.0, 0.0, -1e-3), normal=(0.0, 0.0, -1.0))
    assert len(nodes) and (nodes >= 441).all()


def test_without_a_node_in_range_the_triangle_under_the_foot_carries_the_force():
    mesh = plane(0.1, 25)
    spreader = Spreader(mesh, 1e-3)
    for foot in ((0.003, 0.001, 0.0), (0.012, -0.03, 0.0), (-0.04, 0.045, 0.0)):
        nodes, weights, forces = spread(spreader, foot)
        assert len(nodes) == 3 and forces.sum(axis=0) == approx([0.3, -0.2, -2.0])
        assert weights @ mesh.vertices[nodes] == approx(foot, abs=1e-15)


@pytest.mark.parametrize("foot", [(1e3, 0.0, 0.0), (1e300, -1e300, 1e300), (0.0, 0.0, 5.0)])
def test_a_distant_foot_point_gives_valid_weights(foot):
    _, weights, forces = spread(Spreader(plane(0.1, 100), 8e-3), foot)
    assert weights.sum() == approx(1) and np.isfinite(forces).all()


def test_the_nearest_triangle_is_among_those_that_face_the_normal():
    mesh = bumpy(300, 7)
    rng = np.random.default_rng(0)
    for _ in range(30):
        p = rng.normal(size=3) * 0.03
        normal = p / np.linalg.norm(p)
        triangle, v, w = nearest_triangle(p, normal, mesh.vertices, mesh.triangles, mesh.face_vectors)
        here = np.array([1.0 - v - w, v, w]) @ mesh.vertices[mesh.triangles[triangle]]
        facing = Mesh(mesh.vertices, mesh.triangles[mesh.face_vectors @ normal > 0])
        foot, *_ = MeshClosestPoint(facing).find(p)
        assert np.linalg.norm(here - p) == approx(np.linalg.norm(foot - p), rel=1e-9)
    away = Mesh(mesh.vertices, mesh.triangles[mesh.face_vectors @ UP < 0])
    assert nearest_triangle(np.zeros(3), np.array(UP), away.vertices, away.triangles, away.face_vectors)[0] >= 0


@given(st.lists(st.floats(-1, 1), min_size=12, max_size=12))
def test_the_nearest_point_of_a_triangle_is_the_closest_of_all_points(x):
    p, a, b, c = np.array(x).reshape(4, 3)
    if np.linalg.norm(np.cross(b - a, c - a)) < 1e-9:
        return
    v, w, _ = nearest_weights(*(a - p), *(b - p), *(c - p))
    weights = np.array([1.0 - v - w, v, w])
    assert weights.min() >= -1e-9
    grid = np.array([[i, j, 12 - i - j] for i in range(13) for j in range(13 - i)]) / 12
    others = np.sum((grid @ np.array([a, b, c]) - p) ** 2, axis=1)
    assert np.sum((weights @ np.array([a, b, c]) - p) ** 2) <= others.min() + 1e-9


@pytest.mark.parametrize(("name", "radius"), [("cone", 8e-3), ("biweight", 0.0), ("biweight", math.inf)])
def test_wrong_settings_are_errors(name, radius):
    with pytest.raises(ValueError, match=r"unknown|expected a positive"):
        Spreader(plane(0.1, 100), radius, name)


def contact(load, normal=(0, 0, 1)):
    return Contact(
        foot=(1e-3, 2e-3, 0),
        normal=normal,
        force=load,
        compression=1e-3,
        indentation=1e-3,
        compression_rate=0,
        indentation_rate=0,
    )


def test_the_node_sends_the_force_on_the_body():
    node = Kernel(surface="plane", vertices=2500, position=(0, 0, 0))
    bus = FakeBus(node, friction=Friction(force=(0.4, 0.1, 0), bristle=(0, 0, 0), stick=False))
    (load,) = bus.publish(contact(2.0))
    assert load.forces.sum(axis=0) == approx([0.4, 0.1, -2.0], abs=1e-12)
    bus.kill("friction")
    loads = bus.publish(*[contact(2.0)] * 21)
    assert loads[9].forces.sum(axis=0) == approx([0.2, 0.05, -2.0], abs=1e-12)
    load = loads[-1]
    assert load.forces.sum(axis=0) == approx([0, 0, -2.0], abs=1e-12)
    assert (load.foot, load.normal) == ((1e-3, 2e-3, 0), (0, 0, 1))


def test_without_contact_the_load_is_empty():
    (load,) = FakeBus(Kernel(surface="plane", vertices=400)).publish(contact(0.0))
    assert load.nodes.size == 0 and load.forces.shape == (0, 3)


def radius_squared(off, radius):
    """Squared radius of a biweight patch whose foot is `off` from a plane: the area of the kernel over the plane is
    pi/3 (R² + s) (1 - q)³, q = (off² - s)/(R² + s)."""

    def missing(s):
        return (radius**2 + s) * (1.0 - (off**2 - s) / (radius**2 + s)) ** 3 - radius**2 * (1.0 - OFF**2) ** 3

    s = 0.0 if off <= OFF * radius else brentq(missing, max(0.5 * (off**2 - radius**2), 0.0), off**2)
    return radius**2 + 2.0 * s - off**2


def test_a_foot_off_the_surface_has_the_patch_of_a_cone():
    """The foot of a finger that follows the nearest point through the body: at the radius of the patch below the
    surface its force was that of single nodes."""
    mesh, radius = plane(0.1, 40_000), 8e-3
    spreader = Spreader(mesh, radius)
    for off in (0.0, 2e-3, 4e-3, 6e-3, 7.9e-3, 8.1e-3, 30e-3):
        for side in (1.0, -1.0):
            nodes, weights, forces = spread(spreader, (1e-3, 2e-3, side * off))
            area = math.pi * radius_squared(off, radius)
            assert len(nodes) * 0.1**2 / 40_000 == approx(area, rel=0.03)
            assert weights.max() < 3.3 / area * 0.1**2 / 40_000  # the biweight has 3 times the mean
            centre = weights @ mesh.vertices[nodes]
            assert centre == approx((1e-3, 2e-3, 0.0), abs=2e-5)
            assert forces.sum(axis=0) == approx((0.3, -0.2, -2.0), abs=1e-12)


def test_the_weights_change_at_a_continuous_rate_while_the_foot_passes_between_two_faces():
    """Inside an edge, where both faces are equally near, the rate of the nearest distance changes its sign: the force
    of a viscous body and fingertip fell from 4.2 to 3.0 N within 0.3 ms."""
    mesh = boxes(*[(-0.02, 0.02)] * 3, np.ones((1, 1, 1), bool), 20_000)
    spreader, radii = Spreader(mesh, 8e-3), []
    for x in np.linspace(-1.5e-3, 1.5e-3, 61):  # across the diagonal, 6.5 mm below both faces
        nodes, weights, _ = spread(spreader, (0.0135 + x, 0.0, 0.0135 - x), normal=(0.5**0.5, 0.0, 0.5**0.5))
        radii.append(weights @ np.linalg.norm(mesh.vertices[nodes] - (0.0135, 0.0, 0.0135), axis=1))
    rates = np.diff(radii) / 5e-5
    assert np.abs(np.diff(rates)).max() < 0.05 and np.ptp(rates) > 0.1


def test_a_patch_begins_to_be_widened_at_a_continuous_rate():
    """A foot that rises above a plate, and one that leaves it beyond its edge: where the patch reached the least area
    its radius, or its centre, moved at once at another rate, by 0.38 and 0.21 of the foot's. Beams under a finger that
    passed over a groove of 8 mm had not yielded, and their force rose by 0.14 N in a tick."""
    mesh, step = plane(0.06, 90_000), 5e-5
    spreader = Spreader(mesh, 8e-3)

    def rates(feet, measure):
        patches = (spread(spreader, foot)[:2] for foot in feet)
        return np.diff([measure(weights, mesh.vertices[nodes]) for nodes, weights in patches]) / step

    rising = rates(
        [(1e-3, 0.0, h) for h in np.arange(0.0, 8e-3, step)],
        lambda weights, at: np.sqrt(weights @ np.sum((at - (1e-3, 0.0, 0.0)) ** 2, axis=1)),
    )
    leaving = rates([(1e-3, y, 0.0) for y in np.arange(26e-3, 36e-3, step)], lambda weights, at: weights @ at[:, 1])
    assert np.abs(np.diff(rising)).max() < 0.03 and np.abs(np.diff(leaving)).max() < 0.03
    assert np.ptp(rising) > 0.2 and np.ptp(leaving) > 0.6


@pytest.mark.parametrize("half", [20e-3, 30e-3])  # to the rim, which alone faces a contact along the plate
@pytest.mark.parametrize("place", [(0.0, 0.0, 0.0), (-6e-3, 0.0, -2e-3)])
def test_the_load_passes_to_the_other_side_of_a_plate_while_the_contact_turns(half, place):
    """A foot inside a plate of 12 mm: all of the load passed to the underside while the contact turned by 0.001 rad,
    and the force of a viscous body and fingertip rose from 0.2 to 2.8 N within 2.5 ms."""
    mesh = boxes((-half, half), (-half, half), (-6e-3, 6e-3), np.ones((1, 1, 1), bool), 10_000)
    spreader, angles, rows = Spreader(mesh, 8e-3), np.linspace(1.2, -1.2, 1201), []
    for angle in angles:
        nodes, weights, _ = spread(spreader, place, normal=(-math.cos(angle), 0.0, math.sin(angle)))
        rows.append(np.bincount(nodes, weights, len(mesh.vertices)))
    passed = 0.5 * np.abs(np.diff(rows, axis=0)).sum(axis=1) / -np.diff(angles)
    assert passed.max() < 18.0  # shares of the load per radian
    top, under = (np.array(rows) @ (mesh.normals[:, 2] * sign > 0.9) for sign in (1.0, -1.0))
    assert top[0] > 0.9 and under[-1] > 0.9


def test_the_load_passes_over_an_edge_far_in_front_of_the_foot_while_the_contact_turns():
    """A foot inside a block, 12 mm below its top and 9 mm from its side: without the cone 8.9 shares per radian passed,
    and the force of BeamBundle rose from 2.5 to 3.7 N within 4 ms."""
    mesh = boxes((0.0, 30e-3), (-20e-3, 20e-3), (-25e-3, 10e-3), np.ones((1, 1, 1), bool), 20_000)
    spreader, angles, rows = Spreader(mesh, 8e-3), np.linspace(0.0, math.pi / 2.0, 787), []
    for angle in angles:
        nodes, weights, _ = spread(spreader, (21e-3, 0.0, -2e-3), normal=(math.sin(angle), 0.0, math.cos(angle)))
        rows.append(np.bincount(nodes, weights, len(mesh.vertices)))
    passed = 0.5 * np.abs(np.diff(rows, axis=0)).sum(axis=1) / np.diff(angles)
    assert passed.max() < 7.0
    top, side = (np.array(rows) @ (mesh.normals[:, axis] > 0.9) for axis in (2, 0))
    assert top[0] > 0.9 and side[-1] > 0.9


def test_the_weights_change_continuously_while_the_foot_crosses_a_ball():
    mesh = bumpy(3000, 2)
    spreader, before, change = Spreader(mesh, 8e-3), None, []
    for x in np.linspace(-25e-3, 25e-3, 2001):
        nodes, weights, _ = spread(spreader, (x, 1e-3, 2e-3), normal=(0.0, 0.6, 0.8))
        now = np.zeros(len(mesh.vertices))
        now[nodes] = weights
        change += [np.abs(now - before).sum()] if before is not None else []
        before = now
    assert max(change) < 0.1  # steps of 25 um; in all 7
    assert sum(change) > 1.0
