"""What recording and replaying cost: rate of the kidney graph with and without, bytes a second, speed of replay
and of the check, and the memory of a replay of a long file beside that of a short one.

    python benchmarks/recording.py [--minutes M] [--seconds S] [--json]

Rates are medians of interleaved runs on simulated time, as fast as the machine allows.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute

ROUNDS = 3


def rate(seconds: float, record: Path | None, place: str | None) -> float:
    """[Hz] ticks a second of one run of the kidney graph."""
    outcome = execute(dataclasses.replace(find("kidney").but(duration=seconds, place=place), record=record))
    if not outcome.result.ok:
        raise SystemExit(str(outcome.result.deaths[0]))
    return outcome.result.ticks / outcome.result.wall


def overhead(seconds: float, folder: Path) -> dict[str, dict[str, float]]:
    """Rates with and without recording, of one process and of a process per node."""
    rates: dict[str, dict[str, float]] = {}
    for name, place in (("fused", "fused"), ("processes", None)):
        without, with_it = [], []
        for _ in range(ROUNDS):  # interleaved, so that a busy neighbour troubles both
            without.append(rate(seconds, None, place))
            with_it.append(rate(seconds, folder / f"{name}.mcap", place))
        a, b = statistics.median(without), statistics.median(with_it)
        rates[name] = {"without_Hz": a, "with_Hz": b, "ratio": b / a}
    return rates


def replayed(path: Path, *options: str) -> dict[str, float]:
    """Multiple of real time and peak memory [MB] of `palpate replay`, in a process of its own."""
    command = [sys.executable, "-m", "palpate.launch", "replay", str(path), "--json", *options]
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


def main(given: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--minutes", type=float, default=0.5, help="length of the long recording")
    parser.add_argument("--seconds", type=float, default=4.0, help="of simulated time, each run of the overhead")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args(given)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        figures: dict[str, object] = {"overhead": overhead(options.seconds, folder)}
        short, long = folder / "short.mcap", folder / "long.mcap"
        for path, seconds in ((short, 2.0), (long, options.minutes * 60)):
            rate(seconds, path, "fused")
        seconds = options.minutes * 60
        figures["recording"] = {"seconds": seconds, "kB_per_s": long.stat().st_size / seconds / 1e3}
        figures["replay short"] = replayed(short)
        figures["replay long"] = replayed(long)
        figures["check long"] = {**(check := replayed(long, "--check")), "speed": seconds / check["cpu_s"]}
    if options.json:
        print(json.dumps(figures))
        return
    _print(figures)


def _print(figures: dict) -> None:
    out = Console()
    table = Table(title="ticks a second of the kidney graph", box=None)
    for title in ("", "without", "with recording", "ratio"):
        table.add_column(title, justify="right")
    for name, row in figures["overhead"].items():
        table.add_row(name, f"{row['without_Hz']:.0f}", f"{row['with_Hz']:.0f}", f"{row['ratio']:.2f}")
    out.print(table)
    size = figures["recording"]
    out.print(f"recording of {size['seconds']:.0f} s: {size['kB_per_s']:.0f} kB a second of simulated time")
    for name in ("replay short", "replay long", "check long"):
        row = figures[name]
        out.print(f"{name}: {row['speed']:.1f} x real time, peak memory {row['memory_MB']:.0f} MB")


if __name__ == "__main__":
    main()
