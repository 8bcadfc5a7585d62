"""Processor time and wall time per point of a study on one and two workers, compared with a plain loop.

    python benchmarks/study.py [--points 40] [--rounds 3] [--command-only]

The loop computes the points in one process, with the function that the workers call. Rounds of loop and study
alternate, because the machine may be shared. Processor time includes all child processes; it depends less than wall
time on the load of the machine. Then the command `palpate study` on 200 points of 1.8 s with two peaks and a curve,
from its start to its pictures.
"""

from __future__ import annotations

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import psutil

import palpate
import palpate.physics
from palpate.launch.run.lane_values import extremes
from palpate.launch.run.tasks.local import local
from palpate.studies.sweeps.task import PointTask


def used() -> float:
    """Processor time [s] of this process and its descendants."""
    here = psutil.Process()
    return sum(sum(each.cpu_times()[:2]) for each in (here, *here.children(recursive=True)))


COMMAND = """
graph: kidney
duration: 1.8 s
over:
  tissue.stiffness: {linspace: [130, 390, 100]}
  tissue.retardation: [0 ms, 20 ms]
keep: [peak contact.force, peak contact.indentation, curve contact.force]
"""


def command(folder: Path, rounds: int) -> tuple[float, float]:
    """Least wall time and processor time [s] of the command on two workers."""
    file, times = folder / "study.yaml", []
    file.write_text(COMMAND)
    for turn in range(rounds):
        since, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
        line = [
            sys.executable,
            "-m",
            "palpate.cli",
            "study",
            str(file),
            "--workers",
            "2",
            "-o",
            str(folder / str(turn)),
        ]
        subprocess.run(line, check=True, capture_output=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        times.append((time.perf_counter() - since, spent))
    wall, cpu = map(min, zip(*times, strict=True))
    return wall, cpu


def loops(given: argparse.Namespace) -> None:
    """Print the rate of the plain loop, and of one and two workers."""
    stiffness = {"linspace": [130, 390, given.points]}
    study = palpate.Study("kidney", {"tissue.stiffness": stiffness}, duration=given.duration)
    varied = {path: extremes(values) for path, values in study.space.columns().items()}
    task = PointTask(study.launch, study.keep, None, varied)
    print(f"kidney, {given.duration:g} s of simulated time a point, {given.points} points, {given.rounds} rounds; "
          f"load average {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")  # fmt: skip
    list(task.compute(study.points[:1]))

    def loop() -> None:
        for point in study.points:
            list(task.compute([point]))

    times: dict[str, list[tuple[float, float]]] = {}
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        with local(1, home / "one.log") as one, local(2, home / "two.log") as two:
            for number, client in enumerate((one, two)):
                warm = palpate.Study("kidney", {"tissue.stiffness": [110, 120, 125, 128]}, duration=0.5)
                warm.run(home / f"warm{number}", client)
            for turn in range(given.rounds):
                variants: dict[str, Callable[[], object]] = {
                    "loop": loop,
                    "study, 1 worker": lambda turn=turn: study.run(home / f"a{turn}", one),
                    "study, 2 workers": lambda turn=turn: study.run(home / f"b{turn}", two),
                }
                for name, compute_all in variants.items():
                    since, before = time.perf_counter(), used()
                    compute_all()
                    taken = time.perf_counter() - since, used() - before
                    times.setdefault(name, []).append((taken[0] / given.points, taken[1] / given.points))
    for name, taken in times.items():
        wall, cpu = (statistics.median(column) for column in zip(*taken, strict=True))
        speed, cost = (
            statistics.median(base[k] / each[k] for base, each in zip(times["loop"], taken, strict=True))
            for k in (0, 1)
        )
        print(f"{name:18} {1.0 / wall:5.2f} points/s, {speed:.2f} x the loop; "
              f"processor time {1e3 * cpu:.0f} ms a point, {100.0 * (1.0 / cost - 1.0):+.1f} %")  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--points", type=int, default=40)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--duration", type=float, default=6.3, help="[s] of simulated time a point")
    parser.add_argument("--command-only", action="store_true", help="measure only the command")
    given = parser.parse_args()
    if not given.command_only:
        loops(given)
    with tempfile.TemporaryDirectory() as folder:
        wall, cpu = command(Path(folder), given.rounds)
    print(f"palpate study, 200 points of 1.8 s, two workers: {wall:.1f} s, processor time {cpu:.1f} s; "
          f"load average {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")  # fmt: skip


if __name__ == "__main__":
    main()
