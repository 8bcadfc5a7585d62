"""Cost of recording and replay: rate of the kidney graph, size of files, speed of replay and check, memory of a replay.

    python benchmarks/recording.py [--minutes M] [--seconds S] [--json]

Rates are medians of alternating runs on simulated time, as fast as the machine allows: without a recording, with
sources only, and with all streams. Without a recording the shape of the surface is not computed, because no node reads
it. So a fourth run computes all streams but records none. The memory of a replay is that of a long and of a short file.
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
"""No recording; a recording without any stream, so that all streams are computed."""


def rate(seconds: float, record: Path | None, place: str | None, only: str | None = None) -> tuple[float, float]:
    """Ticks per second of one run of the kidney graph, and processor time per tick [s], user and system."""
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
    """Rates with and without recording, fused and with one process per node.

    Ratios are medians over pairs of consecutive runs. Processor time includes the start of the run.
    """
    rates: dict[str, dict[str, float]] = {}
    for name, place in (("fused", "fused"), ("processes", None)):
        rate(seconds, None, place)
        runs: dict[str, list[tuple[float, float]]] = {NOTHING: [], COMPUTED: [], SOURCES: [], ALL: []}
        for _ in range(ROUNDS):  # alternating, so that other programs slow all of them equally
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
    """Multiple of real time and peak memory [MB] of `palpate replay` in a separate process."""
    command = [sys.executable, "-m", "palpate.cli", "replay", str(path), "--json", *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        summary = json.loads(process.stdout.read())
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{' '.join(command)}: exit code {process.returncode}")
    figures = {"memory_MB": usage.ru_maxrss / 1024, "cpu_s": usage.ru_utime + usage.ru_stime}
    if "wall" in summary:
        figures["speed"] = summary["seconds"] / summary["wall"]
    return figures


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--minutes", type=float, default=0.5, help="length of the long recording")
    options.add_argument("--seconds", type=float, default=4.0, help="simulated time of each run for the overhead")
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
    show("ticks per second of the kidney graph", rows)
    for name in ("recording", "recording of sources"):
        size = figures[name]
        print(f"{name}, {size['seconds']:.0f} s: {size['kB_per_s']:.0f} kB per second of simulated time")
    for name in ("replay short", "replay long", "check long"):
        row = figures[name]
        print(f"{name}: {row['speed']:.1f} x real time, peak memory {row['memory_MB']:.0f} MB")


if __name__ == "__main__":
    main()
