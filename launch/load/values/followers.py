"""Which settings follow a value that is set from outside."""

from typing import Any

from palpate.engine.graph import Graph
from palpate.nodes.base import settings


def followers(before: Graph, after: Graph) -> dict[tuple[str, str], tuple[Any, Any]]:
    """The settings, by node and name, that differ between two loads of one graph: what each was, and is."""
    found = {}
    for name, spec in before.nodes.items():
        other = after.nodes[name].settings if name in after.nodes else {}
        for key, value in spec.settings.items():
            if value != other.get(key):
                found[name, key] = (value, other.get(key))
    return found


def unit_of(graph: Graph, node: str, key: str) -> str:
    """The unit of a node's setting."""
    return settings(graph.nodes[node].cls)[key].unit
