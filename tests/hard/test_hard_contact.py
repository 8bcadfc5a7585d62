"""Hard cases of normal contact: make and break, impact, steps without bound, and a sheet that a ball could tunnel."""

import itertools
import math

import numpy as np
from formulas import force, series, series_path, static_split
from hypothesis import given, settings
from hypothesis import strategies as st
from pytest import approx

from palpate.physics.contact.series import exponential, power, series_energy
from palpate.physics.contact.terminal import Terminal

FINGER, C1 = exponential(26.2641, 1681.06), 8.0
K, N, C2 = 3.0e3, 1.5, 5.0
steps = st.floats(-6, 1).map(lambda e: 10.0**e)
approaches = st.lists(st.floats(-5e-3, 30e-3), min_size=1, max_size=20)
stiffnesses = st.floats(0, 8).map(lambda e: 10.0**e)


def explicit(approach, dt):
    """The usual method: the series law as an ordinary differential equation by explicit Euler,

    s1' = (g2 (1 + c2 e') - g1)/(g1 c1 + g2 c2); the force of the fingertip."""
    s1, before, line = 0.0, 0.0, []
    for e in approach:
        rate, before = (e - before) / dt, e
        s2 = e - s1
        g1 = float(force(FINGER, s1))
        g2 = K * max(s2, 0.0) ** N
        bottom = g1 * C1 + g2 * C2
        speed = (g2 * (1 + C2 * rate) - g1) / bottom if bottom > 1e-12 else rate / 2
        line.append((g1 * max(1 + C1 * speed, 0.0), s1))
        s1 += dt * speed
    return np.array(line).T


def test_the_explicit_series_law_chatters_at_make_and_break():
    """A finger that rests 0.05 mm deep. Near the first touch the law is stiff, its rate n/(c s): explicit Euler at 1 ms
    throws the share of the finger to and fro between the bodies. The implicit step goes to the static split."""
    approach = np.concatenate([np.linspace(0, 5e-5, 20), np.full(200, 5e-5)])
    with np.errstate(all="ignore"):
        _, usual = explicit(approach, 1e-3)
    tail = usual[-100:]
    assert (np.diff(np.sign(np.diff(tail))) != 0).sum() > 50 or not np.isfinite(usual).all()
    f, s1, _ = series_path(approach, 1e-3, FINGER, C1, K, N, C2)
    rest = static_split(5e-5, FINGER, K, N)
    turns = (np.diff(np.sign(np.round(np.diff(s1[30:]), 12))) != 0).sum()
    assert turns <= 1 and f[-1] == approx(float(rest[0]), rel=0.05)


@settings(deadline=None)
@given(approaches, steps, stiffnesses, st.sampled_from([FINGER, power(3e3, 1.5), power(1e8, 1.0)]))
def test_the_series_law_is_bounded_and_generates_no_energy_on_any_path(path, dt, stiffness, finger):
    """Jumps of 30 mm, air in between, steps of 1 us to 10 s, bodies over eight decades: the force is finite and never
    negative, no compression is, and each step takes in at least what the two bodies store."""
    e = np.array([0.0, *path])
    f, s1, s2 = series_path(e, dt, finger, C1, stiffness, N, C2)
    assert np.isfinite(f).all() and (f >= 0).all() and (s1 >= 0).all() and (s2 >= 0).all()
    assert (f[e <= 0] == 0).all()
    held = np.array([series_energy(s, *finger) for s in s1]) + stiffness * s2 ** (N + 1) / (N + 1)
    put_in = f[1:] * (np.diff(s1) + np.diff(s2))
    gained = np.diff(held) - put_in
    assert (gained <= 1e-8 * (held[1:] + held[:-1] + np.abs(put_in)) + 1e-15).all()


@settings(deadline=None)
@given(st.lists(st.floats(0.0, 10e-3), min_size=1, max_size=20), steps)
def test_a_closed_path_never_returns_more_work_than_it_took(path, dt):
    """Twice round the same closed way from 0 to 0, repeated samples among them."""
    e = np.array([0.0, *path, *path[::-1], 0.0, *path, path[-1], 0.0])
    f, _, _ = series_path(e, dt, FINGER, C1, K, N, C2)
    assert float((f[1:] * np.diff(e)).sum()) >= -1e-12


def test_an_encoder_alternating_between_two_counts_gives_no_force_above_the_static_one():
    """Contact begins and ends at alternating ticks. The force of a spring with a parallel dashpot would jump by b e' at
    each begin, here to 100 times the static force, and pull at each end."""
    count, depth = 60e-6, 1e-4
    e = depth + count * (np.arange(400) % 2 - 1) * 2
    f, _, _ = series_path(e, 1e-3, FINGER, C1, K, N, C2)
    rate = np.diff(e, prepend=e[0]) / 1e-3
    # Hunt-Crossley multiplies the static force by 1 + c e' at most, and the two share the rate.
    assert f.max() <= float(force(power(K, N), depth)) * (1 + C2 * rate.max())
    spring, dashpot = 500.0, 5.0
    usual = np.where(e > 0, spring * e + dashpot * rate, 0.0)
    assert usual.max() > 10 * spring * depth
    falling = np.where(e > -1, spring * np.maximum(e, 0) + dashpot * rate, 0.0)
    assert falling.min() < -0.1  # suction
    assert float((f[1:] * np.diff(e)).sum()) >= 0.0


def rebound(speed, damping, dt, mass=0.1, law=None, explicit_spring=False):
    """Speed [m/s] of a mass after its rebound from a wall; the force is constant over each step."""
    law = law or power(K, N)
    z, v, f, before = 0.0, speed, 0.0, 0.0
    for _ in range(1_000_000):
        z += v * dt - 0.5 * f / mass * dt * dt
        v -= f / mass * dt
        if explicit_spring:
            f = law.first * max(z, 0.0) ** law.second
        else:
            f = float(force(law, z, (z - before) / dt, damping))
        before = z
        if z <= 0.0:
            return -v
    raise AssertionError("it stays")


def test_a_sampled_spring_returns_a_mass_faster_than_it_arrived():
    """K = 1000 N/m, 0.3 kg, 0.2 m/s, 1 ms: e = 1.046, so a bounce grows with each impact. Hunt and Crossley's law with
    the damping of tissue gives less than it took."""
    linear = power(1000.0, 1.0)
    assert rebound(0.2, 0.0, 1e-3, 0.3, linear, explicit_spring=True) / 0.2 > 1.02
    assert rebound(0.2, 5.0, 1e-3, 0.3, linear) / 0.2 < 1.0


def test_an_impact_leaves_no_faster_than_one_over_c():
    """At 3 m/s. The exact rebound of a free mass stays below 1/c however fast it came."""
    for speed in (0.3, 1.0, 3.0):
        assert 0.0 < rebound(speed, C2, 4e-6) < 1.0 / C2


@settings(deadline=None)
@given(st.floats(-9, 0), st.floats(0, 8), st.floats(-1, 1))
def test_an_infinite_step_gives_the_static_split(depth, stiffness, longer):
    e, k = 30e-3 * 10.0**depth, 10.0**stiffness
    f, s1, s2 = series(e, 1e9 * 10.0**longer, 0.0, FINGER, C1, Terminal(k, N, C2))
    rest = static_split(e, FINGER, k, N)
    assert s1 + s2 == approx(e, rel=1e-9) and s1 == approx(float(rest[1]), rel=1e-6, abs=1e-9 * e) and f >= 0.0


@settings(deadline=None)
@given(st.sampled_from([5e-324, 1e-310, 1e-200, 1e-30]), steps)
def test_the_smallest_approaches_give_negligible_forces(e, dt):
    f, s1, s2 = series(e, dt, 0.0, FINGER, C1, Terminal(K, N, C2))
    assert 0.0 <= f < 1e-10 and 0.0 <= s1 <= e and 0.0 <= s2 <= e


def test_the_step_converges_with_first_order_to_the_published_ramp():
    """8 mm in 0.1 s, held to 0.3 s, back at 0.4 s: against an implicit Runge-Kutta solution."""
    errors = []
    for dt in (2e-3, 1e-3, 5e-4):
        t = np.arange(1, round(0.4 / dt) + 1) * dt
        e = np.interp(t, [0, 0.1, 0.3, 0.4], [0, 8e-3, 8e-3, 0])
        f, _, _ = series_path(e, dt, FINGER, C1, K, N, C2)
        at = [round(x / dt) - 1 for x in (0.05, 0.1, 0.2, 0.31)]
        errors.append(np.abs(f[at] - [0.38719, 1.55543, 1.19458, 0.69501]).max())
    assert all(a / b > 1.7 for a, b in itertools.pairwise(errors)) and math.isfinite(errors[-1])
