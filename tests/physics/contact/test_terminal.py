"""The terminal law: its inverse, and its fit to bodies with another law."""

import math

import pytest
from formulas import force as law_force
from formulas import series
from hypothesis import given, settings
from hypothesis import strategies as st
from pytest import approx
from scipy.optimize import brentq

from palpate.physics.contact.series import exponential
from palpate.physics.contact.terminal import Terminal, fit_terminal, free_recovery, indentation, terminal_force

positive = st.floats(1e-6, 0.03)


@settings(max_examples=300, deadline=None)
@given(
    force=st.floats(1e-9, 1e3),
    dt=st.floats(-7, 3).map(lambda x: 10.0**x),
    n=st.one_of(st.sampled_from([1.0, 1.5, 2.0, 3.0]), st.floats(1, 3)),
    damping=st.sampled_from([0.0, 1e-3, 5.0, 200.0]),
    free=st.floats(-5e-3, 5e-3),
    previous=st.floats(-5e-3, 0.03),
)
def test_indentation_inverts_the_law(force, dt, n, damping, free, previous):
    s = indentation(force, dt, 3e3, n, damping, free, previous)
    least = free_recovery(previous, free, damping, dt)
    assert s >= least

    def missing(x):
        return terminal_force(x, dt, 3e3, n, damping, free, previous)[0] - force

    high = max(least, previous, free) + 1.0
    while missing(high) < 0:
        high += 10.0
    if missing(least) >= 0.0:  # in a very short step the force of one rounding error of the position is larger
        root = least
    else:
        root = brentq(missing, least, high, xtol=1e-17, rtol=8.9e-16, maxiter=1000)
    assert s == approx(root, rel=1e-9, abs=1e-12)


def test_without_force_the_body_recovers_at_the_rate_of_its_damping():
    assert indentation(0.0, 1e-3, 3e3, 1.5, 5.0, 0.0, 4e-3) == approx(3.8e-3)
    assert indentation(0.0, 1.0, 3e3, 1.5, 5.0, 0.0, 4e-3) == 0.0
    assert indentation(0.0, 1e-3, 3e3, 1.5, 0.0, 0.0, 4e-3) == 0.0
    assert indentation(-1.0, 1e-3, 3e3, 1.5, 0.0, 1e-3, 4e-3) == 1e-3


@given(positive, st.floats(1e-3, 9.0), st.floats(1.0, 3.0), st.floats(-1e-3, 1e-3))
def test_the_fit_keeps_force_and_slope_of_a_power_law(depth, force, n, free):
    k = n * force / depth
    law = Terminal(*fit_terminal(free, free + depth, k, force), 0.0, free, free + depth)
    assert law.exponent == approx(n, rel=1e-9)
    value, slope = terminal_force(free + depth, 1e-3, *law)
    assert value == approx(force, rel=1e-6) and slope == approx(k, rel=1e-6)


@pytest.mark.parametrize(("slope", "n"), [(0.0, 1.0), (1e12, 3.0), (-5.0, 1.0), (math.nan, 1.0)])
def test_the_exponent_stays_in_range(slope, n):
    stiffness, exponent = fit_terminal(0.0, 1e-3, slope, 1.0)
    assert exponent == n and math.isfinite(stiffness) and stiffness > 0


def test_a_rigid_body_gets_a_finite_law():
    stiffness, exponent = fit_terminal(1e-3, 1e-3, 1e9, 0.5)
    assert math.isfinite(stiffness) and stiffness > 0 and 1 <= exponent <= 3


def test_the_fitted_law_of_a_body_with_hidden_state_gives_the_monolithic_force():
    """Power-law spring in series with a Voigt element (hidden state) under the stiff exponential fingertip."""
    finger, c1, dt = exponential(26.2641, 1681.06), 8.0, 1e-3
    stiffness, n, soft, viscous = 3e3, 1.5, 800.0, 20.0

    def body_step(force, z):
        """Indentation after a step under `force`, its tangent, the hidden state."""
        after = (force * dt + viscous * z) / (soft * dt + viscous)
        x = (max(force, 0.0) / stiffness) ** (1 / n)
        compliance = dt / (soft * dt + viscous) + (x / (n * force) if force > 0 else 0.0)
        return x + after, 1 / max(compliance, 1e-12), after

    def compression(load, before):
        """Compression of the fingertip after a step under `load`, by bisection."""
        least = max(0.0, before - dt / c1)
        if load <= 0:
            return least
        return brentq(lambda s: float(law_force(finger, s, (s - before) / dt, c1)) - load, least, 0.02, xtol=1e-16)

    path = [8e-3 * min(1.0, i / 100) if i < 300 else 8e-3 * max(0.0, 1 - (i - 300) / 100) for i in range(1, 420)]
    worst, peak = 0.0, 0.0
    whole, s1w, zw = 0.0, 0.0, 0.0
    s1, z, f, s_prev = 0.0, 0.0, 0.0, 0.0
    for e in path:
        free = body_step(0.0, z)[0]
        at = max(f, 1e-3)
        s, k, _ = body_step(at, z)
        law = Terminal(*fit_terminal(free, s, k, at), 0.0, free, s_prev)
        f, s1, _ = series(e, dt, s1, finger, c1, law)
        s_prev, _, z = body_step(f, z)

        def miss(load, hidden=zw, compressed=s1w, approach=e):
            return compression(load, compressed) + body_step(load, hidden)[0] - approach

        whole = 0.0 if miss(1e-12) >= 0 else brentq(miss, 1e-12, 50.0, xtol=1e-13)
        s1w = compression(whole, s1w)
        zw = body_step(whole, zw)[2]
        worst, peak = max(worst, abs(f - whole)), max(peak, whole)
    assert peak > 0.9 and worst < 1e-2 * peak
