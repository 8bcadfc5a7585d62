"""Leaks, slowdown, failed starts and different results in long runs, many starts and parallel runs of the kidney.

    python benchmarks/soak.py [--fused 60] [--real 20] [--rate 1000] [--day 24] [--starts 300] [--at-once 8] [--json]

fused    minutes of simulated time: the touch is repeated in one process. Memory, descriptors, threads and the duration
         of a tick, means over the first and the last 10 % after the first fifth, in which caches fill
real     minutes on the real clock with one process per node, at this rate [Hz]: the same figures, summed over all
         processes
day      hours of simulated time in one run of 1 kHz, with a touch each five minutes and one of 1000 messages
         recorded: the same figures, and the largest difference of a touch's forces from those of the first
starts   number of starts and stops with one process per node
at-once  number of parallel runs on the simulated clock; each must record the bytes of a fused run
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np
import psutil
from rich.console import Console
from rich.progress import Progress
from tables import parser, print_tables

from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.records.reader import Recording

TOUCH = 6.3
"""[s] Simulated time of one touch of the kidney."""
SAMPLES = 200
TOUCHES = [{"hold": 0.2}, {"to": [0, 0, 0.104], "time": 0.8}, {"to": [0.01, 0, 0.104], "time": 2},
          {"to": [0, 0, 0.104], "time": 2}, {"to": [0, 0, 0.116], "time": 1}, {"hold": 294}]  # fmt: skip
"""A touch of the kidney in five minutes, fewer than a launch file may have entries for in a day."""
BYTES = 100e3
"""[B] Some size of the recording of a touch, for the bar of progress."""


def usage(pid: int) -> dict[str, float]:
    """Memory [MB], descriptors and threads of a process and its descendants."""
    sums = {"memory": 0.0, "descriptors": 0.0, "threads": 0.0}
    for one in {pid, *(child.pid for child in psutil.Process(pid).children(recursive=True))}:
        try:
            text = (Path("/proc") / str(one) / "smaps_rollup").read_text()
            # without pages of files: their share depends on the other processes that map the same libraries
            kinds = ("Pss_Anon:", "Pss_Shmem:")
            sums["memory"] += sum(int(text.split(kind)[1].split()[0]) for kind in kinds) / 1024
            sums["descriptors"] += len(os.listdir(f"/proc/{one}/fd"))
            sums["threads"] += len(os.listdir(f"/proc/{one}/task"))
        except (OSError, IndexError):
            continue
    return sums


def growth(name: str, minutes: float, samples: list[dict[str, float]]) -> dict[str, object]:
    """Means over the first and the last 10 % of the samples, without the first 20 %, in which caches fill."""
    samples = samples[len(samples) // 5 :]
    tenth = max(1, len(samples) // 10)
    row: dict[str, object] = {"test": name, "minutes": round(minutes, 1)}
    for key in samples[0]:
        begin, end = (sum(sample[key] for sample in part) / len(part) for part in (samples[:tenth], samples[-tenth:]))
        row[key] = f"{begin:.4g} -> {end:.4g}"
    return row


def fused(minutes: float, tick) -> dict[str, object]:
    """Repeat the touch in one process."""
    samples: list[dict[str, float]] = []
    while (passed := TOUCH * len(samples)) < 60 * minutes:
        result = execute(find("kidney").but(place="fused", duration=TOUCH)).result
        assert result.ok, result.deaths
        samples.append(usage(os.getpid()) | {"a tick [us]": 1e6 * result.wall / result.ticks})
        tick(passed / (60 * minutes))
    return growth("fused", minutes, samples) | {"touches": len(samples)}


def command(*more: str) -> list[str]:
    return [sys.executable, "-m", "palpate.cli", "run", "kidney", "--no-pictures", "--quiet", *more]


def real(minutes: float, tick, rate: float) -> dict[str, object]:
    """One run on the real clock, one process per node; after its touch the hand stays still."""
    more = ("--clock", "real", "--place", "apart", "--set", f"rate={rate}", "--duration", str(60 * minutes))
    run = subprocess.Popen(command(*more, "--no-record", "--json"), stdout=subprocess.PIPE, text=True)
    printed: list[str] = []
    reader = threading.Thread(target=lambda: printed.append(run.stdout.read()))
    reader.start()
    begun, samples = time.monotonic(), []
    while run.poll() is None:
        if len(samples) < SAMPLES:  # later samples would show processes that end
            samples.append(usage(run.pid))
        tick((time.monotonic() - begun) / (60 * minutes))
        time.sleep(max(0.01, begun + len(samples) * 60 * minutes / SAMPLES - time.monotonic()))
    reader.join()
    assert run.returncode == 0, printed
    return growth(f"processes, real clock, {rate:.0f} Hz", minutes, samples)


def day(hours: float, tick) -> dict[str, object]:
    """One long run: each touch has the forces of the first."""
    touches = max(2, round(12 * hours))
    with tempfile.TemporaryDirectory() as name:
        launch, file = Path(name) / "day.yaml", Path(name) / "day.mcap"
        scene = {"extends": "kidney", "hand": {"path": TOUCHES * touches}}
        launch.write_text(json.dumps({"graph": "kidney", "scene": scene, "duration": 300.0 * touches}))
        thin = [word for stream in find("kidney").load().streams for word in ("--thin", f"{stream}=1000")]
        run = subprocess.Popen([
            sys.executable, "-m", "palpate.cli", "run", str(launch), "--fused", "--record", str(file), "--no-pictures",
            "--quiet", *thin,
        ], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)  # fmt: skip
        begun, samples, sizes = time.monotonic(), [], []
        while run.poll() is None:
            if file.exists() and (size := file.stat().st_size) > (sizes[-1] if sizes else 0):
                samples.append(usage(run.pid) | {"time": time.monotonic()})
                sizes.append(size)
                tick(min(1.0, (size / BYTES / touches)))
            time.sleep(0.5)
        assert run.returncode == 0, run.stdout and run.stdout.read()
        ticks = np.diff(sizes) / sizes[-1] * 300e3 * touches
        passed = np.diff([sample.pop("time") for sample in samples])
        samples = [
            sample | {"a tick [us]": 1e6 * t / n}
            for sample, t, n in zip(samples[1:-1], passed, ticks[:-1], strict=False)
        ]
        force = Recording(file).columns("contact")["force"].reshape(touches, 300)
    worst = np.abs(force - force[0]).max()
    return growth("one run", (time.monotonic() - begun) / 60, samples) | {
        "hours": touches / 12, "touches": touches, "largest force [N]": f"{force.max():.4f}",
        "largest difference [N]": f"{worst:.1g}",
    }  # fmt: skip


def starts(count: int, tick) -> dict[str, object]:
    """Start and stop runs of 0.2 s."""
    failed = 0
    for k in range(count):
        failed += subprocess.run(command("--duration", "0.2", "--no-record"), capture_output=True).returncode != 0
        tick((k + 1) / count)
    return {"test": "starts and stops", "runs": count, "failed": failed}


def digest(path: Path) -> str:
    """SHA-256 over all messages of a recording."""
    recording, sums = Recording(path), hashlib.sha256()
    for stream in sorted(recording.streams):
        for _, _, payload in recording.payloads(stream):
            sums.update(payload)
    return sums.hexdigest()


def at_once(count: int, tick) -> dict[str, object]:
    """Parallel runs: number that failed, and number whose messages have the bytes of a fused run."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        subprocess.run(
            command("--fused", "--duration", "2", "--record", str(folder / "fused.mcap")),
            check=True,
            capture_output=True,
        )
        right = digest(folder / "fused.mcap")

        def one(k: int) -> str:
            file = folder / f"{k}.mcap"
            done = subprocess.run(command("--duration", "2", "--record", str(file)), capture_output=True)
            return digest(file) if done.returncode == 0 else "failed"

        with ThreadPoolExecutor(count) as pool:
            digests = list(pool.map(one, range(count)))
        tick(1.0)
    return {"test": "parallel runs", "runs": count, "failed": digests.count("failed"),
            "same bytes as fused": digests.count(right)}  # fmt: skip


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--fused", type=float, default=60.0, help="minutes")
    options.add_argument("--real", type=float, default=20.0, help="minutes")
    options.add_argument("--rate", type=float, default=1000.0, help="[Hz] of the run on the real clock")
    options.add_argument("--day", type=float, default=24.0, help="hours of simulated time in one run")
    options.add_argument("--starts", type=int, default=300)
    options.add_argument("--at-once", type=int, default=8)
    given = options.parse_args()
    rows = []
    with Progress(console=Console(stderr=True)) as progress:
        works = {
            "fused": (fused, given.fused), "real": (partial(real, rate=given.rate), given.real),
            "day": (day, given.day), "starts": (starts, given.starts), "at once": (at_once, given.at_once),
        }  # fmt: skip
        for name, (work, size) in works.items():
            if size:
                task = progress.add_task(name, total=1.0)
                rows.append(work(size, lambda share, task=task: progress.update(task, completed=share)))
                progress.update(task, completed=1.0)
    print_tables({"Long runs: first 10 % -> last 10 %": rows}, given.json)


if __name__ == "__main__":
    main()
