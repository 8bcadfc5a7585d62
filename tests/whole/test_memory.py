"""Runs of hours need constant memory: ticks keep no memory, and leave no work for the garbage collector."""

import functools
import gc
import sys
from dataclasses import replace

import pytest
from graphs_for_runs import GRAPH, until_it_has, write_graph

from palpate.engine.clock import now
from palpate.launch.load.launchfile import LaunchFile, find
from palpate.launch.load.plan import plan
from palpate.launch.run.assign import jobs
from palpate.launch.run.execute import execute
from palpate.launch.run.work.simulated import SimulatedClock
from palpate.launch.run.work.worker import Worker
from palpate.nodes.controller import Haptic
from palpate.records.reader import Recording

BEGUN, TICKS = 2500, 2500
KEPT = 0.25
"""[1] Objects that a tick may keep on average: counters that exceed Python's cached integers, and free lists of Python
and numpy, which level off. A leak in each tick is at least 1."""


def kept(body: str) -> tuple[float, int]:
    """The kidney's touch in one process: memory blocks that a tick keeps, and number of garbage collections."""
    launch = replace(find("kidney").but(place="fused", overrides=[f"tissue.use=deformation.{body}"]), record=None)
    graph = launch.load()
    graph.nodes["log"].off = "nothing is recorded"
    planned = plan(graph)
    [job] = jobs(planned, launch.placement(planned))
    worker = Worker(job, None, lambda report: None)
    worker.start()
    worker.begin(now())
    clock = SimulatedClock(worker)
    try:
        blocks, ran = [], []
        for tick in range(BEGUN + TICKS):
            if tick == BEGUN:
                gc.collect()
                gc.freeze()
                blocks.append(sys.getallocatedblocks())
                ran.append(sum(generation["collections"] for generation in gc.get_stats()))
            clock.run(tick)
        ran.append(sum(generation["collections"] for generation in gc.get_stats()))
        gc.collect()
        blocks.append(sys.getallocatedblocks())
    finally:
        worker.stop()
    return (blocks[1] - blocks[0]) / TICKS, ran[1] - ran[0]


@pytest.mark.parametrize("body", ["MassSpring", "BeamBundle"])
def test_ticks_keep_no_memory(body):
    per_tick, collections = kept(body)
    assert per_tick < KEPT
    assert collections == 0


def test_a_node_that_keeps_its_inputs_is_detected(monkeypatch):
    messages, step = [], Haptic.step

    @functools.wraps(step)
    def keeps(*given, **more):
        messages.append(given[1])
        return step(*given, **more)

    monkeypatch.setattr(Haptic, "step", keeps)
    per_tick, collections = kept("MassSpring")
    assert per_tick > 1.0 and collections > 0


@pytest.mark.parametrize(
    ("node", "grows"), [("Blocks", False), pytest.param("Keeps", True, marks=pytest.mark.long), ("Cycles", True)]
)
def test_a_worker_on_the_real_clock_keeps_no_memory(tmp_path, node, grows):
    """It sends, receives and reports as in any run, and never runs the garbage collector."""
    path = tmp_path / "run.mcap"
    graph = write_graph(tmp_path, f"rate: 1000\n{GRAPH.replace('nodes_for_runs.Spring', f'nodes_for_memory.{node}')}")
    launch, enough = LaunchFile(graph=graph, record=path, clock="real"), until_it_has(spring=("steps", 1500))
    assert execute(launch, patience=30, watch=enough).result.ok
    printed = list(Recording(path).messages("spring"))[500:]
    per_tick = (printed[-1].energy - printed[0].energy) / len(printed)
    assert per_tick > 0.9 if grows else per_tick < KEPT
    assert printed[-1].force[2] == printed[0].force[2]
