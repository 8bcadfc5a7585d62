"""Stress below a patch: the equations of the half-space, closed forms, and Hertz's contact."""

import math

import numpy as np
import pytest
from pytest import approx
from scipy.integrate import dblquad

from palpate.launch.testing import FakeBus
from palpate.messages import Load
from palpate.models.fe.contact.protocol import ElasticFoundation
from palpate.models.fe.element.mesh import EDGES
from palpate.models.fe.solve.solver import Solver
from palpate.nodes.base import SettingError
from palpate.nodes.tactile.stress import Stress
from palpate.physics.contact import subsurface
from palpate.physics.contact.spread import KERNELS
from palpate.physics.contact.subsurface import PAIRS, point_stress, strain_energy_of, under_patch, von_mises_of
from palpate.physics.materials.neo_hooke import neo_hooke
from palpate.studies.peers.continuum import BED, POISSON, STEPS, YOUNG, TissueBlock, tetrahedra

R, NU = 8e-3, 0.3
AT = np.array([0.3, -0.5, 0.7])


def slope(f, i, step=1e-4):
    e = step * np.eye(3)[i]
    return (f(AT + e) - f(AT - e)) / (2.0 * step)


def stress(points):
    return point_stress(points, NU)


def test_a_point_force_is_in_equilibrium_with_its_stress():
    divergence = sum(slope(stress, i)[i] for i in range(3))
    assert np.abs(divergence).max() < 1e-6 * np.abs(stress(AT)).max()
    assert stress(AT) == approx(stress(AT).swapaxes(0, 1))


def test_the_strain_is_compatible():
    """Beltrami's and Michell's equations, with the trace -(1 + nu) r_k/(pi rho³) that a harmonic pressure has."""

    def trace(points):
        return -(1.0 + NU) * points / (math.pi * np.linalg.norm(points) ** 3)

    assert np.einsum("iik->k", stress(AT)) == approx(trace(AT))

    laplace = sum(_second(stress, i, i) for i in range(3))
    bend = np.array([[_second(trace, i, j) for j in range(3)] for i in range(3)])
    assert np.abs(laplace + bend / (1.0 + NU)).max() < 1e-4 * np.abs(laplace).max()


def _second(f, i, j, step=1e-3):
    a, b = step * np.eye(3)[i], step * np.eye(3)[j]
    return (f(AT + a + b) - f(AT + a - b) - f(AT - a + b) + f(AT - a - b)) / (4.0 * step * step)


def test_the_surface_is_free_except_at_the_point():
    assert np.abs(stress(np.array([0.3, -0.5, 1e-9]))[2]).max() < 1e-7


@pytest.mark.parametrize("k", range(3))
def test_a_plane_below_carries_the_whole_force(k):
    def carried(r, turn):
        return r * stress(np.array([r * math.cos(turn), r * math.sin(turn), 0.7]))[2, k, k]

    total = dblquad(carried, 0.0, 2.0 * math.pi, 0.0, 300.0, epsabs=1e-5)[0]
    assert total == approx(-1.0, abs=5e-3)


@pytest.mark.parametrize("depth", [0.5e-3, 4e-3, 8e-3, 16e-3])
def test_on_the_axis_of_a_biweight_patch_the_normal_stress_has_its_closed_form(depth):
    zeta = depth / R
    a = 1.0 + zeta**2
    right = a * a - 6.0 * a * zeta**2 - 3.0 * zeta**4 + 8.0 * zeta**3 * math.sqrt(a)
    found = under_patch(np.array([[0.0, 0.0, depth]]), R, "biweight", 0.45)[0, 2, 2, 2]
    assert found == approx(-right * 3.0 / (math.pi * R * R), rel=1e-5)


def test_the_largest_shear_under_hertz_is_at_half_the_contact_radius():
    """0.310 p0 at 0.48 a for nu = 0.3, and sigma_z = -p0/(1 + z²/a²) on the axis (Johnson, eq. 3.45 and table 4.1)."""
    peak = 1.5 / (math.pi * R * R)
    depth = np.linspace(0.2, 1.0, 161) * R
    found = under_patch(np.column_stack([0 * depth, 0 * depth, depth]), R, "hertz", 0.3)[..., 2]
    assert found[:, 2, 2] == approx(-peak / (1.0 + (depth / R) ** 2), rel=2e-3)
    shear = 0.5 * np.abs(found[:, 2, 2] - found[:, 0, 0])
    assert shear.max() == approx(0.310 * peak, rel=2e-3)
    assert depth[shear.argmax()] == approx(0.48 * R, abs=0.01 * R)


@pytest.mark.parametrize("kernel", KERNELS)
def test_a_patch_equals_the_sum_of_many_points(kernel):
    """The sum uses squares instead of rings, off the axis, for forces of any direction."""
    place, force, n = np.array([3e-3, -5e-3, 2e-3]), np.array([0.3, -0.2, 1.0]), 161
    grid = R * (np.arange(n) + 0.5 - 0.5 * n) / (0.5 * n)
    x, y = (a.ravel() for a in np.meshgrid(grid, grid))
    share = subsurface.kernel_values(kernel, np.hypot(x, y) / R)
    each = stress(place - np.column_stack([x, y, 0 * x])) @ force
    right = np.tensordot(share / share.sum(), each, axes=1)
    found = under_patch(place[None], R, kernel, NU)[0] @ force
    assert found == approx(right, rel=2e-3, abs=2e-3 * np.abs(right).max())


def test_a_point_at_the_surface_is_an_error():
    with pytest.raises(ValueError, match="expected at least 8e-05 m"):
        under_patch(np.array([[0.0, 0.0, 1e-5]]), R, "biweight", NU)


def test_equivalent_stress_and_energy_are_right_for_tension_and_shear():
    stress, equivalent, energy = np.array([[5.0, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, 5.0]]), np.zeros(2), np.zeros(2)
    von_mises_of(stress, equivalent)
    strain_energy_of(stress, 100.0, NU, energy)
    assert equivalent == approx([5.0, 5.0 * math.sqrt(3.0)]) and equivalent == approx(von_mises(stress))
    assert energy == approx([25.0 / 200.0, 25.0 * (1.0 + NU) / 100.0])
    assert energy == approx(strain_energy_density(stress, 100.0, NU))
    assert PAIRS[5] == (0, 1)


def test_full_finite_elements_have_the_same_stress_below_a_patch():
    """`fe.Solver` with a light load and a surface free to slide; means over rings 0.25 R wide and deep."""
    block, force = TissueBlock(0.0, 3, radius=R, sticks=False), 1e-3
    cut = tetrahedra(block)
    bed = ElasticFoundation(cut.under, BED * YOUNG)
    law = {0: neo_hooke(YOUNG, POISSON)}
    body = Solver(cut.mesh, law, cut.fixed, loads=lambda f: 0.5 * f * cut.unit, contacts=[bed], settings=STEPS)
    body.advance(force)
    corner, u = cut.mesh.points[cut.mesh.elements[:, :4]], body.displacement[cut.mesh.elements]
    slopes = np.linalg.inv(np.concatenate([np.ones((len(corner), 4, 1)), corner], axis=2))[:, 1:]
    gradient = sum(  # at the centroid only the nodes on the edges count
        u[:, 4 + k, :, None] * (slopes[:, :, i] + slopes[:, :, j])[:, None] for k, (i, j) in enumerate(EDGES)
    )
    strain = 0.5 * (gradient + gradient.swapaxes(1, 2))
    volume = np.trace(strain, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    right = YOUNG / (1.0 + POISSON) * (strain + POISSON / (1.0 - 2.0 * POISSON) * volume)
    at = corner.mean(axis=1) * (1.0, 1.0, -1.0)
    away = np.hypot(at[:, 0], at[:, 1])
    near = (away < 1.2 * R) & (at[:, 2] > 0.15 * R) & (at[:, 2] < 1.2 * R)
    found, right = under_patch(at[near], R, "biweight", POISSON)[..., 2] * force, right[near]
    cell = (4.0 * away[near] / R).astype(int) * 10 + (4.0 * at[near, 2] / R).astype(int)
    peak = 3.0 * force / (math.pi * R * R)
    for value, most in ((lambda s: s[:, 2, 2], 0.015), (lambda s: von_mises(voigt(s)), 0.02)):
        off = np.bincount(cell, value(found) - value(right)) / np.maximum(np.bincount(cell), 1) / peak
        assert np.sqrt(np.mean(off[np.unique(cell)] ** 2)) < most
    assert von_mises(voigt(found)).max() == approx(0.5 * peak, rel=0.05)


def von_mises(stress):
    """[Pa] (k) of stresses (k,6), from the deviator."""
    mean = stress[:, :3].mean(axis=1, keepdims=True)
    return np.sqrt(1.5 * ((stress[:, :3] - mean) ** 2).sum(axis=1) + 3.0 * (stress[:, 3:] ** 2).sum(axis=1))


def strain_energy_density(stress, young, poisson):
    """[J/m³] (k): half of stress times strain, by Hooke's law."""
    strain = ((1 + poisson) * stress[:, :3] - poisson * stress[:, :3].sum(axis=1, keepdims=True)) / young
    return 0.5 * (stress[:, :3] * strain).sum(axis=1) + (stress[:, 3:] ** 2).sum(axis=1) * (1 + poisson) / young


def voigt(stress):
    return np.stack([stress[:, i, j] for i, j in PAIRS], axis=1)


def load(force, normal=(0.0, 0.0, 1.0)):
    nodes = np.arange(4, dtype=np.int32)
    return Load(nodes=nodes, forces=np.tile(np.array(force) / 4.0, (4, 1)), foot=(0.1, 0.2, 0.3), normal=normal)


def test_the_node_sends_the_stress_of_its_load_at_each_depth():
    bus = FakeBus(Stress(young=2e4, poisson=NU, depths=(1e-3, 3e-3), spacing=4e-3, reach=4e-3))
    pressed, rubbed, lifted = bus.publish(load((0, 0, -1.0)), load((0.5, 0, -1.0)), load((0, 0, 0)))
    points = pressed.points
    assert points.shape == (18, 3) and set(points[:, 2]) == {1e-3, 3e-3}
    right = under_patch(points, R, "biweight", NU)
    assert pressed.stress == approx(voigt(right[..., 2]))
    assert rubbed.stress == approx(voigt(right @ np.array([0.5, 0.0, 1.0])))
    assert pressed.von_mises == approx(von_mises(pressed.stress))
    assert pressed.energy_density == approx(strain_energy_density(pressed.stress, 2e4, NU))
    assert not lifted.stress.any() and not lifted.von_mises.any()


def test_the_stress_rotates_with_the_surface():
    bus = FakeBus(Stress(depths=(1e-3,), spacing=4e-3, reach=8e-3))
    level, steep = bus.publish(load((0.2, 0, -1.0)), load((0, -0.2, 1.0), (0.0, 0.6, -0.8)))
    c = -np.array([0.0, 0.6, -0.8])
    turned = bus.publish(load(tuple(0.2 * np.array([1.0, 0, 0]) + c), (0.0, 0.6, -0.8)))[0]
    assert turned.stress == approx(level.stress)
    assert steep.stress != approx(level.stress)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"depths": (1e-5, 1e-3)}, "depths of 8e-05 m and more"),
        ({"depths": ()}, "setting 'depths'"),
        ({"spacing": 1e-4, "reach": 1e-2}, "expected at most 10000"),
    ],
)
def test_invalid_points_are_errors(given, message):
    with pytest.raises(SettingError, match=message):
        FakeBus(Stress(**given))
