"""A ball on a bonded layer: the integral equation compared with limits, published series, and finite elements."""

import numpy as np
import pytest
from pytest import approx

from palpate.models.fe.axisymmetric import Indenter, layer, press_round
from palpate.physics.contact import layer as bonded
from palpate.physics.contact.layer import MOST, solve_layer, thickness_factor
from palpate.physics.materials.neo_hooke import neo_hooke


@pytest.mark.parametrize("poisson", [0.0, 0.3, 0.45, 0.5])
def test_a_thick_layer_is_a_half_space_and_a_thin_one_is_stiffer(poisson):
    chi, factor = solve_layer(1e-3, poisson)
    assert chi == approx(1e-3, rel=1e-3) and factor == approx(1.0, abs=2e-3)  # a² = R s
    factors = thickness_factor(poisson)(np.linspace(0.0, thickness_factor(poisson).x[-1], 50))
    assert (np.diff(factors) > 0.0).all()


def test_the_table_interpolates_the_solution():
    factor = thickness_factor(0.5)
    for wide in (0.03, 0.33, 0.777, 1.83):
        chi, exact = solve_layer(wide, 0.5)
        assert factor(chi) == approx(exact, rel=1e-5)
    assert factor.x[-1] == approx(solve_layer(MOST, 0.5)[0])


@pytest.mark.parametrize(("poisson", "first"), [(0.5, 1.133), (0.3, 0.881)])
def test_the_first_term_equals_that_of_dimitriadis(poisson, first):
    """The term -2 a0/pi of eq. 11 of Dimitriadis et al."""
    chi, factor = solve_layer(0.01, poisson)
    assert (factor - 1.0) / chi == approx(first, rel=0.02)


@pytest.mark.parametrize("poisson", [0.0, 0.3])
def test_a_thin_compressible_layer_is_an_elastic_foundation(poisson, monkeypatch):
    """K. L. Johnson, Contact Mechanics (1985), 5.8: F = pi M R s²/h with s = a²/2R, M the modulus of confined
    compression; the contribution of the rim is proportional to h/a."""
    monkeypatch.setattr(bonded, "POINTS", 120)
    monkeypatch.setattr(bonded, "WAVES", 1200)
    confined = (1.0 - poisson) / ((1.0 + poisson) * (1.0 - 2.0 * poisson))
    rims = []
    for wide in (4.0, 8.0):
        chi, factor = solve_layer(wide, poisson)
        force = 4.0 / 3.0 / (1.0 - poisson**2) * chi**3 * factor  # R F/(E h³)
        rims.append(force / (np.pi * confined * (0.5 * wide**2) ** 2) - 1.0)
    assert rims[1] == approx(0.5 * rims[0], rel=0.06)
    assert 0.0 < rims[1] < 0.1


def test_full_finite_elements_agree_where_the_series_does_not():
    """A ball of 12 thicknesses, 3 % deep: neo-Hooke, nearly incompressible; Dimitriadis' series is 8 % below."""
    thick, radius, young = 8e-3, 96e-3, 1e4
    depth = 0.03 * thick
    contact = 1.2 * np.sqrt(radius * depth)
    body = layer(thick, contact, 8)
    under = body.top[: 2 * int(np.searchsorted(body.across[::2], 2.0 * contact)) + 1]
    ball = Indenter(np.zeros(0, np.int64), False, under, radius)
    force = press_round(body, neo_hooke(young, 0.499), ball, [0.5 * depth, depth])[-1]
    chi = np.sqrt(radius * depth) / thick
    hertz = 4.0 / 3.0 * young / (1.0 - 0.499**2) * np.sqrt(radius) * depth**1.5
    assert force == approx(hertz * thickness_factor(0.499)(chi), rel=0.03)
    assert hertz * np.polyval([0.101, 0.763, 1.279, 1.131, 1.0], chi) < 0.94 * force
