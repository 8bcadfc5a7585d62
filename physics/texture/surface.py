"""Surfaces as one period of a fluctuation phi(s) [1] over the path s [m]: the force is phi times the normal force.

At the sliding speed v a spatial frequency k [1/m] is felt at f = k v, and a spatial spectrum S(k) [m] as

    S_f(f) = f_n^2 S(f/v)/v    [N^2/Hz]

Stochastic texture under a sliding contact: J. Siira, D. K. Pai, IEEE ICRA 1996, 557-562. Lateral force as the slope of
a surface: G. Robles-De-La-Torre, V. Hayward, Nature 412 (2001) 445-448.
"""

import csv
from pathlib import Path

import numpy as np

from palpate.physics import exact

POINTS = 16
"""Points of a table per shortest wavelength: interpolation between them costs 0.11 dB there."""
LINES = 70
"""Longest wavelengths in a period: 16 spectral lines in the lowest third-octave band."""
MOST = 1 << 20
"""Points of a table, 8 MiB."""


def density(points: np.ndarray, k: np.ndarray) -> np.ndarray:
    """Spectrum (n) at the spatial frequencies k [1/m] (n): power laws between points (m,2) of (k, S); 0 outside."""
    inside = (k >= points[0, 0]) & (k <= points[-1, 0])
    x, y = exact.log(points[:, 0]), exact.log(points[:, 1])
    return np.where(inside, exact.exp(np.interp(exact.log(np.where(inside, k, points[0, 0])), x, y)), 0.0)


def random_surface(points: np.ndarray, rms: float, seed: int) -> tuple[np.ndarray, float]:
    """One period (n) of a stationary random surface of this spectrum and rms [1], and its spacing [m]: white noise,
    filtered along the path. Each line of the noise has its expected power and a seeded random phase (M. Shinozuka,
    G. Deodatis, Appl. Mech. Rev. 44 (1991) 191-204), so that a period has exactly the wanted spectrum.

    points  (m,2)  spatial frequency [1/m], rising, and relative density > 0
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
    # pocketfft transforms a single row without the instructions of a particular processor.
    return np.fft.irfft(lines, count) * (count * rms / np.sqrt(2.0)), spacing


def grating(wavelength: float, rms: float) -> tuple[np.ndarray, float]:
    """A sinusoidal grating of this wavelength [m] and rms [1], and its spacing [m]."""
    count = 4 * POINTS
    return rms * np.sqrt(2.0) * np.sin(2.0 * np.pi * np.arange(count) / count), wavelength / count


def profile(path: Path, rms: float, shortest: float) -> tuple[np.ndarray, float]:
    """Slope [1] of a measured height profile, and its spacing [m]. The profile repeats; its trend is removed, and what
    is finer than the shortest wavelength [m].

    path  CSV with the header `s,height` [m]; rms: of the slope [1], 0: as measured

    OSError, ValueError: cannot be read; says what is wrong.
    """
    s, height = read_table(path, "s", "height").T
    if len(s) < 4 or not np.all(np.diff(s) > 0.0):
        raise ValueError("expected at least 4 rows with rising s")
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
    """Centres [Hz] of the third-octave bands that lie within these frequencies (IEC 61260, base 10)."""
    first, last = np.ceil(10 * np.log10(lowest) + 0.5), np.floor(10 * np.log10(highest) - 0.5)
    return 10.0 ** (np.arange(first, last + 1) / 10.0)


def read_table(path: Path, *names: str) -> np.ndarray:
    """Columns of a CSV by their names (n, names). ValueError: what is wrong, and in which row."""
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
