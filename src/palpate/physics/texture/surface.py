"""Texture of a surface: one period of a fluctuation phi(s) [1] along the path s [m]; the force is phi f_n.

At the sliding speed v a spatial frequency k [1/m] becomes the frequency f = k v, and a spatial spectrum S(k) [m]

    S_f(f) = f_n^2 S(f/v)/v    [N^2/Hz]

Stochastic texture under a sliding contact: J. Siira, D. K. Pai, IEEE ICRA 1996, 557-562. Lateral force as the slope of
a surface: G. Robles-De-La-Torre, V. Hayward, Nature 412 (2001) 445-448.
"""

import csv
from pathlib import Path

import numpy as np

from palpate.compiler import exact
from palpate.physics.readable import MOST_TEXT, check_readable

POINTS = 16  # Points of a table per shortest wavelength, at which linear interpolation attenuates by 0.11 dB
LINES = 70  # Longest wavelengths per period: 16 spectral lines in the lowest third-octave band
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
    count = 1 << int(np.ceil(np.log2(LINES / points[0, 0] / spacing)))
    if count > MOST:
        most = MOST / (2 * POINTS * LINES)
        raise ValueError(f"its highest frequency is {points[-1, 0] / points[0, 0]:.3g} times its lowest; expected at "
                         f"most {most:.3g} times")  # fmt: skip
    power = density(points, np.arange(count // 2 + 1) / (count * spacing))
    phase = 2.0 * np.pi * np.random.Generator(np.random.PCG64(seed)).random(len(power))
    lines = np.sqrt(power / np.sum(power)) * (np.cos(phase) + 1j * np.sin(phase))
    # reproducible: pocketfft uses no vector instructions for a single row
    return np.fft.irfft(lines, count) * (count * rms / np.sqrt(2.0)), spacing


def grating(wavelength: float, rms: float) -> tuple[np.ndarray, float]:
    """One period of a sinusoidal grating of this wavelength [m] and rms [1], and its spacing [m]."""
    count = 4 * POINTS
    return rms * np.sqrt(2.0) * np.sin(2.0 * np.pi * np.arange(count) / count), wavelength / count


def profile(path: Path, rms: float, shortest: float) -> tuple[np.ndarray, float]:
    """Slope [1] of a measured height profile, repeated periodically, and its spacing [m]. The trend and wavelengths
    below `shortest` [m] are removed. OSError, ValueError: cannot be read; states the reason.

    path  CSV with the header `s,height` [m];  rms of the slope [1], 0: as measured
    """
    s, height = read_table(path, "s", "height").T
    if len(s) < 4 or not np.all(np.diff(s) > 0.0):
        raise ValueError("expected at least 4 rows with increasing s")
    count = int(np.ceil((s[-1] - s[0]) * POINTS / shortest))
    if not 4 <= count <= MOST:
        raise ValueError(f"it is {s[-1] - s[0]:.3g} m long; expected {4 * shortest / POINTS:.3g} to "
                         f"{MOST * shortest / POINTS:.3g} m")  # fmt: skip
    spacing = (s[-1] - s[0]) / count
    even = np.interp(s[0] + spacing * np.arange(count), s, height - (height[-1] - height[0]) * (s - s[0]) / np.ptp(s))
    k = np.fft.rfftfreq(count, spacing)
    lines = np.fft.rfft(even) * (k <= 1.0 / shortest)
    slope = np.fft.irfft(2j * np.pi * k * lines, count)
    found = np.sqrt(np.mean(slope * slope))
    if not found > 1e-9:
        raise ValueError("it is flat")
    return slope * (rms / found if rms else 1.0), spacing


def third_octaves(lowest: float, highest: float) -> np.ndarray:
    """Centres [Hz] of the third-octave bands within these frequencies (IEC 61260, base 10)."""
    first, last = np.ceil(10 * np.log10(lowest) + 0.5), np.floor(10 * np.log10(highest) - 0.5)
    return 10.0 ** (np.arange(first, last + 1) / 10.0)


def read_table(path: Path, *names: str) -> np.ndarray:
    """Columns of a CSV file by name (n, names). ValueError: states the fault and the row."""
    check_readable(path, MOST_TEXT)
    with open(path, encoding="utf-8-sig", newline="") as file:
        rows = [(reader.line_num, row) for reader in [csv.reader(file)] for row in reader if row]
    head = [cell.strip() for cell in rows[0][1]] if rows else []
    if missing := [name for name in names if name not in head]:
        raise ValueError(f"found the columns {', '.join(head) or 'none'}; expected {', '.join(missing)} too")
    places, numbers = [head.index(name) for name in names], []
    for line, row in rows[1:]:
        try:
            numbers.append([float(row[place]) for place in places])
        except (ValueError, IndexError):
            raise ValueError(f"line {line}: found {', '.join(row)!r}, expected numbers") from None
        if not np.all(np.isfinite(numbers[-1])):
            raise ValueError(f"line {line}: found {', '.join(row)!r}, expected finite numbers")
    return np.array(numbers).reshape(-1, len(names))
