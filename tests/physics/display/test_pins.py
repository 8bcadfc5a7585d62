"""Pins: the grid, the stroke, the motion of the actuators."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pytest import approx
from scipy.integrate import solve_ivp
from scipy.optimize import lsq_linear

from palpate.physics.display.pins import Drives, approach_target, drive, fit_stroke, pin_grid, quantise
from palpate.physics.display.shape_display import pad_contact, pad_displacement

heights = st.lists(st.floats(0, 8e-3), min_size=1, max_size=40).map(np.array)


def clipped(wanted, stroke):
    out = np.empty(len(wanted))
    return out, fit_stroke(np.asarray(wanted, float), stroke, out)


def test_the_grid_is_centred_with_the_pitch_between_neighbours():
    grid = pin_grid(3, 4, 2e-3)
    assert grid.shape == (3, 4, 2)
    assert grid.mean(axis=(0, 1)) == approx([0, 0], abs=1e-18)
    assert np.diff(grid[0, :, 0]) == approx([2e-3] * 3) and np.diff(grid[:, 0, 1]) == approx([2e-3] * 2)
    assert pin_grid(1, 1, 2e-3)[0, 0] == approx([0, 0])


@pytest.mark.parametrize("force", [0.05, 1.0, 4.0])
def test_pin_heights_decrease_with_distance_from_the_axis(force):
    grid = pin_grid(9, 7, 2e-3).reshape(-1, 2)
    r = np.hypot(*grid.T)
    u = pad_displacement(r, pad_contact(force, 15e3))
    order = np.argsort(r, kind="stable")
    steps, falls = np.diff(r[order]), np.diff(u[order])
    assert np.all(falls[steps > 1e-12] < 0)
    assert falls[steps <= 1e-12] == approx(0, abs=1e-15)


@given(heights, st.floats(1e-5, 6e-3))
def test_clipping_to_the_stroke_keeps_the_mean_surface(wanted, stroke):
    out, offset = clipped(wanted, stroke)
    assert np.all(out >= 0) and np.all(out <= stroke)
    assert out.mean() + offset == approx(wanted.mean(), abs=1e-15)


@given(heights, st.floats(1e-3, 6e-3))
def test_the_clipped_surface_is_the_nearest_reachable_one(wanted, stroke):
    out, offset = clipped(wanted, stroke)
    columns = np.hstack([np.eye(len(wanted)), np.ones((len(wanted), 1))])
    limits = [0.0] * len(wanted) + [-1.0], [stroke] * len(wanted) + [1.0]
    best = lsq_linear(columns * 1e3, wanted * 1e3, limits, tol=1e-14)
    assert np.sum((1e3 * (out + offset - wanted)) ** 2) <= 2 * best.cost + 1e-9


def test_pins_within_their_stroke_are_unchanged_and_high_ones_are_lowered_together():
    out, offset = clipped([0.0, 1e-3, 2e-3], 2e-3)
    assert offset == 0 and out == approx([0, 1e-3, 2e-3])
    out, offset = clipped([3e-3, 4e-3, 4.5e-3], 2e-3)
    assert offset == approx(2.5e-3) and out == approx([0.5e-3, 1.5e-3, 2e-3])


@given(
    st.floats(0, 4e-3), st.floats(0, 4e-3), st.floats(1e-6, 3.0), st.floats(1e-4, 1.0), st.floats(0, 0.5),
    st.floats(0, 0.5), st.floats(0.01, 0.99),
)  # fmt: skip
def test_two_partial_steps_equal_one_whole_step(value, target, dt, rate, rise, fall, part):
    whole = approach_target(value, target, dt, rate, rise, fall)
    first = approach_target(value, target, part * dt, rate, rise, fall)
    assert approach_target(first, target, (1 - part) * dt, rate, rise, fall) == approx(whole, abs=1e-15)
    assert min(value, target) - 1e-18 <= whole <= max(value, target) + 1e-18
    assert abs(whole - value) <= rate * dt * (1 + 1e-9) + 1e-18


@pytest.mark.parametrize(("value", "target"), [(0.0, 3e-3), (3e-3, 0.5e-3)])
def test_the_actuator_follows_its_differential_equation(value, target):
    rate, rise, fall = 0.02, 0.05, 0.12

    def speed(_, x):
        gap = target - x
        return np.clip(gap / np.where(gap > 0, rise, fall), -rate, rate)

    at = np.array([0.01, 0.05, 0.1, 0.2, 0.4])
    exact = solve_ivp(speed, (0, 0.4), [value], t_eval=at, rtol=1e-10, atol=1e-14, max_step=1e-3).y[0]
    pin_heights = [approach_target(value, target, t, rate, rise, fall) for t in at]
    assert pin_heights == approx(exact, abs=1e-8)


def test_an_actuator_neither_overshoots_nor_moves_without_time():
    assert approach_target(1e-3, 2e-3, 0.0, 0.1, 0.0, 0.0) == 1e-3
    assert approach_target(1e-3, 2e-3, -1.0, 0.1, 0.0, 0.0) == 1e-3
    assert approach_target(1e-3, 2e-3, 1e9, 0.1, 0.05, 0.1) == 2e-3
    assert approach_target(1e-3, 2e-3, 1e-3, np.inf, 0.0, 0.0) == 2e-3
    assert approach_target(0.0, 1.0, 0.5, np.inf, 0.5, 9.0) == approx(1 - np.exp(-1))


def test_cooling_may_be_slower_than_heating():
    up = approach_target(0.0, 1e-3, 0.1, 1e3, 0.1, 0.4)
    down = 1e-3 - approach_target(1e-3, 0.0, 0.1, 1e3, 0.1, 0.4)
    assert up == approx(1e-3 * (1 - np.exp(-1))) and down == approx(1e-3 * (1 - np.exp(-0.25)))


def test_pins_stop_at_whole_steps_within_the_stroke():
    assert quantise(1.26e-3, 0.5e-3, 4e-3) == approx(1.5e-3)
    assert quantise(3.99e-3, 0.7e-3, 4e-3) == approx(3.5e-3)
    assert quantise(4e-3, 0.1e-3, 4e-3) == approx(4e-3)
    assert quantise(1.234e-3, 0.0, 4e-3) == 1.234e-3


def test_the_actuator_compensates_the_limited_pins():
    wanted, pins, shown = np.array([1e-3, 3e-3, 7e-3]), np.zeros(3), np.empty(3)
    by = Drives(stroke=2e-3, travel=0.05, rate=1e3, actuator_rate=1e3, rise=0.0, fall=0.0, step=0.0)
    actuator, limited = drive(pins, wanted, 0.0, 9e-3, 1e3, by, shown)
    assert limited
    assert shown.mean() - actuator == approx(wanted.mean() - 9e-3)
    actuator, limited = drive(pins, wanted / 10, actuator, 9e-3, 1e3, by, shown)
    assert not limited and actuator == approx(9e-3) and shown == approx(wanted / 10)
    actuator, limited = drive(pins, wanted / 10, actuator, 0.09, 1e3, by, shown)
    assert limited and actuator == approx(0.05)
