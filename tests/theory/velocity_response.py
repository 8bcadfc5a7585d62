"""What the velocity filter passes: the mean of N samples, against a single backward difference.

    |H(f)| = |sin(N pi f / fs) / (N sin(pi f / fs))|

First null at fs/N, half power at about 0.446 fs/N (the kidney rendering paper quotes the null as the cut-off). The
delay is N/2 samples, with that of the difference itself.
"""

import numpy as np
from scipy.optimize import brentq


def magnitude(frequency, rate: float, order: int = 8) -> np.ndarray:
    """Magnitude of the mean of N samples, |sin(N pi f / fs) / (N sin(pi f / fs))| [1] (...); 1 at zero frequency.

    frequency  [Hz]  (...)
    rate       [Hz]  ()     sample rate fs
    order      [1]   ()     N
    """
    phase = np.pi * np.asarray(frequency, dtype=float) / rate
    below = np.sin(phase)
    even = np.abs(below) < 1e-9  # multiples of the sample rate
    return np.where(even, 1.0, np.abs(np.sin(order * phase) / (order * np.where(even, 1.0, below))))


def half_power(rate: float, order: int = 8) -> float:
    """Frequency [Hz] at which |H|^2 = 1/2; 0.44596 fs/8 for N = 8.

    ValueError: order below 2, which passes everything.
    """
    if order < 2:
        raise ValueError(f"order {order}: a mean of fewer than 2 differences has no half-power frequency")
    return float(brentq(lambda f: magnitude(f, rate, order) - np.sqrt(0.5), 0.0, rate / order, xtol=1e-12 * rate))
