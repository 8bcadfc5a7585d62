"""The model of one fibre compared with an independent computation of the same equations."""

import math

import numpy as np
import pytest
from pytest import approx
from scipy import signal

from palpate.compiler.fields import blank_record
from palpate.physics.afferents import fibre, population
from palpate.physics.afferents.published import ADAPTATION, DENSITIES, DEPTHS, FITS, PROBE, RATE
from palpate.physics.contact.subsurface import PAIRS, point_stress

EVERY = [(kind, which) for kind, fits in enumerate(FITS) for which in range(len(fits))]


def reference(kind, fit, s):
    """Spikes (samples) of a fibre without noise on its input s [MPa] (n), with scipy's filter and no shared code."""
    b, a = signal.butter(3, fit[0] * 10.0 / (RATE / 2))
    s = signal.lfilter(b, a, s)
    z, radius = 1e3 * DEPTHS[kind], 1e3 * PROBE
    shape = (1 + 3 * (z / radius) ** 2) / (1 + (z / radius) ** 2) ** 2
    d = np.diff(s, prepend=0.0) * RATE * math.pi * radius / (shape * z * z)
    second = np.diff(d, prepend=0.0)
    slow, share = ADAPTATION[kind]
    share = share * signal.lfilter([1 / (slow * RATE)], [1, 1 / (slow * RATE) - 1], s)
    static = np.where(s > share, s - share, np.where(s < 0, s, 0.0))
    current = np.where(static >= 0, fit[1] * static, -fit[2] * static) + np.where(d >= 0, fit[3] * d, -fit[4] * d)
    current = current + np.where(second >= 0, fit[5] * second, -fit[6] * second)
    if fit[7]:
        current = fit[7] * current / (fit[7] + abs(current))
    v, last, spikes = 0.0, -1000, []
    for k, each in enumerate(current):
        t = (k - last - 1) / 5.0
        x = 1.5 * math.pi * math.log(1 + t) / math.log(9)
        after = fit[10] * 0.5 * (1 + math.cos(x)) if x < math.pi else 0.0
        after += fit[11] * 0.5 * (1 + math.cos(x - 1.5 * math.pi)) if 0.5 * math.pi < x < 2.5 * math.pi else 0.0
        v += each + after - v / fit[9]
        if v > 1.0 and k - last >= fibre.REFRACTORY:
            spikes.append(k)
            v, last = 0.0, k
    return spikes


def spikes_of(kind, fit, s, noise=False, block=1, key=5):
    """The same with the kernel, for an input s [MPa] (n) that is linear within blocks of samples."""
    (constants,), _ = fibre.constants_of(fit[None], np.array([DEPTHS[kind]]), 0.45, np.array([kind]))
    if not noise:
        constants.noise = 0.0
    state, since, basis, out = blank_record(fibre.STATE), 1000, fibre.post_spike(), []
    for start in range(0, len(s), block):
        target = s[start + block - 1]
        moved = constants.dynamic * target
        fired, since = fibre.advance(
            constants, state, since, basis, key, start, block, 1.0 / block, 1.0 / block, target, moved
        )
        state.target, state.path_target = target, moved
        out += [start + k for k in range(block) if fired >> k & 1]
    return out


@pytest.mark.parametrize(("kind", "which"), EVERY)
def test_each_fibre_fires_according_to_the_equations(kind, which):
    t = np.arange(3000) / RATE
    u = 0.5 * np.clip(t / 0.05, 0, 1) + np.where(t > 0.2, 0.1 * np.sin(2 * np.pi * 60 * t), 0.0)  # [mm]
    s = 0.04 * u
    right = reference(kind, FITS[kind][which], s)
    assert right and spikes_of(kind, FITS[kind][which], s) == right


def test_the_input_within_a_message_is_linear_for_any_block_size():
    s = np.repeat(np.linspace(0, 0.03, 60), 10)
    line = np.interp(np.arange(600), np.arange(-1, 600, 10), np.r_[0.0, s[9::10]])
    fit = FITS[0][0]
    assert spikes_of(0, fit, line, block=10) == spikes_of(0, fit, line, block=1)


def test_noise_is_white_and_depends_only_on_fibre_and_sample():
    numbers = np.array([[fibre._noise(key, sample) for sample in range(4000)] for key in (3, 4, 1 << 61)])
    assert numbers.mean() == approx(0.0, abs=0.03) and numbers.std() == approx(1.0, abs=0.02)
    assert abs(np.corrcoef(numbers)[np.triu_indices(3, 1)]).max() < 0.06
    assert abs(np.corrcoef(numbers[:, :-1].ravel(), numbers[:, 1:].ravel())[0, 1]) < 0.04
    s = np.full(1200, 0.02)
    fit = FITS[0][0]
    assert spikes_of(0, fit, s, noise=True) == spikes_of(0, fit, s, noise=True)
    assert spikes_of(0, fit, s, noise=True) != spikes_of(0, fit, s, noise=True, key=6)


@pytest.mark.parametrize("poisson", [0.3, 0.45])
def test_the_gain_equals_that_of_a_flat_punch_on_a_half_space(poisson):
    """By the sum over points of the punch's pressure, P/(2 pi a sqrt(a² - r²))."""
    node, weight = np.polynomial.legendre.leggauss(64)
    angle = 0.25 * np.pi * (node + 1.0)  # r = a sin(angle) removes the singularity at the rim
    r, share = PROBE * np.sin(angle), 0.25 * np.pi * weight * np.sin(angle)
    turn = 2 * np.pi * np.arange(64) / 64
    source = np.stack([np.outer(r, np.cos(turn)), np.outer(r, np.sin(turn))], -1).reshape(-1, 2)
    for depth in DEPTHS:
        apart = np.column_stack([-source, np.full(len(source), depth)])
        stress = np.einsum("s,sij->ij", np.repeat(share / 64, 64), point_stress(apart, poisson)[..., 2])
        assert share.sum() == approx(1.0)
        q = math.sqrt((1 + poisson) * np.sum(stress * stress) - poisson * np.trace(stress) ** 2)
        chi, dynamic = fibre.probe_gains(np.array([depth]), poisson)
        assert chi[0] == approx(-stress[2, 2] / q, rel=1e-6)
        # s = G u and d = E* (du/dt)/z² [MPa/(mm s)] with G = sigma_z/u and P = 2 E* a u
        assert dynamic[0] == approx(1.0 / (1e3 * -stress[2, 2] * 2 * PROBE * depth**2), rel=1e-6)


def test_equivalent_stress_is_right_for_a_bar_and_for_shear():
    grid = np.array([(x, y, z) for z in (1e-3, 2e-3) for x in (-1e-3, 1e-3) for y in (-1e-3, 1e-3)])
    at = np.array([(0.3e-3, -0.2e-3, 1.4e-3)])
    corners, weights = np.zeros((1, 8), np.int32), np.zeros((1, 8))
    assert population.place(grid, at, corners, weights) == (0, 0)
    assert weights.sum() == approx(1.0) and weights[0] @ grid[corners[0]] == approx(at[0])

    def q(**given):
        stress = np.zeros((8, 6))
        for name, value in given.items():
            stress[:, [f"{'xyz'[i]}{'xyz'[j]}" for i, j in PAIRS].index(name)] = value
        return population.equivalent(stress, corners[0], weights[0], 0.45)

    assert q(zz=-3e3) == q(xx=3e3) == approx(3e3)
    assert q(xz=1e3) == approx(1e3 * math.sqrt(2 * 1.45))
    assert q(xx=-1e3, yy=-1e3, zz=-1e3) == approx(1e3 * math.sqrt(3 * (1 - 2 * 0.45)))
    assert q(zz=-1e3, xz=1e3) > q(zz=-1e3)


def test_densities_equal_those_of_a_human_fingertip():
    made = population.scatter(DENSITIES, 8e-3, DEPTHS, 1)
    area = math.pi * 0.8**2  # [cm²]
    assert np.bincount(made.kind) / area == approx([70, 140, 21], abs=0.5)
    assert np.hypot(made.at[:, 0], made.at[:, 1]).max() < 8e-3
    assert made.at[made.kind == 0].mean(axis=0) == approx([0, 0, DEPTHS[0]], abs=1.2e-3)
    again, other = population.scatter(DENSITIES, 8e-3, DEPTHS, 1), population.scatter(DENSITIES, 8e-3, DEPTHS, 2)
    assert all(np.array_equal(a, b) for a, b in zip(made, again, strict=True))
    assert not np.array_equal(made.at, other.at)
