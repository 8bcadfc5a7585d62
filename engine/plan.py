"""What of a graph runs: the plan that every way of running follows, and its form in a recording."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from palpate.engine.faults import Fault, GraphError, Location, short
from palpate.engine.graph import Edge, EffectChoice, Graph, NodeSpec
from palpate.engine.imports import full_name, load_class
from palpate.nodes.base import Node


@dataclass
class Plan:
    """The part of a graph that runs.

    order      running nodes, each after the senders of its direct edges
    skipped    the others and the reason
    edges      connected inputs of each running node, in port order
    wanted     body fields of each stream that somebody reads
    observers  running loggers and viewers and the streams that they hear
    """

    graph: Graph
    order: list[str]
    skipped: dict[str, str]
    edges: dict[str, tuple[Edge, ...]]
    wanted: dict[str, frozenset[str]]
    observers: dict[str, tuple[str, ...]]

    def fields(self, name: str) -> frozenset[str]:
        """Names of the output fields of a running node that somebody reads."""
        return frozenset().union(*(self.wanted[s] for s in self.graph.nodes[name].streams))

    def make(self, name: str) -> Node:
        """A new node of the plan with its settings and `wanted`, not yet started."""
        spec = self.graph.nodes[name]
        node = spec.cls(**spec.settings)
        if name in self.edges:
            node.wanted = self.fields(name)
        return node

    def to_spec(self) -> dict[str, Any]:
        """The plan as data that JSON can hold."""
        graph = self.graph
        return {
            "path": short(str(graph.path)),
            "rate": graph.rate,
            "scene": graph.scene,
            "source": graph.source,
            "streams": None if graph.wanted is None else list(graph.wanted),
            "effects": {name: [choice.on, *_spot(choice.place)] for name, choice in graph.effects.items()},
            "nodes": [_node_spec(node) for node in graph.nodes.values()],
            "order": self.order,
            "skipped": self.skipped,
            "edges": {name: _edge_specs(edges) for name, edges in self.edges.items()},
            "wanted": {stream: sorted(names) for stream, names in self.wanted.items()},
            "observers": {name: list(streams) for name, streams in self.observers.items()},
        }

    @classmethod
    def from_spec(cls, spec: dict[str, Any], load: Callable[[str], Any] = load_class) -> Plan:
        """The plan that `to_spec` wrote; `load` gives a class by its full name. GraphError: one cannot be imported."""
        nodes = {}
        faults = []
        for item in spec["nodes"]:
            try:
                nodes[item["name"]] = _node(item, load)
            except (ImportError, AttributeError) as error:
                faults.append(Fault(f"class {item['class']!r} cannot be imported: {error}", node=item["name"]))
        if faults:
            raise GraphError(faults)
        wanted = None if spec["streams"] is None else tuple(spec["streams"])
        said = {name: EffectChoice(on, Location(*spot)) for name, (on, *spot) in spec.get("effects", {}).items()}
        graph = Graph(Path(spec["path"]), spec["rate"], spec["scene"], nodes, wanted, spec.get("source", {}), said)
        return cls(
            graph,
            list(spec["order"]),
            dict(spec["skipped"]),
            {name: _edges(edges) for name, edges in spec["edges"].items()},
            {stream: frozenset(names) for stream, names in spec["wanted"].items()},
            {name: tuple(streams) for name, streams in spec["observers"].items()},
        )


def _node_spec(node: NodeSpec) -> dict[str, Any]:
    return {
        "name": node.name,
        "use": node.use,
        "class": full_name(node.cls),
        "settings": node.settings,
        "every": node.every,
        "restart": node.restart,
        "when": node.when,
        "off": node.off,
        "edges": _edge_specs(node.edges),
        "listen": None if node.listen is None else list(node.listen),
        "place": _spot(node.place),
    }


def _spot(place: Location) -> list[Any]:
    return [short(place.file), place.line, place.column]


def _node(spec: dict[str, Any], load: Callable[[str], Any]) -> NodeSpec:
    return NodeSpec(
        name=spec["name"],
        use=spec["use"],
        cls=load(spec["class"]),
        settings=dict(spec["settings"]),
        every=spec["every"],
        restart=spec["restart"],
        when=spec["when"],
        off=spec["off"],
        edges=_edges(spec["edges"]),
        listen=None if spec["listen"] is None else tuple(spec["listen"]),
        place=Location(*spec["place"]),
    )


def _edge_specs(edges: tuple[Edge, ...]) -> list[dict[str, Any]]:
    return [{"port": e.port, "producer": e.producer, "stream": e.stream, "loop": e.loop} for e in edges]


def _edges(specs: list[dict[str, Any]]) -> tuple[Edge, ...]:
    return tuple(Edge(s["port"], s["producer"], s["stream"], s["loop"]) for s in specs)
