"""Least-squares fit of a force model, with the standard errors of its parameters.

Variable projection (Golub & Pereyra, SIAM J. Numer. Anal. 10, 1973): linear least squares eliminates the linear
parameters, so that the search has one or two dimensions. It starts with a grid over the whole range, which avoids local
minima. The Jacobian of the projected residual is that of L. Kaufman, BIT 15 (1975) 49-57: its gradient is exact.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import t as student

from palpate.physics.contact.force_models import ForceModel
from palpate.physics.errors import PalpateError


class FitError(PalpateError, ValueError):
    """The data do not determine the model."""


@dataclass(frozen=True)
class CurveFit:
    """A fitted model.

    parameters  (p)    linear ones first, units as in the model
    covariance  (p,p)  of the parameters; inf if the data do not determine them
    rmse        [N]    sqrt(sum of squares / (n - p)), standard deviation of the residuals
    freedom     [1]    degrees of freedom of the errors: n - p, or sessions - 1
    at_limit           names of the parameters at an end of their range
    """

    model: ForceModel
    parameters: np.ndarray
    covariance: np.ndarray
    rmse: float
    freedom: int
    at_limit: tuple[str, ...] = ()

    def __call__(self, depth) -> np.ndarray:
        """The fitted curve at each depth [m] (...)."""
        return self.model(depth, self.parameters)

    @property
    def errors(self) -> np.ndarray:
        """Standard error of each parameter (p)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    def interval(self, level: float = 0.95) -> np.ndarray:
        """Confidence interval of each parameter (p,2), by Student's t."""
        half = student.ppf(0.5 + 0.5 * level, self.freedom) * self.errors
        return np.stack([self.parameters - half, self.parameters + half], axis=1)

    def rms(self, depth, force) -> float:
        """Root mean square error [N] on other data."""
        return float(np.sqrt(np.mean((np.asarray(force) - self(depth)) ** 2)))


def fit_curve(model: ForceModel, x, y, sessions=None, *, constant: bool = False) -> CurveFit:
    """Fit `model` to y [N] (n) at x [m] (n).

    sessions  (n)  labels. Errors of one session are correlated, because the position of the finger varies between
                   sessions. With labels the standard errors are cluster-robust and allow for a scatter that grows with
                   depth: sandwich estimator of A. C. Cameron, D. L. Miller, J. Human Resources 50 (2015), eq. 11, with
                   sessions - 1 degrees of freedom. Without labels, rows are independent and homoscedastic.

    constant       accept a constant y, which otherwise indicates a dead sensor

    FitError: fewer rows than parameters + 1, fewer than two sessions, values that are not finite, or constant y.
    """
    x, y = np.asarray(x, float), np.asarray(y, float)
    count, size = len(y), len(model.parameters)
    if count <= size:
        raise FitError(f"{model.name}: found {count} rows, expected at least {size + 1} for {size} parameters")
    if not (np.isfinite(x).all() and np.isfinite(y).all()):
        raise FitError(f"{model.name}: found values that are not finite numbers")
    if np.ptp(x) == 0:
        raise FitError(f"{model.name}: found one constant value of the depth")
    if np.ptp(y) == 0 and not constant:
        raise FitError(f"{model.name}: found one constant value of the force")
    parameters, at_limit = _search(model, x, y)
    residual = y - model.predict(x, parameters)
    jacobian = model.jacobian(x, parameters)
    covariance, freedom = _errors(jacobian, residual, sessions)
    rmse = float(np.sqrt(residual @ residual / (count - size)))
    return CurveFit(model, parameters, covariance, rmse, freedom, at_limit)


def _search(model: ForceModel, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, tuple[str, ...]]:
    starts = model.start(x)
    if not starts:
        return _linear(np.stack(model.basis(x), axis=-1), y), ()
    # grid search: the point whose basis explains most of y
    grid = [axis.ravel() for axis in np.meshgrid(*starts, indexing="ij")]
    columns = np.stack(model.basis(x, *(axis[:, None] for axis in grid)), axis=-1)
    scale = np.linalg.norm(columns, axis=1, keepdims=True)
    q, _ = np.linalg.qr(columns / np.where(scale > 0, scale, 1.0))
    explained = np.sum((np.swapaxes(q, 1, 2) @ y) ** 2, axis=1)
    # refine by least squares on the projected residual
    best = int(np.argmax(explained))
    begin = np.array([axis[best] for axis in grid])
    low, high = np.array([s[0] for s in starts]), np.array([s[-1] for s in starts])
    begin = np.clip(begin, low + 1e-9 * (high - low), high - 1e-9 * (high - low))

    def solve_linear(nonlinear: np.ndarray) -> np.ndarray:
        return np.concatenate([_linear(np.stack(model.basis(x, *nonlinear), axis=-1), y), nonlinear])

    def slope(nonlinear: np.ndarray) -> np.ndarray:
        basis, bent = np.split(model.jacobian(x, solve_linear(nonlinear)), [len(model.linear)], axis=1)
        span, _ = np.linalg.qr(basis)
        return bent - span @ (span.T @ bent)

    optimum = least_squares(
        lambda nonlinear: model.predict(x, solve_linear(nonlinear)) - y, begin, slope, bounds=(low, high),
        x_scale=(high - low) / 100.0, ftol=1e-15, xtol=1e-15, gtol=1e-15,
    ).x  # fmt: skip
    near = 1e-6 * (high - low)
    at_end = (optimum < low + near) | (optimum > high - near)
    at_limit = tuple(name for name, limited in zip(model.nonlinear, at_end, strict=True) if limited)
    return solve_linear(optimum), at_limit


def _linear(basis: np.ndarray, y: np.ndarray) -> np.ndarray:
    scale = np.linalg.norm(basis, axis=0)
    scale[scale == 0] = 1.0
    return np.linalg.lstsq(basis / scale, y, rcond=None)[0] / scale


def _errors(jacobian: np.ndarray, residual: np.ndarray, sessions) -> tuple[np.ndarray, int]:
    count, size = jacobian.shape
    scale = np.linalg.norm(jacobian, axis=0)
    scale[scale == 0] = 1.0
    j = jacobian / scale
    freedom = count - size
    if sessions is not None:
        labels, group = np.unique(np.asarray(sessions), return_inverse=True)
        freedom = len(labels) - 1
        if freedom < 1:
            raise FitError("found one session, expected at least two for the errors of the parameters")
    if np.linalg.cond(j) > 1e8:
        return np.full((size, size), np.inf), freedom
    bread = np.linalg.inv(j.T @ j)
    if sessions is None:
        inner = bread * (residual @ residual / freedom)
    else:
        scores = np.zeros((len(labels), size))
        np.add.at(scores, group, j * residual[:, None])
        small = len(labels) / freedom * (count - 1) / (count - size)
        inner = bread @ (scores.T @ scores) @ bread * small
    return inner / np.outer(scale, scale), freedom
