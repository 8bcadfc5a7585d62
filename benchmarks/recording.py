"""Cost of recording and replay: rate of the kidney graph, size of files, speed of replay and check, memory of a replay.

    python benchmarks/recording.py [--minutes M] [--seconds S] [--json] [--processor-time] [--real]

Rates are medians of alternating runs on simulated time, as fast as the machine allows: without a recording, with
sources only, and with all streams. Without a recording the shape of the surface is not computed, because no node reads
it. So a fourth run computes all streams but records none. The memory of a replay is that of a long and of a short file.

--processor-time prints only the processor time of a tick in one process, which other programs change less than rates:
of the thread that runs the ticks, and of all threads. It is that of a long run minus that of a short one. The last rows
are lower bounds for any recorder: the time to copy, check and compress the bytes of a tick once.
"""

from __future__ import annotations

import dataclasses
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import zstandard
from control import missed
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from tables import parser, show

from palpate.launch.load.launchfile import ALL, SOURCES, find
from palpate.launch.load.placement import AUTO
from palpate.launch.load.plan import plan
from palpate.launch.run.assign import PRIORITY, cores_of
from palpate.launch.run.execute import execute
from palpate.records.format.mcap_writer import CHUNK_SIZE, LEVEL
from palpate.records.reader import Recording

ROUNDS = 5
REAL, REPEATED = 5000.0, 8  # [Hz], and runs on the real clock
SHORT, LONG = 0.5, 6.0  # [s] simulated time of the runs for the processor time
BODIES = ("MassSpring", "ReducedFE")
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


def processor_time(body: str, folder: Path) -> dict[str, dict[str, float]]:
    """Processor time [us] of a tick with this body: of its thread, and of all threads; the least of several runs."""
    path = folder / "time.mcap"
    launch = find("kidney").but(place="fused", overrides=(f"tissue.use=deformation.{body}",), only=ALL)
    graph = launch.load()
    streams = [stream for name in plan(graph).order for stream in graph.nodes[name].streams]

    def used(seconds: float, only: str) -> tuple[float, ...]:
        this = dataclasses.replace(launch.but(duration=seconds), record=None if only == NOTHING else path)
        before = time.thread_time(), time.process_time()
        result = execute(this, leave_out=streams if only == COMPUTED else ()).result
        after = time.thread_time(), time.process_time()
        return *(b - a for a, b in zip(before, after, strict=True)), result.ticks

    times: dict[str, list[list[tuple[float, ...]]]] = {name: [] for name in (NOTHING, COMPUTED, ALL)}
    for _ in range(ROUNDS + 1):  # the first round loads the kernels
        for only, made in times.items():
            made.append([used(SHORT, only), used(LONG, only)])
    rows = {}
    for only, made in times.items():
        short, long = (np.min(one, axis=0) for one in zip(*made[1:], strict=True))
        thread, every = 1e6 * (long - short)[:2] / (long - short)[2]
        rows[f"{body}, {only}"] = {"thread": thread, "all": every}
    return rows | {f"{body}, {name}": {"all": value} for name, value in least(path).items()}


def least(path: Path) -> dict[str, float]:
    """Processor time [us per tick] to copy, check and compress the chunks of a recording once."""
    with open(path, "rb") as file:
        chunks = [record for record in StreamReader(file, emit_chunks=True).records if isinstance(record, Chunk)]
    data = [zstandard.decompress(chunk.data, max_output_size=chunk.uncompressed_size) for chunk in chunks]
    to, ticks = np.empty(4 * CHUNK_SIZE, np.uint8), 1000.0 * LONG

    def copy(data: bytes) -> None:
        to[: len(data)] = np.frombuffer(data, np.uint8)

    def spent(work: Callable[[bytes], object]) -> float:
        begun = time.process_time()
        for each in data:
            work(each)
        return 1e6 * (time.process_time() - begun) / ticks

    size = sum(map(len, data)) / ticks
    return {
        f"copy of {1e-3 * size:.1f} kB": min(spent(copy) for _ in range(ROUNDS)),
        "crc32": min(spent(zlib.crc32) for _ in range(ROUNDS)),
        f"zstd {LEVEL}": min(spent(zstandard.ZstdCompressor(level=LEVEL).compress) for _ in range(ROUNDS)),
    }


def left_out(seconds: float, record: Path | None) -> dict[str, float]:
    """Shares [%] of the ticks that a run on the real clock leaves out, and of the messages that its recording lacks."""
    launch = find("kidney").but(duration=seconds, place=AUTO, clock="real", overrides=(f"rate={REAL}",), only=ALL)
    outcome = execute(dataclasses.replace(launch, record=record))
    if not outcome.result.ok:
        raise SystemExit(str(outcome.result.deaths[0]))
    device = outcome.result.health["device"]
    shares = {"ticks": 100 * device["late"] / (device["steps"] + device["late"])}
    if record is not None:
        counts = Recording(record).counts.values()
        lost = sum(each["lost"] for each in counts)
        shares["messages"] = 100 * lost / (lost + sum(each["count"] for each in counts))
    return shares


def asleep(seconds: float) -> dict[str, float]:
    """Share [%] of the ticks that a process misses that only sleeps, with the core and priority of the force path."""
    lateness = missed(seconds, cores_of(True, False, 2), PRIORITY + 1, 1.0 / REAL)
    return {"ticks": 100 * lateness.missed}


def on_real_clock(seconds: float, folder: Path) -> dict[str, dict[str, list[float]]]:
    """Shares [%] of ticks and messages that are left out, of each run."""
    cases: dict[str, Callable[[], dict[str, float]]] = {
        "a process that only sleeps": lambda: asleep(seconds),
        NOTHING: lambda: left_out(seconds, None),
        ALL: lambda: left_out(seconds, folder / "real.mcap"),
    }
    found: dict[str, dict[str, list[float]]] = {name: {} for name in cases}
    for _ in range(REPEATED):
        for name, measured in cases.items():
            for key, share in measured().items():
                found[name].setdefault(key, []).append(share)
    return found


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
    options.add_argument("--processor-time", action="store_true", help="only the processor time of a tick")
    options.add_argument("--real", action="store_true", help="only what the real clock leaves out at 5 kHz")
    given = options.parse_args()
    if not given.seconds > 0.0 or not given.minutes > 0.0:
        options.error(f"--seconds, --minutes: found {given.seconds:g} and {given.minutes:g}, expected more than 0")
    if given.real:
        with tempfile.TemporaryDirectory() as name:
            shares = on_real_clock(given.seconds, Path(name))
        if given.json:
            print(json.dumps(shares))
            return
        _print_left_out(shares)
        return
    if given.processor_time:
        with tempfile.TemporaryDirectory() as name:
            times = {key: row for body in BODIES for key, row in processor_time(body, Path(name)).items()}
        if given.json:
            print(json.dumps(times))
            return
        titles = {"thread": "thread of the tick", "all": "all threads"}
        rows = [{"": name} | {titles[key]: row.get(key, "") for key in titles} for name, row in times.items()]
        show("processor time [us] of a tick of the kidney graph in one process", rows)
        return
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


def _print_left_out(shares: dict[str, dict[str, list[float]]]) -> None:
    title = f"left out at {REAL:.0f} Hz on the real clock, --place auto: median, least to most of {REPEATED} runs"
    columns = ("ticks", "messages")
    show(title, [{"": name} | {f"{key} [%]": _range(row.get(key)) for key in columns} for name, row in shares.items()])


def _range(shares: list[float] | None) -> str:
    return f"{statistics.median(shares):.2f}, {min(shares):.2f} to {max(shares):.2f}" if shares else ""


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
