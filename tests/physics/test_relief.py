"""The pressure of a relief on the skin, against closed forms, line loads and point forces."""

import numpy as np
import pytest
from pytest import approx

from palpate.physics.contact.subsurface import point_stress
from palpate.physics.texture import relief, surface

MODULUS, POISSON, WAVE = 6e4, 0.45, 3e-3
COUNT = 256
S = np.arange(COUNT) * WAVE / COUNT
STEP = WAVE / COUNT
AMPLITUDE = 0.1e-3
HEIGHT = AMPLITUDE * np.cos(2.0 * np.pi * S / WAVE)
FULL = np.pi * MODULUS * AMPLITUDE / WAVE
"""[Pa] mean pressure of full contact of a sinusoid: K. L. Johnson, Contact Mechanics, eq. 13.6."""


def test_a_sinusoid_in_full_contact_has_johnsons_pressure():
    p = relief.full_contact(HEIGHT, STEP, MODULUS)
    assert p == approx(FULL * np.cos(2.0 * np.pi * S / WAVE), abs=1e-9 * FULL)


@pytest.mark.parametrize("share", [0.05, 0.2, 0.5, 0.9])
def test_a_sinusoid_in_partial_contact_has_westergaards_pressure(share):
    mean = share * FULL
    p = relief.solve_pressure(HEIGHT, STEP, MODULUS, mean, FULL + relief.full_contact(HEIGHT, STEP, MODULUS))
    x = (S + 0.5 * WAVE) % WAVE - 0.5 * WAVE
    half = np.arcsin(np.sqrt(share))  # pi a/L
    inside = np.maximum(np.sin(half) ** 2 - np.sin(np.pi * x / WAVE) ** 2, 0.0)
    exact = 2.0 * mean * np.cos(np.pi * x / WAVE) / np.sin(half) ** 2 * np.sqrt(inside)
    assert p.mean() == approx(mean) and np.mean(p > 0.0) == approx(2.0 * half / np.pi, abs=2.0 / COUNT)
    assert np.sqrt(np.mean((p - exact) ** 2)) < 0.01 * exact.max()


def rough(count=COUNT, seed=2):
    made, spacing = surface.random_surface(np.array([[400.0, 1.0], [4000.0, 0.1]]), 0.1, seed)
    height = relief.heights(made, spacing, 4000.0)[0][:count]
    return height - height.mean()


@pytest.mark.parametrize("share", [1e-3, 0.03, 0.3])
def test_a_rough_relief_touches_without_overlap_by_the_sum_of_line_loads(share):
    """u = -2/(pi E*) sum p ds ln|2 sin(pi (s - s')/L)|, summed directly, in place of a Fourier transform."""
    height = rough()
    full = relief.full_contact(height, STEP, MODULUS)
    mean = -share * full.min()
    p = relief.solve_pressure(height, STEP, MODULUS, mean, full - full.min())
    apart = np.abs(np.sin(np.pi * (S[:, None] - S[None, :]) / WAVE))
    np.fill_diagonal(apart, np.pi * STEP / WAVE / (2.0 * np.e))  # the mean of the logarithm over a cell
    u = -2.0 / (np.pi * MODULUS) * STEP * np.log(2.0 * apart) @ p
    gap = u - height
    gap -= gap[p > 0.0].mean()
    assert p.min() >= 0.0 and p.mean() == approx(mean) and 0.0 < np.mean(p > 0.0) < 0.9
    assert np.abs(gap[p > 0.0]).max() < 0.02 * np.ptp(height) and gap.min() > -0.02 * np.ptp(height)


@pytest.mark.parametrize("place", [0.0, 0.4e-3, 1.1e-3])
@pytest.mark.parametrize("depth", [0.3e-3, 1.6e-3])
def test_the_stress_is_that_of_many_point_forces(place, depth):
    """Boussinesq's point forces over 24 wavelengths, faded out by a Gaussian. The mean pressure is left out."""
    across, along = (np.arange(-12 * n, 12 * n + 1) / n * WAVE for n in (16, 32))
    x, y = np.meshgrid(along, across, indexing="ij")
    force = np.cos(2.0 * np.pi * x / WAVE) * np.exp(-(x**2 + y**2) / (2.0 * (4.0 * WAVE) ** 2)) * WAVE**2 / (16 * 32)
    at = np.stack([place - x, -y, np.full_like(x, depth)], axis=-1).reshape(-1, 3)
    found = np.zeros((3, 3))
    for part in np.array_split(np.arange(len(at)), 20):
        found += np.einsum("n,nij->ij", FULL * force.ravel()[part], point_stress(at[part], POISSON)[..., 2])
    table = relief.imprint(HEIGHT, STEP, MODULUS, POISSON, np.array([0.1e-3, depth]))
    zz, xz, xx, *_ = relief.interpolate_imprint(table.stress, table.surface, table.full, 1, place / STEP, 2.0 * FULL)
    assert (zz, xz, xx) == approx((found[2, 2], found[0, 2], found[0, 0]), abs=0.006 * FULL)
    assert POISSON * (xx + zz) == approx(found[1, 1], abs=0.006 * FULL)


def test_the_displacement_is_that_of_line_loads():
    """Inwards the skin follows the relief in full contact; along it, each line load pulls its sides towards itself by
    (1 - 2 nu)/(2 (1 - nu)) of the load over E*, at any distance."""
    table = relief.imprint(HEIGHT, STEP, MODULUS, POISSON, np.array([1e-3]))
    load = FULL * np.cos(2.0 * np.pi * S / WAVE) * STEP
    for i in (0, 40, 100):
        *_, down, side = relief.interpolate_imprint(table.stress, table.surface, table.full, 0, float(i), 2.0 * FULL)
        left, right = load[np.arange(i - COUNT // 2, i)].sum(), load[np.arange(i + 1, i + COUNT // 2) % COUNT].sum()
        assert down == approx(MODULUS * HEIGHT[i], abs=1e-9)
        # half a wavelength on each side has twice the load of the whole side, averaged over its end
        assert side == approx(-0.25 * (1 - 2 * POISSON) / (1 - POISSON) * (left - right), abs=0.004)


def test_the_table_is_accurate_between_its_pressures():
    depth = 0.3e-3
    table = relief.imprint(HEIGHT, STEP, MODULUS, POISSON, np.array([depth]))
    k = relief.waves(COUNT, STEP)
    for share in (0.013, 0.11, 0.42, 0.83):
        p = relief.solve_pressure(
            HEIGHT, STEP, MODULUS, share * FULL, FULL + relief.full_contact(HEIGHT, STEP, MODULUS)
        )
        lines = np.fft.rfft(p - p.mean())
        exact = np.fft.irfft(-(1.0 + k * depth) * np.exp(-k * depth) * lines, COUNT)
        found = [
            relief.interpolate_imprint(table.stress, table.surface, table.full, 0, float(i), share * FULL)[0]
            for i in range(COUNT)
        ]
        assert np.array(found) == approx(exact, abs=0.01 * np.abs(exact).max())
    assert relief.interpolate_imprint(table.stress, table.surface, table.full, 0, 10.0, 0.0) == approx((0.0,) * 5)


def test_a_coarse_relief_bears_at_single_points():
    """Two equal points, then one, bear the whole load, without an error of rounding that grows."""
    height = 1e-4 * np.array([0.9, 1.0, 1.0, 0.2, 0.0, 0.1, 0.0, 0.3])
    mean = 1e-6 * MODULUS
    p = relief.solve_pressure(height, WAVE / 8, MODULUS, mean, np.ones(8))
    assert p == approx(mean * np.array([0, 4, 4, 0, 0, 0, 0, 0]), rel=1e-6)
    height[1] *= 1.01
    assert relief.solve_pressure(height, WAVE / 8, MODULUS, mean, p) == approx(8.0 * mean * np.eye(8)[1], rel=1e-6)


def test_heights_are_the_integral_of_the_slope():
    slope = np.gradient(np.tile(HEIGHT, 3), STEP)[COUNT : 2 * COUNT]
    found, spacing = relief.heights(slope, STEP, 1.0 / WAVE)
    assert len(found) == 8 and spacing == approx(WAVE / 8)
    assert found == approx(AMPLITUDE * np.cos(2.0 * np.pi * np.arange(8) / 8), rel=2e-3, abs=1e-8)
    with pytest.raises(ValueError, match="expected at most 4096 of the shortest wavelengths"):
        relief.heights(np.zeros(1 << 16), 1e-6, 1e5)
