"""The plan: the part of a graph that runs, for runs, replays and tests, and its form in a recording."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from palpate.engine.faults import Fault, GraphError, Location, short
from palpate.engine.graph import Edge, EffectChoice, Graph, NodeSpec
from palpate.engine.imports import full_name, load_class
from palpate.nodes.base import Node


@dataclass
class Plan:
    """The part of a graph that runs.

    order      running nodes, each after the senders of its direct edges
    skipped    the other nodes and the reason
    edges      connected inputs of each running node, in port order
    wanted     fields of each stream that a node reads
    observers  running loggers and viewers and their streams
    """

    graph: Graph
    order: list[str]
    skipped: dict[str, str]
    edges: dict[str, tuple[Edge, ...]]
    wanted: dict[str, frozenset[str]]
    observers: dict[str, tuple[str, ...]]

    def fields(self, name: str) -> frozenset[str]:
        """Names of the output fields of a running node that other nodes read."""
        return frozenset().union(*(self.wanted[s] for s in self.graph.nodes[name].streams))

    def make(self, name: str) -> Node:
        """Create a node of the plan with its settings and `wanted`, without starting it."""
        spec = self.graph.nodes[name]
        node = spec.cls(**spec.settings)
        if name in self.edges:
            node.wanted = self.fields(name)
        return node

    def to_spec(self) -> dict[str, Any]:
        """The plan as data for JSON."""
        graph = self.graph
        return {
            "path": short(str(graph.path)),
            "rate": graph.rate,
            "scene": graph.scene,
            "source": graph.source,
            "streams": None if graph.wanted is None else list(graph.wanted),
            "effects": {name: [choice.on, *_spot(choice.place)] for name, choice in graph.effects.items()},
            "nodes": [_node_form(node) for node in graph.nodes.values()],
            "order": self.order,
            "skipped": self.skipped,
            "edges": msgspec.to_builtins(self.edges),
            "wanted": {stream: sorted(names) for stream, names in self.wanted.items()},
            "observers": {name: list(streams) for name, streams in self.observers.items()},
        }

    @classmethod
    def from_spec(cls, spec: dict[str, Any], load: Callable[[str, type[Node]], type[Node]] = load_class) -> Plan:
        """The plan written by `to_spec`; `load` returns the class of a full name, a subclass of Node. GraphError: an
        import failed."""
        nodes = {}
        faults = []
        for form in msgspec.convert(spec["nodes"], list[_NodeForm]):
            try:
                nodes[form.name] = _node(form, load)
            except (ImportError, AttributeError) as error:
                faults.append(Fault(f"class {form.cls!r} cannot be imported: {error}", node=form.name))
        if faults:
            raise GraphError(faults)
        wanted = None if spec["streams"] is None else tuple(spec["streams"])
        effects = {name: EffectChoice(on, Location(*spot)) for name, (on, *spot) in spec.get("effects", {}).items()}
        graph = Graph(Path(spec["path"]), spec["rate"], spec["scene"], nodes, wanted, spec.get("source", {}), effects)
        return cls(
            graph,
            list(spec["order"]),
            dict(spec["skipped"]),
            msgspec.convert(spec["edges"], dict[str, tuple[Edge, ...]]),
            {stream: frozenset(names) for stream, names in spec["wanted"].items()},
            {name: tuple(streams) for name, streams in spec["observers"].items()},
        )


class _NodeForm(msgspec.Struct, rename={"cls": "class"}):
    """A `NodeSpec` for JSON: with the full name of its class, and file, line and column."""

    name: str
    use: str
    cls: str
    settings: dict[str, Any]
    every: int
    restart: bool
    when: str | None
    off: str | None
    edges: tuple[Edge, ...]
    listen: tuple[str, ...] | None
    place: tuple[str, int, int]


def _node_form(node: NodeSpec) -> dict[str, Any]:
    form = {key: getattr(node, key) for key in _NodeForm.__struct_fields__}
    return msgspec.to_builtins(_NodeForm(**form | {"cls": full_name(node.cls), "place": _spot(node.place)}))


def _node(form: _NodeForm, load: Callable[[str, type[Node]], type[Node]]) -> NodeSpec:
    given = msgspec.structs.asdict(form)
    return NodeSpec(**given | {"cls": load(form.cls, Node), "place": Location(*form.place)})


def _spot(place: Location) -> tuple[str, int, int]:
    return short(place.file), place.line, place.column


def force_path(plan: Plan) -> set[str]:
    """The nodes between the outputs and the inputs of the paced nodes, which determine the latency for the hand."""
    after: dict[str, set[str]] = {name: set() for name in plan.order}
    for name in plan.order:
        for edge in plan.edges[name]:
            after[edge.producer].add(name)
    before = {name: {edge.producer for edge in plan.edges[name]} for name in plan.order}
    paced = [name for name in plan.order if plan.graph.nodes[name].cls.paced]
    return _reach(paced, after) & _reach(paced, before) | set(paced)


def _reach(start: Iterable[str], neighbours: dict[str, set[str]]) -> set[str]:
    reached: set[str] = set()
    left = list(start)
    while left:
        for name in neighbours[left.pop()] - reached:
            reached.add(name)
            left.append(name)
    return reached
