"""Selection of a force model by cross-validation over measured sessions, and its prediction band.

Protocol `published`, as in the experiment, for S sessions (20 there) at the same depths:

1. Drop the sessions with the largest and the smallest sum of force (the first of equal ones).
2. Split the others, in order, into nine consecutive groups. Fold k tests on group k, validates on group k + 1 (cyclic)
   and trains on the others: 14, 2 and 2 sessions of 18.
3. Fit each force model to the training sessions. The training error is sqrt(SSE/(n - p)); the errors on validation and
   test sessions are root mean squares.
4. Fit the same models to the standard deviation over sessions (n - 1 in the denominator) at each depth > 0, once per
   fold on the training sessions and once on all kept sessions.
5. Choose the force model with the lowest mean validation error and the deviation model with the lowest error on all
   kept sessions, and fit both to all kept sessions. The test sessions do not influence the choice.

The coverage of its band, F +- 1.96 sigma, is too low for a new session: sigma and the errors are too small without the
extreme sessions. Protocol `whole` differs in these steps:

1. No session is dropped.
3. Errors are root mean squares over all folds, not means of the roots of each fold, which are lower.
4. The scatter is relative to the chosen curve, not to the mean at each depth, so that it includes the error of the
   curve.
5. The band uses Student's t with the scale and the degrees of freedom below.

Prediction band. The curve F(d) and the scatter sigma(d) are fitted to S sessions at D depths, few sessions with
correlated errors. A force of a new session differs from the fitted curve by its scatter and by the error of the curve,
and sigma is an estimate:

    f = F + sigma w t,   t: Student's t with nu degrees of freedom

The uncertainty of F and sigma depends on the intraclass correlation r of the forces in units of their scatter, the
share of the variance between sessions. A mean of k depths has the variance sigma² (1 + (k - 1) r) / (k S). A variance
estimated from m depths has (S - 1) m / (1 + (m - 1) r²) degrees of freedom: S - 1 if sessions only shift as a whole
(r = 1), and those of all rows if the rows are independent (r = 0). A curve of p parameters averages about k = D/p of D
depths.

At a single depth (k = m = 1) this is the prediction interval of a normal sample, mean +- t s sqrt(1 + 1/S), which is
exact for any r.
"""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from scipy.special import ndtri
from scipy.stats import t as student

from palpate.models.fit.curve_fit import CurveFit, FitError, fit_curve
from palpate.physics.contact.force_models import MODELS

FOLDS = 9
Protocol = Literal["whole", "published"]


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


class Fold(NamedTuple):
    """Indices of sessions."""

    train: np.ndarray
    validation: np.ndarray
    test: np.ndarray


@dataclass(frozen=True)
class ModelChoice:
    """Result of the protocol for one subject.

    protocol         "whole" or "published"
    dropped          indices of the sessions with the smallest and the largest sum of force; () if none is dropped
    folds            indices of the kept sessions in each
    force            model name -> (training, validation, test) error over the folds [N]
    spread           model name -> (training error over the folds, error on all kept sessions) [N]
    mean             chosen force model, fitted to all kept sessions
    deviation        chosen model of the standard deviation, fitted to all kept sessions; None without scatter
    band             distribution of a new force around the mean
    means            [N] (D)  of the kept sessions at each depth
    deviations       [N] (D)  to which the model of the standard deviation was fitted
    test_share  [1]  test error of the chosen force model over the mean force of the kept sessions
    """

    protocol: Protocol
    dropped: tuple[int, ...]
    folds: list[Fold]
    force: dict[str, tuple[float, float, float]]
    spread: dict[str, tuple[float, float]]
    mean: CurveFit
    deviation: CurveFit | None
    band: Spread
    means: np.ndarray
    deviations: np.ndarray
    test_share: float


def drop_outliers(forces) -> tuple[np.ndarray, tuple[int, int]]:
    """(indices kept, in order; (smallest, largest)) of forces [N] (S,D), by the sum over depths."""
    sums = np.sum(np.asarray(forces, float), axis=1)
    low, high = int(np.argmin(sums)), int(np.argmax(sums))
    if low == high:  # all sums are equal
        high = len(sums) - 1
    return np.array([i for i in range(len(sums)) if i not in (low, high)]), (low, high)


def make_folds(kept, count: int = FOLDS) -> list[Fold]:
    """Folds of the kept sessions (see the module). ValueError: fewer than 3 folds, or fewer sessions than folds."""
    kept = np.asarray(kept)
    if count < 3 or len(kept) < count:
        raise ValueError(f"found {len(kept)} sessions for {count} folds, expected at least 3 folds and a session each")
    groups = np.array_split(kept, count)
    folds = []
    for k in range(count):
        after = (k + 1) % count
        train = np.concatenate([g for i, g in enumerate(groups) if i not in (k, after)])
        folds.append(Fold(train, groups[after], groups[k]))
    return folds


def score(name: str, depths, forces, folds: list[Fold], protocol: Protocol = "whole") -> tuple[float, float, float]:
    """Errors [N] of a force model on training, validation and test sessions; depths [m] (D), forces [N] (S,D)."""
    errors, weights = [], []
    for fold in folds:
        fit = _fit_mean(name, depths, forces, fold.train)
        errors.append((fit.rmse, fit.rms(depths, forces[fold.validation]), fit.rms(depths, forces[fold.test])))
        weights.append([len(part) for part in fold])
    if protocol == "published":
        train, validation, test = np.mean(errors, axis=0)
    else:
        train, validation, test = np.sqrt(np.average(np.square(errors), axis=0, weights=weights))
    return float(train), float(validation), float(test)


def choose(
    depths,
    forces,
    count: int = FOLDS,
    mean: str | None = None,
    deviation: str | None = None,
    protocol: Protocol = "whole",
) -> ModelChoice:
    """Run a protocol on one subject.

    depths  [m]  (D)    increasing     forces  [N]  (S,D)
    count   [1]         number of folds
    mean, deviation     names of models to use instead of the best

    FitError: constant forces, or too few depths for the models. ValueError: fewer sessions than folds (+ 2 if two are
    dropped).
    """
    depths, forces = np.asarray(depths, float), np.asarray(forces, float)
    if np.ptp(forces) == 0:
        raise FitError(f"the force is {forces.flat[0]:g} N at all depths of all sessions")
    kept, dropped = drop_outliers(forces) if protocol == "published" else (np.arange(len(forces)), ())
    folds = make_folds(kept, count)
    used = forces[kept]
    # force model with the lowest validation error
    force = {name: score(name, depths, forces, folds, protocol) for name in MODELS}
    mean = mean or min(force, key=lambda name: force[name][1])
    curve = _fit_mean(mean, depths, forces, kept)
    # model of the standard deviation with the lowest error, and the band
    scatter, around, band = used.std(axis=0, ddof=1), None, Spread()
    spread: dict[str, tuple[float, float]] = {}
    if float(np.max(np.ptp(used, axis=0))) > 1e-12 * float(np.max(np.abs(used))):
        if protocol == "whole":
            scatter = _scatter(depths, used, curve)
            groups = [(forces[fold.train], _fit_mean(mean, depths, forces, fold.train)) for fold in folds]
            over_folds = [_scatter(depths, some, fold_curve) for some, fold_curve in groups]
        else:
            over_folds = [forces[fold.train].std(axis=0, ddof=1) for fold in folds]
        for name in MODELS:
            train = np.mean([_fit_deviation(name, depths, fold).rmse for fold in over_folds])
            spread[name] = float(train), _fit_deviation(name, depths, scatter).rmse
        deviation = deviation or min(spread, key=lambda name: spread[name][1])
        around = _fit_deviation(deviation, depths, scatter)
        if protocol == "whole":
            curve, around, band = fit_band(depths, used, mean, deviation)
    return ModelChoice(protocol, dropped, folds, force, spread, curve, around, band, used.mean(axis=0), scatter,
                  force[mean][2] / float(used.mean()))  # fmt: skip


def fit_band(depths, forces, mean: str, deviation: str) -> tuple[CurveFit, CurveFit, Spread]:
    """Curve, scatter around it and spread of a new session; depths [m] (D), forces [N] (S,D), names of models.

    A force of a new session is within curve +- spread.reach(0.95) * scatter with a probability of 0.95.
    """
    depths, forces = np.asarray(depths, float), np.asarray(forces, float)
    curve = _fit_mean(mean, depths, forces, np.arange(len(forces)))
    around = _fit_deviation(deviation, depths, _scatter(depths, forces, curve))
    return curve, around, prediction_spread(forces[:, depths > 0], curve, around)


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


def _fit_mean(name: str, depths: np.ndarray, forces: np.ndarray, rows: np.ndarray) -> CurveFit:
    labels = np.repeat(np.arange(len(rows)), len(depths))
    return fit_curve(MODELS[name], np.tile(depths, len(rows)), forces[rows].ravel(), labels, constant=True)


def _scatter(depths: np.ndarray, forces: np.ndarray, curve: CurveFit) -> np.ndarray:
    """Standard deviation [N] (D) of forces (S,D) from a curve; n - 1 in the denominator."""
    return np.sqrt(((forces - curve(depths)) ** 2).sum(axis=0) / (len(forces) - 1))


def _fit_deviation(name: str, depths: np.ndarray, scatter: np.ndarray) -> CurveFit:
    pressed = depths > 0
    return fit_curve(MODELS[name], depths[pressed], scatter[pressed], constant=True)
