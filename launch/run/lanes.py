"""Runs of one graph side by side in this process, on simulated time: lanes (engine/lanes.py) of what files describe."""

import math
import os
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any

import msgspec
import numpy as np

from palpate.engine.faults import Location
from palpate.engine.graph import Graph, NodeSpec
from palpate.engine.job import Job, NodeJob
from palpate.engine.lanes import Lanes, NodeImage, Pool
from palpate.engine.plan import Plan
from palpate.engine.segment import Segment
from palpate.engine.slot import NodeError, RecordOutput
from palpate.launch.load.files import Override
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.load.placement import fused
from palpate.launch.load.plan import plan
from palpate.launch.load.recording import set_recording
from palpate.launch.load.values.source import YamlSource
from palpate.launch.run.assign import jobs
from palpate.launch.run.work.worker import Worker
from palpate.nodes.base import CompiledNode
from palpate.nodes.logger import Mcap
from palpate.physics.errors import ArgumentError

BLOCK = 0.02  # [s] that a call of compiled code may take: Ctrl-C waits for it
FIRST = 8  # ticks of the first call
PROBES = 4  # lanes for each of which the graph is loaded


@dataclass(frozen=True)
class Prepared:
    """What a lane runs.

    graph  checked;  job  all nodes that the kept streams need
    """

    graph: Graph
    job: Job

    @cached_property
    def structure(self) -> list[Any]:
        """What lanes that run side by side have in common: all but the settings."""
        return [self.job.rate, [msgspec.structs.replace(node, settings={}) for node in self.job.nodes]]


def prepare(launch: LaunchFile, keep: Sequence[tuple[str, str]], graph: Graph | None = None) -> Prepared:
    """What a lane of this run has to compute for these fields of streams; `graph` is that of the launch file, if
    already read, and is changed. GraphError, ArgumentError: what is wrong."""
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
    (job,) = jobs(planned, fused(planned))
    return Prepared(graph, msgspec.structs.replace(job, observers=()))


def prepare_all(
    launch: LaunchFile, over: Mapping[str, Sequence[Any]], lanes: int, keep: Sequence[tuple[str, str]]
) -> list[Prepared]:
    """What each lane of this run has to compute, with the values that `over` gives it for paths as of `--set`.

    A graph takes some 10 ms to load. Numbers that it hands to settings as they are, at the least and the greatest value
    and at 0, are put there without loading it again for each lane; nodes check them when they are made.

    GraphError, ArgumentError: what is wrong.
    """

    def load(lane: int, values: Mapping[str, Any]) -> Prepared:
        key = repr(values)
        if key not in known:
            changes = [
                Override(tuple(path.split(".")), YamlSource(value, {(): Location(f"lane {lane}, {path}")}))
                for path, value in values.items()
            ]
            known[key] = prepare(launch.but(overrides=changes), keep)
        return known[key]

    known: dict[str, Prepared] = {}
    first = {path: values[0] for path, values in over.items()}
    base = load(0, first)
    direct: dict[str, set[tuple[int, str]]] = {}
    for path, values in over.items():
        if lanes > PROBES and all(type(value) is float and math.isfinite(value) for value in values):
            probes = {values.index(extreme) for extreme in (min(values), max(values))}
            probes |= {lane for lane, value in enumerate(values) if value == 0.0}
            others = {lane: load(lane, first | {path: values[lane]}) for lane in sorted(probes)}
            targets = [_follows(base, other, values[0], values[lane]) for lane, other in others.items()]
            found = {setting for target in targets for setting in target or ()}
            if None not in targets and found.isdisjoint(set().union(*direct.values())):
                direct[path] = found
    prepared = []
    for lane in range(lanes):
        rest = {path: first[path] if path in direct else values[lane] for path, values in over.items()}
        one = load(lane, rest)
        nodes = list(one.job.nodes)
        for path, followers in direct.items():
            for place, name in followers:
                settings = {**nodes[place].settings, name: over[path][lane]}
                nodes[place] = msgspec.structs.replace(nodes[place], settings=settings)
        prepared.append(Prepared(one.graph, msgspec.structs.replace(one.job, nodes=tuple(nodes))))
    return prepared


def _follows(base: Prepared, other: Prepared, usual: float, value: float) -> set[tuple[int, str]] | None:
    """The settings, by place of the node and name, in which a graph with another value differs from `base`, which has
    the usual one; None where it differs in more than in settings that are these values."""
    if other.structure != base.structure:
        return None
    found = set()
    for place, (before, after) in enumerate(zip(base.job.nodes, other.job.nodes, strict=True)):
        for name in before.settings.keys() | after.settings.keys():
            if before.settings.get(name) != after.settings.get(name):
                if (before.settings.get(name), after.settings.get(name)) != (usual, value):
                    return None
                found.add((place, name))
    return found


def check_compiled(planned: Plan) -> None:
    """ArgumentError: a node of the plan is not one that lanes can run."""
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
    """Lanes of graphs of one structure.

    prepared  what each lane runs
    keep      stream and name of the fields that are kept
    rows      number of values of each that are kept;  every  divisor of the ticks of which

    `failures` has why a lane does not run, or stopped, by its number. ArgumentError: the structures differ. NodeError:
    no node starts.
    """

    def __init__(self, prepared: Sequence[Prepared], keep: Sequence[tuple[str, str]], rows: int, every: int = 1):
        self.failures: dict[int, NodeError] = {}
        worker = Worker(prepared[0].job, None, lambda report: None)
        worker.start()
        (segment,) = worker.parts
        assert isinstance(segment, Segment) and segment.alone(), worker.parts
        self.worker, self.segment, self._pool = worker, segment, Pool()
        self._images: dict[Any, NodeImage] = {}
        self.lanes = Lanes(segment, len(prepared))
        fields = []
        for stream, name in keep:
            output = worker.outputs[stream]
            assert isinstance(output, RecordOutput)
            fields.append((output, name))
        self.lanes.keep(fields, rows, every)
        self._prepared = prepared
        self.restart()

    def restart(self, prepared: Sequence[Prepared] = ()) -> None:
        """Put all lanes at their beginning, with these settings, of the same structure, if any are given. Images of the
        settings before are dropped."""
        self._prepared = prepared or self._prepared
        self.failures.clear()
        former, self._images = self._images, {}
        for lane, one in enumerate(self._prepared):
            try:
                images = [self.image(place, node, former) for place, node in enumerate(one.job.nodes)]
                self.lanes.place(lane, images)
            except NodeError as error:
                self.failures[lane] = error

    def close(self) -> None:
        """Stop the nodes."""
        self.worker.stop()

    def image(self, place: int, job: NodeJob, former: Mapping[Any, NodeImage] = MappingProxyType({})) -> NodeImage:
        """A node at its start with the settings of a job; those that are equal start once. NodeError.

        former  images that are still valid
        """
        key = place, repr(sorted(job.settings.items()))
        if key not in self._images:
            image = former.get(key) or NodeImage(job, self.segment.slots[place].counts, self._pool)
            self._images[key] = image
        return self._images[key]

    def run(self, ticks: int, threads: int | None = None, done: Callable[[int], None] = lambda ticks: None) -> None:
        """Run each lane up to this number of ticks, in threads. `done` is called with the number of ticks that all
        lanes have run, now and then. KeyboardInterrupt: the threads have ended."""
        todo = iter([lane for lane in range(self.lanes.count) if lane not in self.failures])
        lock, stop, ran = threading.Lock(), threading.Event(), [0]

        # Each thread takes lane after lane, in blocks of ticks of at most about `BLOCK` seconds.
        def work() -> None:
            block = FIRST
            while not stop.is_set():
                with lock:
                    lane = next(todo, None)
                if lane is None:
                    return
                now = 0
                while now < ticks and not stop.is_set():
                    count, begun = min(block, ticks - now), time.perf_counter()
                    self.lanes.run(lane, 1, count)
                    reached, took = int(self.lanes.ticks[lane]), time.perf_counter() - begun
                    ran[0] += reached - now
                    if reached < now + count:
                        break
                    if count == block:
                        block = max(1, block // 2) if took > BLOCK else block * 2 if took < 0.5 * BLOCK else block
                    now = reached

        count = min(threads or len(os.sched_getaffinity(0)), self.lanes.count)
        with ThreadPoolExecutor(count, "palpate lanes") as pool:
            working = [pool.submit(work) for _ in range(count)]
            try:
                while wait(working, timeout=0.1, return_when=FIRST_EXCEPTION).not_done:
                    done(ran[0])
            finally:
                stop.set()
        for future in working:
            future.result()
        done(ran[0])
        # Results of a failed lane are NaN from the failed tick on.
        for lane in range(self.lanes.count):
            if lane not in self.failures and (error := self.lanes.failure(lane)) is not None:
                self.failures[lane] = error
                for column in self.lanes.columns:
                    if column.dtype.kind == "f":
                        column[lane, -(-int(self.lanes.ticks[lane]) // self.lanes.every) :] = np.nan
