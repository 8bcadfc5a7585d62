"""What of a graph runs, in which order, and why the rest does not.

Which edges are held was decided on the whole graph, so what is left computes the same values as the whole.
"""

from collections.abc import Iterator

from palpate.engine.faults import GraphError
from palpate.engine.graph import Edge, Graph
from palpate.engine.plan import Plan
from palpate.launch.load.classes import body
from palpate.launch.load.demand import missing_senders, running_nodes, skipped_nodes
from palpate.launch.load.effects import trimmed
from palpate.nodes.base import inputs


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
        waiting = running - done
        name = next(n for n in left if all(e.loop or e.producer not in waiting for e in graph.nodes[n].edges))
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
