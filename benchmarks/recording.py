"""What recording and replaying cost: rate of the kidney graph with and without, bytes a second, speed of replay
and of the check, and the memory of a replay of a long file beside that of a short one.

    python benchmarks/recording.py [--minutes M] [--seconds S] [--json]

Rates are medians of interleaved runs on simulated time, as fast as the machine allows. No node reads the shape of the
surface: without a recording nobody computes it. So a third rate is that of a run that computes all and keeps nothing.
"""

from __future__ import annotations

import dataclasses
import json
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from tables import parser, show

from palpate.launch.load.launchfile import ALL, SOURCES, find
from palpate.launch.load.plan import plan
from palpate.launch.run.execute import execute

ROUNDS = 5
NOTHING, COMPUTED = "without", "computed"
"""Not recorded; and a recording that leaves out every stream."""


def rate(seconds: float, record: Path | None, place: str | None, only: str | None = None) -> tuple[float, float]:
    """Ticks a second [Hz] of one run of the kidney graph, and processor time a tick [s], user and system."""
    kept = {"only": only} if only in (SOURCES, ALL) else {}
    launch = dataclasses.replace(find("kidney").but(duration=seconds, place=place, **kept), record=record)
    graph = launch.load()
    streams = [stream for name in plan(graph).order for stream in graph.nodes[name].streams]
    before = os.times()
    outcome = execute(launch, leave_out=streams if only == COMPUTED else ())
    spent = sum(os.times()[:4]) - sum(before[:4])
    if not outcome.result.ok:
        raise SystemExit(str(outcome.result.deaths[0]))
    return outcome.result.ticks / outcome.result.wall, spent / outcome.result.ticks


def overhead(seconds: float, folder: Path) -> dict[str, dict[str, float]]:
    """Rates with and without recording, of one process and of a process per node; ratios are medians of pairs that run
    one after the other. Processor time has the start of the run in it."""
    rates: dict[str, dict[str, float]] = {}
    for name, place in (("fused", "fused"), ("processes", None)):
        rate(seconds, None, place)
        runs: dict[str, list[tuple[float, float]]] = {NOTHING: [], COMPUTED: [], SOURCES: [], ALL: []}
        for _ in range(ROUNDS):  # interleaved, so that a busy neighbour troubles both
            for only, made in runs.items():
                made.append(rate(seconds, None if only == NOTHING else folder / f"{name}.mcap", place, only))
        for only, base in ((SOURCES, NOTHING), (ALL, NOTHING), (ALL, COMPUTED)):
            pairs = list(zip(runs[base], runs[only], strict=True))
            rates[f"{name}, {only}" + (", all computed in both" if base == COMPUTED else "")] = {
                "without_Hz": statistics.median(a for a, _ in runs[base]),
                "with_Hz": statistics.median(b for b, _ in runs[only]),
                "ratio": statistics.median(b[0] / a[0] for a, b in pairs),
                "processor_ratio": statistics.median(a[1] / b[1] for a, b in pairs),
            }
    return rates


def replayed(path: Path, *options: str) -> dict[str, float]:
    """Multiple of real time and peak memory [MB] of `palpate replay`, in a process of its own."""
    command = [sys.executable, "-m", "palpate.cli", "replay", str(path), "--json", *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        told = json.loads(process.stdout.read())
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{' '.join(command)}: exit code {process.returncode}")
    figures = {"memory_MB": usage.ru_maxrss / 1024, "cpu_s": usage.ru_utime + usage.ru_stime}
    if "wall" in told:
        figures["speed"] = told["seconds"] / told["wall"]
    return figures


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--minutes", type=float, default=0.5, help="length of the long recording")
    options.add_argument("--seconds", type=float, default=4.0, help="of simulated time, each run of the overhead")
    given = options.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        figures: dict[str, object] = {"overhead": overhead(given.seconds, folder)}
        short, long, sources = folder / "short.mcap", folder / "long.mcap", folder / "sources.mcap"
        seconds = given.minutes * 60
        for path, length, only in ((short, 2.0, ALL), (long, seconds, ALL), (sources, seconds, SOURCES)):
            rate(length, path, "fused", only)
        for name, path in (("recording", long), ("recording of sources", sources)):
            figures[name] = {"seconds": seconds, "kB_per_s": path.stat().st_size / seconds / 1e3}
        figures["replay short"] = replayed(short)
        figures["replay long"] = replayed(long)
        figures["check long"] = {**(check := replayed(long, "--check")), "speed": seconds / check["cpu_s"]}
    if given.json:
        print(json.dumps(figures))
        return
    _print(figures)


def _print(figures: dict) -> None:
    names = {
        "without_Hz": "without",
        "with_Hz": "with recording",
        "ratio": "ratio",
        "processor_ratio": "by processor time",
    }
    rows = [{"": name} | {names[key]: row[key] for key in names} for name, row in figures["overhead"].items()]
    show("ticks a second of the kidney graph", rows)
    for name in ("recording", "recording of sources"):
        size = figures[name]
        print(f"{name}, {size['seconds']:.0f} s: {size['kB_per_s']:.0f} kB a second of simulated time")
    for name in ("replay short", "replay long", "check long"):
        row = figures[name]
        print(f"{name}: {row['speed']:.1f} x real time, peak memory {row['memory_MB']:.0f} MB")


if __name__ == "__main__":
    main()
