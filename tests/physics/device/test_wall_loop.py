"""The loop of a device and a wall, sample by sample: each part compared with its closed form."""

from math import exp, inf

import numpy as np
import pytest
from formulas import decays
from pytest import approx

from palpate.physics.device.wall_loop import WallDevice, advance, felt_stiffness, run, settles

EXACT = WallDevice(resolution=0.0)
MILLISECONDS = np.full(400, 1e-3)


def test_a_stuck_mass_stays_and_a_stronger_force_moves_it():
    assert advance(1e-3, 0.0, 0.09, 0.1, 0.2, 0.1, 1e-3) == (1e-3, 0.0)
    assert advance(1e-3, 0.0, -0.1, 0.1, 0.2, 0.1, 1e-3) == (1e-3, 0.0)
    x, v = advance(1e-3, 0.0, -0.11, 0.1, 0.2, 0.1, 1e-3)
    assert x < 1e-3 and v < 0.0


def test_a_long_step_with_dry_friction_approximates_the_fine_one():
    """With eight parts per step slightly more than 1/16 of the first-order error of one part remains."""
    long = advance(0.0, 0.5, 0.0, 0.1, 0.2, 0.1, 0.1)
    x, v = 0.0, 0.5
    for _ in range(10_000):
        x, v = advance(x, v, 0.0, 0.1, 0.2, 0.1, 1e-5)
    assert long == approx((x, v), rel=0.02)
    assert advance(0.0, 0.5, 0.0, 0.1, 0.2, 0.0, 0.1)[1] == approx(0.5 * exp(-0.2))


def test_a_free_run_has_no_hand_and_a_bilateral_wall():
    """After half a period of a mass on a spring, pi sqrt(m/K), from rest at `begin`, it is on the other side."""
    device = WallDevice(mass=0.1, drag=1e-6, resolution=0.0)
    half = int(np.pi * (0.1 / 10.0) ** 0.5 / 1e-4)
    path = run(device, 10.0, 0.0, controlled=False, steps=np.full(half, 1e-4), free=True)
    assert path[0, 0] == approx(1e-3, rel=1e-3) and path[-1, 0] == approx(-1e-3, rel=1e-2)


def test_a_hand_arrives_at_5_cm_per_second_and_rests_at_push_over_stiffness():
    path = run(EXACT, 500.0, 2.0, controlled=False, steps=np.full(20_000, 1e-4), push=0.8)
    assert (path[0, 0] - 1e-3) / 1e-4 == approx(-0.05, rel=0.02)
    assert path[-1, :2] == approx((-0.8 / 500.0, 0.8), rel=1e-3)


def test_damping_of_a_wall_dissipates_energy_and_never_pulls():
    """A sampled wall injects energy into a bouncing grip; with damping it dissipates energy."""
    bounces = [run(EXACT, 500.0, damping, controlled=False, steps=MILLISECONDS, push=0.0) for damping in (0.0, 2.0)]
    assert bounces[0][-1, 2] > 0.0 > bounces[1][-1, 2]
    speeds = np.diff(bounces[1][:, 0], prepend=1e-3) / 1e-3
    kinetic, lost = 0.5 * EXACT.mass * (speeds[-1] ** 2 - 0.05**2), EXACT.drag * (speeds**2).sum() * 1e-3
    assert bounces[1][-1, 2] == approx(kinetic + lost, rel=0.02)
    assert all(path[:, 1].min() == 0.0 and path[:50, 1].max() > 0.0 for path in bounces)


def test_the_position_is_rounded_to_the_nearest_count():
    device = WallDevice(resolution=1e-4)
    path = run(device, 1000.0, 0.0, controlled=False, steps=MILLISECONDS)
    seen = np.minimum(np.round(path[:, 0] / 1e-4) * 1e-4, 0.0)
    assert path[:, 1] == approx(-1000.0 * seen, abs=1e-12)


def test_samples_are_delayed_and_lost_ones_repeat_the_last():
    path = run(EXACT, 300.0, 0.0, controlled=False, steps=MILLISECONDS, delay=3)
    assert path[3:, 1] == approx(np.maximum(-300.0 * path[:-3, 0], 0.0), abs=1e-12)
    prompt = run(EXACT, 300.0, 0.0, controlled=False, steps=MILLISECONDS)
    assert prompt[:, 1] == approx(np.maximum(-300.0 * prompt[:, 0], 0.0), abs=1e-12)
    lost = np.arange(400) % 4 > 0
    path = run(EXACT, 300.0, 0.0, controlled=False, steps=MILLISECONDS, lost=lost)
    assert path[:, 1] == approx(np.maximum(-300.0 * np.repeat(path[::4, 0], 4), 0.0), abs=1e-12)


def test_the_force_is_limited_to_that_of_the_device():
    path = run(EXACT, 1e4, 0.0, controlled=False, steps=MILLISECONDS, push=20.0)
    assert path[:, 1].max() == EXACT.limit


def test_the_hand_feels_the_stiffness_of_the_wall():
    paths = tuple(run(EXACT, 400.0, 2.0, controlled=False, steps=np.full(8000, 1e-4), push=push) for push in (0.5, 1.0))
    assert felt_stiffness(paths) == approx(400.0, rel=1e-3)
    assert felt_stiffness(paths[::-1]) == inf == felt_stiffness((paths[0], paths[0]))


@pytest.mark.parametrize(("swing", "rests"), [(0.5, True), (0.89, True), (0.91, False), (1.1, False)])
def test_an_oscillation_counts_as_settled_if_it_decays_by_10_percent(swing, rests):
    wave = np.tile([1e-2, -1e-2], 50)
    assert settles(np.concatenate([wave, wave, wave, swing * wave]), 0.0) == rests


def test_an_oscillation_of_two_steps_and_5_micrometres_counts_as_rest():
    for size, rests in ((124e-6, True), (126e-6, False)):
        assert settles(np.tile([0.5 * size, -0.5 * size], 200), 60e-6) == rests
    assert settles(np.zeros(400), 0.0)


def test_a_diverging_oscillation_neither_settles_nor_decays():
    wild = run(EXACT, 1e7, 0.0, controlled=False, steps=np.full(4000, 1e-3), free=True)
    assert np.isinf(wild[-1, 0]) and np.abs(wild[np.isfinite(wild[:, 0]), 0]).max() < 1e6
    assert not settles(wild[:, 0], 1.0) and not decays(wild[:, 0])
