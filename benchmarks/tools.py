"""Time of the commands that compute many touches, over that of one `Ensemble` of as many lanes of the same length.

    python benchmarks/tools.py [study gym experiment fit tune rates] [--duration 1.8] [--lanes 200]

Each tool computes touches of the kidney in a separate process, followed by the ensemble in another one. Processor time
includes child processes; wall time also depends on other programs. `study` and `gym` compute `--lanes` touches; the
others as many as they need, which are counted.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
import warnings
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

import palpate
import palpate.gym
from palpate.launch.load.launchfile import LaunchFile, find

WAYS = {
    "study": "lanes, in blocks of 2 s in child processes",
    "gym": "lanes, one call of compiled code for each step",
    "experiment": "a lane for each stimulus, and a run that records it",
    "fit": "one call of compiled code for each tick of a recorded touch",
    "tune": "the same",
    "rates": "the same, and a run for each motion",
}
EXPERIMENT = 1.1  # [s] of a stimulus of the observer of kidney-stiffness


def used() -> float:
    """Processor time [s] of this process and of its children that have ended."""
    both = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in both)


def ensemble(lanes: int, duration: float) -> None:
    stiffness = np.linspace(130, 390, lanes)
    palpate.Ensemble("kidney", lanes, {"tissue.stiffness": stiffness}, duration=duration).run(quiet=True)


def count_calls(module: Any, name: str, touches: Any) -> list[int]:
    """Replace a function of a module by one that adds `touches(arguments)` to the returned list."""
    counts, call = list[int](), getattr(module, name)

    def counted(*args: Any, **given: Any) -> Any:
        counts.append(touches(*args, **given))
        return call(*args, **given)

    setattr(module, name, counted)
    return counts


def compute(tool: str, lanes: int, launch: LaunchFile, folder: Path) -> int:
    """Run a tool; returns the number of touches that it has computed."""
    from palpate.studies import fit_body, rates, search, tune
    from palpate.studies.psychophysics import observer
    from palpate.studies.psychophysics.opening import OF_EXPERIMENT, open_sitting

    duration = launch.duration or 0.0
    if tool == "study":
        over = {"tissue.stiffness": {"linspace": [130, 390, lanes]}}
        palpate.Study("kidney", over, ["peak contact.force"], duration=duration).run(folder)
        return lanes
    if tool == "gym":
        envs = gymnasium.make_vec("palpate/Touch-v0", lanes, vectorization_mode="vector_entry_point")
        envs.reset(seed=0)
        for _ in range(round(duration * 1000 / 10)):
            envs.step(np.zeros(envs.action_space.shape))
        envs.close()
        return lanes
    if tool == "experiment":
        counts = count_calls(observer, "execute", lambda *args: 1)
        opening = open_sitting("kidney-stiffness", folder, None, None, [], False, lambda text: None, OF_EXPERIMENT)
        with opening as sitting:
            sitting.simulate(lambda trial: None)
        return sum(counts)
    counts = [  # of each call of `compare` the reference and the variants; of each recorded touch 1
        count_calls(module, "compare", lambda recording, variants, **given: 1 + len(variants))
        for module in (search, fit_body, rates)
    ] + [count_calls(module, "record_touch", lambda *args: 1) for module in (fit_body, rates, tune)]
    if tool == "fit":
        fit_body.fit_body(launch, folder / "fitted.yaml")
    elif tool == "tune":
        tune.tune(launch, tune.Goal(0.5e-3, None), folder / "tuned.yaml")
    else:
        rates.rates(launch, 0.01, folder / "rates.yaml")
    return sum(map(sum, counts))


def measure(tool: str, lanes: int, duration: float) -> dict[str, float]:
    """Wall time, processor time and number of touches of a tool, including the load of kernels and meshes."""
    launch = find("kidney").but(duration=duration)
    with tempfile.TemporaryDirectory() as folder:
        since, before = time.perf_counter(), used()
        if tool == "ensemble":
            ensemble(lanes, duration)
        else:
            lanes = compute(tool, lanes, launch, Path(folder))
        return {"wall": time.perf_counter() - since, "cpu": used() - before, "touches": lanes}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tools", nargs="*", default=list(WAYS))
    parser.add_argument("--duration", type=float, default=1.8, help="[s] of a touch")
    parser.add_argument("--lanes", type=int, default=200)
    parser.add_argument("--measure", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.measure:
        warnings.simplefilter("ignore")
        print(json.dumps(measure(given.tools[0], given.lanes, given.duration)))
        return

    def run(tool: str, lanes: int, duration: float) -> dict[str, float]:
        words = [tool, "--measure", "--lanes", str(lanes), "--duration", str(duration)]
        done = subprocess.run([sys.executable, __file__, *words], stdout=subprocess.PIPE, text=True, check=True)
        return json.loads(done.stdout.splitlines()[-1])

    print(f"kidney, touches of {given.duration:g} s; load average {os.getloadavg()[0]:.1f} on "
          f"{len(os.sched_getaffinity(0))} cores")  # fmt: skip
    print("tool         touches   processor time: tool  ensemble  ratio   wall time: tool  ensemble  ratio")
    for tool in given.tools:
        duration = EXPERIMENT if tool == "experiment" else given.duration
        one = run(tool, given.lanes, duration)
        all_lanes = run("ensemble", int(one["touches"]), duration)
        cpu, wall = ((one[key], all_lanes[key], one[key] / all_lanes[key]) for key in ("cpu", "wall"))
        print(f"{tool:<12}{one['touches']:>8}{cpu[0]:>21.2f} s{cpu[1]:>8.2f} s{cpu[2]:>7.1f}"
              f"{wall[0]:>15.2f} s{wall[1]:>8.2f} s{wall[2]:>7.1f}   {WAYS[tool]}", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
