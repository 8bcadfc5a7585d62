"""Synthetic indentation sessions with known laws, for examples and tests of the fits."""

import numpy as np
from scipy.special import ndtr

from palpate.physics.contact.force_band import PUBLISHED, Band, truncated_quantile
from palpate.physics.contact.force_models import MODELS

DEPTHS = np.linspace(0.0, 5.0e-3, 11)
"""Depths of the published experiment [m]: 0 to 5 mm in steps of 0.5 mm."""


def synthetic_sessions(
    seed: int, sessions: int = 20, depths=DEPTHS, band: Band = PUBLISHED, together: float = 0.5
) -> np.ndarray:
    """Forces [N] (sessions,D), 0 at depth 0, otherwise drawn from N(F(d), sigma(d)²) truncated to f >= 0.

    seed      [1]     the same seed gives the same forces
    depths    [m]     (D)
    band              laws of mean and deviation
    together  [1]     correlation of two forces of one session, in [0, 1]
    """
    random = np.random.Generator(np.random.Philox(seed))
    depths = np.asarray(depths, float)
    mean = MODELS[band.mean](depths, band.mean_parameters)
    deviation = MODELS[band.deviation](depths, band.deviation_parameters)
    whole = random.standard_normal((sessions, 1))
    single = random.standard_normal((sessions, len(depths)))
    z = np.sqrt(together) * whole + np.sqrt(1.0 - together) * single
    return np.where(depths > 0, truncated_quantile(ndtr(z), mean, deviation), 0.0)
