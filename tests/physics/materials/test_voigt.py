"""The generalised Voigt chain compared with closed forms."""

import numpy as np
import pytest
from formulas import stress_history
from pytest import approx

from palpate.physics.materials.voigt import STRAIN_LIMIT, chain_strain_step, chain_stress_step

E = np.array([3.4e4, 1.36e5])
C = E * np.array([1.4, 0.07])
ONES = np.ones(2)
TAU = C.sum() / E.sum()
LONG_TERM = E.prod() / E.sum()


def ramp_and_hold(steps_a_second, end=1.0):
    time = np.linspace(0, end, round(end * steps_a_second) + 1)
    return time, np.minimum(time / 0.5, 1) * 0.2


def exact(time, rate=0.4, until=0.5):
    """Two elements under a ramp and then a hold: s + (C/Σc) terms solved by hand. Creep form: the strain of element 1
    satisfies (c1 + c2) e1' + (E1 + E2) e1 = E2 e + c2 e'."""
    t = np.minimum(time, until)
    e, de = rate * t, rate
    # Particular solution e1 = p t + q plus q-decay from rest.
    p = E[1] * rate / E.sum()
    q = (C[1] * de - C.sum() * p) / E.sum()
    e1 = p * t + q * (1 - np.exp(-t / TAU))
    de1 = p + q / TAU * np.exp(-t / TAU)
    during = E[0] * e1 + C[0] * de1
    end = E[1] * e[-1] / E.sum()
    e1_end = e1[-1]
    after_e1 = end + (e1_end - end) * np.exp(-(time - until) / TAU)
    after = E[0] * after_e1 - C[0] * (e1_end - end) / TAU * np.exp(-(time - until) / TAU)
    return np.where(time <= until, during, after)


def test_the_closed_form_has_the_reference_numbers():
    time = np.array([0.25, 0.5, 0.5 + 1e-12, 1.0])
    assert exact(time) == approx([10703.03, 15708.53, 12535.20, 7042.11], abs=0.01)
    assert approx([5440.0, 0.336]) == [LONG_TERM * 0.2, TAU]
    assert 0.4 * C.prod() / C.sum() == approx(15708.53 - 12535.20, abs=0.02)


def test_the_chain_converges_to_the_closed_form_at_first_order():
    errors = []
    for n in (1000, 2000, 4000):
        time, strain = ramp_and_hold(n)
        stress = stress_history(time, strain, E, C, ONES)
        at = [round(0.25 * n), round(0.5 * n), n]
        errors.append(np.abs(stress[at] - [10703.03, 15708.53, 7042.11]) / 1e4)
    errors = np.array(errors)
    assert np.all(errors[2] < 2e-3)
    assert errors[0] / errors[1] == approx([2, 2, 2], rel=0.1)
    assert errors[1] / errors[2] == approx([2, 2, 2], rel=0.1)


def test_richardson_extrapolation_gives_the_reference_numbers():
    coarse, fine = (stress_history(*ramp_and_hold(n), E, C, ONES) for n in (4000, 8000))
    stress = [2 * fine[round(t * 8000)] - coarse[round(t * 4000)] for t in (0.25, 0.5, 1.0)]
    assert stress == approx([10703.03, 15708.53, 7042.11], rel=1e-5)


def test_stress_relaxes_to_the_springs_in_series_with_shares():
    lengths = np.array([1.0, 3.0])
    shares = lengths / lengths.sum()
    time = np.concatenate([[0, 0.01], 0.01 + np.geomspace(1e-3, 60, 500)])
    stress = stress_history(time, np.where(time > 0, 0.2, 0.0), E, C, shares)
    assert stress[-1] == approx(0.2 / (shares / E).sum(), rel=1e-6)
    assert np.all(np.diff(stress[1:]) <= 1e-6)


def test_splitting_an_element_into_two_halves_changes_nothing():
    time, strain = ramp_and_hold(500)
    whole = stress_history(time, strain, E, C, [0.3, 0.7])
    split = stress_history(time, strain, E[[0, 1, 1]], C[[0, 1, 1]], [0.3, 0.35, 0.35])
    assert split == approx(whole, rel=1e-12)


@pytest.mark.parametrize("dt", [1e-6, 1e-3, 1.0, 1e3, 1e9])
def test_any_step_is_stable_and_a_long_one_gives_the_static_result(dt):
    strains = np.zeros(2)
    seen = [chain_strain_step(strains, E, C, np.array([0.5, 0.5]), 0.2, dt) for _ in range(200)]
    assert np.all(np.isfinite(seen)) and np.all(np.diff(seen) <= 1e-9 * seen[0])
    static = 0.2 / (0.5 / E).sum()
    assert seen[-1] >= static * (1 - 1e-9)
    if dt >= 1e3:
        assert seen[0] == approx(static, rel=1e-2)


def test_the_chain_never_pulls_and_recovers_after_release():
    strains = np.zeros(2)
    shares = np.array([0.5, 0.5])
    for _ in range(200):
        chain_strain_step(strains, E, C, shares, 0.3, 1e-3)
    left = strains.copy()
    assert chain_strain_step(strains, E, C, shares, 0.0, 1e-3) == 0.0
    assert strains == approx(left / (1 + 1e-3 * E / C))
    for _ in range(20000):
        assert chain_strain_step(strains, E, C, shares, 0.0, 1e-3) == 0.0
    assert np.all(strains < 1e-6) and np.all(strains >= 0)


def test_an_imposed_stress_creeps_to_stress_over_modulus():
    strains = np.zeros(2)
    shares = np.array([0.25, 0.75])
    for _ in range(300):
        total = chain_stress_step(strains, E, C, shares, 5e3, 0.1)
    assert total == approx((shares * 5e3 / E).sum(), rel=1e-6)


def test_no_element_exceeds_the_strain_limit_under_strain_or_stress():
    strains, shares = np.zeros(2), np.array([0.25, 0.75])
    for _ in range(50):
        stress = chain_strain_step(strains, E, C, shares, 0.7, 1e-2)
        assert np.all(strains <= STRAIN_LIMIT) and np.isfinite(stress)
        assert (shares * strains).sum() == approx(0.7)
    for _ in range(50):
        chain_stress_step(strains, E, C, shares, 1e9, 1.0)
    assert strains == approx(STRAIN_LIMIT)


def test_one_elastic_element_follows_hookes_law():
    time = np.linspace(0, 1, 11)
    assert stress_history(time, 0.1 * time, [1e4], [0.0]) == approx(1e3 * time)
