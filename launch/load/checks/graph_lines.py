"""The lines of a graph file before their inputs are resolved, for keys of the scene that add nodes to them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from palpate.engine.faults import Location
from palpate.launch.load.classes import ClassError, find_class
from palpate.launch.load.values.source import YamlSource
from palpate.messages import Message
from palpate.nodes.base import Node, Observer, inputs, outputs


@dataclass
class Line:
    """A node of the graph file: class, and the senders of each input as written."""

    name: str
    cls: type[Node]
    data: dict[str, Any]

    def senders(self, kind: type[Message]) -> list[str]:
        """Names of the senders at the inputs of this type."""
        return [node for port in self.ports(kind) for node in names_in(self.given(port))]

    def ports(self, kind: type[Message]) -> list[str]:
        return [port.name for port in inputs(self.cls) if issubclass(port.type, kind)]

    def given(self, port: str) -> Any:
        inside = self.data.get("in")
        return inside.get(port) if isinstance(inside, dict) else None

    def sends(self, *kinds: type[Message]) -> bool:
        return bool(set(outputs(self.cls)) & set(kinds))


def lines_of(nodes: Mapping[str, Any]) -> Iterator[Line]:
    """The nodes whose classes are found; the loader reports the others."""
    for name, data in nodes.items():
        if not (isinstance(data, dict) and isinstance(data.get("use"), str)):
            continue
        try:
            cls = find_class(data["use"])
        except ClassError:
            continue
        if not issubclass(cls, Observer):
            yield Line(name, cls, data)


def names_in(value: Any) -> list[str]:
    """The nodes that are named as senders of an input."""
    several = value if isinstance(value, list) else [value]
    named = (one.get("from") if isinstance(one, dict) else one for one in several)
    return [name.partition(".")[0] for name in named if isinstance(name, str)]


def put_line(graph: YamlSource, name: str, line: dict[str, Any], place: Location) -> None:
    graph.put(("nodes", name), YamlSource(line, {(): place}))


def touches_itself(cls: type[Node]) -> bool:
    """Whether a contact of organs is that of an organ with itself (contact.Folds)."""
    return bool(getattr(cls, "of_one_body", False))
