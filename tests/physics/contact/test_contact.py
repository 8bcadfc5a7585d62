"""Normal contact: laws, the series step, impact, the Hertz pair, and the contact node."""

import itertools
import math

import numpy as np
import pytest
from formulas import force, series, series_path, static_split
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pytest import approx
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq
from theory.hertz import finger_pair, pair_approach, pair_force, pair_modulus
from theory.impact import peak_energy, peak_indentation, restitution

from palpate.launch.testing import FakeBus
from palpate.messages import Proximity, Surface
from palpate.nodes.contact import Series
from palpate.physics.contact.series import elastic, exponential, hertz_exponential, power, series_energy
from palpate.physics.contact.terminal import Terminal, indentation

FINGER, C1 = exponential(26.2641, 1681.06), 8.0
K, N, C2 = 3.0e3, 1.5, 5.0
LAWS = [FINGER, power(3e3, 1.5), power(500.0, 1.0), hertz_exponential(5.672e6, 466.6, 9.84e-3)]


def ramp(step):
    t = np.arange(1, round(0.4 / step) + 1) * step
    return np.interp(t, [0, 0.1, 0.3, 0.4], [0, 8e-3, 8e-3, 0])


@pytest.mark.parametrize("law", LAWS)
def test_stored_energy_is_the_integral_of_the_force(law):
    for s in (1e-7, 1e-4, 2.5e-3, 6e-3):
        expected = quad(lambda x: float(force(law, x)), 0, s, epsabs=0, epsrel=1e-12)[0]
        assert float(series_energy(s, *law)) == approx(expected, rel=1e-10)


def test_force_is_never_negative_and_zero_when_apart():
    s = np.linspace(-1e-3, 3e-3, 41)
    f = force(FINGER, s[:, None], np.linspace(-10, 10, 21), C1)
    assert (f >= 0).all() and (f[s <= 0] == 0).all()


def test_the_fingertip_law_passes_through_its_calibration_points():
    assert force(FINGER, [1.24e-3, 2.08e-3]) == approx([0.11, 0.50], rel=1e-3)


def test_the_static_split_balances_the_forces():
    f, s1, s2 = static_split(np.array([1, 2, 4, 6, 8, 10, 14]) * 1e-3, FINGER, K, N)
    assert s1 * 1e3 == approx([0.58015, 1.09118, 1.80418, 2.26273, 2.58752, 2.83515, 3.19905], abs=1e-5)
    assert f == approx([0.02581, 0.08219, 0.30869, 0.68541, 1.19458, 1.81942, 3.36755], abs=1e-5)
    assert f == approx(K * s2**N, rel=1e-12)


def test_ramp_hold_release_matches_an_independent_solution():
    """Rates form of the series model, integrated by an implicit Runge-Kutta method."""
    times, levels = [0, 0.1, 0.3, 0.4], [0, 8e-3, 8e-3, 0]
    b, m = 26.2641, 1681.06

    def forces(t, s1, rate):
        s2 = np.interp(t, times, levels) - s1
        g1, g2 = b / m * np.expm1(m * s1), K * max(s2, 0.0) ** N
        d1 = (g2 * (1 + C2 * rate) - g1) / max(g1 * C1 + g2 * C2, 1e-30)
        return d1, g1 * (1 + C1 * d1)

    s1, reference = 1e-6 * 0.58, {}
    for start, end, rate, ask in ((1e-5, 0.1, 0.08, (0.05,)), (0.1, 0.3, 0.0, (0.2,)), (0.3, 0.31, -0.08, (0.31,))):
        run = solve_ivp(
            lambda t, y, r=rate: [forces(t, y[0], r)[0]],
            (start, end),
            [s1],
            method="Radau",
            rtol=1e-9,
            atol=1e-13,
            dense_output=True,
        )
        for t in ask:
            reference[t] = forces(t, run.sol(t)[0], rate)[1]
        s1 = run.y[0, -1]
    step = 1e-5
    f, _, _ = series_path(ramp(step), step, FINGER, C1, K, N, C2)
    for t, expected in ((0.05, 0.38719), (0.2, 1.19458), (0.31, 0.69501)):
        assert f[round(t / step) - 1] == approx(expected, abs=3e-5)
        assert reference[t] == approx(expected, abs=2e-5)
    assert f[round(0.1 / step) - 1] == approx(1.55543, abs=3e-5)


def test_loading_is_above_unloading_and_a_cycle_dissipates_work():
    e = ramp(1e-4)
    f, _, _ = series_path(e, 1e-4, FINGER, C1, K, N, C2)
    loading, unloading = f[:1000], f[3000:]
    assert (loading[99::100] > unloading[::-1][100::100][: len(loading[99::100])].tolist() + [0.0]).all()
    assert np.sum(f * np.diff(e, prepend=0.0)) == approx(1.82e-3, rel=0.01)


def test_the_step_converges_with_first_order():
    exact = 0.69500844
    errors = []
    for step in (1e-3, 5e-4, 2.5e-4, 1.25e-4):
        f, _, _ = series_path(ramp(step), step, FINGER, C1, K, N, C2)
        errors.append(abs(f[round(0.31 / step) - 1] - exact))
    ratios = np.array(errors[:-1]) / errors[1:]
    assert (ratios > 1.7).all() and (ratios < 2.3).all()


def test_holding_relaxes_to_the_static_split():
    f, s1, _ = series_path(np.full(3000, 6e-3), 1e-3, FINGER, C1, K, N, C2)
    still = static_split(6e-3, FINGER, K, N)
    assert f[-1] == approx(float(still[0]), rel=1e-9) and s1[-1] == approx(float(still[1]), rel=1e-9)
    assert (np.diff(f) <= 1e-12).all()


def test_force_is_continuous_through_make_and_break():
    t = np.linspace(0, 0.2, 20001)
    e = np.maximum(0.0, 1e-3 * np.sin(2 * np.pi * t / 0.1))
    f, _, _ = series_path(e[1:], 1e-5, FINGER, C1, K, N, C2)
    assert np.abs(np.diff(f)).max() < 2e-3 * f.max()


@pytest.mark.parametrize("n", [1.0, 1.5, 2.2, 3.0])
def test_two_identical_power_laws_share_equally(n):
    f, s1, s2 = static_split([1e-4, 3e-3, 2e-2], power(K, n), K, n)
    assert s1 == approx(s2, rel=1e-12)
    assert f == approx(K / 2**n * np.array([1e-4, 3e-3, 2e-2]) ** n, rel=1e-12)
    _moving, s1, s2 = series_path(ramp(1e-3), 1e-3, power(K, n), C2, K, n, C2)
    assert s1 == approx(s2, abs=1e-12)


def test_the_rebound_equals_the_table():
    y = [0.05, 0.5, 1.5, 2.5, 5]
    assert restitution(y) == approx([0.967739, 0.748435, 0.487741, 0.352379, 0.196980], abs=1e-6)
    assert 1 - restitution(1.82) ** 2 == approx(0.81, abs=1e-5)
    assert restitution(0.0) == 1.0 and 500 * restitution(500.0) == approx(1.0)


@given(st.floats(1e-9, 50.0))
def test_rebound_closed_form_solves_the_energy_balance(y):
    """-w - ln(1 - w) = y - ln(1 + y), w = c v_out; by its series where the logarithms cancel."""
    w = y * float(restitution(y))
    assert 0 < w < min(y, 1.0) or (y > 30 and w == approx(1.0))
    if 0.3 > y > 1e-4:
        left = sum(w**k / k for k in range(2, 60))
        right = -sum((-y) ** k / k for k in range(2, 60)) * -1
        assert left == approx(right, rel=1e-10)
    elif 0.3 <= y < 20:
        assert -w - math.log1p(-w) == approx(y - math.log1p(y), rel=1e-6)


@pytest.mark.parametrize(("law", "n"), [(power(K, 1.5), 1.5), (power(200.0, 1.0), 1.0)])
@pytest.mark.parametrize("y", [0.05, 0.5, 1.5, 5.0])
def test_the_rebound_of_a_mass_equals_the_closed_form(law, n, y):
    mass, c = 0.05, 4.0

    def motion(t, state):
        x, v = state
        return [v, -float(force(law, x, v, c)) / mass]

    def leaves(t, state):
        return state[0] + (1.0 if t < 1e-5 else 0.0)

    leaves.terminal = True
    run = solve_ivp(motion, (0, 5.0), [0.0, y / c], events=leaves, method="DOP853", rtol=1e-11, atol=1e-14)
    assert -run.y[1, -1] / (y / c) == approx(float(restitution(y)), abs=1e-6)
    assert run.y[0].max() <= float(peak_indentation(mass, y / c, law.first, n, c)) * (1 + 1e-9)
    deepest = float(series_energy(peak_indentation(mass, y / c, law.first, n, c), *law))
    assert deepest == approx(float(peak_energy(mass, y / c, c)), rel=1e-12)


def test_peak_without_damping_stores_all_the_energy():
    assert float(peak_energy(0.3, 2.0, 0.0)) == approx(0.6)
    assert float(peak_energy(0.3, 2.0, 1e-7)) == approx(0.6, rel=1e-6)


jumps = st.floats(0.0, 0.03)


@settings(max_examples=150, deadline=None)
@example(FINGER, [(2.225073858507e-311, 0.0), (1 / 64, 0.0)], 0.0, 0.0, 1.0)
@given(
    st.sampled_from(LAWS),
    st.lists(st.tuples(jumps, st.floats(-7, 4)), min_size=1, max_size=25),
    st.sampled_from([0.0, 0.5, 8.0, 100.0]),
    st.sampled_from([0.0, 5.0, 50.0]),
    st.floats(1.0, 3.0),
)
def test_any_path_and_step_gives_a_finite_force_and_no_energy(law, path, c1, c2, n):
    s1 = s2 = 0.0
    for e, exponent in path:
        dt = 10.0**exponent
        f, a, b = series(e, dt, s1, law, c1, Terminal(K, n, c2, 0.0, s2))
        assert math.isfinite(f) and f >= 0 and a >= 0 and b >= 0
        if f > 0:
            assert a + b == approx(e, rel=1e-12)
            gained = float(
                series_energy(a, *law)
                - series_energy(s1, *law)
                + series_energy(b, *power(K, n))
                - series_energy(s2, *power(K, n))
            )
            scale = float(series_energy(max(a, s1), *law) + series_energy(max(b, s2), *power(K, n)))
            assert f * (a + b - s1 - s2) >= gained - 1e-11 * scale - 1e-18
        else:
            assert a + b >= e
        s1, s2 = a, b


sizes = st.sampled_from([0.0, 1e-300, 1e-12, 1e-3, 1.0, 1e6, 1e150])


@settings(max_examples=300, deadline=None)
@given(
    st.sampled_from(LAWS),
    sizes,
    st.sampled_from([1e-12, 1e-9, 1e-3, 1e6, 1e300, math.inf]),
    st.sampled_from([0.0, 2e-3, 1.0]),
    sizes,
    st.sampled_from([1.0, 1.5, 3.0]),
    st.sampled_from([0.0, 5.0, 1e9]),
    st.sampled_from([-1e-3, 0.0, 1e-3]),
    st.sampled_from([-1e-3, 0.0, 4e-3]),
)
def test_extreme_numbers_give_finite_results(law, e, dt, s1, stiffness, n, c2, free, previous):
    f, a, b = series(e, dt, s1, law, C1, Terminal(stiffness, n, c2, free, previous))
    assert math.isfinite(f) and f >= 0 and math.isfinite(a) and a >= 0 and math.isfinite(b)
    if stiffness > 0 and f < 1e200:
        assert math.isfinite(indentation(f, dt, stiffness, n, c2, free, previous))


@settings(max_examples=80, deadline=None)
@given(
    st.floats(1e-9, 0.03),
    st.floats(1e-6, 10.0),
    st.floats(0, 4e-3),
    st.floats(10.0, 1e7),
    st.floats(1.0, 3.0),
    st.floats(-2e-3, 0.02),
)
def test_the_series_force_agrees_with_another_root_finder(e, dt, s1, stiffness, n, free):
    body = Terminal(stiffness, n, 0.0, free, free)
    f, a, b = series(e, dt, s1, FINGER, C1, body)
    r1 = max(0.0, s1 - dt / C1)
    if r1 + free >= e:
        assert f == 0.0 and a == r1 and b == free
        return

    def balance(x):
        own = float(force(FINGER, e - x, (e - x - s1) / dt, C1))
        return stiffness * max(x - free, 0.0) ** n - own

    most = (e - r1) * (1 + 1e-9)  # beyond the end, where rounding may leave a force
    root = brentq(balance, free, most, xtol=1e-18, rtol=8.9e-16, maxiter=500)
    assert b == approx(root, rel=1e-9, abs=1e-15)


@pytest.mark.parametrize("dt", [0.1, 1.0, 10.0, math.inf])
def test_a_very_large_step_gives_the_quasi_static_result(dt):
    f, _s1, _s2 = series(8e-3, dt, 0.0, FINGER, C1, Terminal(K, N, C2, 0.0, 0.0))
    still = static_split(8e-3, FINGER, K, N)
    slack = 0.0 if math.isinf(dt) else 2 * max(C1, C2) * 8e-3 / dt
    assert float(still[0]) <= f * (1 + 1e-12) and f <= float(still[0]) * (1 + slack) + 1e-12


def test_chatter_of_one_count_dissipates_and_adds_no_force():
    lsb = 60e-6
    for step in (1e-4, 1e-3, 1e-2):
        e = np.tile([lsb, 0.0], 200)
        f, _, _ = series_path(e, step, FINGER, C1, K, N, C2)
        work = np.add.reduceat(f * np.diff(e, prepend=0.0), np.arange(0, 400, 2))
        assert (work >= -1e-18).all()
        # Damping raises the force above the static one at most by its rate, and cycles do not accumulate.
        still = float(static_split(lsb, FINGER, K, N)[0])
        assert f.max() <= still * (1 + max(C1, C2) * lsb / step) and f.max() <= f[0] * (1 + 1e-12)


@pytest.mark.parametrize("step", [1e-5, 1e-4])
@pytest.mark.parametrize("speed", [0.1, 1.0, 3.0])
def test_a_mass_rebounds_more_slowly_than_the_bodies_recover(step, speed):
    x, v, s1, s2, mass, _energy_in, peak = 0.0, speed, 0.0, 0.0, 0.02, 0.0, 0.0
    for _ in range(round(0.5 / step)):
        f, s1, s2 = series(max(x, 0.0), step, s1, FINGER, C1, Terminal(K, N, C2, 0.0, s2))
        v -= f / mass * step
        x += v * step
        peak = max(peak, f)
        if x < 0:
            break
    assert x < 0 and math.isfinite(peak)
    assert 0 < -v < min(speed, 1 / C1 + 1 / C2)


def test_jumps_of_30_mm_in_a_step_stay_finite():
    e = np.concatenate([np.full(50, 30e-3), np.zeros(3), np.full(50, 30e-3), np.zeros(100)])
    for step in (1e-6, 1e-3, 1.0):
        f, s1, s2 = series_path(e, step, FINGER, C1, K, N, C2)
        assert np.isfinite(f).all() and (f >= 0).all() and f[-1] == 0.0
        assert (s1 >= 0).all() and (s2 >= 0).all()


def test_the_hertz_pair_adds_compliances():
    star = pair_modulus(2e4, 3e4)
    assert star == approx(1.2e4)
    assert pair_modulus(2e4, math.inf) == 2e4
    assert pair_approach(float(pair_force(2e-3, star, 8e-3)), star, 8e-3) == approx(2e-3)
    assert pair_approach(-1.0, star, 8e-3) == 0.0


def test_at_equal_stiffness_the_series_rule_gives_1_26_times_the_approach_of_the_pair():
    modulus, radius, load = 2e4, 8e-3, 0.7
    alone = 4 / 3 * modulus * math.sqrt(radius)
    series_approach = 2 * (load / alone) ** (2 / 3)
    pair = pair_approach(load, pair_modulus(modulus, modulus), radius)
    assert series_approach / pair == approx(2 ** (1 / 3), rel=1e-12)


def test_silicone_indentations_agree_with_the_pair_and_not_with_the_series_rule():
    b, m, radius, silicone = 5.672e6, 466.6, 9.84e-3, 180e3 / (1 - 0.48**2)
    finger = hertz_exponential(b, m, radius)
    stiffness = 4 / 3 * silicone * math.sqrt(radius)
    for load, pair, row in ((0.11, 1.32e-3, 1.47e-3), (0.50, 2.36e-3, 2.72e-3)):
        assert brentq(lambda e, p=load: finger_pair(e, b, m, radius, silicone)[0] - p, 1e-5, 1e-2) == approx(
            pair, abs=6e-6
        )
        in_series = brentq(lambda e, p=load: float(static_split(e, finger, stiffness, 1.5)[0]) - p, 1e-5, 1e-2)
        assert in_series == approx(row, abs=6e-6)


def test_a_pair_with_a_rigid_body_equals_the_fingertip_alone():
    f, _s1, s2 = finger_pair(1.24e-3, 5.672e6, 466.6, 9.84e-3, math.inf)
    assert f == approx(float(force(hertz_exponential(5.672e6, 466.6, 9.84e-3), 1.24e-3))) and s2 == 0.0
    assert finger_pair(0.0, 5.672e6, 466.6, 9.84e-3, 2e4) == (0.0, 0.0, 0.0)
    assert all(map(math.isfinite, finger_pair(5.0, 5.672e6, 466.6, 9.84e-3, 2e4)))


def proximity(e):
    return Proximity(
        foot=(0, 0, 0), normal=(0, 0, 1), coordinates=(0, 0), element=0, gap=4e-3 - e, approach=e, slip=(0, 0, 0)
    )


def body(previous=0.0):
    return Surface(
        nodes=[],
        displacement=np.zeros((0, 3)),
        stiffness=K,
        exponent=N,
        damping=C2,
        rest_indentation=0.0,
        previous_indentation=previous,
    )


def test_the_node_solves_the_series_step():
    bus = FakeBus(Series(), body=body())
    s1 = s2 = 0.0
    for e in (1e-3, 3e-3, 8e-3, 8e-3, 2e-3, 0.0):
        (answer,) = bus.publish(proximity(e))
        f, a, b = series(e, 1e-3, s1, FINGER, C1, Terminal(K, N, C2, 0.0, s2))
        assert (answer.force, answer.compression, answer.indentation) == approx((f, a, b), rel=1e-9, abs=1e-15)
        assert answer.compression_rate == approx((a - s1) / 1e-3, rel=1e-6, abs=1e-9)
        s1, s2 = a, b
        bus.hold("body", body(s2))


def test_the_force_ramps_to_zero_within_8_ms_without_a_body():
    bus = FakeBus(Series(), body=body())
    (pressed,) = bus.publish(proximity(8e-3))
    bus.kill("body")
    answers = bus.publish(*[proximity(8e-3)] * 30)
    forces = [pressed.force, *(a.force for a in answers)]
    assert forces[:9] == sorted(forces[:9], reverse=True) and forces[6] > 0.0
    assert all(a.force == 0 and a.indentation == 0 for a in answers[7:])
    left = [a.compression for a in answers]
    assert left == sorted(left, reverse=True) and left[-1] == 0.0


@pytest.mark.parametrize("absent", [1, 3, 10, 100])
def test_after_an_outage_of_the_body_contact_begins_at_first_touch(absent):
    """If the whole approach were applied in one step, damping would multiply the force."""
    bus = FakeBus(Series(), body=body())
    still = bus.publish(*[proximity(8e-3)] * 300)[-1].force
    bus.hold("body", None)
    bus.publish(*[proximity(8e-3)] * absent)
    bus.hold("body", body())
    back = [a.force for a in bus.publish(*[proximity(8e-3)] * 300)]
    assert max(back) <= 1.2 * still
    assert max(b - a for a, b in itertools.pairwise(back)) < 0.1 * still
    assert back[-1] == approx(still, rel=1e-6)


def test_a_contact_that_starts_inside_the_tissue_begins_at_first_touch():
    late = FakeBus(Series(), body=body())
    late.tick = 5000
    forces = [a.force for a in late.publish(*[proximity(8e-3)] * 200)]
    begun = FakeBus(Series(), body=body()).publish(*[proximity(8e-3)] * 200)
    assert forces[0] < 0.01 * begun[0].force and forces[-1] == approx(begun[-1].force, rel=1e-6)


def test_a_duplicate_message_changes_nothing():
    bus = FakeBus(Series(), body=body())
    bus.twice()
    first, second = bus.publish(proximity(5e-3))
    assert (first.force, first.compression) == (second.force, second.compression)
    bus.swap()
    for answer in bus.publish(proximity(5e-3), proximity(6e-3)):
        assert math.isfinite(answer.force)


@pytest.mark.parametrize("law", ["power", "hertz", "exponential", "soft", "median", "stiff"])
def test_every_finger_law_gives_a_force(law):
    (answer,) = FakeBus(Series(finger_law=law), body=body()).publish(proximity(5e-3))
    assert answer.force > 0 and answer.compression + answer.indentation == approx(5e-3)


@pytest.mark.parametrize(
    "law", [power(8.1e3, 1.5), exponential(26.2641, 1681.06), hertz_exponential(5.672e6, 466.6, 9.84e-3)]
)
@pytest.mark.parametrize("s", [1e-5, 3e-4, 2e-3])
def test_the_slope_of_each_law_is_its_derivative(law, s):
    h = 1e-6 * s
    force, slope = elastic(s, *law)
    assert slope == approx((elastic(s + h, *law)[0] - elastic(s - h, *law)[0]) / (2 * h), rel=1e-7)
    assert force > 0.0
    assert elastic(0.0, *law) == elastic(-s, *law) == (0.0, 0.0)
