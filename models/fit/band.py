"""Prediction band for the forces of a new session, from few sessions with correlated errors.

The curve F(d) and the scatter sigma(d) are fitted to S sessions at D depths. A force of a new session differs from the
fitted curve by its scatter and by the error of the curve, and sigma is an estimate:

    f = F + sigma w t,   t: Student's t with nu degrees of freedom

The uncertainty of F and sigma depends on the intraclass correlation r of the forces in units of their scatter, the
share of the variance between sessions. A mean of k depths has the variance sigma² (1 + (k - 1) r) / (k S). A variance
estimated from m depths has (S - 1) m / (1 + (m - 1) r²) degrees of freedom: S - 1 if sessions only shift as a whole
(r = 1), and those of all rows if the rows are independent (r = 0). A curve of p parameters averages about k = D/p of D
depths.

At a single depth (k = m = 1) this is the prediction interval of a normal sample, mean +- t s sqrt(1 + 1/S), which is
exact for any r.
"""

from typing import NamedTuple

import numpy as np
from scipy.special import ndtri
from scipy.stats import t as student

from palpate.models.fit.curve_fit import CurveFit


class Spread(NamedTuple):
    """Distribution of a new force around the curve.

    widening  [1]  w, factor on the scatter for the error of the curve
    freedom   [1]  nu, degrees of freedom; 0: normal distribution
    together  [1]  r, share of the variance between sessions
    """

    widening: float = 1.0
    freedom: float = 0.0
    together: float = 0.0

    def reach(self, level: float = 0.95) -> float:
        """Half width [1], in units of the scatter, of the band that contains a new force with a probability."""
        half = 0.5 + 0.5 * level
        return self.widening * float(student.ppf(half, self.freedom) if self.freedom > 0 else ndtri(half))


def prediction_spread(forces, mean: CurveFit, deviation: CurveFit) -> Spread:
    """Spread of the forces of a new session around a curve; forces [N] (S,D) at depths > 0, with nonzero scatter."""
    forces = np.asarray(forces, float)
    sessions, depths = forces.shape
    together = between_sessions(forces)
    k = max(depths / len(mean.parameters), 1.0)
    m = max(depths / len(deviation.parameters), 1.0)
    widening = np.sqrt(1.0 + (1.0 + (k - 1.0) * together) / (k * sessions))
    freedom = (sessions - 1) * m / (1.0 + (m - 1.0) * together**2)
    return Spread(float(widening), float(freedom), together)


def between_sessions(forces) -> float:
    """Intraclass correlation [0, 1] of forces [N] (S,D) in units of the scatter at each depth.

    The variance of the sessions' means of D unit variables that correlate by r is (1 + (D - 1) r) / D.
    """
    forces = np.asarray(forces, float)
    scatter = forces.std(axis=0, ddof=1)
    forces = forces[:, scatter > 0] / scatter[scatter > 0]
    count = forces.shape[1]
    if count < 2:
        return 1.0
    return float(np.clip((count * forces.mean(axis=1).var(ddof=1) - 1.0) / (count - 1.0), 0.0, 1.0))
