"""Fibres under the flat probe of the experiments: spike trains, and thresholds of a sinusoid."""

import numpy as np

from palpate.compiler.fields import blank_record
from palpate.compiler.kernel import kernel
from palpate.physics.afferents import fibre
from palpate.physics.afferents.published import DEPTHS, FITS, PROBE, RATE
from palpate.physics.arrays import Array, Matrix, Record

MODULUS = 0.05 / (1.0 - 0.4**2)  # [MPa] of the skin of the published fits, E/(1 - nu²)


def input_of(kind: int, u: np.ndarray) -> np.ndarray:
    """The input s [MPa] (n) below a probe that indents the skin by u [mm] (n); type of the receptor."""
    zeta, radius = DEPTHS[kind] / PROBE, 1e3 * PROBE
    return MODULUS * (1.0 + 3.0 * zeta**2) / (np.pi * radius * (1.0 + zeta**2) ** 2) * u


@kernel
def _count(constants: Record, state: Record, basis: Matrix, key: int, s: Array, begin: int):
    since, spikes = 1000, 0
    for k in range(len(s)):
        moved = constants.dynamic * s[k]
        fired, since = fibre.advance(constants, state, since, basis, key, k, 1, 1.0, 1.0, s[k], moved)
        state.target, state.path_target = s[k], moved
        if fired and k >= begin:
            spikes += 1
    return spikes


def tuning_threshold(
    kind: int,
    which: int,
    frequency: float,
    gain: float = 1.0,
    poisson: float = 0.45,
    fits: tuple[np.ndarray, ...] = FITS,
) -> float:
    """Amplitude [dB re 1 um] of a sinusoid [Hz] of the probe at which fibre `which` of a type fires once per cycle: the
    tuning threshold of W. H. Talbot et al., J. Neurophysiol. 31 (1968) 301. gain: factor of its input; fits: its
    constants.

    By bisection to 0.1 dB between 3e-5 and 20 mm, with the fibre's noise, over 0.4 s and at least 10 cycles, after 4
    cycles.
    """
    fit = fits[kind][which]
    (constants,), _ = fibre.constants_of(fit[None], np.array([DEPTHS[kind]]), poisson, np.array([kind]))
    cycles = max(10, round(0.4 * frequency))
    t = np.arange(round((cycles + 4.0) / frequency * RATE)) / RATE
    wave, basis, begin = input_of(kind, gain * np.sin(2.0 * np.pi * frequency * t)), fibre.post_spike(), 4.0 / frequency
    low, high = -4.5, 1.3  # log10 of mm
    while high - low > 0.005:
        middle = 0.5 * (low + high)
        spikes = _count(constants, blank_record(fibre.STATE), basis, 5, 10.0**middle * wave, round(begin * RATE))
        low, high = (low, middle) if spikes >= cycles else (middle, high)
    return 20.0 * (high + 3.0)


def median_threshold(kind: int, frequency: float, gain: float = 1.0, fits: tuple[np.ndarray, ...] = FITS) -> float:
    """Median over the fibres of a type [dB re 1 um]."""
    return float(
        np.median([tuning_threshold(kind, which, frequency, gain, fits=fits) for which in range(len(fits[kind]))])
    )
