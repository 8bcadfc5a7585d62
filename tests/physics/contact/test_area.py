"""Laws of a contact area that grows with the force, and the approach derived from the same energy."""

import math

import numpy as np
import pytest
from pytest import approx
from scipy.integrate import quad

from palpate.nodes.tactile import flow
from palpate.physics.archive import read_arrays
from palpate.physics.bodies.large_displacement import nonlinearity
from palpate.physics.contact import area

R, E = 8e-3, 19e3 / (1.0 - 0.45**2)
LINEAR = np.zeros(0)
LAWS = {
    "ball": area.ball(R, E),
    "fingertip": area.fingertip(R, E),
    "table": area.of_table([0.02, 0.3, 1.0, 4.0], [1e-3, 4e-3, 4e-3, 12e-3]),
    "steep": area.of_table([0.1, 1.0], [1e-3, 0.031]),
}
laws = pytest.mark.parametrize("name", LAWS)
FORCES = np.geomspace(1e-3, 40.0, 60)


def radius(law, force):
    return area.radius_at(law.forces, law.radii, force)


def tabulated(name, rho=LINEAR):
    return area.with_approach(LAWS[name], area.MEAN / E, rho)


@pytest.mark.parametrize("force", [1e-6, 1e-3, 0.1, 1.0, 1.9])
def test_a_rigid_ball_follows_hertz(force):
    """a³ = 3fR/4E*, d = a²/R, dd/df = 1/2E*a, V = 2fd/5."""
    law = tabulated("ball")
    a = radius(law, force)
    assert a == approx((0.75 * force * R / E) ** (1.0 / 3.0), rel=1e-12)
    d, slope, energy = area.approach(law.table, force)
    assert d == approx(a * a / R, rel=1e-9) and slope == approx(0.5 / (E * a), rel=1e-9)
    assert energy == approx(0.4 * force * d, rel=1e-9)


def test_the_mean_displacement_under_hertz_is_four_fifths_of_the_depth():
    mean = quad(lambda q: 3.0 * q * math.sqrt(1.0 - q * q) * area.hertz_depth(q * q), 0.0, 1.0)[0]
    assert mean == approx(0.8, rel=1e-9) and 0.75 * mean == approx(area.MEAN, rel=1e-9)
    assert area.hertz_depth(1.0 + 1e-12) == approx(0.5, abs=1e-5)
    assert 0.75 * area.hertz_depth(1e6) == approx(1.0 / (math.pi * 1e3), rel=1e-5)  # point force


def test_the_pressure_has_the_width_of_a_biweight_patch():
    square = quad(lambda q: 3.0 * q**3 * math.sqrt(1.0 - q * q), 0.0, 1.0)[0]
    assert approx(2.0 * math.sqrt(square), rel=1e-9) == area.WIDTH


@laws
def test_the_radius_never_falls_and_the_approach_always_rises(name):
    law, forces = tabulated(name), np.geomspace(1e-9, 1e4, 3000)
    assert (np.diff([radius(law, f) for f in forces]) >= 0.0).all()
    found = np.array([area.approach(law.table, f) for f in forces])
    assert (np.diff(found[:, 0]) > 0.0).all() and (found[:, 1] > 0.0).all() and (np.diff(found[:, 2]) > 0.0).all()


@laws
@pytest.mark.parametrize("poisson", [None, 0.3, 0.49])
def test_the_work_of_the_force_is_the_energy(name, poisson):
    law = tabulated(name, LINEAR if poisson is None else nonlinearity(poisson))
    forces = np.cumsum(np.full(4000, 3e-4))
    found = np.array([area.approach(law.table, f) for f in forces])
    work = np.sum(0.5 * (forces[1:] + forces[:-1]) * np.diff(found[:, 0]))
    assert work == approx(found[-1, 2] - found[0, 2], rel=2e-3)
    if poisson is None and name != "steep":
        right = [0.5 * f * f * area.MEAN / (E * radius(law, f)) for f in forces]
        assert found[:, 2] == approx(right, rel=5e-3, abs=1e-9)


def test_a_fixed_radius_is_linear():
    law = area.with_approach(area.of_table([1e-9], [5e-3]), area.MEAN / E, LINEAR)
    for force in (0.01, 0.5, 3.0):
        assert area.approach(law.table, force)[0] == approx(area.MEAN / (E * 5e-3) * force, rel=2e-3)


def test_two_spheres_follow_hertz(monkeypatch):
    """A spherical finger on a plate is compared with the same finger on a soft body: 1/E* is the sum of both."""
    forces, own = np.geomspace(1e-3, 2.0, 12), 40e3
    monkeypatch.setattr(area, "PLATE", (forces, np.cbrt(0.75 * forces * R / own)))
    law = area.fingertip(R, E)
    assert law.radii == approx(np.cbrt(0.75 * forces * R * (1.0 / own + 1.0 / E)), rel=1e-12)


def test_the_plate_law_is_the_shipped_curve_of_the_finger_model():
    table = read_arrays(flow.TABLE)
    forces, radii = (np.array(each)[:-1] for each in area.PLATE)
    right = np.sqrt(np.interp(forces, table["steel.force"], table["steel.area"]) / math.pi)
    assert radii == approx(right, rel=2e-3)


def test_on_silicone_the_area_is_within_10_percent_of_the_finger_model():
    """Two deformable bodies by full finite elements: the finger, 9.84 mm, on a block of 180 kPa, nu 0.48."""
    table = read_arrays(flow.TABLE)
    law = area.fingertip(9.84e-3, 180e3 / (1.0 - 0.48**2))
    for force, right in zip(table["silicone.force"], table["silicone.area"], strict=True):
        if force > 0.01:
            assert math.pi * radius(law, force) ** 2 == approx(right, rel=0.1)


@pytest.mark.parametrize(
    ("forces", "radii", "printed"),
    [
        ([], [], "at least one"),
        ([1.0, 2.0], [1e-3], "a radius for each force"),
        ([1.0, 1.0], [1e-3, 2e-3], "forces that rise"),
        ([0.1, 1.0], [2e-3, 1e-3], "the radius goes from 2 mm at 0.1 N to 1 mm at 1 N"),
        ([0.1, 0.11], [1e-3, 8e-3], "grows at most as"),
        ([0.0, 1.0], [1e-3, 2e-3], "rise from above 0"),
        ([0.1, math.nan], [1e-3, 2e-3], "rise from above 0"),
        ([0.1, 1.0], [1e-3, math.inf], "radii above 0"),
    ],
)
def test_an_invalid_law_is_an_error(forces, radii, printed):
    with pytest.raises(ValueError, match=printed):
        area.of_table(forces, radii)
