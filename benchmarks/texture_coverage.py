"""Coverage of the 95 % intervals of `palpate fit texture`: share of recordings whose interval contains the true rms.

    python benchmarks/texture_coverage.py [trials]

A recording has 60, 100 or 200 windows of 0.1 s of a resonance at 60 Hz (bandwidth 32 or 3 Hz), and a gain that
wanders by 0 or 20 %, with a time constant of 0.3 or 1 s and a mean square of 1.
"""

from __future__ import annotations

import sys

import numpy as np
from scipy.signal import lfilter

from palpate.models.fit.texture import rms_interval

SAMPLING, WINDOW = 1000.0, 100
CASES = {
    "broad, steady": (0.01, 0.0, 1.0), "narrow, steady": (0.1, 0.0, 1.0), "wanders, 0.3 s": (0.01, 0.2, 0.3),
    "wanders, 1 s": (0.01, 0.2, 1.0),
}  # fmt: skip
"""Decay time of the resonance [s], standard deviation of the logarithm of the gain, its time constant [s]."""


def powers(windows: int, decay: float, wander: float, slow: float, rng: np.random.Generator) -> np.ndarray:
    """Mean squares (windows) of a recording whose true mean square is 1."""
    radius, angle = np.exp(-1.0 / (decay * SAMPLING)), 2.0 * np.pi * 60.0 / SAMPLING
    ring = [1.0, -2.0 * radius * np.cos(angle), radius * radius]
    scale = np.sqrt(np.sum(lfilter([1.0], ring, np.eye(1, 4000)[0]) ** 2))
    x = lfilter([1.0], ring, rng.normal(size=windows * WINDOW + 2000))[2000:] / scale
    keep = np.exp(-WINDOW / SAMPLING / slow)
    log_gain = wander * lfilter([np.sqrt(1.0 - keep * keep)], [1.0, -keep], rng.normal(size=windows + 200))[200:]
    return np.mean(x.reshape(windows, WINDOW) ** 2, axis=1) * np.exp(2.0 * log_gain - 2.0 * wander**2)


def coverage(windows: int, case: tuple[float, float, float], trials: int, seed: int = 0) -> float:
    """Share of trials whose interval contains the true rms, 1."""
    rng, inside = np.random.default_rng(seed), 0
    for _ in range(trials):
        low, high = rms_interval(powers(windows, *case, rng))
        inside += low < 1.0 < high
    return inside / trials


def main() -> None:
    trials = int(sys.argv[1]) if len(sys.argv) > 1 else 400
    print("windows  " + "  ".join(f"{name:>16}" for name in CASES))
    for windows in (60, 100, 200):
        print(f"{windows:7d}  " + "  ".join(f"{coverage(windows, case, trials):16.3f}" for case in CASES.values()))


if __name__ == "__main__":
    main()
