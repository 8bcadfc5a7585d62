"""The kernel of the controller alone: invariance under rotation, damping during unloading, and the energy observer."""

import math
import re

import numpy as np
import pytest
from pytest import approx
from scipy.spatial.transform import Rotation

from palpate.compiler.fields import blank_record
from palpate.physics.device.controller import (
    GAINS,
    RECOVERY,
    STATE,
    haptic,
    observe,
    reset,
    rings,
)
from palpate.physics.device.rendered import LEAP, SHARE, SPAN, SURFACE, compensation, lift, stiffest

T, MASS, DRAG, COUNT = 1e-3, 0.1, 0.2, 60e-6
STILL, UP = (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)


def gains(resolution=0.0, passive=True, **more):
    return blank_record(
        GAINS, hysteresis=60e-6, mass=MASS, drag=DRAG, limit=1e6, slew=1e9, resolution=resolution, observes=True,
        passive=passive, **more,
    )  # fmt: skip


def buffers(delay):
    """State and rings before the first step."""
    return blank_record(STATE), rings(delay)


def run(path, stiffness, delay=0, turn=None, friction=0.0, resolution=0.0):
    """Forces [N] (k,3) and energies [J] on a plane z = 0 with a normal `stiffness` and a `friction` coefficient along
    x; the scene is rotated by `turn`, and the result is rotated back."""
    turn = np.eye(3) if turn is None else turn
    state, past = buffers(delay)
    forces, energies = [], []
    n = tuple(turn @ (0.0, 0.0, 1.0))
    for point in path:
        depth = max(-point[2], 0.0)
        push = stiffness * depth
        along = tuple(turn @ (friction * push, 0.0, 0.0))
        place = tuple(turn @ point)
        *force, _, energy = haptic(gains(resolution), state, past, push, n, along, depth, depth, place, STILL, T)
        forces.append(turn.T @ force)
        energies.append(energy)
    return np.array(forces), np.array(energies)


def strokes() -> np.ndarray:
    """Three presses, each faster than the last, during a sideways motion [m]."""
    t = np.arange(600) * T
    depth = -2e-3 * np.sin(2 * math.pi * (4 * t + 10 * t * t))
    return np.stack([3e-3 * np.sin(15 * t), 2e-3 * np.cos(23 * t), depth], axis=1)


@pytest.mark.parametrize("delay", [0, 2])
@pytest.mark.parametrize(("seed", "stiffness"), [(1, 2000.0), (2, 2000.0), (3, 20_000.0)])
def test_a_rotated_scene_gets_the_rotated_force(delay, seed, stiffness):
    turn = Rotation.random(random_state=seed).as_matrix()
    straight, energy = run(strokes(), stiffness, delay, friction=0.3)
    turned, turned_energy = run(strokes(), stiffness, delay, turn, friction=0.3)
    assert np.abs(straight).max() > 0.4
    assert turned == approx(straight, abs=1e-9 * np.abs(straight).max())
    assert turned_energy == approx(energy, abs=1e-12)


@pytest.mark.parametrize(("delay", "stiffness"), [(0, 2000.0), (1, 400.0), (3, 120.0)])
def test_during_unloading_the_force_is_the_law_minus_the_damping(delay, stiffness):
    """F = K s - B v with B = 4 max(0, K t - b/2), t = T (d + 1/2), after the speed is known; during loading the law
    alone."""
    speed, steps = 0.05, 60
    depth = np.concatenate([np.arange(1, steps), np.arange(steps, 0, -1)]) * speed * T
    forces, _ = run(np.stack([0 * depth, 0 * depth, -depth], axis=1), stiffness, delay)
    law = stiffness * depth
    assert forces[: steps - 1, 2] == approx(law[: steps - 1], rel=1e-9)
    out = slice(steps + delay + 15, 2 * steps - 15)
    damping = compensation(stiffness, T * (delay + 0.5), DRAG)
    assert damping == approx(4.0 * max(stiffness * T * (delay + 0.5) - 0.1, 0.0)) and damping > 0.1
    assert (law - forces[:, 2])[out] == approx(damping * speed, rel=1e-6)


def test_the_stiffest_slope_has_its_formula():
    lag = 0.5 * T
    assert stiffest(MASS, DRAG, 0.0, lag) == approx(DRAG / lag + SHARE * MASS / lag**2)
    assert stiffest(MASS, DRAG, 0.0, lag) == approx(400.0 + 4000.0)
    assert stiffest(MASS, DRAG, COUNT, lag) == approx(LEAP / COUNT)
    assert SHARE == 0.01 and LEAP == 0.1


@pytest.mark.parametrize("turned", [0.0, 0.7, 2.0])
def test_a_tangential_oscillation_does_not_raise_a_limited_force_but_a_slide_does(turned):
    """At a depth of 1 mm the law gives 20 N, of which the finger feels 0.6 N. A finger that oscillates sideways by a
    few counts keeps that force; a sliding one gains at most LEAP per count of motion, up to LEAP per count of the
    approach."""
    t = np.arange(-150, 150) * T
    most = LEAP / COUNT
    for side, slides in ((4 * COUNT * np.sin(2 * math.pi * 30 * t), False), (0.1 * t, True)):
        state, past = buffers(0)
        force = []
        for k, s in enumerate(side):
            depth = min(1e-5 * k, 1e-3)
            s *= k >= 150
            place = (s * math.cos(turned), s * math.sin(turned), -depth)
            push = 500.0 * depth if k < 90 else 20.0
            force.append(haptic(gains(COUNT), state, past, push, UP, STILL, depth, depth, place, STILL, T)[2])
        assert force[149] == approx(0.45 + 0.1e-3 * most, rel=0.02)
        if slides:
            assert force[-1] == approx(most * 1e-3)
            assert np.diff(force[150:]).max() < 1.01 * most * 0.1 * T
        else:
            assert force[150:] == approx(np.full(150, force[149]), rel=1e-6)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_return_of_one_count_is_not_counted_and_a_longer_one_is(axis, way):
    """E <- E - F.dx, in any direction of motion."""
    push = np.array([0.3, -0.7, 1.1])
    step = np.zeros(3)
    step[axis] = way * COUNT
    state, _ = buffers(0)
    for count in (1, 2, 3):
        observe(state, push, *(count * step), T, COUNT)
    inward = -3 * push @ step
    assert state.energy == approx(inward)
    for count in (2, 3, 2, 3):
        assert observe(state, push, *(count * step), T, COUNT) == (0.0, 0.0, 0.0)
    assert state.energy == approx(inward)
    velocity = observe(state, push, *(1 * step), T, COUNT)
    assert velocity == approx(-2 * step / (5 * T))  # two counts in the five steps since the last movement
    assert state.energy == approx(-push @ step)


@pytest.mark.parametrize("resolution", [0.0, COUNT])
def test_a_finger_at_rest_keeps_its_force(resolution):
    deep = np.concatenate([np.linspace(0.0, 1e-3, 30), np.full(50, 1e-3)])
    forces, _ = run(np.stack([0 * deep, 0 * deep, -deep], axis=1), 500.0, resolution=resolution)
    assert forces[30:, 2] == approx(0.5, rel=1e-9)


def test_an_extreme_step_gives_no_force_and_the_next_one_is_normal():
    state, past = buffers(0)
    up, still = (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
    for place in ((0.0, 0.0, -1e-3), (0.0, 0.0, math.inf), (0.0, 0.0, -1e-3)):
        fx, fy, fz, touching, _ = haptic(gains(), state, past, 0.5, up, still, 1e-3, 1e-3, place, still, T)
        assert (fx, fy) == (0.0, 0.0) and fz == (0.0 if math.isinf(place[2]) else approx(0.5)) and touching


@pytest.mark.parametrize("place", [(0.0, 0.0, 0.0), (0.05, -0.02, 0.1)])
def test_the_path_starts_at_the_first_position_of_the_finger(place):
    """The first position is not a motion: no energy, no damping, and the spring of free motion is anchored there."""
    law = gains(stiffness=50.0, damping=2.0)
    state, past = buffers(1)
    still = (0.0, 0.0, 0.0)
    for _ in range(5):
        *force, touching, energy = haptic(law, state, past, 0.0, (0.0, 0.0, 1.0), still, 0.0, 0.0, place, still, T)
        assert force == [0.0, 0.0, 0.0] and not touching and energy == 0.0
    away, fast = (place[0] + 1e-3, place[1] + 2e-3, place[2] - 3e-3), (0.01, -0.03, 0.02)
    *force, _, _ = haptic(law, state, past, 0.0, (0.0, 0.0, 1.0), still, 0.0, 0.0, away, fast, T)
    assert force == approx([-0.07, -0.04, 0.11])


def step(law, state, past, push=0.0, place=STILL, velocity=STILL, n=UP, friction=STILL, dt=T):
    """One step of the kernel, 1 mm deep: force [N] (3), whether it touches, energy [J]."""
    return haptic(law, state, past, push, n, friction, 1e-3, 1e-3, tuple(place), velocity, dt)


def test_the_switch_to_contact_causes_no_jump_and_its_difference_decays():
    law = gains(passive=False, stiffness=50.0, damping=2.0, contact_damping=1.0)
    state, past = buffers(0)
    fast = np.array([0.01, 0.03, -0.02])
    step(law, state, past)
    free = np.array(step(law, state, past, 0.0, (1e-3, -2e-3, 3e-3), tuple(fast))[:3])
    assert np.abs(free).min() > 0.03
    first = step(law, state, past, 1e-12, (1e-3, -2e-3, 3e-3), tuple(fast))
    assert first[:3] == approx(free) and first[3]
    second = step(law, state, past, 1e-12, (1e-3, -2e-3, 3e-3), tuple(fast))
    assert second[:3] == approx(-fast + (free + fast) * math.exp(-T / 0.01))


@pytest.mark.parametrize("axis", range(3))
def test_contact_ends_beyond_approach_and_hysteresis_along_each_axis(axis):
    (state, past), place, along = buffers(0), np.array([0.02, -0.03, 0.05]), np.eye(3)[axis]
    for push, way, touches in ((0.5, 0.0, True), (0.0, 1.05e-3, True), (0.0, 1.07e-3, False)):
        assert step(gains(passive=False), state, past, push, place + way * along)[3] == touches


@pytest.mark.parametrize("dt", [0.0, -T, math.inf, math.nan])
def test_a_step_of_zero_duration_repeats_the_last_output(dt):
    law, (state, past) = gains(passive=False), buffers(1)
    given = {"n": (0.6, 0.0, 0.8), "friction": (0.0, -0.2, 0.0)}
    for z in (0.0, 1e-4, 3e-4, 4e-4):
        answer = step(law, state, past, 0.5, (0.0, 0.0, z), **given)
    assert len(set(answer)) == 5
    before = state.item(), [ring.copy() for ring in past]
    assert step(law, state, past, 0.5, STILL, dt=dt, **given) == answer
    assert repr(state.item()) == repr(before[0]) and all(map(np.array_equal, past, before[1]))


def test_after_a_non_finite_input_the_force_rises_from_zero_at_the_slew_limit():
    law, (state, past) = gains(passive=False), buffers(0)
    law.slew = 1.0
    n = (2 / 7, 3 / 7, 6 / 7)
    for _ in range(50):
        force = step(law, state, past, 0.5, n=n)[:3]
    assert force == approx(0.05 * np.array(n))
    assert step(law, state, past, math.nan, n=n)[:3] == (0.0, 0.0, 0.0)
    for k in (1, 2, 3):
        assert step(law, state, past, 0.5, n=n)[:3] == approx(k * 1e-3 * np.array(n))


@pytest.mark.parametrize("delay", [0, 2])
def test_energy_is_counted_with_the_force_delayed_like_the_device(delay):
    rng = np.random.default_rng(3)
    pushes = np.concatenate([[0.0], rng.uniform(0.5, 2.0, 30)])
    places = np.concatenate([[0.0], np.cumsum(rng.uniform(1e-4, 3e-4, 30))])
    state, past = buffers(delay)
    forces, energies = [], []
    for push, z in zip(pushes, places, strict=True):
        *force, _, energy = step(gains(passive=False), state, past, push, (0.0, 0.0, z))
        forces.append(force[2])
        energies.append(energy)
    acted = np.concatenate([np.zeros(1 + delay), forces])[: len(places)]
    assert energies == approx(-np.cumsum(acted * np.diff(places, prepend=0.0)))


def test_friction_is_scaled_like_the_normal_force():
    depth = np.linspace(0.0, 2e-3, 100)
    forces, _ = run(np.stack([0 * depth, 0 * depth, -depth], axis=1), 20_000.0, delay=2, friction=0.3)
    assert 0.4 < forces[-1, 2] < 4.0  # of the 40 N of the law alone
    assert forces[:, 0] == approx(-0.3 * forces[:, 2])


def test_absorbed_energy_is_reset_at_the_switch_and_generated_energy_is_kept():
    law = gains(passive=False)
    for energy in (0.3, -0.004, -0.05):
        for push, paid in ((0.5, 0.0), (0.0, 0.25 * 2e-3)):  # into contact and out of it
            state, past = buffers(0)
            step(law, state, past, 0.5 - push)
            state.energy, state.rise = energy, 7.0
            step(law, state, past, push, (0.0, 0.0, 0.0 if push else 2e-3))
            assert state.energy == approx(min(energy - paid, 0.0))
            assert state.rise == (7.0 if push else 0.0)
    state, past = buffers(0)
    energies = [step(law, state, past, 0.5, (0.0, 0.0, -1e-3 * k))[4] for k in range(5)]
    assert energies == approx([0.0, 0.25e-3, 0.75e-3, 1.25e-3, 1.75e-3])  # the first step had no force


@pytest.mark.parametrize("seconds", [0.3, 2.0, 8.0])
@pytest.mark.parametrize("resolution", [0.0, COUNT])
def test_a_slow_retreat_from_soft_viscous_tissue_keeps_its_force(seconds, resolution):
    """400 N/m and 8 N s/m: where a retreat slows down, the force rises while the finger moves out. A finger whose speed
    varies, by 40 % at 7 Hz and by rounding, still feels the law."""
    n = np.array([0.36, -0.48, 0.8])
    t = np.arange(0.0, seconds + 0.5, T)
    rng, (state, past) = np.random.default_rng(5), buffers(0)
    deep = 6e-3 * np.minimum(t / 0.4, 1.0)
    out = np.maximum(t - 0.5, 0.0)
    deep -= 4e-3 / seconds * (out + 0.4 * np.sin(44.0 * out) / 44.0)
    deep += 2e-7 * rng.normal(size=len(t))
    lacks, forces = [], []
    for depth, speed in zip(deep, np.gradient(deep, T), strict=True):
        force = max(400.0 * depth + 8.0 * speed, 0.0)
        *shown, _, _ = haptic(
            gains(resolution), state, past, force, n, STILL, depth, depth, tuple(-depth * n), STILL, T
        )
        forces.append(force)
        lacks.append(force - np.array(shown) @ n)
    lacks = np.array(lacks)[t > 0.51]  # contact and retreat begin with jumps of the viscous force, which are limited
    assert max(forces) > 2.0 and lacks.max() < 0.03 and lacks.mean() < 0.01


@pytest.mark.parametrize("out", [0.0, 5e-3])
@pytest.mark.parametrize("resolution", [0.0, COUNT])
def test_a_hand_feels_a_surface_that_comes_to_it_and_moves_out_slowly(resolution, out):
    """The surface comes at 20 mm/s, the hand yields by `out` [m/s], and fingertip and tissue of 800 N/m each share the
    rest. Its encoder changes by a count now and then. By the path of the hand alone this force was withheld."""
    state, past = buffers(0)
    forces, felt = [], []
    for k in range(300):
        if k == 2:
            state.energy = 5e-3  # that the hand has put in, so that its motion outwards is not damped
        place = out * T * k
        place = resolution * math.floor(place / resolution + 0.5 + (k % 10 == 0)) if resolution > 0.0 else place
        depth = max(0.02 * T * k - place, 0.0)
        forces.append(400.0 * depth)
        force = haptic(
            gains(resolution), state, past, forces[-1], UP, STILL, depth, 0.5 * depth, (0.0, 0.0, place), STILL, T
        )
        felt.append(force[2])
    assert forces[-1] > 1.5
    lacks = np.array(forces) - felt
    assert lacks[150:].mean() < 0.05 and lacks.max() < 0.4


def test_an_oscillation_of_the_finger_is_not_motion_of_the_surface():
    """Its compression grows by what it moves in, or by a part of that, and shrinks again."""
    for share in (0.2, 1.0):
        for period in (4, 20, 100):
            surface, moved, before = blank_record(SURFACE), 0.0, 2e-3
            for k in range(1000):
                place = 2e-3 + 0.5e-3 * math.sin(math.tau * k / period)
                moved += lift(surface, share * place, place - before, 0.0, T)
                before = place
            assert moved < 1e-9


@pytest.mark.parametrize("out", [0.0, 5e-6, 3e-5])
def test_a_surface_that_compresses_a_finger_moving_out_has_moved_by_both(out):
    """Without compression beyond the motion nothing is known of the surface; a retreat through tissue is none."""
    surface, moved = blank_record(SURFACE), [0.0]
    for k in range(300):
        moved.append(lift(surface, 1e-3 + 1e-5 * k, -out, 0.0, T))
    assert moved[-1] == approx(1e-5 + out, rel=1e-5)
    surface = blank_record(SURFACE)
    assert all(lift(surface, 2e-3 - 0.3 * out * k, -out, 0.0, T) == 0.0 for k in range(60))


def test_the_spring_of_free_motion_pulls_to_its_start():
    law, (state, past), begin = gains(passive=False), buffers(0), np.array([0.02, -0.03, 0.05])
    law.stiffness = 50.0
    for way in ((0.0, 0.0, 0.0), (1e-3, 2e-3, -3e-3), (4e-3, 0.0, 1e-3)):
        assert step(law, state, past, 0.0, begin + way)[:3] == approx(-50.0 * np.array(way), abs=1e-12)


@pytest.mark.parametrize("axis", range(3))
def test_a_steep_law_may_also_rise_with_tangential_motion(axis):
    """From 0.2 N by the stiffest slope, 4400 N/m for a delay of half a step, times the path in the surface plane."""
    n, (state, past) = np.eye(3)[axis], buffers(0)
    step(gains(), state, past, 0.2, STILL, n=tuple(n))
    sideways = np.roll((0.0, 3e-5, 4e-5), axis)
    force = step(gains(), state, past, 5.0, sideways - 2e-5 * n, n=tuple(n))[:3]
    assert force == approx((0.2 + 4400.0 * (5e-5 + 2e-5)) * n)


def test_motion_in_the_air_does_not_count_as_unloading_speed():
    state, past = buffers(0)
    for k in range(5):
        step(gains(), state, past, 0.0, (0.0, 0.0, 1e-3 * k))
    assert state.outward == 0.0


@pytest.mark.parametrize("dt", [1e-18, 1e-9])
def test_a_step_too_short_for_the_clock_gives_a_finite_force(dt):
    state, past = buffers(0)
    for k in range(5):
        step(gains(), state, past, 0.5, (0.0, 0.0, -1e-4 * k))
    assert np.isfinite(step(gains(), state, past, 0.5, (0.0, 0.0, -3e-4), dt=dt)).all()
    assert not re.search("nan|inf", str(state))


def test_a_first_sample_far_from_the_origin_is_not_damped():
    state, past = buffers(3)
    for k in range(1, 7):
        place = (0.05, -0.02, 0.3 - 1e-5 * k)
        force = step(gains(), state, past, 100.0 * 1e-5 * k, place)[:3]
        assert force == approx((0.0, 0.0, 1e-3 * k))


@pytest.mark.parametrize("push", [0.0, 0.5])
def test_a_non_finite_input_does_not_change_mode_and_energy(push):
    state, past = buffers(0)
    step(gains(), state, past, push)
    step(gains(), state, past, push, (0.0, 0.0, 1e-4))
    assert step(gains(), state, past, math.nan) == (0.0, 0.0, 0.0, push > 0.0, state.energy)
    assert bool(state.energy) == (push > 0.0)


def test_a_slope_is_measured_over_eight_counts_because_of_rounding():
    state, past = buffers(0)
    for k in range(12):
        step(gains(COUNT), state, past, 100.0 * COUNT * k, (0.0, 0.0, -COUNT * k))
        assert state.gauge.mark == approx(COUNT * (8 if k >= 8 else 0))


def test_a_fresh_state_is_that_of_new_buffers():
    state, past = buffers(2)
    for k in range(4):
        step(gains(), state, past, 0.5, (0.0, 1e-3 * k, -1e-4 * k))
    assert state.tobytes() != buffers(2)[0].tobytes() and all(ring.any() for ring in past)
    reset(state, past)
    assert state.tobytes() == buffers(2)[0].tobytes() and not any(ring.any() for ring in past)


@pytest.mark.parametrize("push", [0.2, 5.0])
@pytest.mark.parametrize(("way", "n"), [
    ((0.6, 0.8, 0.0), UP), ((0.0, -0.6, 0.8), (1.0, 0.0, 0.0)), ((0.8, 0.0, 0.6), (0.0, -1.0, 0.0)),
])  # fmt: skip
def test_a_finger_drags_a_point_in_contact_and_carries_it_in_air(push, way, n):
    """The point of `drag_distance` follows at SPAN counts along the surface, under any force."""
    (state, past), law, begin = buffers(0), gains(COUNT), np.array([0.01, -0.02, 0.03])
    for k in range(60):
        place = begin + 5e-5 * k * np.array(way)
        step(law, state, past, push, place, n=n)
    assert state.dragged == approx(place - SPAN * COUNT * np.array(way), abs=1e-12)
    step(law, state, past, 0.0, place + 1e-3 * np.array(n), n=n)
    assert state.dragged == approx(place + 1e-3 * np.array(n), abs=1e-15)


def pressed(steps, stiffness):
    """Forces [N] of a press by 20 um per step, whose durations [s] are given, on a plane of a `stiffness` [N/m]."""
    (state, past), forces = buffers(0), []
    for k, dt in enumerate(steps):
        depth = 2e-5 * k
        place = (0.0, 0.0, -depth)
        forces.append(haptic(gains(), state, past, stiffness * depth, UP, STILL, depth, depth, place, STILL, dt)[2])
    return np.array(forces)


@pytest.mark.parametrize(
    ("late", "softened"), [((2.9,), True), ((3.1,), False), ((10.0,), False), ((10.0, 10.0), True)]
)
def test_a_single_step_more_than_three_times_late_does_not_lower_the_stiffness(late, softened):
    """Between the bounds of the usual and of the late lag; a second late step is the usual one."""
    lags = [stiffest.py_func(MASS, DRAG, 0.0, 0.5 * each * T) for each in (1.0, 2.9)]
    stiffness = 0.5 * sum(lags)
    assert lags[1] < stiffness < lags[0]
    steps = [T] * 10 + [each * T for each in late]
    law = stiffness * 2e-5 * np.arange(len(steps))
    forces = pressed(steps, stiffness)
    assert forces[:10] == approx(law[:10]) and (forces[-1] < 0.99 * law[-1]) == softened
    assert forces[-2] == approx(law[-2]) and (softened or forces[-1] == approx(law[-1]))


@pytest.mark.parametrize("outage", [False, True])
def test_after_an_outage_a_limited_force_rises_at_rest_by_ten_newtons_per_second(outage):
    state, past = buffers(0)
    forces = []
    for k in range(102):
        if k == 1:
            state.rise = 500.0 if outage else 0.0
        place = (0.0, 0.0, -1e-3 * min(k, 1))
        forces.append(haptic(gains(COUNT), state, past, 8.0 * min(k, 1), UP, STILL, 5e-3, 5e-3, place, STILL, T)[2])
    assert RECOVERY == 10.0
    assert forces[1] == approx(LEAP / COUNT * 1e-3 + outage * 10.0 * T * (forces[1] > LEAP / COUNT * 1e-3 * 1.001))
    assert forces[101] - forces[1] == approx(outage * 10.0 * 100 * T)


def test_only_the_motion_of_the_hand_counts_while_the_position_follows_it_after_an_outage():
    """E = -∫ F·dx of the device, by a sum outside the kernel; a device at rest absorbs nothing while the position
    moves, and nothing pushes it."""
    rng = np.random.default_rng(8)
    for moves in (0.0, 1.0):
        state, past = buffers(0)
        device = np.cumsum(moves * rng.uniform(-1e-4, 1e-4, (200, 3)), axis=0)
        gap = np.linspace(5e-3, 0.0, 200)[:, None] * (0.3, 0.2, -1.0)
        energy, last = 0.0, np.zeros(3)
        for k in range(200):
            state["behind"] = gap[k]
            place = device[k] - gap[k]
            push = 50.0 * (5e-3 - gap[k, 2]) if k else 0.0  # the first step is at rest
            if k:
                energy -= last @ (device[k] - device[k - 1])
            *force, _, seen = haptic(
                gains(), state, past, push, UP, STILL, 5e-3, 5e-3, tuple(place), (0.1, 0.1, -0.3), T
            )
            last = np.array(force)
            assert seen == approx(energy, abs=1e-12)
            if not moves:
                assert np.hypot(*last[:2]) == 0.0, "a damping force that no motion has caused"
