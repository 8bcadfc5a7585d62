"""Ogden, Demiray, Yeoh and the Prony series: closed forms, shear modulus at rest, published constants."""

import numpy as np
import pytest
from pytest import approx

from palpate.models.fe import MaterialError, demiray, mooney_rivlin, neo_hooke, ogden, yeoh
from palpate.physics.materials.hyperelastic import moduli, rest_moduli, uniaxial
from palpate.physics.materials.prony import relax_response, relaxed_slopes

STRETCH = np.array([0.4, 0.7, 0.9, 0.99, 1.01, 1.2])
LAWS = {
    "ogden": (ogden(0.49, 6e3, 4.7, 2e3, -3.0), 8e3),
    "demiray": (demiray(3e4, 0.499, 2.0), 3e4 / 2.998),
    "yeoh": (yeoh(0.49, 5e3, 1.2e3, 150.0), 1e4),
}


@pytest.mark.parametrize("name", LAWS)
def test_the_shear_modulus_at_rest_agrees_with_finite_differences(name):
    material, shear = LAWS[name]
    assert rest_moduli(material)[0] == approx(shear, rel=1e-9)
    h = 1e-4
    slope = np.diff(uniaxial(material, np.array([1 - h, 1 + h])))[0] / (2 * h)
    assert slope == approx(3 * shear, rel=1e-6)  # E = 3 G, incompressible


def test_uniaxial_stress_has_its_closed_form():
    l = STRETCH
    i1 = l**2 + 2 / l - 3
    of_i1 = 2 * (l - l**-2)
    mu, alpha = np.array([6e3, 2e3]), np.array([4.7, -3.0])
    expected = sum(2 * m / a * (l ** (a - 1) - l ** (-a / 2 - 1)) for m, a in zip(mu, alpha, strict=True))
    assert uniaxial(LAWS["ogden"][0], l) == approx(expected, rel=1e-9)
    assert uniaxial(LAWS["demiray"][0], l) == approx(of_i1 * 0.5 * 3e4 / 2.998 * np.exp(2 * i1), rel=1e-9)
    assert uniaxial(LAWS["yeoh"][0], l) == approx(of_i1 * (5e3 + 2 * 1.2e3 * i1 + 3 * 150 * i1**2), rel=1e-9)


def test_ogden_with_alpha_2_and_demiray_with_small_b_are_neo_hooke():
    expected = uniaxial(neo_hooke(3e4, 0.49), STRETCH)
    shear = moduli(3e4, 0.49)[0]
    assert uniaxial(ogden(0.49, shear, 2.0), STRETCH) == approx(expected, rel=1e-9)
    assert uniaxial(demiray(3e4, 0.49, 1e-9), STRETCH) == approx(expected, rel=1e-6)
    assert uniaxial(yeoh(0.49, shear / 2), STRETCH) == approx(expected, rel=1e-9)
    both = mooney_rivlin(shear / 2, 0.0, 800.0, 0.0, 0.0, 1e-6)
    assert uniaxial(yeoh(0.49, shear / 2, 800.0), STRETCH) == approx(uniaxial(both, STRETCH), rel=1e-9)


def test_published_constants_give_the_measured_stress():
    """Human cortex (Budday et al. 2017), compression: -1.148 kPa measured at a stretch of 0.9; silicone EF10 without
    thinner (Dawood et al. 2026): 254 kPa at 20 of 30 mm, constants in the form (mu/alpha) sum l^alpha."""
    assert uniaxial(ogden(0.499, 1.61e3, -16.6), np.array([0.9]))[0] == approx(-1.148e3, rel=0.01)
    alpha = 4.716
    assert uniaxial(ogden(0.499, 6.053e3 * alpha / 2, alpha), np.array([1 / 3]))[0] == approx(-254e3, rel=0.05)


T = np.linspace(0.0, 1.0, 3)


@pytest.mark.parametrize(
    "make", [lambda: ogden(0.4, 1e3), lambda: ogden(0.4, 1e3, 0.0), lambda: ogden(0.4, -1e3, 2.0),
             lambda: ogden(0.5, 1e3, 2.0), lambda: ogden(-1.5, 1e3, 2.0), lambda: demiray(1e4, 0.4, 0.0),
             lambda: yeoh(0.4, 0.0), lambda: yeoh(0.4, 1e3, float("nan")),
             lambda: relax_response([0.5, 0.6], [1.0, 2.0], T, T), lambda: relax_response([0.5], [0.0], T, T),
             lambda: relax_response([0.5], [1.0, 2.0], T, T)]
)  # fmt: skip
def test_impossible_constants_are_errors(make):
    with pytest.raises(MaterialError, match="expected"):
        make()


def test_a_prony_series_relaxes_a_step_and_a_ramp_like_the_integral():
    series = [0.3, 0.4], [0.1, 2.0]
    time = np.linspace(0.0, 3.0, 31)
    step = 1.0 + 0.3 * np.expm1(-time / 0.1) + 0.4 * np.expm1(-time / 2.0)
    assert relax_response(*series, time, np.ones(31)) == approx(step, rel=1e-12)
    ramp = time - 0.3 * (time - 0.1 * -np.expm1(-time / 0.1)) - 0.4 * (time - 2.0 * -np.expm1(-time / 2.0))
    assert relax_response(*series, time, time) == approx(ramp, rel=1e-12)
    assert relax_response(*series, np.array([0.0, 1e9]), np.ones(2))[1] == approx(0.3)


def test_slopes_of_a_prony_series_are_those_of_its_step_and_ramp():
    """Derivatives of the closed forms by each share and by the logarithm of each time."""
    g, tau = np.array([0.3, 0.4]), np.array([0.1, 2.0])
    time = np.linspace(0.0, 3.0, 31)
    x = time[:, None] / tau
    step = np.stack([np.expm1(-x), g * x * np.exp(-x)], axis=2).reshape(-1, 4)
    assert relaxed_slopes(g, tau, time, np.ones(31)) == approx(step, rel=1e-11, abs=1e-13)
    ramp = np.stack([-tau * np.expm1(-x) - time[:, None], g * tau * (-np.expm1(-x) - x * np.exp(-x))], axis=2)
    assert relaxed_slopes(g, tau, time, time) == approx(ramp.reshape(-1, 4), rel=1e-11, abs=1e-13)
