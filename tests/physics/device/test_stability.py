"""The stable and the passive wall: poles, Jury's conditions, the simulated loop and published bounds agree."""

from decimal import Decimal, localcontext

import numpy as np
import pytest
from formulas import decays, delayed_damping, jury_stiffness
from pytest import approx

from palpate.physics.device.stability import (
    MOST,
    hold_step,
    passive_stiffness,
    poles,
    quantised_stiffness,
    stable_stiffness,
)
from palpate.physics.device.wall_loop import WallDevice, run, settles

EXACT = WallDevice(resolution=0.0)


def largest(stable, low, high):
    """Stiffness [N/m] at which `stable` ends, to 1e-4."""
    while high / low > 1.0001:
        middle = (low * high) ** 0.5
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low


@pytest.mark.parametrize("mass", [0.05, 0.3])
@pytest.mark.parametrize("period", [2.5e-4, 1e-3, 1e-2])
def test_poles_and_jury_agree(mass, period):
    for drag in (0.05, 0.2, 5.0):
        assert stable_stiffness(0.0, mass, drag, period) == approx(jury_stiffness(mass, drag, period), rel=1e-6)


def test_the_step_with_held_force_equals_a_fine_integration():
    a, p, c, q = hold_step(0.1, 0.2, 1e-2)
    x, v = 0.0, 1.0
    for _ in range(100_000):
        v += 1e-7 * (3.0 - 0.2 * v) / 0.1
        x += 1e-7 * v
    assert (a + 3 * c, p + 3 * q) == approx((x, v), rel=1e-5)
    assert hold_step(0.1, 1e-9, 1e-3)[2] == approx(0.5e-6 / 0.1, rel=1e-6)  # a mass without drag: T²/(2 m)


@pytest.mark.parametrize("ratio", [1e-9, 1e-5, 9.9e-4, 1.01e-3, 0.3])
def test_the_step_with_held_force_is_exact_for_any_drag(ratio):
    with localcontext(prec=60):
        mass, period, r = Decimal("0.1"), Decimal("0.001"), Decimal(ratio)
        drag, p = r * mass / period, (-r).exp()
        a = mass / drag * (1 - p)
        exact = [float(value) for value in (a, p, (period - a) / drag, (1 - p) / drag)]
    assert hold_step(0.1, float(drag), 1e-3) == approx(exact, rel=2e-11, abs=0.0)


def test_a_device_with_the_required_drag_meets_the_stiffest_wall():
    assert stable_stiffness(0.0, 0.1, 1e7, 1e-3) == MOST


def test_the_default_delay_is_zero():
    assert stable_stiffness(0.1, 0.1, 0.5, 1e-3) == stable_stiffness(0.1, 0.1, 0.5, 1e-3, 0, 1)
    assert passive_stiffness(0.1, 0.5, 1e-3) == passive_stiffness(0.1, 0.5, 1e-3, 0, 1)


@pytest.mark.parametrize("delay", [0, 1, 2, 5])
@pytest.mark.parametrize(("damping", "order"), [(0.0, 1), (1.0, 1), (1.0, 4)])
def test_the_simulated_stability_limit_agrees_with_the_poles_within_3_percent(delay, damping, order):
    device = EXACT._replace(drag=0.5)
    theory = stable_stiffness(damping, device.mass, device.drag, 1e-3, delay, order)
    steps = np.full(40_000, 1e-3)

    def stable(k):
        return decays(run(device, k, damping, controlled=False, steps=steps, delay=delay, order=order, free=True)[:, 0])

    assert largest(stable, theory / 3, theory * 3) == approx(theory, rel=0.03)


@pytest.mark.parametrize("delay", [0, 1, 3])
def test_the_passive_bound_has_its_closed_form_and_is_below_the_stable_one(delay):
    stiffness = passive_stiffness(0.0, 0.5, 1e-3, delay)
    assert delayed_damping(stiffness, 1e-3, delay) == approx(0.5, rel=1e-5)
    assert stiffness <= stable_stiffness(0.0, 0.1, 0.5, 1e-3, delay) * 1.01
    # With damping the two bounds differ: a stable wall can inject energy into the hand.
    assert passive_stiffness(0.3, 0.5, 1e-3, delay) < 0.9 * stable_stiffness(0.3, 0.1, 0.5, 1e-3, delay)


def test_a_wall_with_too_much_damping_is_unstable_at_any_stiffness():
    assert stable_stiffness(500.0, 0.1, 0.2, 1e-3) == 0.0 == passive_stiffness(500.0, 0.2, 1e-3)
    assert np.abs(poles(1.0, 500.0, 0.1, 0.2, 1e-3)).max() > 1.0


def test_dry_friction_and_encoder_resolution_bound_the_passive_wall():
    assert quantised_stiffness(0.2, 0.05, 1e-3, 0.0) == 400.0
    assert quantised_stiffness(0.2, 0.005, 1e-3, 60e-6) == approx(166.67, abs=0.01)
    assert quantised_stiffness(0.2, 5.0, 1e-3, 60e-6) == 400.0


def test_dry_friction_stops_a_sliding_mass_after_the_exact_distance():
    """v²/(2 f_c/m) without drag."""
    device = WallDevice(drag=1e-6, coulomb=0.1, resolution=0.0)
    path = run(device, 0.0, 0.0, controlled=False, steps=np.full(2000, 1e-4), push=0.0)
    assert path[0, 0] - path[-1, 0] == approx(0.05**2 / 2 / (0.1 / 0.1), rel=0.02)


@pytest.mark.parametrize("delay", [0, 2])
def test_with_the_controller_every_wall_settles_and_without_it_the_stiff_one_does_not(delay):
    steps = np.full(4000, 1e-3)
    for stiffness in (300.0, 1e4, 1e6):
        assert settles(run(WallDevice(), stiffness, 0.0, controlled=True, steps=steps, delay=delay)[:, 0], 60e-6)
    wild = run(WallDevice(), 1e4, 0.0, controlled=False, steps=steps, delay=delay)
    assert not settles(wild[:, 0], 60e-6) and wild[:, 2].max() > 1e-3
