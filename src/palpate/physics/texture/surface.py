"""Texture of a surface: one period of a fluctuation phi(s) [1] along the path s [m]; the force is phi f_n.

A relief of heights h acts by its slope, phi = h'(s), along the axis of s for every direction of motion. A friction map
is a deviation of the coefficient of friction, whose force opposes the motion.

At the sliding speed v a spatial frequency k [1/m] becomes the frequency f = k v, and a spatial spectrum S(k) [m]

    S_f(f) = f_n^2 S(f/v)/v    [N^2/Hz]

Stochastic texture under a sliding contact: J. Siira, D. K. Pai, IEEE ICRA 1996, 557-562. Lateral force as the slope of
a surface: G. Robles-De-La-Torre, V. Hayward, Nature 412 (2001) 445-448.
"""

import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from palpate.compiler import exact
from palpate.physics.table_file import read_table
from palpate.physics.texture.fourier import irfft, rfft
from palpate.units.header import split_unit

POINTS = 16  # Points of a table per shortest wavelength, at which linear interpolation attenuates by 0.11 dB
LINES = 70  # Longest wavelengths per period: 16 spectral lines in the lowest third-octave band
LENGTHS = ("s", "height")
MOST = 1 << 20  # Maximum number of points of a table, 8 MiB


def density(points: np.ndarray, k: np.ndarray) -> np.ndarray:
    """Spectrum (n) at the spatial frequencies k [1/m] (n): power laws between points (m,2) of k and S; 0 outside."""
    inside = (k >= points[0, 0]) & (k <= points[-1, 0])
    x, y = exact.log(points[:, 0]), exact.log(points[:, 1])
    return np.where(inside, exact.exp(np.interp(exact.log(np.where(inside, k, points[0, 0])), x, y)), 0.0)


def random_surface(points: np.ndarray, rms: float, seed: int) -> tuple[np.ndarray, float]:
    """One period (n) of a stationary random surface with this spectrum and rms [1], and its spacing [m]: spectral
    representation with seeded random phases (M. Shinozuka, G. Deodatis, Appl. Mech. Rev. 44 (1991) 191-204), so that
    the spectrum of a period is exact.

    points  (m,2)  spatial frequency [1/m], increasing, and relative density > 0
    """
    spacing = 1.0 / (POINTS * points[-1, 0])
    count = 1 << (math.ceil(LINES / points[0, 0] / spacing) - 1).bit_length()
    if count > MOST:
        most = MOST / (2 * POINTS * LINES)
        raise ValueError(f"its highest frequency is {points[-1, 0] / points[0, 0]:.3g} times its lowest; expected at "
                         f"most {most:.3g} times")  # fmt: skip
    power = density(points, np.arange(count // 2 + 1) / (count * spacing))
    phase = 2.0 * np.pi * np.random.Generator(np.random.PCG64(seed)).random(len(power))
    lines = np.sqrt(power / np.sum(power)) * (exact.cos(phase) + 1j * exact.sin(phase))
    return irfft(lines, count) * (count * rms / np.sqrt(2.0)), spacing


def grating(wavelength: float, rms: float) -> tuple[np.ndarray, float]:
    """One period of a sinusoidal grating of this wavelength [m] and rms [1], and its spacing [m]."""
    count = 4 * POINTS
    return rms * np.sqrt(2.0) * exact.sin(2.0 * np.pi * np.arange(count) / count), wavelength / count


def has_heights(path: Path) -> bool:
    """Whether a profile is a relief (column `height` [m]) and not a friction map (`friction` [1]). OSError, ValueError:
    cannot be read."""
    table = read_table(path, partial(_score, ("s", "height", "friction")), 2)
    head = [name.lower() for name in table.names]
    return "friction" not in head or "height" in head


def profile(path: Path, rms: float, shortest: float) -> tuple[np.ndarray, float]:
    """Slope [1] of a height profile, or deviation [1] of a coefficient of friction from its mean, repeated
    periodically, and its spacing [m]. The trend and wavelengths below `shortest` [m] are removed. OSError, ValueError:
    cannot be read; states the reason.

    path  table with the columns `s`, `height` (in m without units) or `s`, `friction`
    rms   of the result [1], 0: as measured
    """
    heights = has_heights(path)
    even, spacing = _evenly_spaced(path, "height" if heights else "friction", shortest)
    k = np.arange(len(even) // 2 + 1) / (len(even) * spacing)
    lines = rfft(even) * (k <= 1.0 / shortest) * (k > 0.0)
    found = irfft(2j * np.pi * k * lines if heights else lines, len(even))
    size = np.sqrt(np.mean(found * found))
    if not size > 1e-9:
        raise ValueError("it is flat")
    return found * (rms / size if rms else 1.0), spacing


def _evenly_spaced(path: Path, column: str, shortest: float) -> tuple[np.ndarray, float]:
    """A column of a profile (n) without its trend, at even places, and their spacing [m]."""
    s, values = _columns(path, "s", column).T
    if len(s) < 4 or not np.all(np.diff(s) > 0.0):
        raise ValueError("expected at least 4 rows with increasing s")
    count = int(np.ceil((s[-1] - s[0]) * POINTS / shortest))
    if not 4 <= count <= MOST:
        raise ValueError(f"it is {s[-1] - s[0]:.3g} m long; expected {4 * shortest / POINTS:.3g} to "
                         f"{MOST * shortest / POINTS:.3g} m")  # fmt: skip
    spacing = (s[-1] - s[0]) / count
    level = values - (values[-1] - values[0]) * (s - s[0]) / np.ptp(s)
    return np.interp(s[0] + spacing * np.arange(count), s, level), spacing


def third_octaves(lowest: float, highest: float) -> np.ndarray:
    """Centres [Hz] of the third-octave bands within these frequencies (IEC 61260, base 10)."""
    first, last = np.ceil(10 * np.log10(lowest) + 0.5), np.floor(10 * np.log10(highest) - 0.5)
    return 10.0 ** (np.arange(first, last + 1) / 10.0)


def _columns(path: Path, *names: str) -> np.ndarray:
    """Columns of a table by name (n, names), in SI units. ValueError: states the fault and the row."""
    table = read_table(path, partial(_score, names), len(names))
    head = [name.lower() for name in table.names]
    if missing := [name for name in names if name not in head]:
        more = ", or friction" if "height" in missing else ""
        raise ValueError(f"found the columns {', '.join(head) or 'none'}; expected {', '.join(missing)} too{more}")
    places = [head.index(name) for name in names]
    values, _ = table.values(places)
    for name, place, column in zip(names, places, values.T, strict=True):
        if name in LENGTHS:
            column *= table.factor(place, "m") or 1.0
    return values


def _score(names: Sequence[str], cells: Sequence[str]) -> int:
    """Number of these names in the cells of a header."""
    return len(set(names) & {split_unit(cell)[0].lower() for cell in cells})
