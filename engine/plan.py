"""What of a graph runs, in which order, and why the rest does not.

Which edges are held was decided on the whole graph, so what is left computes the same values as the whole.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from palpate.engine.faults import Fault, GraphError, Place, short
from palpate.engine.imports import full_name, load_class
from palpate.launch.load.classes import body
from palpate.launch.load.demand import missing_senders, running_nodes, skipped_nodes
from palpate.launch.load.effects import Choice, trimmed
from palpate.launch.load.graph import Graph, NodeSpec
from palpate.launch.load.wiring import Edge
from palpate.nodes.base import Node, inputs


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
        said = {name: Choice(on, Place(*spot)) for name, (on, *spot) in spec.get("effects", {}).items()}
        graph = Graph(Path(spec["path"]), spec["rate"], spec["scene"], nodes, wanted, spec.get("source", {}), said)
        return cls(
            graph,
            list(spec["order"]),
            dict(spec["skipped"]),
            {name: _edges(edges) for name, edges in spec["edges"].items()},
            {stream: frozenset(names) for stream, names in spec["wanted"].items()},
            {name: tuple(streams) for name, streams in spec["observers"].items()},
        )


def plan(graph: Graph) -> Plan:
    """What of a graph runs. GraphError: a running node needs the message of one that does not."""
    faults = missing_senders(graph)
    if faults:
        raise GraphError(faults)
    running = running_nodes(graph)
    edges = {
        name: tuple(e for e in graph.nodes[name].edges if e.producer in running) for name in _order(graph, running)
    }
    streams = [s for name in edges for s in graph.nodes[name].streams]
    observers = {
        spec.name: tuple(s for s in streams if spec.listen is None or s in spec.listen)
        for spec in graph.nodes.values()
        if spec.observer and spec.off is None
    }
    return Plan(graph, list(edges), skipped_nodes(graph, running), edges, _wanted(graph, edges, streams), observers)


def _order(graph: Graph, running: set[str]) -> Iterator[str]:
    """Running nodes, each after the senders of its direct edges; file order where there is a choice."""
    left = [name for name in graph.nodes if name in running and not graph.nodes[name].observer]
    done: set[str] = set()
    while left:
        ready = (
            n
            for n in left
            if all(e.loop or e.producer not in running or e.producer in done for e in graph.nodes[n].edges)
        )
        name = next(ready)
        left.remove(name)
        done.add(name)
        yield name


def _wanted(graph: Graph, edges: dict[str, tuple[Edge, ...]], streams: list[str]) -> dict[str, frozenset[str]]:
    """Body fields of each stream that somebody reads, or that an effect asks for.

    A stream that is wanted by name, or that observers alone read, is wanted whole. Of others an observer gets what is
    computed for their readers, and the `fields:` that it asks for.
    """
    kinds = graph.streams
    fields: dict[str, frozenset[str]] = dict.fromkeys(streams, frozenset())
    for name, own in edges.items():
        ports = {p.name: p for p in inputs(graph.nodes[name].cls)}
        for edge in own:
            fields[edge.stream] |= ports[edge.port].wants & body(kinds[edge.stream])
    whole, extra = set(graph.wanted or ()), dict.fromkeys(streams, frozenset[str]())
    for spec in graph.nodes.values():
        if spec.observer and spec.off is None:
            heard = streams if spec.listen is None and graph.wanted is None else spec.listen or ()
            asked = spec.settings.get("fields", "all")
            for stream in heard:
                if asked == "all" or not fields[stream]:
                    whole.add(stream)
                else:
                    extra[stream] |= body(kinds[stream]).intersection(asked)
    return trimmed(
        {s: body(kinds[s]) if s in whole else read | extra[s] for s, read in fields.items()},
        graph.effects,
        [graph.nodes[name] for name in edges],
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


def _spot(place: Place) -> list[Any]:
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
        place=Place(*spec["place"]),
    )


def _edge_specs(edges: tuple[Edge, ...]) -> list[dict[str, Any]]:
    return [{"port": e.port, "producer": e.producer, "stream": e.stream, "loop": e.loop} for e in edges]


def _edges(specs: list[dict[str, Any]]) -> tuple[Edge, ...]:
    return tuple(Edge(s["port"], s["producer"], s["stream"], s["loop"]) for s in specs)
