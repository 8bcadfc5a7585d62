"""Errors of sensors, of a single channel: hysteresis, low pass, drift, noise, steps of the converter.

Values and settings have the same unit. Data sheets list the errors of a channel over its full scale: JCGM 200:2012
(VIM), 4.21 instrumental drift, 4.14 resolution; hysteresis as the width of a loop over the full scale.
"""

import math

from palpate.compiler.kernel import ieee_kernel, kernel
from palpate.physics.arrays import Indices
from palpate.physics.device.random_numbers import uniform


@kernel
def play(value: float, before: float, width: float):
    """Play operator: the output follows the input at a distance of at most half of `width`, so that a cycle of the
    input encloses a loop of this width at constant output. M. Brokate, J. Sprekels, Hysteresis and Phase Transitions
    (1996), section 2.1."""
    return min(max(before, value - 0.5 * width), value + 0.5 * width)


@kernel
def low_pass(value: float, before: float, cutoff: float, dt: float):
    """First-order low pass with the cut-off frequency [Hz], exact for an input that is constant over dt [s]."""
    return value - (value - before) * math.exp(-2.0 * math.pi * cutoff * dt)


@kernel
def convert(value: float, full: float, step: float):
    """What a converter reports: limited to +-`full`, and rounded to a multiple of `step`; 0 leaves either out."""
    if full > 0.0:
        value = min(max(value, -full), full)
    return step * math.floor(value / step + 0.5) if step > 0.0 else value


@ieee_kernel
def normal(random: Indices):
    """The next standard normal number; random: state of `random_numbers`. G. E. P. Box, M. E. Muller, Ann. Math. Stat.
    29 (1958) 610-611."""
    radius = math.sqrt(-2.0 * math.log(1.0 - uniform(random)))
    return radius * math.cos(2.0 * math.pi * uniform(random))
