"""Prepares and starts lanes (`engine/lanes.py`) of a graph file in this process, on simulated time."""

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import msgspec
import numpy as np

from palpate.engine.graph import Graph, NodeSpec
from palpate.engine.job import Job, NodeJob
from palpate.engine.lanes import Lanes, NodeImage, Pool
from palpate.engine.plan import Plan
from palpate.engine.segment import CompiledSegment, record_of
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.load.placement import fuse_nodes
from palpate.launch.load.plan import plan
from palpate.launch.load.recording import set_recording
from palpate.launch.run.assign import jobs
from palpate.launch.run.work.worker import Worker
from palpate.messages.record import layout
from palpate.nodes.base import CompiledNode
from palpate.nodes.logger import Mcap
from palpate.physics.errors import ArgumentError

IMAGES = 1 << 24  # [bytes] Maximum size of the images of started nodes that a structure keeps


@dataclass(frozen=True)
class Prepared:
    """A lane that is ready to run.

    graph  the checked graph
    job    all nodes that the recorded streams need
    notes  lines for the user about the graph with these settings
    ticks  number of ticks after which this lane ends, if before the others
    """

    graph: Graph
    job: Job
    notes: tuple[str, ...] = ()
    ticks: int | None = None

    @cached_property
    def structure(self) -> list[Any]:
        """Everything except the settings; parallel lanes must agree in it."""
        return [self.job.rate, [msgspec.structs.replace(node, settings={}) for node in self.job.nodes]]


def prepare(launch: LaunchFile, keep: Sequence[tuple[str, str]], graph: Graph | None = None) -> Prepared:
    """The lane of a run that computes these fields of streams.

    graph  the graph of the launch file, if already read; it is modified

    GraphError: faults of the graph. ArgumentError: a node cannot run in a lane, or the clock is real, or a kept stream
    is not sent.
    """
    graph = graph or launch.load()
    for spec in graph.nodes.values():
        unsent = [f"{stream}.{name}" for stream, name in keep if stream in spec.streams] if spec.off else []
        if unsent:
            raise ArgumentError(f"keep {unsent[0]!r}: node {spec.name!r} does not run: {spec.off}")
    set_recording(graph, None)
    graph.wanted = None
    for spec in graph.nodes.values():
        if spec.observer and spec.off is None:
            spec.off = "an ensemble has no observers"
    graph.nodes[""] = NodeSpec(
        name="", use="", cls=Mcap, settings={"fields": [field for _, field in keep]},
        listen=tuple(dict.fromkeys(stream for stream, _ in keep)),
    )  # fmt: skip
    planned = plan(graph)
    check_compiled(planned)
    if launch.clock == "real":
        raise ArgumentError(f"{graph.path.stem}: lanes need simulated time, but clock: real; run it with palpate.run")
    (job,) = jobs(planned, fuse_nodes(planned))
    return Prepared(graph, msgspec.structs.replace(job, observers=()), graph.notes)


def check_compiled(planned: Plan) -> None:
    """ArgumentError: a node of the plan cannot run in a lane."""
    name = planned.graph.path.stem
    for node in planned.order:
        kind = planned.graph.nodes[node].cls
        if kind.hardware:
            raise ArgumentError(f"{name}: lanes need simulated time, but {node!r} drives a device; use palpate.run")
        if not (issubclass(kind, CompiledNode) and kind.step is CompiledNode.step):
            raise ArgumentError(
                f"{name}: {node!r} ({kind.__name__}) runs in Python; lanes run compiled nodes alone. Leave it out of "
                "the graph, give it the compiled form (docs/add_a_node.md), or use palpate.run or palpate.Study"
            )
        for edge in planned.edges[node]:
            if edge.loop and planned.order.index(edge.producer) <= planned.order.index(node):
                raise ArgumentError(
                    f"{name}: input {edge.port!r} of {node!r} holds an earlier message of {edge.producer!r}, which runs"
                    " before it in each tick; a lane keeps only the newest. Leave out `loop: true`, or use palpate.run"
                    " or palpate.Study"
                )


class LaneRun:
    """Started nodes of one structure, and lanes with this structure.

    first    a lane with this structure
    keep     stream and name of the fields to record
    columns, every  see `Lanes`
    count    number of lanes that exist together

    NodeError: a node of the first lane does not start.
    """

    def __init__(
        self,
        first: Prepared,
        keep: Sequence[tuple[str, str]],
        columns: Sequence[np.ndarray],
        every: int = 1,
        count: int = 1,
    ) -> None:
        worker = Worker(first.job, None, lambda report: None)
        try:
            worker.start()
        except BaseException:
            worker.stop()
            raise
        (segment,) = worker.parts
        assert isinstance(segment, CompiledSegment) and segment.alone(), worker.parts
        self.worker, self.segment, self._pool = worker, segment, Pool()
        self._images: OrderedDict[Any, NodeImage] = OrderedDict()
        self.size = 0
        """Size [bytes] of the images."""
        fields = [(record_of(worker.outputs[stream]), name) for stream, name in keep]
        self.lanes = Lanes(segment, count, fields, columns, every)

    def close(self) -> None:
        """Stop the nodes."""
        self.worker.stop()

    def place(self, lane: int, one: Prepared, row: int) -> None:
        """Reset a lane to the start of this run, and record it in this row. NodeError: a node does not start."""
        self.lanes.place(lane, [self.image(place, node) for place, node in enumerate(one.job.nodes)], row)

    def image(self, place: int, job: NodeJob) -> NodeImage:
        """The started node with the settings of a job. The images that were used last are kept. NodeError: the node
        does not start."""
        key = place, repr(sorted(job.settings.items()))
        known = self._images.get(key)
        if known is None:
            known = self._images[key] = NodeImage(job, self.segment.slots[place].counts, self._pool)
            self.size += known.bytes
            while self.size > IMAGES and len(self._images) > len(self.segment.slots):
                self.size -= self._images.popitem(last=False)[1].bytes
        else:
            self._images.move_to_end(key)
        return known


def columns_of(one: Prepared, keep: Sequence[tuple[str, str]], lanes: int, rows: int) -> list[np.ndarray]:
    """Arrays (lanes, rows, ...) for the values of these fields."""
    return [np.zeros((lanes, rows), layout(one.graph.streams[stream])[name]) for stream, name in keep]
