"""Least squares of the fields of a graph in lanes: residuals and Jacobian of recordings over free parameters."""

import math
from collections import OrderedDict
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.stats import qmc

from palpate.gradients.parameters import Parameter
from palpate.models.fit.tissue.estimate import LEAST_PER_UNKNOWN, Problem
from palpate.models.fit.tissue.measured import MeasuredPress
from palpate.models.fit.tissue.noise import step_of
from palpate.models.fit.tissue.residuals import inflation
from palpate.models.fit.tissue.rigs import Parameter as Unknown
from palpate.physics.errors import ArgumentError
from palpate.studies.inverse.descent import Descent, Point
from palpate.studies.inverse.forward import Forward
from palpate.studies.inverse.measured import Measured
from palpate.studies.inverse.priors import Prior, Priors, check_range

RANGE = 30.0  # [1] Largest factor of a positive parameter from its start
REACH = 10.0  # Largest change of another parameter, in scales
STEP, FINE = 1e-4, 1e-3
"""[1] Steps of forward differences of the search, and of central ones at the minimum, in search coordinates."""
ROUNDED = 1e-9  # [1] Noise that is added to each field, over its peak: less than the tolerance of an implicit step
FAILED = 1e3  # weighted residual of a run that fails
CANDIDATES, SPREAD = 3, math.log(4.0)
"""Random points of which the best one is a start, and how far they reach in search coordinates."""
EXACT, NEAR, SETTLE = 1e-6, 1e-4, 3
"""[1] Decrease of the sum of squares, over it, by a further step at the minimum, and so near to it that the derivatives
stay the same; rounds of the search for it."""
SMALL = 0.1  # [1] Part of the peak of a field below which it counts by its size, above by its logarithm
KEPT = 8  # points whose fields are kept


class RunProblem(Problem):
    """Residuals of recordings, over parameters that all share and parameters that each recording has for itself.

    parameters  numbers of the graph;  separate  paths of those with a value for each recording
    """

    def __init__(
        self, measured: Sequence[Measured], parameters: Sequence[Parameter], separate: Sequence[str] = ()
    ) -> None:
        self.runs_of, self.numbers = list(measured), list(parameters)
        self.forward = [Forward(each, parameters) for each in measured]
        several = len(measured) > 1
        self.places: list[list[int]] = [[] for _ in measured]  # unknown of each parameter, by recording
        unknowns: list[Unknown] = []
        for number in parameters:
            alone = number.path in separate and several
            for k, run in enumerate(measured):
                if alone or k == 0:
                    unknowns.append(_unknown(number, f", {run.name}" if alone else ""))
                self.places[k].append(len(unknowns) - 1)
        self.parameters = tuple(unknowns)
        self.names = [each.name for each in unknowns]
        self.presses, self.weight = [], []
        for run in measured:
            for path, values in zip(run.fields, run.values, strict=True):
                flat = values.T.ravel()
                peak = float(np.abs(flat).max()) or 1.0
                # a recording without noise has finite statistics too
                flat = flat + ROUNDED * peak * np.random.default_rng(0).standard_normal(len(flat))
                name, zero = f"{run.name} {path}", np.zeros(len(flat))
                self.presses.append(MeasuredPress(name, None, zero, flat, 0.0, 0.0, 0.0, step=step_of(values[:, 0])))
                self.weight.append(np.full(len(flat), 1.0 / (SMALL * peak)))
        self.baselines, self.rises, self.free_touch, self.relative = [], [], False, False
        self.count = sum(len(press.force) for press in self.presses)
        if self.count < LEAST_PER_UNKNOWN * len(unknowns):
            raise ArgumentError(
                f"found {self.count} values for {len(unknowns)} settings, expected at least "
                f"{LEAST_PER_UNKNOWN * len(unknowns)}: a longer recording, or a later --until"
            )
        self._fields = OrderedDict[bytes, list[np.ndarray]]()  # of the last points, unweighted
        self.compressed = True
        """Whether residuals are those of asinh(field / (`SMALL` peak)), before `weigh`. They change in proportion to
        the logarithm of a setting by which the field is multiplied, so that few steps lead from far to the minimum."""
        self.minimum: Point | None = None
        """With derivatives by central differences."""
        self.priors: Priors | None = None
        """Whose rows follow those of the fields."""

    def believe(self, known: Mapping[str, Prior], at: Point) -> Point:
        """Add the priors of parameters by path. Returns the point with their rows. ArgumentError: they do not fit."""
        if not known:
            return at
        each: list[Prior | None] = [None] * len(self.parameters)
        for places in self.places:
            for number, place in zip(self.numbers, places, strict=True):
                each[place] = known.get(number.path)
        check_range(self.parameters, {k: prior for k, prior in enumerate(each) if prior is not None})
        parts = np.split(at.r, np.cumsum([len(each) for each in self.weight])[:-1])
        variance = float(np.mean(at.r**2))
        self.priors = Priors(self.parameters, each, math.sqrt(variance * inflation(parts, len(at.x))))
        return Point(at.x, self.residuals(at.x), self.with_priors(at.slopes, at.x), at.fresh)

    def weigh(self, at: Point) -> Point:
        """Weigh the residuals of each field by their RMS at a point from now on. Returns the point with these
        residuals."""
        steepness = []
        for k, (force, press) in enumerate(zip(self.law_forces(at.x), self.presses, strict=True)):
            rms, peak = (float(np.sqrt(np.mean(each**2))) for each in (force - press.force, press.force))
            size = 1.0 / max(rms, ROUNDED * peak, 1e-300)
            # derivatives of the fields over those of the present residuals
            steepness.append(size * np.hypot(force * self.compressed, 1.0 / self.weight[k]))
            self.weight[k] = np.full(len(press.force), size)
        self.compressed = False
        slopes = at.slopes * np.nan_to_num(np.concatenate(steepness))[:, None]
        return Point(at.x, self.residuals(at.x), slopes, at.fresh)

    def touches(self, x: np.ndarray) -> list[float]:
        return [0.0] * len(self.presses)

    def start(self) -> np.ndarray:
        return np.clip([p.to_search(p.guess) for p in self.parameters], *self.bounds)

    def other_minima(self, x: np.ndarray) -> list[np.ndarray]:
        """None: the starts of the search are spread over the range of each parameter."""
        return []

    def residuals(self, x: np.ndarray) -> np.ndarray:
        """Weighted residuals (values) of the fields, then of the priors."""
        return self._with_rows(self._weighted([force[None] for force in self.law_forces(x)]), x[None])[0]

    def points(self, k: int, several: np.ndarray) -> np.ndarray:
        """The values of the parameters of a recording at these unknowns (n, unknowns)."""
        return np.array([
            [self.parameters[place].value(x[place]) for place in self.places[k]] for x in several
        ])  # fmt: skip

    def many(self, several: np.ndarray) -> list[np.ndarray]:
        """The fields at these unknowns (n, unknowns), each (n, values), in the order of `presses`."""
        found = []
        for k, forward in enumerate(self.forward):
            found += [each.transpose(0, 2, 1).reshape(len(several), -1) for each in forward(self.points(k, several))]
        return found

    def law_forces(self, x: np.ndarray) -> list[np.ndarray]:
        key = x.tobytes()
        if key not in self._fields:
            self._fields[key] = [each[0] for each in self.many(x[None])]
            if len(self._fields) > KEPT:
                self._fields.popitem(last=False)
        return self._fields[key]

    def all_residuals(self, several: np.ndarray) -> np.ndarray:
        """Weighted residuals (n, values) at these unknowns."""
        return self._with_rows(self._weighted(self.many(several)), several)

    def _weighted(self, fields: Sequence[np.ndarray]) -> np.ndarray:
        """Weighted residuals (n, values) of fields (n, values each); NaN where a run has failed."""
        pairs = [(f * w, p.force * w) for f, p, w in zip(fields, self.presses, self.weight, strict=True)]
        if self.compressed:
            pairs = [(np.arcsinh(each), np.arcsinh(measured)) for each, measured in pairs]
        return np.concatenate([each - measured for each, measured in pairs], axis=1)

    def _with_rows(self, weighted: np.ndarray, several: np.ndarray) -> np.ndarray:
        """Residuals without NaN, with those of the priors at these unknowns (n, unknowns)."""
        found = np.nan_to_num(weighted, nan=FAILED)
        if self.priors is None:
            return found
        return np.concatenate([found, [self.priors.residuals(x) for x in several]], axis=1)

    def law_slopes(self, x: np.ndarray, here: Sequence[np.ndarray], free: np.ndarray) -> np.ndarray:
        """(values, unknowns) Derivatives by central differences, one-sided at a limit; at the minimum those that are
        known."""
        if self.minimum is not None and np.array_equal(self.minimum.x, x):
            return self.minimum.slopes[: self.count]
        return self._slopes(x, self._weighted([force[None] for force in here])[0], free, FINE, both=True)

    def slopes_at(self, x: np.ndarray, r: np.ndarray, free: np.ndarray | None = None) -> np.ndarray:
        """(values, unknowns) Derivatives of the residuals, which are r at x, by forward differences; 0 by unknowns that
        are not `free`."""
        free = np.ones(len(x), bool) if free is None else free
        return self.with_priors(self._slopes(x, r[: self.count], free, STEP, both=False), x)

    def _slopes(self, x: np.ndarray, r: np.ndarray, free: np.ndarray, step: float, both: bool) -> np.ndarray:
        low, high = self.bounds
        moves = []
        for i in np.flatnonzero(free):
            up, down = bool(x[i] + step <= high[i]), bool(x[i] - step >= low[i])
            moves += [(i, 1.0)] * (up or not down) + [(i, -1.0)] * (down and (both or not up))
        rows = np.array([x + sign * step * np.eye(len(x))[i] for i, sign in moves])
        moved = self._weighted(self.many(rows))
        slopes = np.zeros((self.count, len(x)))
        for i in np.flatnonzero(free):
            mine = [number for number, (place, _) in enumerate(moves) if place == i]
            slopes[:, i] = np.mean([(moved[number] - r) / (moves[number][1] * step) for number in mine], axis=0)
        return np.nan_to_num(slopes)

    def begins(self, count: int) -> list[Point]:
        """The start, and the best of random points around it, without derivatives, in the order of their squares."""
        begin, (low, high), more = self.start(), self.bounds, CANDIDATES * (count - 1)
        drawn = 2.0 * qmc.LatinHypercube(len(begin), rng=np.random.default_rng(0)).random(more) - 1.0
        wide = np.where([p.log for p in self.parameters], SPREAD, 0.3 * REACH * self._scales())
        several = np.clip([begin, *(begin + drawn * wide)], low + 1e-6 * (high - low), high - 1e-6 * (high - low))
        none = np.zeros((0, len(begin)))
        found = [Point(x, r, none) for x, r in zip(several, self.all_residuals(several), strict=True)]
        kept = [found[0], *sorted(found[1:], key=lambda each: each.squares)[: count - 1]]
        return sorted(kept, key=lambda each: each.squares)

    def _scales(self) -> np.ndarray:
        """Scale of each unknown that is not searched as a logarithm, else 1."""
        found = np.ones(len(self.parameters))
        for places in self.places:
            for number, place in zip(self.numbers, places, strict=True):
                found[place] = 1.0 if self.parameters[place].log else number.scale
        return found

    @property
    def descent(self) -> Descent:
        """The search with the present weights and priors."""
        return Descent(self.residuals, self.slopes_at, *self.bounds, self._scales())

    def settle(self, at: Point) -> Point:
        """The minimum near a point, with derivatives by central differences."""
        search, free = self.descent, np.ones(len(at.x), bool)
        for _ in range(SETTLE):
            at = search.run(at, EXACT)
            at = Point(at.x, at.r, self.with_priors(self.law_slopes(at.x, self.law_forces(at.x), free), at.x))
            step, predicted = search.step(at)
            if predicted <= EXACT * at.squares:
                break
            x = at.x + step
            r = self.residuals(x)
            if r @ r < at.squares:
                at = Point(x, r, at.slopes)
                if predicted <= NEAR * at.squares:
                    break
        return at

    def with_priors(self, slopes: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Derivatives of the weighted fields with those of the priors."""
        return slopes if self.priors is None else np.concatenate([slopes, self.priors.slopes(x)])

    def solve(self, x: np.ndarray, fixed: int = -1) -> tuple[np.ndarray, float]:
        """The point itself: `estimate` takes the minimum that is known, and the fields without priors."""
        return x, float(np.sum(self.residuals(x)[: self.count] ** 2))

    def close(self) -> None:
        """Stop the nodes of all recordings."""
        for each in self.forward:
            each.close()


def _is_log(number: Parameter) -> bool:
    """Whether a parameter is positive, so that its logarithm is searched: by its limit, or in a list, whose limits are
    those of the list, if its scale is its value."""
    return number.value > 0.0 and (number.scale == number.value if number.inside else number.low >= 0.0)


def _unknown(number: Parameter, owner: str) -> Unknown:
    """A parameter of a graph as an unknown with its bounds."""
    if _is_log(number):
        low, high = max(number.low, number.value / RANGE), min(number.high, number.value * RANGE)
    else:
        low, high = (number.value + side * REACH * number.scale for side in (-1.0, 1.0))
        low, high = max(low, number.low), min(high, number.high)
    return Unknown(f"{number.path}{owner}", number.unit, number.value, low, high, _is_log(number))
