"""Constants of the fibres whose tuning thresholds are those of recorded units (docs/equations/afferents.md).

The published RA1 need 20 dB more amplitude at 200 Hz than recorded ones, because the filter of their input cuts off at
70 to 180 Hz. Two factors per type, of the cut-off frequency and of the weights of the input, are fitted to the tuning
thresholds, one spike per cycle, of 11 RA and 11 PC afferents (`benchmarks/measured/thresholds.py`, which prints them).
A unit's curve relative to its mean level determines the cut-off, the median of the levels the gain. Nothing else was
fitted; textures were not used.
"""

import numpy as np

from palpate.physics.afferents.published import FITS

CUT_OFF = (1.0, 2.0, 1.0)
"""[1] Factor of the cut-off frequency of SA1, RA1 and PC. RA1: 1.2 to 4 (95 %). PC: 0.7 to 2.8 would be as good, so
the published one is kept. SA1: no thresholds were available."""
GAIN = (1.0, 1.35, 0.5)
"""[1] Factor of the weights of the input, if the recorded amplitudes are peaks; twice as large, if they are peak to
peak. RA1: 0.7 to 2.5, PC: 0.26 to 0.93 (95 %)."""


def adjust(cut_off: tuple[float, ...], gain: tuple[float, ...]) -> tuple[np.ndarray, ...]:
    """`FITS` with these factors [1] of the cut-off frequencies, and of the weights of the input, of each type."""
    made = []
    for fits, faster, stronger in zip(FITS, cut_off, gain, strict=True):
        each = fits.copy()
        each[:, 0] *= faster
        each[:, 1:7] *= stronger
        made.append(each)
    return tuple(made)


CONSTANTS = {"published": FITS, "calibrated": adjust(CUT_OFF, GAIN)}
"""The sets of constants, each a table per type."""
