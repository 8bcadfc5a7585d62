"""Units of the varied settings of a study."""

from collections.abc import Mapping, Sequence
from typing import Any

from palpate.engine.faults import GraphError
from palpate.engine.graph import Graph
from palpate.launch.load.launchfile import LaunchFile
from palpate.nodes.base import settings
from palpate.studies.sweeps.axes import Space
from palpate.studies.sweeps.checks import accepted
from palpate.studies.sweeps.point import overrides

SEVERAL = 8  # values of a path that are tried for its unit


def units(launch: LaunchFile, space: Space) -> dict[str, str]:
    """Unit of each path with numbers. GraphError: the graph has changed and no longer loads.

    A path that changes no setting, or only together with other paths, has no unit.
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
