"""From a run to its started nodes, as one segment of compiled code and the pointers that its host moves."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import msgspec

from palpate.engine.faults import GraphError
from palpate.engine.graph import Graph
from palpate.engine.imports import load_class
from palpate.engine.job import Job, NodeJob
from palpate.engine.plan import Plan, force_path
from palpate.engine.provenance import about
from palpate.engine.segment import CompiledSegment, Entrance
from palpate.engine.slot import Slot
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.load.placement import fuse_nodes
from palpate.launch.load.plan import plan
from palpate.launch.load.recording import set_recording
from palpate.launch.run.assign import jobs
from palpate.launch.run.work.worker import Worker
from palpate.nodes.base import CompiledNode, Node
from palpate.nodes.base.wired import EMULATOR
from palpate.nodes.device.hid import RawHid
from palpate.nodes.device.mouse import Pointer
from palpate.nodes.logger import Mcap
from palpate.web.errors import WebError


@dataclass(frozen=True)
class Started:
    """Started nodes.

    planned   the plan, in which the logger records all streams
    job       the nodes, the logger with its streams, and the provenance of the run
    segment   all compiled nodes
    pointers  the nodes whose messages the host writes, in the order of the fingers
    devices   the raw-HID devices, whose messages the host writes too
    left_out  nodes that do not run, with the reason
    """

    planned: Plan
    job: Job
    segment: CompiledSegment
    pointers: list[Slot]
    devices: list[Slot]
    left_out: dict[str, str]

    def entrances(self, host: Slot) -> list[Entrance]:
        """The inputs that read the messages of a pointer or device."""
        (stream,) = (output.stream for output in host.outputs)
        return [each for each in self.segment.inlets() if each.port.stream == stream]


@contextmanager
def started(launch: LaunchFile) -> Iterator[Started]:
    """Start the nodes of a run on the simulated clock. WebError: one of them is not compiled. GraphError, NodeError."""
    graph = launch.load()
    set_recording(graph, Path(f"{launch.graph.stem}.mcap"))
    left_out = leave_out_python(graph)
    _record_sources(graph)
    planned = plan(graph)
    place = fuse_nodes(planned)
    groups = {group.name: group.nodes for group in place.groups}
    provenance = about(planned, clock="simulated", pace=None, ticks=None, groups=groups)
    (job,) = jobs(planned, place, about=provenance)
    hosted = {name for name in planned.order if issubclass(planned.graph.nodes[name].cls, HOSTED)}
    nodes = tuple(sorted(map(_without_device, job.nodes), key=lambda node: node.name not in hosted))
    worker = Worker(msgspec.structs.replace(job, nodes=nodes, observers=()), None, lambda report: None)
    try:
        worker.start()
        *hosts, segment = worker.parts
        assert isinstance(segment, CompiledSegment) and all(isinstance(each, Slot) for each in hosts), worker.parts
        devices = [slot for slot in hosts if isinstance(slot.node, RawHid)]  # type: ignore[union-attr]
        pointers = [slot for slot in hosts if slot not in devices]
        for slot in devices:
            slot.node.exchange.stop()  # type: ignore[union-attr]  # the page exchanges the reports
        yield Started(planned, job, segment, pointers, devices, left_out)  # type: ignore[arg-type]
    finally:
        worker.stop()


def _without_device(node: NodeJob) -> NodeJob:
    """The same node, started here with an emulator instead of its device, which the page opens."""
    if load_class(node.cls, Node) is not RawHid:
        return node
    return msgspec.structs.replace(node, settings={**node.settings, "port": EMULATOR})


def _record_sources(graph: Graph) -> None:
    """Let the logger record the messages of the nodes that the clock drives, as pointers, and the others as checks."""
    driven = [s for spec in graph.nodes.values() if spec.cls.paced and spec.off is None for s in spec.streams]
    (logger,) = (spec for spec in graph.nodes.values() if issubclass(spec.cls, Mcap) and spec.off is None)
    logger.settings = {**logger.settings, "sources": driven}


def leave_out_python(graph: Graph) -> dict[str, str]:
    """Switch off the nodes in Python that are not on the path of the force; returns each with the reason. WebError: a
    node that the others need is not compiled, drives a device, or holds an earlier message."""
    planned = plan(graph)
    name, path, left = graph.path.stem, force_path(planned), dict[str, str]()
    for node in planned.order:
        spec = graph.nodes[node]
        if issubclass(spec.cls, HOSTED):
            continue
        if spec.cls.hardware:
            raise WebError(f"{name}: {node!r} ({spec.cls.__name__}) drives a device; expected a simulated one")
        if not (issubclass(spec.cls, CompiledNode) and spec.cls.step is CompiledNode.step):
            if node in path:
                raise WebError(f"{name}: {node!r} ({spec.cls.__name__}) {_PYTHON} and is part of the loop; {_CURE}")
            spec.off = left[node] = f"{spec.cls.__name__} {_PYTHON}"
        for edge in planned.edges[node]:
            if edge.loop and planned.order.index(edge.producer) <= planned.order.index(node):
                raise WebError(
                    f"{name}: input {edge.port!r} of {node!r} holds an earlier message of {edge.producer!r}, which "
                    "runs before it in each tick; a page keeps only the newest. Leave out `loop: true`"
                )
    try:
        if not any(not issubclass(graph.nodes[node].cls, HOSTED) for node in plan(graph).order):
            raise WebError(f"{name}: no node is compiled: {', '.join(left) or 'it has none'} {_PYTHON}; {_CURE}")
    except GraphError as error:
        raise WebError(
            f"{name}: {', '.join(map(repr, left))} {_PYTHON}, and others need it; {_CURE}. {error}"
        ) from None
    return left


HOSTED = (Pointer, RawHid)
"""Nodes whose messages the page writes."""
_PYTHON, _CURE = "runs in Python", "a page runs compiled nodes alone: give it the compiled form (docs/add_a_node.md)"
