"""A band with the stated coverage for a new session, from few sessions with correlated errors.

The curve F(d) and the scatter sigma(d) are fitted to S sessions at D depths. A force of a new session lies off the
fitted curve by its own scatter and by the error of the curve, and sigma is itself estimated:

    f = F + sigma w t,   t of Student with nu degrees of freedom

How much is known of F and sigma depends on how far the forces of one session err together. With the share r of the
variance that lies between sessions (the intraclass correlation of forces in units of their scatter) a mean of k depths
has the variance sigma² (1 + (k - 1) r) / (k S), and a variance estimated from m depths has the degrees of freedom
(S - 1) m / (1 + (m - 1) r²): those of S - 1 sessions where they only shift as a whole (r = 1), and of all rows where
the rows are independent (r = 0). A curve of p parameters at D depths takes about k = D/p of them together.

For a band at one depth (k = m = 1) this is the prediction interval of a normal sample, mean +- t s sqrt(1 + 1/S), which
is exact whatever r is.
"""

from typing import NamedTuple

import numpy as np
from scipy.special import ndtri
from scipy.stats import t as student

from palpate.models.fit.curve_fit import Fit


class Spread(NamedTuple):
    """How a new force lies about the curve.

    widening  [1]  w, by which the error of the curve widens the scatter
    freedom   [1]  nu; 0: the normal law
    together  [1]  r, share of the variance that lies between sessions, the rest being within them
    """

    widening: float = 1.0
    freedom: float = 0.0
    together: float = 0.0

    def reach(self, level: float = 0.95) -> float:
        """Half width [1], in units of the scatter, of the band that holds a new force with a probability."""
        half = 0.5 + 0.5 * level
        return self.widening * float(student.ppf(half, self.freedom) if self.freedom > 0 else ndtri(half))


def prediction_spread(forces, mean: Fit, deviation: Fit) -> Spread:
    """The spread of a new session's forces about a curve; forces [N] (S,D) at depths > 0, which scatter."""
    forces = np.asarray(forces, float)
    sessions, depths = forces.shape
    together = between_sessions(forces)
    k = max(depths / len(mean.parameters), 1.0)
    m = max(depths / len(deviation.parameters), 1.0)
    widening = np.sqrt(1.0 + (1.0 + (k - 1.0) * together) / (k * sessions))
    freedom = (sessions - 1) * m / (1.0 + (m - 1.0) * together**2)
    return Spread(float(widening), float(freedom), together)


def between_sessions(forces) -> float:
    """Share [0, 1] of the variance of forces [N] (S,D), in units of the scatter at each depth, between sessions.

    The variance of the sessions' means of D unit variables that correlate by r is (1 + (D - 1) r) / D.
    """
    forces = np.asarray(forces, float)
    scatter = forces.std(axis=0, ddof=1)
    forces = forces[:, scatter > 0] / scatter[scatter > 0]
    count = forces.shape[1]
    if count < 2:
        return 1.0
    return float(np.clip((count * forces.mean(axis=1).var(ddof=1) - 1.0) / (count - 1.0), 0.0, 1.0))
