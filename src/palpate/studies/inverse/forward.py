"""The fields of a recording's run as functions of its parameters, in lanes that stay ready."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from palpate.gradients.parameters import Parameter, put_all
from palpate.launch.run.lane_runner import LaneKeep, LaneRunner
from palpate.launch.run.lane_values import LanePreparation, extremes
from palpate.launch.run.lanes import columns_of
from palpate.launch.run.work.compiling import compiling
from palpate.studies.inverse.measured import Measured


class Forward:
    """The fields of one recording's run as functions of the parameters, in lanes that stay ready.

    GraphError, ArgumentError: the run is refused.
    """

    def __init__(self, measured: Measured, parameters: Sequence[Parameter]) -> None:
        self.measured, self.parameters = measured, list(parameters)
        keep = [(each.rpartition(".")[0], each.rpartition(".")[2]) for each in measured.fields]
        first = put_all(parameters, [each.value for each in parameters])
        ends = {target: extremes(values) for target, values in _probes(parameters).items()}
        self._lanes = LanePreparation(measured.launch, keep, first, ends)
        self.first, self._keep = self._lanes.first, LaneKeep(keep, measured.ticks)
        self._runner = LaneRunner(self._keep)
        self.count = 0
        """Number of runs so far."""
        self.failure = ""
        """Why the last run that failed did."""

    def __call__(self, points: np.ndarray) -> list[np.ndarray]:
        """For each field its values (points, rows, k) at these values of the parameters (points, parameters); NaN where
        a run fails."""
        count = len(points)
        each = [put_all(self.parameters, row) for row in points.tolist()]
        self._lanes.give(1, {target: [values[target] for values in each] for target in each[0]})
        columns = columns_of(self.first, self._keep.fields, count, self._keep.rows)
        with compiling(lambda number: None):
            found = self._runner.run(lambda row: self._lanes(row + 1), columns)
        for row, error in found.failures.items():
            self.failure = str(error)
            for column in columns:
                column[row] = np.nan
        self.count += count
        rows = self.measured.rows
        return [np.asarray(column[:, rows], float).reshape(count, len(rows), -1) for column in columns]

    def close(self) -> None:
        """Stop the nodes."""
        self._runner.close()


def _probes(numbers: Sequence[Parameter]) -> dict[str, list[Any]]:
    """By target two values, with all its numbers moved, from which the settings that it reaches are found."""
    found: dict[str, list[Any]] = {}
    for side in (-1.0, 1.0):
        moved = [min(max(each.value + 0.01 * side * each.scale, each.low), each.high) for each in numbers]
        for target, value in put_all(numbers, moved).items():
            found.setdefault(target, []).append(value)
    return found
