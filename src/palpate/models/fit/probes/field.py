"""A smooth field over a surface from values at scattered places: a Gaussian process.

    y_i = m + g(x_i) + n_i + e_i,   cov(g(x), g(x')) = a² (1 + r) exp(-r),  r = sqrt(3) |x - x'|/l

with the Matérn covariance of smoothness 3/2, the distance along a chord, independent deviations n ~ N(0, b²) from place
to place, and known errors e_i of the values. a, l and b maximise the restricted likelihood, which integrates over the
mean m (C. E. Rasmussen, C. K. I. Williams, Gaussian Processes for Machine Learning (2006), eqs. 2.41 to 2.45, 4.17).
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize
from scipy.spatial.distance import cdist

PLAIN = 4.0  # Difference of -2 ln likelihood up to which a flat field is preferred: twice its missing numbers


@dataclass(frozen=True)
class Field:
    """A fitted field.

    places (N,3) [m], values (N), errors (N);  amplitude a, nugget b, length l [m]
    mean, mean_error   m, with the correlation of the places in its error
    loss               -2 ln restricted likelihood
    """

    places: np.ndarray
    values: np.ndarray
    errors: np.ndarray
    amplitude: float
    length: float
    nugget: float
    mean: float
    mean_error: float
    loss: float = 0.0

    @property
    def flat(self) -> bool:
        """Whether neighbouring places are not more similar than distant ones."""
        return self.amplitude**2 < 0.05 * (self.amplitude**2 + self.nugget**2)

    def at(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """m + g and its standard deviation, without n, at places (k,3) [m]."""
        noise = np.diag(self.errors**2 + self.nugget**2)
        factor = cho_factor(_covariance(self.places, self.amplitude, self.length) + noise)
        ones = np.ones(len(self.values))
        weight = cho_solve(factor, self.values - self.mean)
        across = _covariance(places, self.amplitude, self.length, self.places)
        solved = cho_solve(factor, across.T)
        rest = 1.0 - across @ cho_solve(factor, ones)  # the mean is also estimated
        variance = self.amplitude**2 - np.sum(across * solved.T, axis=1) + rest**2 * self.mean_error**2
        return self.mean + across @ weight, np.sqrt(np.maximum(variance, 0.0))

    def next_places(self, candidates: np.ndarray, count: int) -> np.ndarray:
        """Indices of candidates (k,3) [m] to probe next: each is the most uncertain one, given those before it."""
        chosen: list[int] = []
        places, errors = self.places, self.errors
        for _ in range(count):
            values = np.concatenate([self.values, np.full(len(chosen), self.mean)])
            known = Field(places, values, errors, self.amplitude, self.length, self.nugget, self.mean, self.mean_error)
            chosen.append(int(np.argmax(known.at(candidates)[1])))
            places = np.vstack([places, candidates[chosen[-1]]])
            errors = np.append(errors, np.median(self.errors))
        return np.array(chosen)


def fit_field(places: np.ndarray, values: np.ndarray, errors: np.ndarray) -> Field:
    """The field with the largest restricted likelihood, from three first lengths; a flat one if that explains as much.

    Lengths beyond 0.4 of the widest distance are a trend, whose mean the values do not determine."""
    apart = cdist(places, places)
    widest = float(apart.max())
    nearest = float(np.median(np.where(apart > 0.0, apart, np.inf).min(axis=1)))
    spread = max(float(np.std(values)), 1e-6)
    bounds = [(np.log(1e-3 * spread), np.log(10.0 * spread)), (np.log(0.5 * nearest), np.log(0.4 * widest)),
              (np.log(1e-3 * spread), np.log(10.0 * spread))]  # fmt: skip

    def loss(x: np.ndarray) -> float:
        return restricted_likelihood(apart, values, errors, *np.exp(x))[0]

    starts = [[np.log(0.7 * spread), np.log(share), np.log(0.5 * spread)]
              for share in np.geomspace(1.5 * nearest, 0.3 * widest, 3)]  # fmt: skip
    best = min((minimize(loss, start, method="L-BFGS-B", bounds=bounds) for start in starts), key=lambda one: one.fun)
    alone = minimize(lambda x: loss(np.array([bounds[0][0], best.x[1], x[0]])), [np.log(spread)], bounds=bounds[2:])
    if alone.fun < best.fun + PLAIN:
        best.x = np.array([bounds[0][0], best.x[1], alone.x[0]])
    amplitude, length, nugget = map(float, np.exp(best.x))
    lowest, mean, error = restricted_likelihood(apart, values, errors, amplitude, length, nugget)
    return Field(places, values, errors, amplitude, length, nugget, mean, error, lowest)


def _covariance(places: np.ndarray, amplitude: float, length: float, others: np.ndarray | None = None) -> np.ndarray:
    return matern(cdist(places, places if others is None else others), amplitude, length)


def matern(apart: np.ndarray, amplitude: float, length: float) -> np.ndarray:
    """Covariance at these distances [m]."""
    r = np.sqrt(3.0) * apart / length
    return amplitude**2 * (1.0 + r) * np.exp(-r)


def restricted_likelihood(
    apart: np.ndarray, values: np.ndarray, errors: np.ndarray, amplitude: float, length: float, nugget: float
) -> tuple[float, float, float]:
    """-2 ln restricted likelihood, mean and its standard error."""
    factor = cho_factor(matern(apart, amplitude, length) + np.diag(errors**2 + nugget**2))
    ones = np.ones(len(values))
    solved = cho_solve(factor, ones)
    known = float(ones @ solved)
    mean = float(solved @ values) / known
    rest = values - mean
    logs = 2.0 * float(np.log(np.diag(factor[0])).sum())
    return float(rest @ cho_solve(factor, rest)) + logs + np.log(known), mean, 1.0 / np.sqrt(known)
