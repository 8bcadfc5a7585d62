"""Second-order rates of `benchmarks/tap_steps.py`: their order, corners, and the energy of closed motions."""

import numpy as np
import pytest
import tap_steps

LIMITED = ("limited", "lagged finger, limited tissue", "predicted")


@pytest.fixture(scope="module")
def tap():
    return tap_steps.reference("tap of 30 ms")


@pytest.mark.parametrize(("form", "order"), [("Euler", 1.0), *((form, 2.0) for form in LIMITED)])
def test_the_order_of_a_tap(form, order, tap):
    rms = [tap_steps.error("tap of 30 ms", form, rate, tap)[0] for rate in (1000, 2000, 4000)]
    assert np.log2(rms[0] / rms[2]) / 2 == pytest.approx(order, abs=0.15)


@pytest.mark.parametrize("form", LIMITED)
def test_a_tap_at_1_khz_is_within_3_percent(form, tap):
    assert tap_steps.error("tap of 30 ms", form, 1000, tap)[1] < 0.03 < 0.08 < tap_steps.error(
        "tap of 30 ms", "Euler", 1000, tap
    )[1]  # fmt: skip


@pytest.mark.parametrize("form", LIMITED)
def test_a_corner_has_no_larger_error_than_with_implicit_euler(form):
    fine = tap_steps.reference("press that stops")
    assert tap_steps.error("press that stops", form, 1000, fine)[1] < 3e-3
    assert tap_steps.error("press that stops", "BDF2", 1000, fine)[1] > 0.05


@pytest.mark.parametrize("form", LIMITED)
def test_closed_motions_dissipate_energy_without_adhesive_force(form):
    assert tap_steps.least_work(form, 60) > 0.5
    random = np.random.default_rng(7)
    force = tap_steps.pressed(0.02 * random.random(500) - 0.005, 1e-3, 270.0, 0.02, *tap_steps.FORMS[form])
    assert (force >= 0.0).all() and np.isfinite(force).all()
