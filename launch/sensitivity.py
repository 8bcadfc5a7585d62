"""Which settings a parameter stands for, as `palpate.run(..., sensitivity=[...])` takes them: by loading the graph
again with another value of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from palpate.engine.faults import GraphError, choices
from palpate.engine.plan import Plan
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.load.values.followers import followers, unit_of
from palpate.launch.load.values.units import UnitError, parse, split
from palpate.physics.errors import ArgumentError
from palpate.records.sensitivity import Chain, Where

CHANGE = 1e-3  # [1] by which a parameter is changed to see what follows it


def resolved(launch: LaunchFile, names: Sequence[str]) -> tuple[Chain, list[Where]]:
    """The nodes that carry the contact's derivatives, and where each parameter enters them.

    ArgumentError: a graph or a parameter without derivatives; says which have them.
    """
    if isinstance(names, str) or not all(isinstance(name, str) for name in names):
        raise ArgumentError(f"sensitivity: found {names!r}, expected a list of parameters, ['tissue.stiffness']")
    if launch.clock == "real":
        raise ArgumentError("sensitivity: found clock: real, expected a run on simulated time")
    planned = launch.plan()
    chain = Chain.of(planned)
    found = [_where(launch, planned, name) for name in dict.fromkeys(names)]
    chain.check(found)
    return chain, found


def _where(launch: LaunchFile, planned: Plan, name: str) -> Where:
    value = _value(planned, name)
    new, other = value * (1.0 + CHANGE) or CHANGE, None
    for changed in (new, value * (1.0 - CHANGE)):
        try:
            other = launch.but(overrides=[f"{name}={changed!r}"]).plan()
            break
        except GraphError as error:  # perhaps beyond the setting's limit
            fault = error
    if other is None:
        raise ArgumentError(f"sensitivity {name!r}: cannot be changed by {CHANGE:.1%}: {fault}")
    moved = {spot: ends for spot, ends in followers(planned.graph, other.graph).items() if spot[0] in planned.order}
    for (node, key), ends in moved.items():
        if ends != (value, changed):
            raise ArgumentError(f"sensitivity {name!r}: {node}.{key} does not follow it one to one")
    reached = tuple(moved)
    unit = unit_of(planned.graph, *reached[0]) if reached else ""
    return Where(name, unit, reached)


def _value(planned: Plan, name: str) -> float:
    """The number [SI] of a parameter, a node's or the scene's."""
    graph, (head, *keys) = planned.graph, name.split(".")
    value: Any = graph.scene
    if head in graph.nodes:
        value = graph.nodes[head].settings
    elif head != "scene":
        keys = [head, *keys]
    for key in keys:
        known = value if isinstance(value, dict) else {}
        if key not in known:
            raise ArgumentError(f"sensitivity {name!r}: there is no {key!r}. {choices('Known', key, list(known))}")
        value = known[key]
    if isinstance(value, str):
        try:
            number, unit = split(value)
            return float(number * parse(unit).factor) if unit else float(number)
        except UnitError:
            pass
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ArgumentError(f"sensitivity {name!r}: found {value!r}, expected a parameter that is a number")
    return float(value)
