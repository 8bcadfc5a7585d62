"""Runs that record only their sources: their plan, and the reasons why a graph cannot be recorded like this."""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace

from palpate.engine.faults import Fault, GraphError
from palpate.engine.graph import Graph, NodeSpec
from palpate.engine.imports import full_name
from palpate.engine.plan import Plan
from palpate.launch.load.launchfile import SOURCES
from palpate.launch.load.plan import plan
from palpate.nodes.logger import Mcap


def record_sources(graph: Graph, clock: str) -> Plan:
    """The plan of a run whose logger records only the sources. On the simulated clock nothing is computed only for the
    recording. On the real clock all fields are computed: a node that computes less comes to rest earlier, which changes
    the ages of its messages.

    GraphError: nodes that cannot be recomputed, and why.
    """
    whole = plan(graph)
    spec = next(spec for spec in graph.nodes.values() if issubclass(spec.cls, Mcap) and spec.off is None)
    faults = list(_faults(graph, whole, clock, spec))
    if faults:
        raise GraphError(faults)
    sources = [s for name in whole.order if _is_source(graph.nodes[name]) for s in graph.nodes[name].streams]
    fields: dict[str, list[str]] = {"fields": []} if clock == "simulated" else {}
    logger = replace(spec, settings={**spec.settings, "sources": sources, **fields})
    return plan(replace(graph, nodes={**graph.nodes, spec.name: logger}))


def _is_source(spec: NodeSpec) -> bool:
    """Whether its messages are not a function of other messages."""
    return spec.cls.paced or spec.cls.hardware


def _faults(graph: Graph, whole: Plan, clock: str, logger: NodeSpec) -> Iterator[Fault]:
    thin: Mapping[str, int] = logger.settings.get("thin", {})
    left_out: Collection[str] = logger.settings.get("leave_out", ())
    cure = "Record all messages: `record: all`, or --record-only all."
    if thin:
        yield Fault(f"thin: {', '.join(thin)}: with {SOURCES!r} the other streams are computed, none is thinned out",
                    cure, logger.place, node=logger.name)  # fmt: skip
    for name in whole.order:
        spec = graph.nodes[name]
        why = ""
        if _is_source(spec):
            missing = [stream for stream in spec.streams if stream in left_out]
            why = f"its stream {missing[0]!r} is left out, and everything is computed from it" if missing else ""
        elif spec.cls.__module__ == "__main__" or "<locals>" in full_name(spec.cls):
            why = f"its class {full_name(spec.cls)} cannot be imported by this name"
        elif spec.restart and clock == "simulated":
            why = "it may be restarted, and the behaviour of the other nodes meanwhile is not a function of the sources"
        if why:
            yield Fault(f"record {SOURCES}: the node cannot be computed again: {why}", cure, spec.place, node=name)
