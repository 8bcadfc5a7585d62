"""Checks of a study before anything runs, and the units of its varied settings."""

from collections.abc import Mapping, Sequence
from itertools import islice, product
from typing import Any

import numpy as np

from palpate.engine.faults import Fault, GraphError
from palpate.engine.graph import Graph
from palpate.launch.load.launchfile import LaunchFile
from palpate.nodes.base import settings
from palpate.physics.errors import ArgumentError
from palpate.studies.sweeps.axes import DESIGNS, Axis, Space
from palpate.studies.sweeps.point import overrides
from palpate.studies.sweeps.sensitivity import METHODS
from palpate.units.quantity import UnitError, convert, parse, split

TRIED = 64  # Maximum number of combinations of bodies, motions and files that are loaded before anything runs
DRAWS = 8  # Maximum number of points that are tried until one loads
SEVERAL = 8  # Maximum number of values of a path that are tried for its unit


def space(axes: list[Axis], samples: int, design: str, seed: int, sensitivity: str | None) -> Space:
    """All points of the axes. ArgumentError: a repeated path, an unknown method or design, samples without a
    distribution."""
    drawn = [one for one in axes if one.law is not None]
    paths = [path for one in axes for path in one.paths]
    twice = {path for path in paths if paths.count(path) > 1}
    if twice:
        raise ArgumentError(f"over: {min(twice)} stands twice, expected each path once")
    if sensitivity is not None:
        if sensitivity not in METHODS:
            raise ArgumentError(f"sensitivity: found {sensitivity!r}, expected {' or '.join(METHODS)}")
        if not drawn:
            raise ArgumentError("sensitivity: no distribution in `over`, expected such as {uniform: [low, high]}")
        design = f"sensitivity {sensitivity}"
    elif design not in DESIGNS:
        raise ArgumentError(f"design: found {design!r}, expected {', '.join(DESIGNS)}")
    if bool(drawn) != bool(samples) or not isinstance(samples, int) or samples < 0:
        why = f"over has {len(drawn)} distributions, expected {'samples from 1' if drawn else 'no samples'}"
        raise ArgumentError(f"samples: found {samples!r}; {why}")
    return Space(tuple(axes), samples, design, seed)


def path(name: str, base: Graph) -> str:
    """Paths as for `--set`, completed: without `scene.`, they mean the scene unless a node has the same name."""

    def full(path: str) -> str:
        head = path.partition(".")[0]
        return f"scene.{path}" if head in base.scene and head not in base.nodes else path

    return ", ".join(full(part.strip()) for part in str(name).split(","))


def check(launch: LaunchFile, base: Graph, space: Space) -> None:
    """Check that the points can run. GraphError, ArgumentError: they cannot, or a varied path does not exist."""
    if launch.duration is None:
        raise ArgumentError(f"{launch.graph.stem}: the graph has no duration; give one: duration=2.0, or '2 s'")
    devices = [name for name, spec in base.nodes.items() if spec.cls.hardware]
    if launch.clock == "real" or devices:
        what = f"{devices[0]!r} drives a device" if devices else "clock: real"
        raise ArgumentError(f"{launch.graph.stem}: a study needs simulated time, but {what}")
    for path in space.paths:
        if len(path.split(".")) < 2 and path != "rate":
            raise ArgumentError(f"over {path}: expected a setting, such as {path}.stiffness, or scene.<path>")
    choices, units = [], list[tuple[str, str]]()
    for one in space.axes:
        if one.law is not None or all(isinstance(v, int | float) for row in one.values for v in row):
            units += [(one.paths[0], split(text)[1]) for text in one.texts[:1]]
        else:
            choices.append([dict(zip(one.paths, row, strict=True)) for row in one.values])
    for combination in islice(product(*choices), TRIED):
        values = find_loadable(launch, space, {path: value for part in combination for path, value in part.items()})
        for path, unit in units if values is not None else ():
            assert values is not None
            same = f"{values[path] / float(parse(unit).factor)!r} {unit}" if unit else str(values[path])
            launch.but(overrides=overrides({**values, path: same})).load()


def find_loadable(launch: LaunchFile, space: Space, fixed: Mapping[str, Any] | None = None) -> dict[str, Any] | None:
    """Values of a point that loads, with some values `fixed`.

    None: no tried point loads, each for a different reason. The values are then out of range, and each point becomes a
    row with its error. GraphError: faults that do not depend on the values.
    """
    common, faults = set[Fault](), list[Fault]()
    for number in range(min(DRAWS, max(space.shape, default=1))):
        each = [number % count for count in space.shape]  # each axis has another value in each try
        values = space.point(int(np.ravel_multi_index(each, space.shape)))[0] | dict(fixed or {})
        try:
            launch.but(overrides=overrides(values)).load()
            return values
        except GraphError as error:
            common = common & set(error.faults) if number else set(error.faults)
            faults = [fault for fault in error.faults if fault in common]
            if number and faults:
                break
    if faults:
        raise GraphError(faults)
    return None


def seconds(name: str, given: float | str | None) -> float | None:
    """A time [s] from 1e-9 to 1e9, given as a number or with a unit. ArgumentError: it is neither or out of range."""
    try:
        length = None if given is None else convert(str(given), "s")
    except UnitError as error:
        raise ArgumentError(f"{name}: {error}") from None
    if length is not None and not 1e-9 <= length <= 1e9:
        raise ArgumentError(f"{name}: found {given!r}, expected a time from 1e-9 to 1e9 s")
    return length


def units(launch: LaunchFile, space: Space) -> dict[str, str]:
    """Unit of each path with numbers. GraphError: the graph has changed and no longer loads.

    A path that changes no setting, or only together with other paths, has no unit.
    """
    first, found = find_loadable(launch, space), dict[str, str]()
    if first is None:
        return found
    base = launch.but(overrides=overrides(first)).load()
    for one in space.axes:
        for k, name in enumerate(one.paths):
            values = one.law.ppf([0.4, 0.6]).tolist() if one.law is not None else [row[k] for row in one.values]
            if not all(type(value) in (int, float) for value in values) or len(set(values)) == 1:
                continue
            if unit := "Hz" if name == "rate" else _unit(launch, base, first, name, values):
                found[name] = unit
    return found


def _unit(launch: LaunchFile, base: Graph, first: Mapping[str, Any], name: str, values: Sequence[float]) -> str | None:
    """Unit of the first setting that depends on a path; `base` is the graph with the values `first`."""
    others = [value for value in dict.fromkeys(values) if value != first[name]]
    tried = [{name: value} for value in others[:: min(-1, -len(others) // SEVERAL)]]
    fixed = {path: value for path, value in first.items() if path != name}
    for change in [*tried, {}]:  # {}: the graph's value
        try:
            after = launch.but(overrides=overrides(fixed | change)).load()
        except GraphError:  # a point that fails and gets an error in its row, or a value that is only valid with others
            continue
        for node, spec in base.nodes.items():
            there = after.nodes[node].settings if node in after.nodes else {}
            for key, value in spec.settings.items():
                if value != there.get(key):
                    return settings(spec.cls)[key].unit
    return None
