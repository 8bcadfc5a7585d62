"""Fit probes: rows in the range of the law, one law for all places, a map, and its error on held-out probes."""

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from palpate.models.fit.probes.field import Field, fit_field
from palpate.models.fit.probes.inclusion import Ground, Inclusion, find_inclusions
from palpate.models.fit.probes.pooled import PooledFit, Rows, fit_pooled
from palpate.models.fit.probes.read import LEAST_ROWS, Probes
from palpate.models.fit.sessions import SessionError
from palpate.models.fit.tissue.plausible import check_units
from palpate.models.fit.tissue.rigs import Law, Rig, closed_form

EMPIRICAL = ("power", "exponential")
FOLDS = 5
BALL_RATIO = 100.0  # [1] Modulus of an inclusion over that of the tissue, if it is not given


@dataclass
class ProbeMap:
    """Stiffness over the probed surface.

    fit        the pooled fit;  field, touch  fields of ln K, and of the touch point [mm], at the modes of the probes
    predicted, mean_curve   [N] (n) errors on held-out probes, of the map and of the mean curve of the other probes
    inclusions, scores      stiff balls, and the criterion with 0, 1, 2 ... of them
    next_places             (k,3) [m] to probe next
    """

    probes: Probes
    fit: PooledFit
    ground: Ground
    field: Field
    touch: Field
    predicted: np.ndarray
    mean_curve: np.ndarray
    inclusions: list[Inclusion] = dataclasses.field(default_factory=list)
    scores: list[float] = dataclasses.field(default_factory=list)
    next_places: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros((0, 3)))

    def errors(self) -> tuple[float, float]:
        """RMS [N] on held-out probes, of the map and of the mean curve."""
        return tuple(float(np.sqrt(np.mean(one**2))) for one in (self.predicted, self.mean_curve))  # type: ignore[return-value]


def fit_probes(probes: Probes, law: Law, deepest: float = math.inf) -> PooledFit:
    """One law for all probes, whose mean allows for similar neighbours. SessionError: too few rows in its range."""
    rows = probes.rows
    limit = min(deepest, law.reach)
    mask = rows.mask & (rows.depth <= limit)
    notes = []
    if (lost := int(rows.mask.sum() - mask.sum())) > 0:
        why = f"the law {law.name} is valid to {1e3 * law.reach:.3g} mm" if law.reach < deepest else "--depth-limit"
        notes.append(f"{lost} of {int(rows.mask.sum())} rows are deeper than {1e3 * limit:.3g} mm and left out: {why}")
    enough = mask.sum(axis=1) >= LEAST_ROWS
    if enough.mean() < 0.5:
        raise SessionError(
            f"{notes[0]}; {int(mask.sum(axis=1).mean())} rows per probe remain, expected at least {LEAST_ROWS}. Take "
            f"--law {' or '.join(EMPIRICAL)}, which have no limit"
        )
    if not enough.all():
        notes.append(f"{int((~enough).sum())} probes with fewer than {LEAST_ROWS} rows in this range are left out")
    kept = probes.part(enough)
    found = fit_pooled(Rows(kept.rows.depth, kept.rows.force, mask[enough]), law)
    found.notes = notes + found.notes
    if kept.places is not None and len(np.unique(kept.places, axis=0)) > 3:
        around = fit_field(kept.places, found.place, found.error)
        half = float(student.ppf(0.975, len(found.place) - 1)) * around.mean_error
        value, (low, high) = found.values[found.first], found.intervals[found.first]
        if not around.flat and half > 0.5 * math.log(high / low):
            found.intervals[found.first] = value * math.exp(-half), value * math.exp(half)
            found.notes.append(
                f"places within {1e3 * around.length:.2g} mm are similar: the interval of {found.first} counts them so"
            )
    return found


def best_law(probes: Probes, rig: Rig, name: str | None, deepest: float = math.inf) -> PooledFit:
    """The fit of a law; None: of the power law or the exponential, whichever leaves less noise without a constant at
    its limit. SessionError: no law can be fitted."""
    fits, failed = [], []
    for one in [name] if name else EMPIRICAL:
        try:
            fits.append(fit_probes(probes, closed_form(rig, one), deepest))
        except SessionError as error:
            failed.append(str(error))
    if not fits:
        raise SessionError("; ".join(failed))
    best = min(fits, key=lambda fit: (bool(fit.limited), fit.noise))
    best.notes += [f"left out: {text}" for text in failed]
    best.notes += [f"law {fit.law.name} is not used: {fit.limited}" for fit in fits if fit is not best and fit.limited]
    peaks = np.where(best.rows.mask, best.rows.force, -np.inf).max(axis=1)
    reaches = np.where(best.rows.mask, best.rows.depth, -np.inf).max(axis=1) - best.touches
    best.notes += check_units(rig, float(np.median(peaks)), float(np.median(reaches)))
    return best


def fit_map(
    probes: Probes, rig: Rig, name: str | None, *, deepest: float = math.inf, ratio: float = BALL_RATIO, more: int = 6,
    report: Callable[[str, float], object] = lambda text, share: None,
) -> ProbeMap:  # fmt: skip
    """The map of one region. SessionError: no places, or too few rows."""
    if probes.places is None:
        raise SessionError(f"{probes.read[0]}: no places, expected the columns x, y and z with units")
    report("pooled fit", 0.1)
    fit = best_law(probes, rig, name, deepest)
    if len(fit.place) < len(probes.names):
        keep = (probes.rows.mask & (probes.rows.depth <= min(deepest, fit.law.reach))).sum(axis=1) >= LEAST_ROWS
        probes = probes.part(keep)
    assert probes.places is not None
    predicted, mean_curve = _held_out(probes, fit, report)
    field, touch = _fields(probes.places, fit)
    reach = min(
        math.sqrt(rig.radius * max(float(np.median(fit.rows.depth.max(axis=1) - fit.touches)), 1e-5)), 0.9 * rig.radius
    )
    ground = Ground.of(probes.places, probes.normals, reach)
    report("inclusions", 0.2)
    inclusions, _, scores = find_inclusions(ground, fit.place, fit.error, ratio)
    report("places to probe next", 0.2)
    candidates = np.array([ground.surface_point(uv) for uv in grid(ground, 30)])
    following = candidates[field.next_places(candidates, more)]
    return ProbeMap(probes, fit, ground, field, touch, predicted, mean_curve, inclusions, scores, following)


def _fields(places: np.ndarray, fit: PooledFit) -> tuple[Field, Field]:
    """Fields of ln K and of the touch point [mm], with the noise of both as a nugget."""
    none = np.zeros(len(places))
    return fit_field(places, fit.shrunk, none), fit_field(places, 1e3 * fit.touches, none)


def _held_out(probes: Probes, fit: PooledFit, report: Callable[[str, float], object]) -> tuple[np.ndarray, np.ndarray]:
    """Errors [N] of the force on probes that the fit did not use: by the map, and by the mean curve of the others."""
    assert probes.places is not None
    fold = np.random.default_rng(0).permutation(len(probes.names)) % FOLDS
    rows, map_errors, mean_errors = fit.rows, [], []
    for k in range(FOLDS):
        report("held-out probes", 0.5 / FOLDS)
        used = fold != k
        try:
            part = fit_pooled(Rows(rows.depth[used], rows.force[used], rows.mask[used]), fit.law)
        except SessionError as error:
            fit.notes.append(f"a part of the held-out probes is not predicted: {error}")
            continue
        field, touch = _fields(probes.places[used], part)
        stiff, at = field.at(probes.places[~used])[0], 1e-3 * touch.at(probes.places[~used])[0]
        for i, probe in enumerate(np.flatnonzero(~used)):
            here = rows.mask[probe]
            depth, force = rows.depth[probe, here], rows.force[probe, here]
            curves = [np.interp(depth, d[m], f[m], left=np.nan, right=np.nan)
                      for d, f, m in zip(rows.depth[used], rows.force[used], rows.mask[used], strict=True)]  # fmt: skip
            counted = np.isfinite(curves).any(axis=0)
            mean = np.nanmean(np.array(curves)[:, counted], axis=0)
            map_errors.append((part.force(stiff[i], at[i], depth) - force)[counted])
            mean_errors.append(mean - force[counted])
    if not map_errors:
        raise SessionError(f"no part of the probes determines the law {fit.law.name}; expected more probes")
    return np.concatenate(map_errors), np.concatenate(mean_errors)


def grid(ground: Ground, count: int) -> np.ndarray:
    """Coordinates (k,2) [m] along the axes of the ground, within 1.5 spacings of the probed places."""
    plane = ground.plane
    low, high = plane.min(axis=0), plane.max(axis=0)
    step = float((high - low).max()) / count
    axes = [np.arange(a, b + step, step) for a, b in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    apart = np.sqrt(((points[:, None] - plane) ** 2).sum(axis=2))
    between = np.sqrt(((plane[:, None] - plane) ** 2).sum(axis=2))
    spacing = float(np.median(np.where(between > 0.0, between, np.inf).min(axis=1)))
    return points[apart.min(axis=1) < 1.5 * spacing]


def log_ratio(found: ProbeMap, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """ln of the stiffness at places (k,3) over that of the median place, and its standard deviation."""
    value, error = found.field.at(places)
    return value - math.log(found.fit.values[found.fit.first]), error
