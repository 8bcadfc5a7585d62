"""The fingerpad on soft tissue, compared with published values, closed inverses, quadrature and another root finder."""

import numpy as np
import pytest
from formulas import pad_pressure, tissue_displacement
from hypothesis import given
from hypothesis import strategies as st
from pytest import approx
from scipy.integrate import dblquad, quad
from scipy.optimize import brentq

from palpate.physics.display.shape_display import (
    FINGERPADS,
    Fingerpad,
    bulge,
    deflection_under,
    pad_contact,
    pad_displacement,
)

PAD = FINGERPADS["canonical"]
# E_t [Pa]: force [N]: x, delta, a [mm]
STATES = {
    5e3: {1: (1.91376, 12.96162, 10.183), 3: (2.54012, 25.95970, 14.411), 4: (2.72411, 31.20508, None)},
    15e3: {1: (2.14838, 7.11786, 7.546), 3: (2.84781, 13.62382, 10.440), 4: (3.05080, 16.21917, None)},
    60e3: {1: (2.38881, 4.03823, 5.684), 3: (3.19264, 6.96141, 7.463), 4: (3.42375, 8.08620, None)},
    np.inf: {1: (2.58990, 2.58990, 4.552), 3: (3.56094, 3.56094, 5.337), 4: (3.84914, 3.84914, None)},
}


def force_of(x, modulus, poisson=0.5, radius=np.inf, pad=PAD):
    """The force at a given deformation, in closed form."""
    stiff = 2 * pad.b / pad.m * np.expm1(pad.m * x)
    approach = x * (1 + (1 - poisson**2) / modulus * stiff)
    both = 1 / (1 / stiff + (1 - poisson**2) / modulus)
    r = 1 / (1 / pad.radius + 1 / radius)
    return 4 / 3 * both * np.sqrt(r) * approach**1.5


@pytest.mark.parametrize("modulus", STATES)
def test_the_states_equal_the_table(modulus):
    for force, (x, approach, radius) in STATES[modulus].items():
        contact = pad_contact(force, modulus)
        assert contact.deflection * 1e3 == approx(x, abs=1e-5)
        assert contact.approach * 1e3 == approx(approach, abs=1e-5)
        assert radius is None or contact.radius * 1e3 == approx(radius, abs=1e-3)


@pytest.mark.parametrize("pad", FINGERPADS.values(), ids=FINGERPADS)
@pytest.mark.parametrize("modulus", STATES)
def test_brents_method_finds_the_same_states(modulus, pad):
    for force in (1e-3, 0.2, 1.0, 3.0, 4.0):
        x = brentq(lambda x, f=force: force_of(x, modulus, pad=pad) - f, 1e-9, 0.05, xtol=1e-18, rtol=1e-15)
        assert pad_contact(force, modulus, pad=pad).deflection == approx(x, rel=1e-12)


@given(
    x=st.floats(-9, -1.5).map(lambda e: 10.0**e),
    modulus=st.floats(2, 8).map(lambda e: 10.0**e),
    poisson=st.floats(-0.9, 0.5),
    curvature=st.floats(-40, 400),
    b=st.floats(5, 7.5).map(lambda e: 10.0**e),
    m=st.floats(50, 900),
    size=st.floats(4e-3, 2e-2),
)
def test_the_root_inverts_the_closed_form_of_the_force(x, modulus, poisson, curvature, b, m, size):
    pad, radius = Fingerpad(b, m, size), np.inf if curvature == 0 else 1 / curvature
    force = force_of(x, modulus, poisson, radius, pad)
    assert pad_contact(force, modulus, poisson, radius, pad).deflection == approx(x, rel=1e-10)


def test_the_calibrated_finger_passes_through_its_fitted_points():
    contact = pad_contact([0.11, 0.50], np.inf, pad=FINGERPADS["calibrated"])
    assert contact.deflection * 1e3 == approx([1.24, 2.08], abs=1e-2)


@pytest.mark.parametrize(("force", "modulus"), [(0.05, 15e3), (1.0, 5e3), (3.0, 15e3), (4.0, np.inf)])
def test_the_pressure_integrates_to_the_force(force, modulus):
    state = pad_contact(force, modulus)
    total, _ = quad(lambda r: 2 * np.pi * r * float(pad_pressure(r, state)), 0, float(state.radius))
    assert total == approx(force, rel=1e-8)
    assert pad_pressure(1.01 * state.radius, state) == 0


def test_deflection_and_approach_are_one_on_a_rigid_plate():
    state = pad_contact(np.linspace(0, 4, 9), np.inf)
    np.testing.assert_array_equal(state.deflection, state.approach)
    assert tissue_displacement(1e-3, state) == approx(np.zeros(9), abs=1e-18)


def test_softer_tissue_gives_more_motion_a_larger_contact_and_less_deformation():
    state = pad_contact(1.0, np.geomspace(1e2, 1e8, 60))
    assert np.all(np.diff(state.approach) < 0)
    assert np.all(np.diff(state.radius) < 0)
    assert np.all(np.diff(state.deflection) > 0)


@pytest.mark.parametrize("modulus", STATES)
def test_deflection_and_approach_grow_concavely_with_force(modulus):
    state = pad_contact(np.linspace(0, 4, 81), modulus)
    for value in (state.deflection, state.approach):
        assert np.all(np.diff(value) > 0)
        assert np.all(np.diff(value, 2) < 0)


@pytest.mark.parametrize("radius", [np.inf, 0.05, -0.05])
def test_inside_the_contact_both_displacements_sum_to_the_approach(radius):
    state = pad_contact(0.7, 15e3, 0.45, radius)
    r = np.linspace(0, float(state.radius), 50)
    both = pad_displacement(r, state) + tissue_displacement(r, state)
    assert both == approx(state.approach - r**2 * state.curvature / 2, rel=1e-12)
    assert pad_displacement(0.0, state) == approx(state.deflection, rel=1e-12)


def test_the_displacement_is_that_of_the_pressure_on_a_half_space():
    """Boussinesq: u(r) = integral of p/(pi E* distance), in polar coordinates around the point r."""
    state = pad_contact(0.3, 15e3)
    a = float(state.radius)
    for r in (0.0, 0.4 * a, 0.99 * a, 1.3 * a, 4.0 * a):

        def chord(angle, r=r):
            inside = a**2 - (r * np.sin(angle)) ** 2
            half = np.sqrt(max(inside, 0.0))
            return max(-r * np.cos(angle) - half, 0.0), max(-r * np.cos(angle) + half, 0.0)

        total, _ = dblquad(
            lambda s, angle, r=r: float(pad_pressure(np.sqrt(r**2 + s**2 + 2 * r * s * np.cos(angle)), state)),
            0, np.pi, lambda t: chord(t)[0], lambda t: chord(t)[1], epsabs=1e-6, epsrel=1e-6,
        )  # fmt: skip
        assert pad_displacement(r, state) == approx(2 * total / (np.pi * state.pad_modulus), rel=1e-4)


def test_far_away_the_displacement_is_that_of_a_point_force():
    state = pad_contact(0.3, 15e3)
    r = float(state.radius) * np.array([1e2, 1e4, 1e8])
    assert pad_displacement(r, state) == approx(0.3 / (np.pi * state.pad_modulus * r), rel=1e-4)


def test_the_displacement_falls_continuously_with_distance():
    state = pad_contact(1.0, 15e3)
    r = float(state.radius) * np.concatenate([np.linspace(0, 1, 200), np.geomspace(1, 1e6, 400)[1:]])
    u = pad_displacement(r, state)
    assert np.all(np.diff(u) < 0) and u[-1] > 0
    a = float(state.radius)
    assert bulge(a * (1 + 1e-12), a) == approx(bulge(a, a), rel=1e-9)
    five = 5 * a  # here the series replaces the closed form
    assert bulge(five * (1 + 1e-12), a) == approx(bulge(five, a), rel=1e-11)


def test_zero_force_gives_zeros_and_a_tiny_force_tiny_states():
    state = pad_contact(0.0, 15e3)
    assert [float(v) for v in state[:5]] == [0, 0, 0, 0, 0] and state.valid
    assert pad_displacement([0.0, 1e-3], state) == approx([0, 0], abs=0)
    tiny = pad_contact(1e-9, 15e3)
    assert 0 < tiny.deflection < tiny.approach < 1e-5


@pytest.mark.parametrize("force", [1e-300, 1e-30, 1e-9, 1e3, 1e6, 1e12, 1e100, 1e300])
@pytest.mark.parametrize("modulus", [1e-3, 15e3, 1e12, np.inf])
def test_any_force_gives_finite_states(force, modulus):
    state = pad_contact(force, modulus)
    assert all(np.isfinite(v) for v in state)
    assert state.deflection <= state.approach
    if 1e-100 < force < 1e100 and modulus > 1:
        assert float(force_of(state.deflection, modulus)) == approx(force, rel=1e-9)


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"force": [1.0, -1e-9], "modulus": 1e4}, r"force: found -1e-09 at index 1, expected a finite force >= 0 N"),
        ({"force": np.nan, "modulus": 1e4}, "force: found nan"),
        ({"force": np.inf, "modulus": 1e4}, "force: found inf"),
        ({"force": 1.0, "modulus": 0.0}, "modulus: found 0.0, expected a modulus > 0"),
        ({"force": 1.0, "modulus": 1e4, "poisson": 0.6}, "poisson: found 0.6"),
        ({"force": 1.0, "modulus": 1e4, "radius": -0.008}, "radius: found -0.008"),
        ({"force": 1.0, "modulus": 1e4, "radius": 0.0}, "radius: found 0.0"),
        ({"force": 1.0, "modulus": 1e4, "pad": Fingerpad(0.0, 1.0, 1.0)}, "pad: found"),
    ],
)
def test_invalid_arguments_are_errors_with_their_names(given, text):
    with pytest.raises(ValueError, match=text):
        pad_contact(**given)


def test_the_validity_flag_ends_at_half_the_radius_of_the_fingerpad():
    # On flat tissue a = R_f/2 means delta = R_f/4; the force there has a closed form on a rigid plate.
    limit = force_of(PAD.radius / 4, np.inf)
    assert pad_contact(limit * 0.999, np.inf).valid and not pad_contact(limit * 1.001, np.inf).valid
    assert not pad_contact(3.0, 15e3).valid


def test_one_call_computes_thousands_of_states():
    force, modulus = np.linspace(0, 4, 60)[:, None], np.geomspace(1e3, 1e6, 50)
    table = pad_contact(force, modulus)
    assert table.deflection.shape == table.valid.shape == (60, 50)
    assert table.approach[17, 31] == pad_contact(force[17, 0], modulus[31]).approach


def test_the_deflection_under_a_pressure_solves_its_equation():
    for load in (1e-12, 1e-3, 1.0, 1e5, 1e9):
        x = deflection_under(load, PAD.b, PAD.m)
        assert x * 2.0 * PAD.b / PAD.m * np.expm1(PAD.m * x) == approx(load, rel=1e-11)
