"""The plan of a graph: which nodes run, in which order, and why the others do not.

A node runs if its `when:` is true and its output is needed: the search goes upstream from sources, sinks, streams that
observers read and streams in `wanted`. An observer of all streams needs them all, unless `wanted` is given. The held
edges were chosen on the whole graph, so the running part computes the same values as the whole graph.
"""

from collections.abc import Iterator
from dataclasses import replace
from heapq import heappop, heappush

from palpate.engine.faults import Fault, GraphError
from palpate.engine.graph import Edge, Graph, NodeSpec
from palpate.engine.plan import Plan
from palpate.launch.load.classes import body
from palpate.launch.load.effects import trim_fields
from palpate.nodes.base import SettingError, effects, inputs


def plan(graph: Graph) -> Plan:
    """The plan of a graph. GraphError: a running node needs the message of a node that does not run."""
    faults = missing_senders(graph)
    if faults:
        raise GraphError(faults)
    running = _running(graph)
    edges = {
        name: tuple(e for e in graph.nodes[name].edges if e.producer in running) for name in _order(graph, running)
    }
    streams = [s for name in edges for s in graph.nodes[name].streams]
    observed = {
        spec.name: set(streams if spec.listen is None else spec.listen)
        for spec in graph.nodes.values()
        if spec.observer and spec.off is None
    }
    observers = {name: tuple(s for s in streams if s in listen) for name, listen in observed.items()}
    return Plan(
        graph, list(edges), _skipped_nodes(graph, running), edges, _wanted_fields(graph, edges, streams), observers
    )


def check_stored(plan: Plan) -> None:
    """GraphError: a file that a running node loads at its start is missing."""
    faults = []
    for name in plan.order:
        spec = plan.graph.nodes[name]
        try:
            spec.cls(**spec.settings).check()
        except SettingError as error:
            faults.append(Fault(str(error), place=spec.place, node=name))
    if faults:
        raise GraphError(faults)


def _order(graph: Graph, running: set[str]) -> Iterator[str]:
    """Running nodes in topological order of their direct edges; otherwise in file order."""
    nodes = [name for name in graph.nodes if name in running and not graph.nodes[name].observer]
    place = {name: number for number, name in enumerate(nodes)}
    waits = {n: {e.producer for e in graph.nodes[n].edges if not e.loop and e.producer in place} for n in nodes}
    readers: dict[str, list[str]] = {name: [] for name in nodes}
    for name, senders in waits.items():
        for sender in senders:
            readers[sender].append(name)
    ready = [place[name] for name in nodes if not waits[name]]  # sorted, so it is a heap
    while ready:
        name = nodes[heappop(ready)]
        yield name
        for reader in readers[name]:
            waits[reader].discard(name)
            if not waits[reader]:
                heappush(ready, place[reader])


def _wanted_fields(graph: Graph, edges: dict[str, tuple[Edge, ...]], streams: list[str]) -> dict[str, frozenset[str]]:
    """Body fields of each stream that a node reads or an effect needs.

    All fields of a stream are computed if it is wanted by name or read only by observers. Of other streams an observer
    gets the fields computed for other readers and those in its `fields:`.
    """
    kinds = graph.streams
    fields: dict[str, frozenset[str]] = dict.fromkeys(streams, frozenset())
    for name, incoming in edges.items():
        ports = {p.name: p for p in inputs(graph.nodes[name].cls)}
        for edge in incoming:
            fields[edge.stream] |= ports[edge.port].wants & body(kinds[edge.stream])
    whole, extra = set(graph.wanted or ()), dict.fromkeys(streams, frozenset[str]())
    for spec in graph.nodes.values():
        if spec.observer and spec.off is None:
            recorded = streams if spec.listen is None and graph.wanted is None else spec.listen or ()
            asked = spec.settings.get("fields", "all")
            for stream in recorded:
                if asked == "all" or not fields[stream]:
                    whole.add(stream)
                else:
                    extra[stream] |= body(kinds[stream]).intersection(asked)
    return trim_fields(
        {s: body(kinds[s]) if s in whole else read | extra[s] for s, read in fields.items()},
        graph.effects,
        [graph.nodes[name] for name in edges],
    )


def missing_senders(graph: Graph) -> list[Fault]:
    """Faults of running nodes whose required input comes from a node whose condition is false."""
    faults = []
    running = _running(graph)
    for name, spec in graph.nodes.items():
        if name not in running:
            continue
        ports = {p.name: (i, p) for i, p in enumerate(inputs(spec.cls))} if not spec.observer else {}
        for edge in spec.edges:
            index, port = ports[edge.port]
            driving = index == 0 and not spec.cls.paced
            if edge.producer in running or (port.optional and not driving):
                continue
            if driving and port.optional and _has_sender(spec, port.name, running):
                continue
            sender = graph.nodes[edge.producer]
            if port.many and _is_effect(graph.nodes[edge.producer]) and _has_sender(spec, port.name, running):
                continue
            need = "drives this node" if driving else "is not optional"
            without = f"{port.name}: {replace(port, optional=True).expects}"
            cure = f"Give node {name!r} the condition `when: {sender.when}` as well"
            cure += "." if driving else f", or write `{without}` in its class."
            text = f"{need}, but its sender {sender.name!r} does not run: {sender.off}"
            faults.append(Fault(text, cure, spec.place, node=name, port=edge.port))
    return faults


def _has_sender(spec: NodeSpec, port: str, running: set[str]) -> bool:
    return any(edge.producer in running for edge in spec.edges if edge.port == port)


def _is_effect(sender: NodeSpec) -> bool:
    """Whether a node as a whole is an effect, so that a list of several senders does without it."""
    return any(effect.how == "node" for effect in effects(sender.cls))


def _running(graph: Graph) -> set[str]:
    may = {name: spec for name, spec in graph.nodes.items() if spec.off is None}
    queue = [name for name, spec in may.items() if spec.cls.paced or spec.cls.sink or spec.observer]
    listening = [spec for spec in may.values() if spec.observer]
    asked = set(graph.wanted or ()) | {s for spec in listening for s in spec.listen or ()}
    queue += [name for name, spec in may.items() if not asked.isdisjoint(spec.streams)]
    if graph.wanted is None and any(spec.listen is None for spec in listening):
        queue += may
    running: set[str] = set()
    while queue:
        name = queue.pop()
        if name in may and name not in running:
            running.add(name)
            queue += [e.producer for e in graph.nodes[name].edges]
    return running


def _skipped_nodes(graph: Graph, running: set[str]) -> dict[str, str]:
    reasons = {}
    read_by: dict[str, dict[str, None]] = {}
    for name, spec in graph.nodes.items():
        for edge in spec.edges:
            read_by.setdefault(edge.producer, {})[name] = None
    for name, spec in graph.nodes.items():
        if name in running:
            continue
        if spec.off is not None:
            reasons[name] = spec.off
            continue
        readers = list(read_by.get(name, ()))
        rest = "does not run" if len(readers) == 1 else "do not run"
        only = f"; read only by {', '.join(readers)}, which {rest}" if readers else ""
        reasons[name] = f"output unused: {', '.join(spec.streams)}{only}"
    return reasons
