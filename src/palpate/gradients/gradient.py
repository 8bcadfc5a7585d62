"""Derivatives of an ensemble's lanes: from parameters to lanes, and from their results to a Dataset."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from palpate.engine.graph import Graph
from palpate.engine.job import Job
from palpate.gradients.lanes import Differences, events_of, reduce, reduction_of
from palpate.gradients.parameters import Parameter, find_parameter, scales_of
from palpate.gradients.reach import Reach
from palpate.launch.load.checks.ideal import describe_jumps
from palpate.launch.run.lane_values import Values, value_of
from palpate.messages.record import layout
from palpate.physics.errors import ArgumentError

Function = Callable[[np.ndarray], Any] | None


class Gradient:
    """The lanes that the derivatives of the lanes of an ensemble need.

    graph      of the ensemble; `keep`: its fields, "stream.field"; `over`: its settings, `count` values each
    by         paths of the parameters
    job        what its first lane runs
    reductions, scale, tolerance  see `Ensemble.gradient`

    ArgumentError: one of them is not valid.
    """

    def __init__(
        self, graph: Graph, keep: Sequence[str], by: Sequence[str], over: Mapping[str, Values],
        count: int, job: Job, reductions: Mapping[str, Any], scale: Mapping[str, float] | None, tolerance: float,
    ) -> None:  # fmt: skip
        by = [by] if isinstance(by, str) else list(by)
        if not by or len(set(by)) < len(by):
            raise ArgumentError(f"by: found {by}, expected different settings, such as ['tissue.stiffness']")
        if not 0.0 < tolerance < 1.0:
            raise ArgumentError(f"tolerance: found {tolerance!r}, expected a number from 0 to 1")
        running = {node.name for node in job.nodes}
        scales = scales_of(scale, by)
        self.parameters = [find_parameter(graph, path, running, scales.get(path)) for path in by]
        self._places = {id(each): place for place, each in enumerate(self.parameters)}
        self._reductions = {name: reduction_of(name, given, keep) for name, given in reductions.items()}
        self._tolerance, self._fields, self._over, self._count = tolerance, list(keep), over, count
        self._jumps = describe_jumps(graph, [name for name in graph.nodes if name in running])
        known = {stream: kind for stream, kind in graph.streams.items() if _sends(graph, stream) in running}
        self._events = events_of(known)
        self.keep = [*keep, *(path for path in self._events if path not in keep)]
        for path in keep:
            stream, _, name = path.rpartition(".")
            kind = layout(graph.streams[stream])[name].base.kind
            if kind not in "f" and path not in {self._fields[place] for place, _ in self._reductions.values()}:
                raise ArgumentError(f"keep {path!r}: found a field without decimals, which has no derivative")
        self._work = [Differences(self.parameters, self._values(lane)) for lane in range(count)]
        self._reach = Reach(graph, self.parameters)
        if self._jumps:
            for work in self._work:
                work.rows = work.rows[:1]

    @property
    def lanes(self) -> int:
        """Number of lanes."""
        return sum(len(work.rows) for work in self._work)

    @property
    def scout(self) -> list[str]:
        """Fields of the lanes of the ensemble that `leave_out` needs; [] if it would leave out nothing."""
        return [] if self._jumps else self._reach.keep

    def leave_out(self, columns: Sequence[np.ndarray], errors: Sequence[str]) -> None:
        """Give no lanes to parameters that the touches cannot reach.

        columns  of the fields of `scout`, (lanes, rows, ...)
        """
        for lane, work in enumerate(self._work):
            if not errors[lane]:
                touch = {path: column[lane] for path, column in zip(self.scout, columns, strict=True)}
                without = frozenset(self._reach.unreached(touch))
                self._work[lane] = Differences(work.parameters, work.values, without=without)

    def take_back(self, columns: Sequence[np.ndarray], errors: Sequence[str]) -> bool:
        """Give lanes to all parameters again where one that was left out has an effect; whether one has.

        columns  of the kept fields, (lanes, rows, ...)
        """
        begin, found = 0, False
        for lane, work in enumerate(self._work):
            checks = [begin + number for number, row in enumerate(work.rows) if row.check]
            same = all(np.array_equal(column[begin], column[at], True) for column in columns for at in checks)
            if not same or any(errors[at] for at in checks):
                self._work[lane], found = Differences(work.parameters, work.values), True
            begin += len(work.rows)
        return found

    def _values(self, lane: int) -> list[float]:
        """The values of the parameters in a lane of the ensemble."""
        return [
            each.read(value_of(self._over[each.target], lane)) if each.target in self._over else each.value
            for each in self.parameters
        ]

    @property
    def over(self) -> dict[str, Any]:
        """The settings of all lanes by path."""
        targets: dict[str, list[Parameter]] = {}
        for each in self.parameters:
            targets.setdefault(each.target, []).append(each)
        rows = [(lane, work, row) for lane, work in enumerate(self._work) for row in work.rows]
        found: dict[str, Any] = {
            path: [value_of(values, lane) for lane, _, _ in rows] for path, values in self._over.items()
        }
        for target, several in targets.items():
            given, column = found.get(target), []
            base: list[Any] = []
            for number, (lane, work, row) in enumerate(rows):
                if lane == len(base):  # the values of this lane, once
                    value = None if given is None else given[number]
                    for each in several:
                        value = each.put(work.values[self._places[id(each)]], value)
                    base.append(value)
                value = base[lane]
                for each in several:
                    place = self._places[id(each)]
                    if row.parameter == place or (row.check and place in work.without):
                        value = each.put(work.value(row, place), value)
                column.append(value)
            found[target] = np.array(column) if not several[0].inside else column
        return found

    def dataset(
        self, columns: Sequence[np.ndarray], errors: Sequence[str], time: np.ndarray, units: Sequence[str]
    ) -> Any:
        """The derivatives as a Dataset, or as a dictionary of arrays without xarray.

        columns  of the fields in `keep`, (lanes, rows, ...);  errors  of the lanes;  units  of the kept fields
        """
        named = dict(zip(self.keep, columns, strict=True))
        wanted: dict[str, tuple[str, Function, str]] = {
            name: (self._fields[place], function, units[place]) for name, (place, function) in self._reductions.items()
        } or {name: (name, None, unit) for name, unit in zip(self._fields, units, strict=True)}
        data: dict[str, Any] = {}
        for name, (source, function, unit) in wanted.items():
            touches = list(self._touches(name, named, source, function, errors, time))
            values, derivative, error, reasons = (np.stack(each) for each in zip(*touches, strict=True))
            axes = [*([] if function else ["time"]), *["axis"] * (values.ndim - 1 - (function is None))]
            data[name] = ["lane", *axes], values, {"units": unit}
            data[f"{name}.derivative"] = ["lane", "parameter", *axes], derivative, {}
            data[f"{name}.error"] = ["lane", "parameter", *axes], error, {}
            data[f"{name}.reason"] = ["lane", "parameter"], reasons, {}
        try:
            import xarray
        except ImportError:
            return {**{name: values for name, (_, values, _) in data.items()}, "time": time}
        coordinates = {
            "lane": np.arange(self._count), "time": ("time", time, {"units": "s"}),
            "parameter": [each.path for each in self.parameters],
            "unit": ("parameter", [each.unit for each in self.parameters]),
            "value": (("lane", "parameter"), np.array([list(work.values) for work in self._work])),
        }  # fmt: skip
        return xarray.Dataset(data, coordinates)

    def _touches(
        self, name: str, named: Mapping[str, np.ndarray], source: str, function: Function, errors: Sequence[str],
        time: np.ndarray,
    ) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:  # fmt: skip
        """For each lane: values; derivatives, their errors and reasons by parameter."""
        begin = 0
        for work in self._work:
            part = slice(begin, begin + len(work.rows))
            begin = part.stop
            mine = named[source][part]
            events: dict[str, np.ndarray] = {}
            for path, what in self._events.items():
                events[what] = events.get(what, False) | (named[path][part] > 0)
            values, why = mine, events
            if function is not None:
                values, why = reduce(function, mine, name), {}
            found = [
                self._derive(work, place, values, why, errors[part], time) for place in range(len(self.parameters))
            ]
            derivative, error = np.stack([one[0] for one in found]), np.stack([one[1] for one in found])
            reasons = np.array([one[2] for one in found], dtype=object)
            if function is not None:
                values, derivative, error = values[:, 0], derivative[:, 0], error[:, 0]
            yield values[0], derivative, error, reasons

    def _derive(
        self, work: Differences, place: int, values: np.ndarray, events: Mapping[str, np.ndarray],
        errors: Sequence[str], time: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray, str]:  # fmt: skip
        """The derivative (n, ...) of values (lanes, n, ...) by one parameter, its error, and why some are NaN."""
        nothing = np.full(values.shape[1:], math.nan)
        if self._jumps:
            return nothing, nothing, self._jumps
        lanes = [0, *(number for number, row in enumerate(work.rows) if row.parameter == place)]
        if failed := [number for number in lanes if errors[number]]:
            at = work.value(work.rows[failed[0]], place)
            return nothing, nothing, f"the run at {self.parameters[place].path}={at:g} failed: {errors[failed[0]]}"
        found = work.derivative(values, place, self._tolerance)
        settled = np.asarray(found.settled.reshape(values.shape[1], -1).all(axis=1))
        if len(settled) == 1:
            reason = "" if settled.all() else f"the steps disagree by {float(found.error.max()):.3g}"
        else:
            reason = work.why(settled, place, events, time)
        return np.where(found.settled, found.value, math.nan), found.error, reason


def _sends(graph: Graph, stream: str) -> str:
    """The node that sends a stream."""
    return next(name for name, spec in graph.nodes.items() if stream in spec.streams)
