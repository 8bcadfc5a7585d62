"""Recordings of strokes over a surface, made of known models."""

import numpy as np
from scipy.signal import lfilter

SAMPLING = 2000.0
SPEEDS, FORCES = (0.04, 0.06, 0.09, 0.135), (0.5, 1.0)


def resonance(speed):
    """A surface wavelength of 0.5 mm through a broad resonance: a (2) at its frequency."""
    angle = 2 * np.pi * speed / 0.5e-3 / SAMPLING
    return np.array([-2 * 0.9 * np.cos(angle), 0.81])


def strokes(path, count):
    """A recording of `count` rows at each speed and force."""
    random, rows, time = np.random.default_rng(0), [], 0.0
    for speed in SPEEDS:
        for force in FORCES:
            x = lfilter([1.0], np.concatenate([[1.0], resonance(speed)]), random.normal(size=count + 1000))[1000:]
            x *= 0.3 * force * speed / x.std()
            t = time + np.arange(count) / SAMPLING
            time = t[-1] + 1 / SAMPLING
            wobble = 1 + 0.03 * np.sin(7 * t)
            rows.append(np.column_stack([t, speed * wobble, force * wobble[::-1], x + 0.05 * np.sin(4 * t)]))
    np.savetxt(path, np.concatenate(rows), "%.7g", ",", header="t,speed,normal,lateral", comments="")
    return path
