"""The units of what a study varies."""

from collections.abc import Mapping, Sequence
from typing import Any

from palpate.engine.faults import GraphError
from palpate.engine.graph import Graph
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.load.values.followers import followers, unit_of
from palpate.studies.sweeps.axes import Space
from palpate.studies.sweeps.checks import accepted
from palpate.studies.sweeps.point import overrides

SEVERAL = 8  # values of a path that are tried for its unit


def units(launch: LaunchFile, space: Space) -> dict[str, str]:
    """The unit of each path whose values are numbers. GraphError: the graph is no longer what it was.

    Without a unit is what changes no setting, and what changes only together with other paths.
    """
    first, found = accepted(launch, space), dict[str, str]()
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
    """The unit of the first setting that follows a path; `base` is the graph at the values `first`."""
    others = [value for value in dict.fromkeys(values) if value != first[name]]
    tried = [{name: value} for value in others[:: min(-1, -len(others) // SEVERAL)]]
    fixed = {path: value for path, value in first.items() if path != name}
    for change in [*tried, {}]:  # at last the graph's value
        try:
            after = launch.but(overrides=overrides(fixed | change)).load()
        except GraphError:  # a point that fails, which its row tells; or a value that only goes with others
            continue
        if follower := next(iter(followers(base, after)), None):
            return unit_of(base, *follower)
    return None
