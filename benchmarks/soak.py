"""Long runs, many starts, several runs at once: does anything grow, slow down, fail to start, or differ?

    python benchmarks/soak.py [--fused 60] [--real 20] [--starts 300] [--at-once 8] [--json]

fused    minutes of the graph's clock of the kidney's touch, again and again in one process: memory, descriptors,
         threads, and the duration of a tick in the first and the last tenth
real     minutes of the same as processes on the real clock: the same of all its processes together
starts   starts and stops of the kidney as processes
at-once  runs side by side on the simulated clock: each must have the bytes of the fused run
"""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import tempfile
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import psutil
from rich.console import Console
from rich.progress import Progress
from tables import parser, tell

from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.records.reader import Recording

TOUCH = 6.3
"""[s] of the graph's clock: one touch of the kidney."""
SAMPLES = 200


def held(pid: int) -> dict[str, float]:
    """Memory [MB], descriptors and threads of a process and all below it."""
    sums = {"memory": 0.0, "descriptors": 0.0, "threads": 0.0}
    for one in {pid, *(child.pid for child in psutil.Process(pid).children(recursive=True))}:
        try:
            text = (Path("/proc") / str(one) / "smaps_rollup").read_text()
            # without pages of files: their share depends on who else on the machine has the same libraries open
            kinds = ("Pss_Anon:", "Pss_Shmem:")
            sums["memory"] += sum(int(text.split(kind)[1].split()[0]) for kind in kinds) / 1024
            sums["descriptors"] += len(os.listdir(f"/proc/{one}/fd"))
            sums["threads"] += len(os.listdir(f"/proc/{one}/task"))
        except (OSError, IndexError):
            continue
    return sums


def grown(name: str, minutes: float, looks: list[dict[str, float]]) -> dict[str, object]:
    """Means over the first and the last tenth of the looks, the first fifth left out: caches fill."""
    looks = looks[len(looks) // 5 :]
    tenth = max(1, len(looks) // 10)
    row: dict[str, object] = {"what": name, "minutes": round(minutes, 1)}
    for key in looks[0]:
        begin, end = (sum(look[key] for look in part) / len(part) for part in (looks[:tenth], looks[-tenth:]))
        row[key] = f"{begin:.4g} -> {end:.4g}"
    return row


def fused(minutes: float, tick) -> dict[str, object]:
    """One process, touch after touch."""
    looks: list[dict[str, float]] = []
    while (passed := TOUCH * len(looks)) < 60 * minutes:
        result = execute(find("kidney").but(place="fused", duration=TOUCH)).result
        assert result.ok, result.deaths
        looks.append(held(os.getpid()) | {"a tick [us]": 1e6 * result.wall / result.ticks})
        tick(passed / (60 * minutes))
    return grown("fused", minutes, looks) | {"touches": len(looks)}


def command(*more: str) -> list[str]:
    return [sys.executable, "-m", "palpate.cli", "run", "kidney", "--no-pictures", "--quiet", *more]


def real(minutes: float, tick) -> dict[str, object]:
    """Processes on the real clock, one run; the hand holds after its touch."""
    run = subprocess.Popen(command("--clock", "real", "--duration", str(60 * minutes), "--no-record", "--json"),
                           stdout=subprocess.PIPE, text=True)  # fmt: skip
    said: list[str] = []
    reader = threading.Thread(target=lambda: said.append(run.stdout.read()))
    reader.start()
    begun, looks = time.monotonic(), []
    while run.poll() is None:
        if len(looks) < SAMPLES:  # after that it ends
            looks.append(held(run.pid))
        tick((time.monotonic() - begun) / (60 * minutes))
        time.sleep(60 * minutes / SAMPLES)
    reader.join()
    assert run.returncode == 0, said
    return grown("processes, real clock", minutes, looks)


def starts(count: int, tick) -> dict[str, object]:
    """Starts and stops of 0.2 s each."""
    failed = 0
    for k in range(count):
        failed += subprocess.run(command("--duration", "0.2", "--no-record"), capture_output=True).returncode != 0
        tick((k + 1) / count)
    return {"what": "starts and stops", "runs": count, "failed": failed}


def digest(path: Path) -> str:
    """Of all messages of a recording."""
    recording, sums = Recording(path), hashlib.sha256()
    for stream in sorted(recording.streams):
        for _, _, payload in recording.payloads(stream):
            sums.update(payload)
    return sums.hexdigest()


def at_once(count: int, tick) -> dict[str, object]:
    """Runs side by side; the bytes of each against those of the fused run."""
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
    return {"what": "at once", "runs": count, "failed": digests.count("failed"),
            "same bytes as fused": digests.count(right)}  # fmt: skip


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--fused", type=float, default=60.0, help="minutes")
    options.add_argument("--real", type=float, default=20.0, help="minutes")
    options.add_argument("--starts", type=int, default=300)
    options.add_argument("--at-once", type=int, default=8)
    given = options.parse_args()
    rows = []
    with Progress(console=Console(stderr=True)) as progress:
        for work, size in ((fused, given.fused), (real, given.real), (starts, given.starts), (at_once, given.at_once)):
            if size:
                task = progress.add_task(work.__name__, total=1.0)
                rows.append(work(size, lambda share, task=task: progress.update(task, completed=share)))
                progress.update(task, completed=1.0)
    tell({"Long runs: first tenth -> last tenth": rows}, given.json)


if __name__ == "__main__":
    main()
