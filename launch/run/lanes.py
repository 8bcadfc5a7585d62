"""Runs many lanes (`engine/lanes.py`) of a graph file in parallel in this process, on simulated time."""

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any

import msgspec
import numpy as np

from palpate.compiler.cores import usable_cores
from palpate.engine.graph import Graph, NodeSpec
from palpate.engine.job import Job, NodeJob
from palpate.engine.lanes import Lanes, NodeImage, Pool
from palpate.engine.plan import Plan
from palpate.engine.segment import CompiledSegment, record_of
from palpate.engine.slot import NodeError
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.load.placement import fuse_nodes
from palpate.launch.load.plan import plan
from palpate.launch.load.recording import set_recording
from palpate.launch.run.assign import jobs
from palpate.launch.run.lane_threads import FIRST, LaneThreads, adapt_block
from palpate.launch.run.work.worker import Worker
from palpate.nodes.base import CompiledNode
from palpate.nodes.logger import Mcap
from palpate.physics.errors import ArgumentError, PalpateError


@dataclass(frozen=True)
class Prepared:
    """A lane that is ready to run.

    graph  the checked graph
    job    all nodes that the recorded streams need
    """

    graph: Graph
    job: Job

    @cached_property
    def structure(self) -> list[Any]:
        """Everything except the settings; parallel lanes must agree in it."""
        return [self.job.rate, [msgspec.structs.replace(node, settings={}) for node in self.job.nodes]]


def prepare(launch: LaunchFile, keep: Sequence[tuple[str, str]], graph: Graph | None = None) -> Prepared:
    """The lane of a run that computes these fields of streams.

    graph  the graph of the launch file, if already read; it is modified

    GraphError: faults of the graph. ArgumentError: a node cannot run in a lane, or the clock is real.
    """
    graph = graph or launch.load()
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
    return Prepared(graph, msgspec.structs.replace(job, observers=()))


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


class LaneRun:
    """Parallel lanes with the same structure.

    prepared  the lanes
    keep      stream and name of the fields to record
    rows      number of values to record of each field: the last ones of a run
    every     divisor of the ticks whose values are recorded
    count     maximum number of lanes of a later `restart`; None: the number of lanes

    `failures` has the error of each lane that did not start or that stopped, by lane number; a lane that is in it
    before `run` does not run, and its values are NaN. NodeError: a node of the first lane does not start.
    """

    def __init__(
        self,
        prepared: Sequence[Prepared],
        keep: Sequence[tuple[str, str]],
        rows: int,
        every: int = 1,
        count: int | None = None,
    ) -> None:
        self.failures: dict[int, Exception] = {}
        worker = Worker(prepared[0].job, None, lambda report: None)
        worker.start()
        (segment,) = worker.parts
        assert isinstance(segment, CompiledSegment) and segment.alone(), worker.parts
        self.worker, self.segment, self._pool = worker, segment, Pool()
        self._images: dict[Any, NodeImage] = {}
        self.lanes = Lanes(segment, count or len(prepared))
        self.lanes.keep([(record_of(worker.outputs[stream]), name) for stream, name in keep], rows, every)
        self._prepared: Sequence[Prepared | PalpateError] = prepared
        self.restart()

    def restart(self, prepared: Sequence[Prepared | PalpateError] = ()) -> None:
        """Reset all lanes to their start. New lanes, if given, replace the settings; they have the same structure. An
        error in place of a lane is its failure. Images of settings that are no longer used are dropped."""
        self._prepared = prepared or self._prepared
        self.failures.clear()
        former, self._images = self._images, {}
        for lane, one in enumerate(self._prepared):
            if isinstance(one, PalpateError):
                self.failures[lane] = one
                continue
            try:
                images = [self.image(place, node, former) for place, node in enumerate(one.job.nodes)]
                self.lanes.place(lane, images)
            except NodeError as error:
                self.failures[lane] = error

    def close(self) -> None:
        """Stop the nodes."""
        self.worker.stop()

    def image(self, place: int, job: NodeJob, former: Mapping[Any, NodeImage] = MappingProxyType({})) -> NodeImage:
        """The started node with the settings of a job; nodes with equal settings are started once.

        former  images of the previous settings, which are reused

        NodeError: the node does not start.
        """
        key = place, repr(sorted(job.settings.items()))
        if key not in self._images:
            self._images[key] = former.get(key) or NodeImage(job, self.segment.slots[place].counts, self._pool)
        return self._images[key]

    def run(self, ticks: int, threads: int | None = None, done: Callable[[int], None] = lambda ticks: None) -> None:
        """Run this number of ticks of each lane, in threads.

        done  called ten times a second with the sum of the ticks of all lanes

        On KeyboardInterrupt the threads are stopped before it is raised.
        """
        todo = iter([lane for lane in range(len(self._prepared)) if lane not in self.failures])
        lock, ran = threading.Lock(), [0]

        # Each thread runs one lane after another, in blocks of ticks that take about `BLOCK` seconds at most.
        def work(stopped: Callable[[], bool]) -> None:
            block = FIRST
            while not stopped():
                with lock:
                    lane = next(todo, None)
                if lane is None:
                    return
                now = 0
                while now < ticks and not stopped():
                    count, begun = min(block, ticks - now), time.perf_counter()
                    self.lanes.run(lane, 1, count)
                    reached, took = int(self.lanes.ticks[lane]), time.perf_counter() - begun
                    ran[0] += reached - now
                    if reached < now + count:
                        break
                    if count == block:
                        block = adapt_block(block, took)
                    now = reached

        count = min(threads or len(usable_cores()), self.lanes.count)
        pool = LaneThreads(count)
        try:
            pool.run([work] * count, lambda: done(ran[0]))
        finally:
            pool.close()
        done(ran[0])
        # Results of a failed lane are NaN from the failed tick on.
        for lane in range(len(self._prepared)):
            reached = 0
            if lane not in self.failures:
                if (error := self.lanes.failure(lane)) is None:
                    continue
                self.failures[lane], reached = error, -(-int(self.lanes.ticks[lane]) // self.lanes.every)
            for column in self.lanes.columns:
                column[lane, reached:] = np.nan if column.dtype.kind == "f" else 0
