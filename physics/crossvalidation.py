"""How a force model is chosen from measured sessions: outlier rule, folds, errors on seen and unseen sessions.

Protocol for S sessions (20 in the experiment) at the same depths:

1. Of the sums of force, the sessions with the largest and the smallest are dropped (the first of equals).
2. The rest, in their order, are cut into nine consecutive groups. Fold k tests on group k, validates on group k + 1
   (the first after the last) and trains on the others: 14, 2 and 2 sessions of 18.
3. Each model of the force is fitted to the training sessions. Its training error is sqrt(SSE/(n - p)); the errors on
   validation and test sessions are plain root mean squares, since nothing was fitted to them.
4. The standard deviation over sessions (n - 1 in the denominator) at each depth > 0 is fitted by the same models, once
   per fold on the training sessions and once on all that were kept.
5. Chosen are the force model with the least mean validation error and the deviation model with the least error on all
   kept sessions; both are then fitted to all kept sessions. The test sessions take no part in the choice.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.physics.curve_fit import Fit, FitError, fit_curve
from palpate.physics.force_models import MODELS

FOLDS = 9


class Fold(NamedTuple):
    """Indices of sessions."""

    train: np.ndarray
    validation: np.ndarray
    test: np.ndarray


@dataclass(frozen=True)
class Choice:
    """What the protocol finds for one subject.

    dropped     (2)  indices of the sessions with the smallest and the largest sum of force
    folds            indices of the kept sessions in each
    force            model name -> mean over the folds of (training, validation, test) error [N]
    spread           model name -> (mean training error over the folds, error on all kept sessions) [N]
    mean             chosen force model, fitted to all kept sessions
    deviation        chosen model of the standard deviation, fitted to all kept sessions; None where they do not scatter
    means, deviations  [N] (D)  over the kept sessions at each depth, n - 1 in the denominator
    test_share  [1]  test error of the chosen force model over the mean force of the kept sessions
    """

    dropped: tuple[int, int]
    folds: list[Fold]
    force: dict[str, tuple[float, float, float]]
    spread: dict[str, tuple[float, float]]
    mean: Fit
    deviation: Fit | None
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


def choose(depths, forces, count: int = FOLDS, mean: str | None = None, deviation: str | None = None) -> Choice:
    """Run the protocol on one subject.

    depths  [m]  (D)    growing        forces  [N]  (S,D)
    count   [1]         number of folds
    mean, deviation     names of models to take instead of the best

    FitError: constant forces, or too few depths for the models. ValueError: fewer sessions than folds + 2.
    """
    depths, forces = np.asarray(depths, float), np.asarray(forces, float)
    if np.ptp(forces) == 0:
        raise FitError(f"the force is {forces.flat[0]:g} N at all depths of all sessions")
    kept, dropped = drop_outliers(forces)
    folds = make_folds(kept, count)
    used = forces[kept]
    scatter = float(np.max(np.ptp(used, axis=0))) > 1e-12 * float(np.max(np.abs(used)))
    force = {name: _score(name, depths, forces, folds) for name in MODELS}
    spread = {name: _spread(name, depths, forces, folds, kept) for name in MODELS} if scatter else {}
    mean = mean or min(force, key=lambda name: force[name][1])
    found = _fit_mean(mean, depths, forces, kept)
    around = None
    if scatter:
        around = _fit_deviation(deviation or min(spread, key=lambda name: spread[name][1]), depths, used)
    return Choice(
        dropped,
        folds,
        force,
        spread,
        found,
        around,
        used.mean(axis=0),
        used.std(axis=0, ddof=1),
        force[mean][2] / float(used.mean()),
    )


def _fit_mean(name: str, depths: np.ndarray, forces: np.ndarray, rows: np.ndarray) -> Fit:
    labels = np.repeat(np.arange(len(rows)), len(depths))
    return fit_curve(MODELS[name], np.tile(depths, len(rows)), forces[rows].ravel(), labels, constant=True)


def _fit_deviation(name: str, depths: np.ndarray, forces: np.ndarray) -> Fit:
    pressed = depths > 0
    return fit_curve(MODELS[name], depths[pressed], forces[:, pressed].std(axis=0, ddof=1), constant=True)


def _score(name: str, depths: np.ndarray, forces: np.ndarray, folds: list[Fold]) -> tuple[float, float, float]:
    errors = []
    for fold in folds:
        fit = _fit_mean(name, depths, forces, fold.train)
        errors.append((fit.rmse, fit.rms(depths, forces[fold.validation]), fit.rms(depths, forces[fold.test])))
    train, validation, test = np.mean(errors, axis=0)
    return float(train), float(validation), float(test)


def _spread(
    name: str, depths: np.ndarray, forces: np.ndarray, folds: list[Fold], kept: np.ndarray
) -> tuple[float, float]:
    train = [_fit_deviation(name, depths, forces[fold.train]).rmse for fold in folds]
    return float(np.mean(train)), _fit_deviation(name, depths, forces[kept]).rmse
