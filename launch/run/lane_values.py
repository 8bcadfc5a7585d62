"""Prepares lanes of one graph that differ in the values of paths."""

import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import msgspec
import numpy as np

from palpate.engine.faults import GraphError, Location
from palpate.launch.load.dependencies import content, files_of, texts
from palpate.launch.load.files import Override
from palpate.launch.load.graph import notes_with
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.load.values.source import YamlSource
from palpate.launch.run.lanes import Prepared, prepare
from palpate.messages.record import layout
from palpate.nodes.base import plain
from palpate.physics.errors import ArgumentError, PalpateError

KNOWN = 256  # Maximum number of loaded graphs that a `Preparation` keeps


Values = Sequence[Any] | np.ndarray
"""The value of a path in each lane; an array of numbers stays one, because it takes less memory than objects."""


def value_of(values: Values, place: int) -> Any:
    """Return the value of this lane as plain data."""
    return plain(values[place])


def digest_values(values: Values) -> list[Any]:
    """Return plain data that identifies the values."""
    if isinstance(values, np.ndarray):
        return [values.dtype.str, values.shape, hashlib.sha256(np.ascontiguousarray(values).data).hexdigest()]
    seen = hashlib.sha256()
    for one in values:
        seen.update(f"{one!r},".encode())
    files = [(name, content(name)) for name in sorted(set(texts(values)))]
    return [len(values), seen.hexdigest(), [each for each in files if each[1]]]


def extremes(values: Values) -> tuple[Any, ...]:
    """The least and the greatest of the values of a path, and 0 if it is one of the values; () unless all are finite
    floats. Of lists of as many floats the lists of the least and of the greatest numbers."""
    if not isinstance(values, np.ndarray) and _are_lists(values):
        each = np.array(values)
        zero = (each == 0.0).any(axis=0) & (each != 0.0).any(axis=0)  # a number that may switch an effect on
        return () if zero.any() else (each.min(axis=0).tolist(), each.max(axis=0).tolist())
    if isinstance(values, np.ndarray):
        if values.dtype.kind != "f" or values.ndim != 1 or not np.isfinite(values).all():
            return ()
        return tuple({float(values.min()), float(values.max())} | ({0.0} if (values == 0.0).any() else set()))
    if not all(type(value) is float and math.isfinite(value) for value in values):
        return ()
    return tuple({min(values), max(values)} | {0.0} & set(values))


def _are_lists(values: Sequence[Any]) -> bool:
    """Whether all values are lists of the same number of finite floats, and not empty."""
    if not len(values) or not isinstance(values[0], list) or not values[0]:
        return False
    return all(
        isinstance(value, list) and len(value) == len(values[0])
        and all(type(number) is float and math.isfinite(number) for number in value)
        for value in values
    )  # fmt: skip


class Preparation:
    """Prepares runs of one graph that differ in the values of paths.

    load      prepare the run with these values by path; GraphError, ArgumentError: it is invalid
    extremes  by path, see `extremes`

    A graph takes about 10 ms to load. If the extreme values of a path appear unchanged in settings of nodes, its other
    values are written to these settings without loading the graph again; the nodes' constructors check them.
    """

    def __init__(self, load: Callable[[Mapping[str, Any]], Prepared], extremes: Mapping[str, tuple[Any, ...]]):
        self._load, self._extremes = load, {path: values for path, values in extremes.items() if values}
        self._known: dict[str, Prepared] = {}
        self._groups: dict[str, list[Any]] = {}
        """By the values of all other paths: the first values with them, and the settings that each path reaches."""

    def __call__(self, values: Mapping[str, Any]) -> Prepared:
        """The run with these values. GraphError, ArgumentError: it is invalid."""
        name = repr([value for path, value in values.items() if path not in self._extremes])
        group = self._groups.get(name)
        if group is None:
            loaded = self._load_once(values)
            self._groups[name] = [values, None]
            return loaded
        first, reached = group
        base = self._load_once(first)
        if reached is None:
            reached = group[1] = self._find_targets(first, base)
        one = self._load_once({path: first[path] if path in reached else value for path, value in values.items()})
        if one.structure != base.structure:
            return self._load_once(values)
        nodes = list(one.job.nodes)
        for path, places in reached.items():
            for place, name in places:
                settings = {**nodes[place].settings, name: values[path]}
                nodes[place] = msgspec.structs.replace(nodes[place], settings=settings)
        notes = notes_with(one.graph, {node.name: node.settings for node in nodes})
        return Prepared(one.graph, msgspec.structs.replace(one.job, nodes=tuple(nodes)), notes)

    def _load_once(self, values: Mapping[str, Any]) -> Prepared:
        key = repr(values)
        if key not in self._known:
            if len(self._known) >= KNOWN:
                self._known.clear()
                self._groups.clear()
            self._known[key] = self._load(values)
        return self._known[key]

    def _find_targets(self, first: Mapping[str, Any], base: Prepared) -> dict[str, set[tuple[int, str]]]:
        """For each path, the settings that equal its value. Paths that change anything else are left out."""
        reached: dict[str, set[tuple[int, str]]] = {}
        for path, values in self._extremes.items():
            try:
                others = [(self._load_once({**first, path: value}), value) for value in values]
            except PalpateError:
                continue
            targets = [_follows(base, other, first[path], value) for other, value in others]
            found = {setting for target in targets for setting in target or ()}
            if None not in targets and found.isdisjoint(set().union(*reached.values())):
                reached[path] = found
        return reached


def with_values(launch: LaunchFile, values: Mapping[str, Any], lane: int) -> LaunchFile:
    """The run of a lane with these values by path."""
    places = ((path, Location(f"lane {lane}, {path}")) for path in values)
    return launch.but(
        overrides=[Override(tuple(p.split(".")), YamlSource(values[p], {(): place})) for p, place in places]
    )


class LanePreparation:
    """Prepares lanes of a run by their number.

    first     values of lane 0 by path; all lanes have its rate and its kept fields
    extremes  by path, of the values of all lanes
    """

    def __init__(
        self,
        launch: LaunchFile,
        keep: Sequence[tuple[str, str]],
        first: Mapping[str, Any],
        extremes: Mapping[str, tuple[Any, ...]],
    ) -> None:
        self._launch, self._keep, self._lane, self._values = launch, keep, 0, first
        self._begin, self._over = 0, dict[str, Values]()
        self._prepare = Preparation(self._load, extremes)

    def give(self, begin: int, over: Mapping[str, Values]) -> None:
        """Set the values of lanes from this number on, by path one value for each lane."""
        self._begin, self._over = begin, dict(over)

    @cached_property
    def first(self) -> Prepared:
        """Prepare lane 0. GraphError, ArgumentError: it is invalid."""
        return self._prepare_lane(0, self._values)

    def __call__(self, lane: int) -> Prepared:
        """Prepare a lane. GraphError, ArgumentError: it is invalid; the text names the lane."""
        values = {path: value_of(given, lane - self._begin) for path, given in self._over.items()}
        if not lane:
            return self.first
        one = self._prepare_lane(lane, values)
        if one.graph is not self.first.graph and self._forms(one) != self._forms(self.first):
            raise ArgumentError(
                f"lane {lane} ({describe_values(values)}): found another rate, or other types of the kept fields, than "
                f"in lane 0 ({describe_values(self._values)}); make an ensemble of each kind"
            )
        return replace(one, graph=self.first.graph)  # thousands of other graphs would take much memory

    def _forms(self, one: Prepared) -> list[Any]:
        """Return the rate and the layout of the kept fields, which must be the same in all lanes."""
        return [one.job.rate, *(layout(one.graph.streams[stream])[name] for stream, name in self._keep)]

    def _prepare_lane(self, lane: int, values: Mapping[str, Any]) -> Prepared:
        self._lane = lane  # `_load` names it in faults of a value, but not in what a value does to a node
        try:
            return self._prepare(values)
        except GraphError as error:
            if not values or all(str(fault.place).startswith("lane ") for fault in error.faults):
                raise
            raise GraphError(replace(fault, text=f"lane {lane}: {fault.text}") for fault in error.faults) from None
        except ArgumentError as error:
            raise (ArgumentError(f"lane {lane} ({describe_values(values)}): {error}") if values else error) from None

    def _load(self, values: Mapping[str, Any]) -> Prepared:
        return prepare(with_values(self._launch, values, self._lane), self._keep)


def describe_values(values: Mapping[str, Any]) -> str:
    """The settings of a lane that differ from the graph, as text."""
    return ", ".join(f"{path}={value}" for path, value in values.items()) or "the settings of the graph"


def identity(one: Prepared) -> list[Any]:
    """Everything that determines the results of a lane, as plain data."""
    return [msgspec.to_builtins(one.job, enc_hook=str), sorted(files_of(one.graph))]


def _follows(base: Prepared, other: Prepared, usual: Any, value: Any) -> set[tuple[int, str]] | None:
    """The settings (index of the node, name) that equal `usual` in `base` and `value` in `other`; None if the two
    differ in anything else."""
    if other.structure != base.structure:
        return None
    found = set()
    for place, (before, after) in enumerate(zip(base.job.nodes, other.job.nodes, strict=True)):
        for name in before.settings.keys() | after.settings.keys():
            if before.settings.get(name) != after.settings.get(name):
                if (before.settings.get(name), after.settings.get(name)) != (usual, value):
                    return None
                found.add((place, name))
    return found
