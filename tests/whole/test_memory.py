"""A run may last for hours: its ticks keep nothing of what they allocate."""

import gc
import sys
from dataclasses import replace

import pytest

from palpate.engine.clock import now
from palpate.launch.load.launchfile import find
from palpate.launch.load.plan import plan
from palpate.launch.run.assign import jobs
from palpate.launch.run.work.simulated import run_tick
from palpate.launch.run.work.worker import Worker

BEGUN, TICKS = 2500, 2500
KEPT = 0.25
"""[1] Objects that a tick may keep on the mean: counters that outgrow the numbers of which Python has one each, and
what Python and numpy hold back for reuse, which levels off. Anything that each tick keeps is at least one."""


@pytest.mark.parametrize("body", ["MassSpring", "BeamBundle"])
def test_ticks_keep_no_memory(body):
    launch = replace(find("kidney").but(place="fused", overrides=[f"tissue.use=deformation.{body}"]), record=None)
    graph = launch.load()
    graph.nodes["log"].off = "nothing is recorded"
    planned = plan(graph)
    [job] = jobs(planned, launch.placement(planned))
    worker = Worker(job, None, lambda report: None)
    worker.start()
    worker.begin(now())
    try:
        blocks = []
        for tick in range(BEGUN + TICKS):
            if tick == BEGUN:
                gc.collect()
                blocks.append(sys.getallocatedblocks())
            run_tick(worker, tick)
        gc.collect()
        blocks.append(sys.getallocatedblocks())
    finally:
        worker.stop()
    assert blocks[1] - blocks[0] < KEPT * TICKS
