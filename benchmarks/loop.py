"""The kidney loop: rate fused, with one process per node and on a fine mesh; latency on the real clock; start; memory.

    python benchmarks/loop.py [--seconds S] [--json] [--waits]

Rates are the best and the median of three alternating runs, recorded only where the row says so; other programs can
only slow a run down. The latency is the time from a tick to its torque. In parallel with each run on the real clock, a
process only sleeps until each tick; the machine causes the ticks that this process misses.

--waits prints only how often each of the processes waits in a tick on simulated time, which other programs hardly
change: its voluntary context switches in a long run minus those in a short one.
"""

from __future__ import annotations

import dataclasses
import json
import os
import platform
import re
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from control import Control
from rich.console import Console
from rich.progress import track
from tables import parser, show

from palpate.launch.load.launchfile import LaunchFile, find
from palpate.launch.load.placement import APART, AUTO, fuse_nodes
from palpate.launch.load.plan import plan
from palpate.launch.run.assign import jobs
from palpate.launch.run.execute import execute
from palpate.launch.run.launcher import Launcher
from palpate.launch.run.result import Result
from palpate.nodes.base.surface import surface_mesh
from palpate.physics.geometry.mesh import write_ply
from palpate.records.times import step_times

VERTICES = (10_000, 550_000)  # of the kidney as a mesh file: 20 000 and 1.1 million triangles
REDUCED = ("tissue.use=deformation.ReducedFE",)
CASES: dict[str, tuple[str | None, bool, tuple[str, ...]]] = {
    "fused": ("fused", False, ()),
    "fused, all recorded": ("fused", True, ()),
    "fused, ReducedFE": ("fused", False, REDUCED),
    "fused, ReducedFE, all recorded": ("fused", True, REDUCED),
    "processes": (None, False, ()),
    "processes, all recorded": (None, True, ()),
    "processes, ReducedFE": (None, False, REDUCED),
    "processes, ReducedFE, all recorded": (None, True, REDUCED),
}
"""Placement, whether it is recorded, and overrides of each measured rate."""
REAL = ((APART, 1000.0), (APART, 5000.0), (AUTO, 1000.0), (AUTO, 5000.0))
"""Placements and rates [Hz] on the real clock."""


def run(
    place: str | None,
    clock: str,
    seconds: float,
    rate: float = 1000.0,
    watch: Callable[[Launcher], None] | None = None,
    record: Path | None = None,
    overrides: tuple[str, ...] = (),
) -> Result:
    """One run of the kidney graph."""
    launch = find("kidney").but(place=place, clock=clock, duration=seconds, overrides=(f"rate={rate}", *overrides))
    launch = dataclasses.replace(launch, record=record)
    times = lambda planned: step_times(planned, None)[0]  # noqa: E731
    result = execute(launch, step_times=times, watch=watch or (lambda _: None)).result
    if not result.ok:
        raise SystemExit(str(result.deaths[0]))
    return result


def _unrecorded(launch: LaunchFile) -> LaunchFile:
    return dataclasses.replace(launch, record=None)


def rates(seconds: float) -> dict[str, dict[str, float]]:
    """Rates [Hz] on simulated time, as fast as the machine allows."""
    runs: dict[str, list[Result]] = {name: [] for name in CASES}
    with tempfile.TemporaryDirectory() as folder:
        for _ in track(range(3), "rates", transient=True):
            for name, (place, recorded, over) in CASES.items():
                record = Path(folder) / "touch.mcap" if recorded else None
                runs[name].append(run(place, "simulated", seconds, record=record, overrides=over))
    answer = {}
    for name, results in runs.items():
        hertz = [result.ticks / result.wall for result in results]
        age = min((result.health["device"]["age"] for result in results), key=lambda age: age["p50"])
        answer[name] = {
            "best": max(hertz),
            "median": statistics.median(hertz),
            **{k: age[k] for k in ("p50", "p99", "p999")},
        }
    best = max(runs["fused"], key=lambda result: result.ticks / result.wall)
    answer["steps"] = {name: health["step"]["p50"] for name, health in best.health.items()}
    return answer


def real_time(place: str, rate: float, seconds: float) -> dict[str, object]:
    """Skipped ticks, ticks whose torque arrived after the next tick, and latency on the real clock; the same of the
    process that only sleeps."""
    control = Control(seconds, rate)
    result = run(place, "real", seconds, rate, control.look)
    device, statics = result.health["device"], result.health["statics"]
    ticks = device["steps"] + device["late"]
    return {
        "place": place,
        "rate": rate,
        "ticks": ticks,
        "late": device["late"] / ticks,
        "held": device["held"] / ticks,
        **{key: statics["age"][key] for key in ("p50", "p99", "p999", "longest")},
        "control": control.result(),
        "processor": processor_time(place, rate),
        "refused": "; ".join(result.notes),
    }


def processor_time(place: str, rate: float) -> float:
    """Processor time [us] of all processes per tick on the real clock: of a long run minus that of a short one, over
    the difference of their ticks."""

    def used(seconds: float) -> float:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        run(place, "real", seconds, rate)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    return 1e6 * (used(5.0) - used(1.0)) / (4.0 * rate)


def waits(seconds: float) -> dict[str, float]:
    """Voluntary context switches per tick of each process, and the edges between the processes per tick."""

    def count(seconds: float) -> tuple[dict[str, int], int]:
        found: dict[str, int] = {}

        def look(launcher: Launcher) -> None:
            for group, pid in launcher.pids.items() if launcher.phase == "running" else ():
                status = Path(f"/proc/{pid}/status")
                match = re.search(
                    r"^voluntary_ctxt_switches:\s+(\d+)", status.read_text() if status.exists() else "", re.M
                )
                if match:
                    found[group] = int(match[1])

        return found, run(None, "simulated", seconds, watch=look).ticks

    (short, first), (long, last) = count(seconds / 8), count(seconds)
    graph = find("kidney").load()
    graph.nodes["log"].off = "nothing is recorded"
    (job,) = jobs(steps := plan(graph), fuse_nodes(steps), ticks=1)
    each = {group: (long[group] - short[group]) / (last - first) for group in short}
    return each | {"all": sum(each.values()), "messages": float(sum(len(node.inputs) for node in job.nodes))}


def fine_mesh(seconds: float) -> list[dict[str, object]]:
    """Best rate [Hz] without a recording, and size of a full recording [MB/s], of the kidney as a coarse and as a fine
    mesh file."""
    rows: list[dict[str, object]] = []
    with tempfile.TemporaryDirectory() as folder:
        launches = {}
        for count in VERTICES:
            mesh = surface_mesh("kidney", count)
            file = Path(folder) / f"{count}.ply"
            write_ply(file, mesh)
            over = (f"scene.surface.surface={file}", "collision.use=collision.Mesh")
            launches[len(mesh.triangles)] = find("kidney").but(place="fused", duration=seconds, overrides=over)
        best = dict.fromkeys(launches, 0.0)
        for _ in track(range(3), "fine mesh", transient=True):
            for triangles, launch in launches.items():
                result = execute(_unrecorded(launch)).result
                best[triangles] = max(best[triangles], result.ticks / result.wall)
        for triangles, launch in launches.items():
            record = Path(folder) / "touch.mcap"
            execute(dataclasses.replace(launch, record=record))
            size = record.stat().st_size / seconds
            rows.append({"triangles": triangles, "best [Hz]": best[triangles], "recording [MB/s]": 1e-6 * size})
    return rows


def first_tick() -> float:
    """Time [s] from the command to the first tick, with warm caches."""
    command = [sys.executable, "-m", "palpate.cli", "run", "kidney", "--no-record", "--json", "--duration", "0.05"]
    times = []
    for _ in track(range(3), "start", transient=True):
        begun = time.monotonic()
        printed = subprocess.run(command, capture_output=True, text=True, check=True)
        times.append(json.loads(printed.stdout)["origin"] - begun)
    return min(times)


def memory() -> dict[str, float]:
    """Proportional set size [MB] of each process during a run, in which shared pages count once."""
    launch = _unrecorded(find("kidney").but(duration=1.5))
    graph = launch.load()
    graph.nodes["log"].off = "nothing is recorded"
    sizes: dict[str, float] = {}

    def look(launcher: Launcher) -> None:
        if launcher.phase == "running" and len(sizes) < len(launcher.pids):
            for group, pid in launcher.pids.items():
                text = Path(f"/proc/{pid}/smaps_rollup")
                match = re.search(r"Pss:\s+(\d+)", text.read_text() if text.exists() else "")
                if match:
                    sizes[group] = int(match[1]) / 1024

    steps = plan(graph)
    Launcher(jobs(steps, launch.placement(steps), ticks=1500), show=look).run()
    return sizes


def _row(real: dict) -> dict[str, object]:
    """A run on the real clock as a row of the table."""
    asleep = real["control"]
    return {
        "place": real["place"],
        "Hz": round(real["rate"]),
        "ticks": real["ticks"],
        "skipped [%]": 100 * real["late"],
        "after the next tick [%]": 100 * real["held"],
        **{f"{key} [us]": 1e6 * real[key] for key in ("p50", "p99", "p999")},
        "processor time [us per tick]": real["processor"],
        "sleeper: missed [%]": 100 * asleep["missed"],
        **{f"late {key} [us]": 1e6 * asleep[key] for key in ("p50", "p99", "p999")},
    }


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--seconds", type=float, default=6.0, help="simulated time of each run")
    options.add_argument("--waits", action="store_true", help="only how often each process waits")
    given = options.parse_args()
    if given.waits:
        found = waits(given.seconds)
        if given.json:
            print(json.dumps(found))
            return
        show("waits per tick of each process, and messages between processes", [found], digits=3)
        return
    figures = {
        "machine": platform.platform(),
        "load": os.getloadavg()[0],
        "rates": rates(given.seconds),
        "fine mesh": fine_mesh(given.seconds),
        "real": [real_time(place, rate, given.seconds) for place, rate in REAL],
        "first tick": first_tick(),
        "memory": memory(),
    }
    if given.json:
        print(json.dumps(figures))
        return
    out = Console()
    rows = []
    for name in CASES:
        row = figures["rates"][name]
        times = {f"{key} [us]": 1e6 * row[key] for key in ("p50", "p99", "p999")}
        rows.append({"": name, "best [Hz]": row["best"], "median [Hz]": row["median"], **times})
    show("kidney loop, simulated time as fast as possible, and the time of a tick", rows)
    steps = figures["rates"]["steps"]
    out.print("step p50 \\[us]:", ", ".join(f"{name} {value * 1e6:.1f}" for name, value in steps.items()))
    show("the kidney as a mesh file, fused, simulated time", figures["fine mesh"])
    show("real clock, with a process that only sleeps in parallel", [_row(real) for real in figures["real"]], digits=3)
    for real in figures["real"]:
        queue = ", ".join(f"{group} {wait * 1e6:.1f}" for group, wait in real["control"]["queue"].items())
        out.print(f"wait for the core \\[us per tick], {real['place']}, {real['rate']:.0f} Hz: {queue}")
    for refused in {real["refused"] for real in figures["real"]} - {""}:
        out.print(f"refused by the system: {refused}")
    out.print(f"load of the machine at the end: {figures['load']:.1f}")
    out.print(f"from the command to the first tick: {figures['first tick']:.2f} s")
    sizes = figures["memory"]
    out.print(f"memory \\[MB]: {sum(sizes.values()):.0f} in all;", ", ".join(f"{n} {s:.0f}" for n, s in sizes.items()))


if __name__ == "__main__":
    main()
