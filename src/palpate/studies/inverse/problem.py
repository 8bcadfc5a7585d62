"""Least squares of the fields of a graph in lanes: residuals and Jacobian of recordings over free parameters."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import qmc

from palpate.gradients.parameters import Parameter, put_all
from palpate.launch.run.lane_runner import LaneKeep, LaneRunner
from palpate.launch.run.lane_values import LanePreparation
from palpate.launch.run.lanes import columns_of
from palpate.launch.run.work.compiling import compiling
from palpate.models.fit.tissue.estimate import LEAST_PER_UNKNOWN, Problem
from palpate.models.fit.tissue.measured import MeasuredPress
from palpate.models.fit.tissue.noise import step_of
from palpate.models.fit.tissue.residuals import inflation
from palpate.models.fit.tissue.rigs import Parameter as Unknown
from palpate.physics.errors import ArgumentError
from palpate.studies.inverse.measured import Measured
from palpate.studies.inverse.priors import Prior, Priors, check_range

RANGE = 30.0  # [1] Largest factor of a positive parameter from its start
REACH = 10.0  # Largest change of another parameter, in scales
STEP, FINE = 1e-4, 1e-3
"""[1] Steps of forward differences of the search, and of central ones at the minimum, in search coordinates."""
ROUNDED = 1e-9  # [1] Noise that is added to each field, over its peak: less than the tolerance of an implicit step
FAILED = 1e3  # weighted residual of a run that fails
CANDIDATES, SPREAD = 12, math.log(4.0)
"""Number of random starts that are evaluated, and how far they reach in search coordinates."""


class Forward:
    """The fields of one recording's run as functions of the parameters, in lanes that stay ready.

    GraphError, ArgumentError: the run is refused.
    """

    def __init__(self, measured: Measured, parameters: Sequence[Parameter]) -> None:
        self.measured, self.parameters = measured, list(parameters)
        keep = [(each.rpartition(".")[0], each.rpartition(".")[2]) for each in measured.fields]
        first = put_all(parameters, [each.value for each in parameters])
        ends = {each.target: _probes(each) for each in parameters if not each.inside}
        self._lanes = LanePreparation(measured.launch, keep, first, ends)
        self.first, self._keep = self._lanes.first, LaneKeep(keep, measured.ticks)
        self._runner = LaneRunner(self._keep)
        self.count = 0
        """Number of runs so far."""

    def __call__(self, points: np.ndarray) -> list[np.ndarray]:
        """For each field its values (points, rows, k) at these values of the parameters (points, parameters); NaN where
        a run fails."""
        count = len(points)
        each = [put_all(self.parameters, row) for row in points.tolist()]
        self._lanes.give(1, {target: [values[target] for values in each] for target in each[0]})
        columns = columns_of(self.first, self._keep.fields, count, self._keep.rows)
        with compiling(lambda number: None):
            found = self._runner.run(lambda row: self._lanes(row + 1), columns)
        for row in found.failures:
            for column in columns:
                column[row] = np.nan
        self.count += count
        rows = self.measured.rows
        return [np.asarray(column[:, rows], float).reshape(count, len(rows), -1) for column in columns]

    def close(self) -> None:
        """Stop the nodes."""
        self._runner.close()


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
                self.weight.append(np.full(len(flat), 1.0 / peak))
        self.baselines, self.free_touch, self.relative = [], False, False
        self.count = sum(len(press.force) for press in self.presses)
        if self.count < LEAST_PER_UNKNOWN * len(unknowns):
            raise ArgumentError(
                f"found {self.count} values for {len(unknowns)} settings, expected at least "
                f"{LEAST_PER_UNKNOWN * len(unknowns)}: a longer recording, or a later --until"
            )
        self._at: tuple[bytes, list[np.ndarray]] | None = None
        self.priors: Priors | None = None
        """Whose rows follow those of the fields."""

    def believe(self, known: Mapping[str, Prior], x: np.ndarray) -> None:
        """Add the priors of parameters by path, with the residuals at x. ArgumentError: they do not fit."""
        if not known:
            return
        each: list[Prior | None] = [None] * len(self.parameters)
        for places in self.places:
            for number, place in zip(self.numbers, places, strict=True):
                each[place] = known.get(number.path)
        check_range(self.parameters, {k: prior for k, prior in enumerate(each) if prior is not None})
        parts = [(f - p.force) * w for f, p, w in zip(self.law_forces(x), self.presses, self.weight, strict=True)]
        variance = float(np.mean(np.concatenate(parts) ** 2))
        self.priors = Priors(self.parameters, each, math.sqrt(variance * inflation(parts, len(x))))

    def weigh(self, x: np.ndarray) -> None:
        """Weigh each field by its noise, the RMS of its residuals at x, instead of its peak."""
        for k, (force, press) in enumerate(zip(self.law_forces(x), self.presses, strict=True)):
            rms, peak = (float(np.sqrt(np.mean(each**2))) for each in (force - press.force, press.force))
            self.weight[k] = np.full(len(press.force), 1.0 / max(rms, ROUNDED * peak, 1e-300))

    def touches(self, x: np.ndarray) -> list[float]:
        return [0.0] * len(self.presses)

    def start(self) -> np.ndarray:
        return np.clip([p.to_search(p.guess) for p in self.parameters], *self.bounds)

    def other_minima(self, x: np.ndarray) -> list[np.ndarray]:
        """None: the starts of the search are spread over the range of each parameter."""
        return []

    def residuals(self, x: np.ndarray) -> np.ndarray:
        found = super().residuals(x)
        return found if self.priors is None else np.concatenate([found, self.priors.residuals(x)])

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
        if self._at is None or self._at[0] != x.tobytes():
            self._at = x.tobytes(), [each[0] for each in self.many(x[None])]
        return self._at[1]

    def all_residuals(self, several: np.ndarray) -> np.ndarray:
        """Weighted residuals (n, values) at these unknowns."""
        parts = [(f - p.force) * w for f, p, w in zip(self.many(several), self.presses, self.weight, strict=True)]
        found = np.nan_to_num(np.concatenate(parts, axis=1), nan=FAILED)
        if self.priors is None:
            return found
        return np.concatenate([found, [self.priors.residuals(x) for x in several]], axis=1)

    def law_slopes(self, x: np.ndarray, here: Sequence[np.ndarray], free: np.ndarray) -> np.ndarray:
        """(values, unknowns) Derivatives by central differences, one-sided at a limit."""
        return self._slopes(x, here, FINE, both=True)

    def _slopes(self, x: np.ndarray, here: Sequence[np.ndarray], step: float, both: bool) -> np.ndarray:
        low, high = self.bounds
        moves = []
        for i in range(len(x)):
            up, down = bool(x[i] + step <= high[i]), bool(x[i] - step >= low[i])
            moves += [(i, 1.0)] * (up or not down) + [(i, -1.0)] * (down and (both or not up))
        rows = np.array([x + sign * step * np.eye(len(x))[i] for i, sign in moves])
        base = np.concatenate([f * w for f, w in zip(here, self.weight, strict=True)])
        moved = np.concatenate([f * w for f, w in zip(self.many(rows), self.weight, strict=True)], axis=1)
        slopes = np.zeros((self.count, len(x)))
        for i in range(len(x)):
            mine = [number for number, (place, _) in enumerate(moves) if place == i]
            each = [(moved[number] - base) / (moves[number][1] * step) for number in mine]
            slopes[:, i] = np.mean(each, axis=0)
        return np.nan_to_num(slopes)

    def begins(self, count: int) -> list[np.ndarray]:
        """The start, and the best of random points around it."""
        begin, (low, high) = self.start(), self.bounds
        drawn = 2.0 * qmc.LatinHypercube(len(begin), rng=np.random.default_rng(0)).random(CANDIDATES) - 1.0
        wide = np.where([p.log for p in self.parameters], SPREAD, 0.3 * REACH * self._scales())
        several = np.clip(begin + drawn * wide, low + 1e-6 * (high - low), high - 1e-6 * (high - low))
        order = np.argsort(np.sum(self.all_residuals(several) ** 2, axis=1))
        return [begin, *several[order[: count - 1]]]

    def _scales(self) -> np.ndarray:
        """Scale of each unknown that is not searched as a logarithm, else 1."""
        found = np.ones(len(self.parameters))
        for places in self.places:
            for number, place in zip(self.numbers, places, strict=True):
                found[place] = 1.0 if self.parameters[place].log else number.scale
        return found

    def search(self, x: np.ndarray, loose: bool) -> tuple[np.ndarray, float]:
        """The minimum that the trust region reaches from x, and its sum of squares."""
        low, high = self.bounds
        inside = np.clip(x, low + 1e-6 * (high - low), high - 1e-6 * (high - low))
        limit = 1e-3 if loose else 1e-10
        found = least_squares(
            self.residuals, inside, jac=self.slopes_at, bounds=(low, high), x_scale=self._scales(),
            method="trf", ftol=limit, xtol=limit, gtol=1e-12, max_nfev=12 if loose else 40,
        )  # fmt: skip
        return found.x, 2.0 * float(found.cost)

    def slopes_at(self, x: np.ndarray) -> np.ndarray:
        """(values, unknowns) Derivatives of the residuals by forward differences."""
        return self.with_priors(self._slopes(x, self.law_forces(x), STEP, both=False), x)

    def with_priors(self, slopes: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Derivatives of the weighted fields with those of the priors."""
        return slopes if self.priors is None else np.concatenate([slopes, self.priors.slopes(x)])

    def solve(self, x: np.ndarray, fixed: int = -1) -> tuple[np.ndarray, float]:
        """The point itself: `estimate` takes the minimum that is known, and the fields without priors."""
        return x, float(np.sum(super().residuals(x) ** 2))

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


def _probes(number: Parameter) -> tuple[float, ...]:
    """Two values of a parameter, from which the settings that it reaches are found."""
    up = min(number.value + 0.01 * number.scale, number.high)
    return tuple({up, max(number.value - 0.01 * number.scale, number.low)} - {number.value})
