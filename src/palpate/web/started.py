"""From a run to its started nodes, as one segment of compiled code and the pointers that its host moves."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import msgspec

from palpate.engine.job import Job
from palpate.engine.plan import Plan
from palpate.engine.provenance import about
from palpate.engine.segment import CompiledSegment, Entrance
from palpate.engine.slot import Slot
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.load.placement import fuse_nodes
from palpate.launch.load.plan import plan
from palpate.launch.load.recording import set_recording
from palpate.launch.run.assign import jobs
from palpate.launch.run.work.worker import Worker
from palpate.nodes.base import CompiledNode
from palpate.nodes.device.mouse import Pointer
from palpate.web.errors import WebError


@dataclass(frozen=True)
class Started:
    """Started nodes.

    planned   the plan, in which the logger records all streams
    job       the nodes, the logger with its streams, and the provenance of the run
    segment   all compiled nodes
    pointers  the nodes whose messages the host writes, in the order of the fingers
    """

    planned: Plan
    job: Job
    segment: CompiledSegment
    pointers: list[Slot]

    def entrances(self, pointer: Slot) -> list[Entrance]:
        """The inputs that read the messages of a pointer."""
        (stream,) = (output.stream for output in pointer.outputs)
        return [each for each in self.segment.inlets() if each.port.stream == stream]


@contextmanager
def started(launch: LaunchFile) -> Iterator[Started]:
    """Start the nodes of a run on the simulated clock. WebError: one of them is not compiled. GraphError, NodeError."""
    graph = launch.load()
    set_recording(graph, Path(f"{launch.graph.stem}.mcap"))
    planned = plan(graph)
    check_compiled(planned)
    place = fuse_nodes(planned)
    groups = {group.name: group.nodes for group in place.groups}
    provenance = about(planned, clock="simulated", pace=None, ticks=None, groups=groups)
    (job,) = jobs(planned, place, about=provenance)
    moved = {name for name in planned.order if issubclass(planned.graph.nodes[name].cls, Pointer)}
    nodes = tuple(sorted(job.nodes, key=lambda node: node.name not in moved))  # they have no inputs
    worker = Worker(msgspec.structs.replace(job, nodes=nodes, observers=()), None, lambda report: None)
    try:
        worker.start()
        *pointers, segment = worker.parts
        assert isinstance(segment, CompiledSegment) and all(isinstance(each, Slot) for each in pointers), worker.parts
        yield Started(planned, job, segment, pointers)  # type: ignore[arg-type]
    finally:
        worker.stop()


def check_compiled(planned: Plan) -> None:
    """WebError: a node runs in Python, drives a device, or holds an earlier message."""
    name = planned.graph.path.stem
    for node in planned.order:
        kind = planned.graph.nodes[node].cls
        if issubclass(kind, Pointer):
            continue
        if kind.hardware:
            raise WebError(f"{name}: {node!r} ({kind.__name__}) drives a device; expected a simulated one")
        if not (issubclass(kind, CompiledNode) and kind.step is CompiledNode.step):
            raise WebError(
                f"{name}: {node!r} ({kind.__name__}) runs in Python, and a page runs compiled nodes alone. Leave it out "
                "of the graph, or give it the compiled form (docs/add_a_node.md)"
            )
        for edge in planned.edges[node]:
            if edge.loop and planned.order.index(edge.producer) <= planned.order.index(node):
                raise WebError(
                    f"{name}: input {edge.port!r} of {node!r} holds an earlier message of {edge.producer!r}, which runs "
                    "before it in each tick; a page keeps only the newest. Leave out `loop: true`"
                )
