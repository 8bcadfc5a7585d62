"""Assumed profiles of the recorded textures, of which only the names and the period of the grating are known.

Published constructions (docs/measured.md): regular corduroy has 14 wales per inch, wide wales 6 to 10; the floats of
huckaback are in groups of five threads, of which two documented towels have 15 and 28 per inch, and 50 is assumed for a
fine one; of the wool blend nothing is known. The specimens were not measured, and threads yield, which these profiles
do not.
"""

from __future__ import annotations

import numpy as np

HEIGHTS = (0.1e-3, 0.3e-3, 0.5e-3, 1e-3)
SHAPES = ("sinusoid", "ridges 1/2", "ridges 1/4")
PERIOD = 3e-3  # [m] of the grating


def shape_of(shape: str, x: np.ndarray) -> np.ndarray:
    """Height (n) [1], 0 to 1, over the period x [1]; the share is that of the ridges, whose edges are 5 % of the
    period wide."""
    if shape == "sinusoid":
        return 0.5 + 0.5 * np.cos(2.0 * np.pi * x)
    if shape == "yarns":
        return np.sqrt(np.maximum(1.0 - (2.0 * ((x + 0.5) % 1.0) - 1.0) ** 2, 0.0))
    y = np.abs((x + 0.5) % 1.0 - 0.5)
    return 0.5 - 0.5 * np.tanh((y - 0.5 * (0.5 if shape.endswith("1/2") else 0.25)) / 0.025)


def grating(shape: str, height: float = 0.5e-3) -> tuple[np.ndarray, np.ndarray]:
    """Profile s, h (n) [m]."""
    s = np.linspace(0.0, PERIOD, 257)
    return s, height * shape_of(shape, s / PERIOD)


def yarns(diameter: float, variation: float, count: int = 32) -> tuple[np.ndarray, np.ndarray]:
    """Profile of round yarns side by side, whose diameter varies by this share; thick ones are higher."""
    wide = diameter * np.clip(1.0 + variation * np.random.default_rng(0).standard_normal(count), 0.4, 1.6)
    edges = np.r_[0.0, np.cumsum(wide)]
    s = np.linspace(0.0, edges[-1], 4001)
    k = np.clip(np.searchsorted(edges, s, side="right") - 1, 0, count - 1)
    height = 0.5 * wide[k] * shape_of("yarns", (s - edges[k]) / wide[k]) + 0.5 * (wide[k] - diameter)
    return s, np.r_[height[:-1], height[0]]


def huckaback(per_inch: float, floats: int = 5) -> tuple[np.ndarray, np.ndarray]:
    """Profile of round yarns that are raised by up to a half of their diameter once per group of floats."""
    diameter = 25.4e-3 / per_inch
    s = np.linspace(0.0, floats * diameter, 1025)
    raised = 0.5 * diameter * shape_of("sinusoid", s / s[-1])
    return s, 0.5 * diameter * shape_of("yarns", np.mod(s / diameter, 1.0)) + raised


def wales(period: float, height: float = 0.5e-3) -> tuple[np.ndarray, np.ndarray]:
    """Profile of round wales."""
    s = np.linspace(0.0, period, 257)
    return s, height * shape_of("yarns", s / period)


TEXTURES = {
    "hucktowel": [huckaback(per_inch) for per_inch in (15, 28, 50)],
    "wool_blend": [yarns(wide, varies) for wide in (0.4e-3, 0.8e-3) for varies in (0.2, 0.4)],
    "3mm_grating": [grating(shape) for shape in ("ridges 1/2", "ridges 1/4")],
    "corduroy": [wales(period) for period in (1.8e-3, 2.5e-3, 3.2e-3)],
}
"""15 to 50 yarns per inch; uneven yarns of 0.4 to 0.8 mm; ridges; 8 to 14 wales per inch."""
