"""A normally distributed force truncated at zero: quantiles and reproducible draws.

    p(f | d) = N(F(d), sigma(d)²) restricted to f >= 0

Far from zero this is the normal law. Near first touch, where sigma is comparable to F, the part below zero (18 % at
d = 0 for the published subject) is truncated and the rest is normalised.

Because laws fitted to few sessions are uncertain, a new force is distributed as F + sigma t with Student's t of
`freedom` degrees of freedom (0: the normal law).
"""

from typing import NamedTuple

import numpy as np

from palpate.physics.arrays import Numbers
from palpate.physics.contact.force_models import MODELS
from palpate.physics.contact.quantile import fill_truncated


class Band(NamedTuple):
    """Laws of mean and standard deviation for one subject, in the depth d [m]."""

    mean: str  # name of a model of MODELS
    mean_parameters: tuple[float, ...]  # its parameters, SI units
    deviation: str  # name of a model of MODELS
    deviation_parameters: tuple[float, ...]  # its parameters, SI units
    limit: float  # [m] () deepest indentation that was measured
    freedom: float = 0.0  # [1] () of Student's t; 0: the normal law


PUBLISHED = Band("fourier", (1.694, -1.673, 0.1971, 422.8), "exponential", (0.02272, 376.6), 5.0e-3)
"""Subject 1 of the experiment with a cone-shaped probe on the index fingertip, 0 to 5 mm:

    F = 1.694 + 0.1971 sin(0.4228 d) - 1.673 cos(0.4228 d) N,   sigma = 0.02272 exp(0.3766 d) N,   d in mm
"""


def band_at(depth: Numbers, band: Band = PUBLISHED) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(F, sigma, inside): mean [N], standard deviation [N] and whether the depth was measured, at each depth [m] (...).

    Outside the measured range the laws are evaluated at its end, without extrapolation, and `inside` is false.
    Negative values are replaced by zero.
    """
    depth = np.asarray(depth, float)
    limited = np.clip(depth, 0.0, band.limit)
    mean = MODELS[band.mean](limited, band.mean_parameters)
    deviation = MODELS[band.deviation](limited, band.deviation_parameters)
    return np.maximum(mean, 0.0), np.maximum(deviation, 0.0), (depth >= 0.0) & (depth <= band.limit)


def truncated_quantile(level: Numbers, mean: Numbers, deviation: Numbers, freedom: float = 0.0) -> np.ndarray:
    """Quantile [N] (...) of mean + deviation t truncated to f >= 0, at the probability `level`.

        S(z) = (1 - level) (1 - S(-mean/deviation)),   f = mean + z deviation,   S(z) the survival function of t

    level      [1]  (...)  in (0, 1)        mean  [N]  (...)        deviation  [N]  (...)  >= 0; at 0 it is <mean>
    freedom    [1]  ()     of t; 0: the normal law

    S is computed in logarithms, which is accurate for means far below zero.
    """
    arrays = np.broadcast_arrays(*(np.asarray(v, float) for v in (level, mean, deviation)))
    out = np.empty(arrays[0].shape)
    fill_truncated(*(each.ravel() for each in arrays), float(freedom), out.reshape(-1))
    return out


def uniform(seed: int, tick: int) -> float:
    """A random number in [0, 1) that depends only on seed and tick, so that replays in any order draw the same number:
    Philox 4x64-10 with the seed as key and the tick as counter (J. K. Salmon et al., 2011)."""
    counter = np.array([0, tick & 0xFFFF_FFFF_FFFF_FFFF, 0, 0], dtype=np.uint64)
    philox = np.random.Philox(key=seed, counter=counter)
    return float(np.random.Generator(philox).random())
