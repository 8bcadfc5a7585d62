"""Touch-steps per second of an ensemble, and their ratio to those of one fused run in the same process.

    python benchmarks/ensemble.py [--lanes 256 1024] [--bodies MassSpring ReducedFE] [--duration 1] [--rounds 3]

A touch-step is one tick of one lane. Each lane presses the kidney with a different damping of the finger; only the
force is computed. Fused run and ensembles alternate, because the machine may be shared; the best round counts.
"""

from __future__ import annotations

import argparse
import os
import time

import numpy as np

import palpate
import palpate.physics
from palpate.calling import describe_run
from palpate.launch.load.placement import fuse_nodes
from palpate.launch.load.plan import plan
from palpate.launch.load.recording import set_recording
from palpate.launch.run.assign import jobs
from palpate.launch.run.lanes import LaneRun
from palpate.launch.run.work.simulated import run_simulated
from palpate.launch.run.work.worker import Worker

KEEP = "contact", "force"


def single(body: str, duration: float) -> tuple[float, float]:
    """Ticks per second of one fused run without recording: by wall time, by processor time."""
    launch = describe_run("kidney", scene=None, duration=duration, sets=(), nodes={"tissue": body})
    graph = launch.load()
    set_recording(graph, None)
    planned, ticks = plan(graph), round(duration * graph.rate)
    (job,) = jobs(planned, fuse_nodes(planned), ticks=ticks)
    worker = Worker(job, None, lambda report: None)
    worker.start()
    worker.begin(0)
    begun, used = time.perf_counter(), time.process_time()
    run_simulated(worker, 0)
    took = time.perf_counter() - begun, time.process_time() - used
    worker.stop()
    return ticks / took[0], ticks / took[1]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--lanes", type=int, nargs="+", default=[256, 1024])
    parser.add_argument("--bodies", nargs="+", default=["MassSpring", "ReducedFE"])
    parser.add_argument("--duration", type=float, default=1.0, help="[s] of simulated time a lane")
    parser.add_argument("--rounds", type=int, default=3)
    given = parser.parse_args()
    cores = len(os.sched_getaffinity(0))
    print(f"kidney, force only, {given.duration:g} s of simulated time a lane, best of {given.rounds} rounds; "
          f"load average {os.getloadavg()[0]:.1f} on {cores} cores")  # fmt: skip
    print(f"{'body':<12}{'lanes':>6}{'touch-steps/s':>15}{'/ one run':>11}{'a core':>10}{'/ one run':>11}"
          f"{'built in':>10}{'kB a lane':>11}{'shared MB':>11}")  # fmt: skip
    for body in given.bodies:
        alone = [single(f"deformation.{body}", given.duration)]
        for count in given.lanes:
            begun, rates = time.perf_counter(), []
            over = {"scene.finger.finger_damping": np.linspace(6.0, 10.0, count)}
            asked = palpate.Ensemble("kidney", count, over, duration=given.duration, tissue=f"deformation.{body}")
            runs = LaneRun(asked._prepared, [KEEP], asked.ticks)
            built = time.perf_counter() - begun
            for _ in range(given.rounds):
                alone.append(single(f"deformation.{body}", given.duration))
                runs.restart()
                begun, used = time.perf_counter(), time.process_time()
                runs.run(asked.ticks)
                steps = count * asked.ticks
                rates.append((steps / (time.perf_counter() - begun), steps / (time.process_time() - used)))
            runs.close()
            (wall, core), (one, one_core) = np.max(rates, axis=0), np.max(alone, axis=0)
            state, shared = runs.lanes.memory
            print(f"{body:<12}{count:>6}{wall:>15,.0f}{wall / one:>11.2f}{core:>10,.0f}{core / one_core:>11.2f}"
                  f"{built:>8.1f} s{state / count / 1e3:>11.1f}{shared / 1e6:>11.2f}")  # fmt: skip


if __name__ == "__main__":
    main()
