"""Which nodes somebody wants.

A node runs if its `when:` holds and somebody wants its output: the walk goes back from the sources and sinks, from what
observers listen to and from the streams in `wanted`. An observer of all streams wants them all, unless
`wanted` is given.
"""

from __future__ import annotations

from dataclasses import replace

from palpate.engine.faults import Fault
from palpate.engine.graph import Graph
from palpate.nodes.base import inputs


def missing_senders(graph: Graph) -> list[Fault]:
    """Faults of running nodes whose required input comes from a node whose condition does not hold."""
    faults = []
    running = running_nodes(graph)
    for name, spec in graph.nodes.items():
        if name not in running:
            continue
        ports = {p.name: (i, p) for i, p in enumerate(inputs(spec.cls))} if not spec.observer else {}
        for edge in spec.edges:
            index, port = ports[edge.port]
            driving = index == 0 and not spec.cls.paced
            if edge.producer in running or (port.optional and not driving):
                continue
            if driving and port.optional and any(e.producer in running for e in spec.edges if e.port == port.name):
                continue
            sender = graph.nodes[edge.producer]
            need = "drives this node" if driving else "is not optional"
            without = f"{port.name}: {replace(port, optional=True).expects}"
            cure = f"Give node {name!r} the condition `when: {sender.when}` as well"
            cure += "." if driving else f", or write `{without}` in its class."
            text = f"{need}, but its sender {sender.name!r} does not run: {sender.off}"
            faults.append(Fault(text, cure, spec.place, node=name, port=edge.port))
    return faults


def running_nodes(graph: Graph) -> set[str]:
    """Names of the running nodes, observers included."""
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


def skipped_nodes(graph: Graph, running: set[str]) -> dict[str, str]:
    """The nodes that do not run and the reason."""
    reasons = {}
    for name, spec in graph.nodes.items():
        if name in running:
            continue
        if spec.off is not None:
            reasons[name] = spec.off
            continue
        readers = [n for n, other in graph.nodes.items() if any(e.producer == name for e in other.edges)]
        reasons[name] = f"output unused: {', '.join(spec.streams)}"
        if readers:
            reasons[name] += (
                f"; read only by {', '.join(readers)}, which {'does' if len(readers) == 1 else 'do'} not run"
            )
    return reasons
