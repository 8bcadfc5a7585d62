"""Pressure of a relief on the skin: a rigid profile h(s) [m], whose ridges run across s, on an elastic half-space.

Under the mean pressure p0 the profile presses with p0 + p(s). The pressure and the displacement u(s) of the skin into
the finger have the Fourier components (H. M. Westergaard, J. Appl. Mech. 6 (1939) A49; K. L. Johnson, Contact
Mechanics, 1985, sections 13.2 and 2.2), with E* = E/(1 - nu²),

    u_k = 2 p_k/(E* |k|)

*Full contact*, u = h, so that p_k = E* |k|/2 h_k, is valid while p0 + p > 0 everywhere. With less pressure the profile
bears at its tops only: p0 + p >= 0, the gap u - h + const >= 0, and one of them is zero at each place. A primal-dual
active set (M. Hintermueller, K. Ito, K. Kunisch, SIAM J. Optim. 13 (2003) 865) finds it; the linear problem of each set
takes conjugate gradients with the law of full contact as the preconditioner. For a sinusoid of amplitude a and
wavelength L this is Westergaard's solution, with full contact from p0 = pi E* a/L on.

Below the skin, at the depth z, each component p cos(k s) adds the stress (plane strain, tension positive)

    zz = -p (1 + k z) e^(-k z) cos(k s),  xx = -p (1 - k z) e^(-k z) cos(k s),  xz = -p k z e^(-k z) sin(k s),
    yy = nu (xx + zz)

and at the surface the displacement 2 p/(E* k) cos(k s) inwards, and (1 - 2 nu)/(1 - nu) p/(E* k) sin(k s) along -s.

Range: a homogeneous skin without fingerprints or friction at the ridges; slopes up to about 0.3; wavelengths below the
radius of the contact, so that p0 changes little over one. The skin follows the relief at once: no viscosity.
"""

import math
from typing import NamedTuple

import numpy as np

from palpate.compiler.exact import exp
from palpate.compiler.kernel import ieee_kernel, kernel
from palpate.physics.arrays import Array, Tensor
from palpate.physics.texture.fourier import irfft, rfft

LEVELS = 24
"""Mean pressures of the table: those of full contact times (j/LEVELS)⁴."""
POINTS = 8  # Points of the table per shortest wavelength
MOST = 1 << 15  # Points of a table
CHANGES, ROUNDS, SMALL = 60, 30, 1e-10
"""Most changes of the contact; most rounds of the conjugate gradients, and the share of the squared error that ends
them."""
ROUNDING = 1e-12  # [1] Gap over the height of the relief that is a rounding error


class Imprint(NamedTuple):
    """Stress and displacement of the skin under one period of a relief, for mean pressures from 0 to full contact.

    stress   [Pa] (depths * (LEVELS + 1), n, 3)  fluctuation of zz, xz, xx, depth by depth
    surface  [N/m] (LEVELS + 1, n, 2)  displacement inwards and along s, times E*
    full     [Pa]  least mean pressure of full contact
    """

    stress: np.ndarray
    surface: np.ndarray
    full: float


def heights(slope: np.ndarray, spacing: float, finest: float) -> tuple[np.ndarray, float]:
    """One period (m) [m] of the heights of a relief with mean 0, and its spacing [m], from its slope (n) [1]: `POINTS`
    points per wavelength of the spatial frequency `finest` [1/m]. ValueError: there are too many."""
    length = len(slope) * spacing
    count = min(len(slope), 2 * math.ceil(0.5 * POINTS * finest * length))
    if count > MOST:
        raise ValueError(
            f"found a period of {1e3 * length:.3g} mm with wavelengths down to {1e3 / finest:.3g} mm, expected at most "
            f"{MOST // POINTS} of the shortest wavelengths in a period"
        )
    k = 2.0 * np.pi * np.arange(count // 2 + 1) / length
    lines = rfft(slope)[: len(k)]
    lines[0] = 0.0
    lines[1:] /= 1j * k[1:]
    if count % 2 == 0 and count < len(slope):
        lines[-1] = 0.0
    return irfft(lines, count) * (count / len(slope)), length / count


def full_contact(height: np.ndarray, spacing: float, modulus: float) -> np.ndarray:
    """The fluctuation of the pressure (n) [Pa] in full contact; modulus E* [Pa]."""
    return irfft(0.5 * modulus * waves(len(height), spacing) * rfft(height), len(height))


def waves(count: int, spacing: float) -> np.ndarray:
    """Wave numbers k [rad/m] of a real Fourier transform."""
    return 2.0 * np.pi * np.arange(count // 2 + 1) / (count * spacing)


def solve_pressure(height: np.ndarray, spacing: float, modulus: float, mean: float, guess: np.ndarray) -> np.ndarray:
    """Pressure (n) [Pa] >= 0 with this mean [Pa] between a rigid profile (n) [m] and a half-space, from a guess (n)."""
    count = len(height)
    k = waves(count, spacing)
    stiff = 0.5 * modulus * k
    soft = np.zeros(len(k))
    soft[1:] = 1.0 / stiff[1:]
    stiff[0] = stiff[1]
    p, bears = guess, guess > 0.0
    for _ in range(CHANGES):
        p, gap = _solve_contact(p, height, bears, soft, stiff, mean)
        again = np.where(bears, p > 0.0, gap < 0.0)
        if np.array_equal(again, bears) or not again.any():
            break
        bears = again
    return np.maximum(p, 0.0)


def _solve_contact(
    p: np.ndarray, height: np.ndarray, bears: np.ndarray, soft: np.ndarray, stiff: np.ndarray, mean: float
) -> tuple[np.ndarray, np.ndarray]:
    """Pressure (n) with this mean that closes the gap where `bears` (n), and is 0 elsewhere, and the gap (n) [m]."""
    count, inside = len(p), int(np.count_nonzero(bears))
    p = np.where(bears, p, 0.0)
    p = np.where(bears, p + (mean * count - _total(p, bears)) / inside, 0.0)
    step, before, first, least = np.zeros(count), 0.0, 0.0, ROUNDING * float(height.max() - height.min())
    for _ in range(ROUNDS):
        gap = irfft(soft * rfft(p), count) - height
        gap -= _total(gap, bears) / inside
        residual = np.where(bears, gap, 0.0)
        if float(np.abs(residual).max()) <= least:
            break
        better = irfft(stiff * rfft(residual), count)
        better = np.where(bears, better - _total(better, bears) / inside, 0.0)
        square = _total(better * residual, bears)
        first = first or square
        if square <= SMALL * first or not square > 0.0:
            break
        step = better + square / before * step if before else better
        before = square
        curve = _total(step * irfft(soft * rfft(step), count), bears)
        if not curve > 0.0:
            break
        p = p - square / curve * step
    return p, gap


@kernel
def _total(x: Array, which: Array):
    """The sum of x (n) where `which` (n), in the order of the rows, so that it has the same bits everywhere."""
    total = 0.0
    for i in range(len(x)):
        if which[i]:
            total += x[i]
    return total


def imprint(height: np.ndarray, spacing: float, modulus: float, poisson: float, depths: np.ndarray) -> Imprint:
    """The table of a relief (n) [m] with mean 0: modulus E* [Pa] of the skin, depths [m] of the receptors."""
    count = len(height)
    k = waves(count, spacing)
    fluctuation = full_contact(height, spacing, modulus)
    full = max(-float(fluctuation.min()), 1e-9)
    stress, surface = np.zeros((len(depths), LEVELS + 1, count, 3)), np.zeros((LEVELS + 1, count, 2))
    p = full + fluctuation
    for level in range(LEVELS, 0, -1):
        share = level / LEVELS
        mean = full * (share * share * share * share)
        if level < LEVELS:
            p = solve_pressure(height, spacing, modulus, mean, p)
        lines = rfft(p)
        lines[0] = 0.0
        turned = -1j * lines  # cos(k s) to sin(k s)
        for row, depth in zip(stress, depths, strict=True):
            fade = exp(-k * depth)
            row[level, :, 0] = irfft(-(1.0 + k * depth) * fade * lines, count)
            row[level, :, 1] = irfft(-k * depth * fade * turned, count)
            row[level, :, 2] = irfft(-(1.0 - k * depth) * fade * lines, count)
        lines[1:] /= k[1:]
        surface[level, :, 0] = irfft(2.0 * lines, count)
        surface[level, :, 1] = irfft(1j * (1.0 - 2.0 * poisson) / (1.0 - poisson) * lines, count)
    return Imprint(stress.reshape(-1, count, 3), surface, full)


@ieee_kernel
def interpolate_imprint(stress: Tensor, surface: Tensor, full: float, layer: int, place: float, mean: float):
    """Fluctuation of zz, xz, xx [Pa] at a depth, and displacement [N/m] inwards and along s, from the table `Imprint`:
    index of the depth, place in the period [points], mean pressure [Pa]. Linear between places and pressures."""
    n, top = stress.shape[1], surface.shape[0] - 1
    level = min(math.sqrt(math.sqrt(max(mean, 0.0) / full)), 1.0) * top
    low = min(int(level), top - 1)
    f = level - low
    whole = math.floor(place)
    a = int(whole) % n
    g, b = place - whole, a + 1 if a + 1 < n else 0
    row = layer * (top + 1) + low
    zz = xz = xx = uz = us = 0.0
    for at, share in ((a, 1.0 - g), (b, g)):
        for up, w in ((0, share * (1.0 - f)), (1, share * f)):
            cell, skin = stress[row + up, at], surface[low + up, at]
            zz, xz, xx = zz + w * cell[0], xz + w * cell[1], xx + w * cell[2]
            uz, us = uz + w * skin[0], us + w * skin[1]
    return zz, xz, xx, uz, us
