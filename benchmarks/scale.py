"""From one touch to a million: time and memory of runs, ensembles and studies, on one machine and on a cluster.

    python benchmarks/scale.py [--lanes 1000 10000 100000] [--million] [--bodies MassSpring ReducedFE] [--duration 0.2]
    python benchmarks/scale.py --study [--points 200]

Each ensemble presses on the kidney in a separate process, writes the contact force of each 10th tick to a zarr store,
and prints processor time and wall time for each touch, and the largest resident memory. The first line is one touch by
`palpate.run`, with a recording. `--study` computes a study on this machine, on a Dask cluster of four workers with TLS,
and again while one of them is killed, and compares the bytes of the results.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import logging
import os
import resource
import signal
import subprocess
import sys
import tempfile
import threading
import time
import warnings
from pathlib import Path

import numpy as np

import palpate

TOUCH = ["scene.hand.begin=[0, 0, 0.1085]"]  # just above the surface, so that a short touch presses
MILLION = 1_000_000


def measure(lanes: int, body: str, duration: float, folder: Path) -> dict[str, float]:
    """Run an ensemble, or for `lanes` 0 one touch with `palpate.run`, in this process."""
    given = {"duration": duration, "sets": TOUCH, "tissue": f"deformation.{body}"}
    palpate.run("kidney", record=folder / "first.mcap", **given)  # loads kernels and meshes
    begun, used = time.perf_counter(), time.process_time()
    if lanes:
        over = {"tissue.stiffness" if body == "MassSpring" else "tissue.young": np.linspace(130, 390, lanes)}
        palpate.Ensemble("kidney", lanes, over, every=10, **given).run(out=folder / "touches.zarr", quiet=True)
    else:
        palpate.run("kidney", record=folder / "one.mcap", **given)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    return {"wall": time.perf_counter() - begun, "cpu": time.process_time() - used, "peak": peak}


def ensembles(given: argparse.Namespace) -> None:
    """Print time and memory of each body and number of lanes."""
    counts = [0, *given.lanes, *([MILLION] if given.million else [])]
    print(f"kidney, touches of {given.duration:g} s at 1 kHz; load average {os.getloadavg()[0]:.1f} on "
          f"{len(os.sched_getaffinity(0))} cores")  # fmt: skip
    print("body          touches      wall  processor time    a touch  a million  peak memory")
    for body in given.bodies:
        for lanes in counts:
            with tempfile.TemporaryDirectory() as folder:
                line = [sys.executable, __file__, "--measure", str(lanes), body, str(given.duration), folder]
                done = subprocess.run(line, stdout=subprocess.PIPE, text=True, check=True)
                got = json.loads(done.stdout.splitlines()[-1])
            each = got["cpu"] / max(lanes, 1)
            print(f"{body:<12}{max(lanes, 1):>9,}{got['wall']:>8.1f} s{got['cpu']:>14.2f} s{1e3 * each:>8.2f} ms"
                  f"{each * MILLION / 3600:>9.2f} h{got['peak'] / 1e6:>10.0f} MB", flush=True)  # fmt: skip


def digest(folder: Path) -> str:
    """Hash of the results in the folder of a study."""
    seen = hashlib.sha256((folder / "points.parquet").read_bytes())
    for file in sorted((folder / "curves.zarr").rglob("*")):
        seen.update(file.read_bytes() if file.is_file() else b"")
    return seen.hexdigest()[:12]


def studies(given: argparse.Namespace) -> None:
    """Print the time of a study in three ways, and whether the results have the same bytes."""
    from distributed import Client, LocalCluster, Security

    over = {"tissue.stiffness": {"linspace": [130, 390, given.points]}}
    keep = ["peak contact.force", "curve contact.force"]
    with tempfile.TemporaryDirectory() as scratch:
        folder, security = Path(scratch), Security.temporary()

        def run(name: str, executor: object = None, kill: int = 0) -> None:
            study = palpate.Study("kidney", over, keep, duration="6.3 s")
            if kill:
                threading.Timer(1.0, os.kill, (kill, signal.SIGKILL)).start()
            since = time.perf_counter()
            study.run(folder / name, executor)
            print(f"{name:<42}{time.perf_counter() - since:>8.1f} s   {digest(folder / name)}", flush=True)

        print(f"kidney, {given.points} points of 6.3 s; load average {os.getloadavg()[0]:.1f} on "
              f"{len(os.sched_getaffinity(0))} cores")  # fmt: skip
        run("this machine, a process for each core")
        cluster = LocalCluster(n_workers=4, threads_per_worker=1, protocol="tls", security=security,
                               dashboard_address=None, silence_logs=logging.CRITICAL)  # fmt: skip
        with cluster, Client(cluster) as client:
            palpate.Study("kidney", {"tissue.stiffness": {"linspace": [100, 120, 32]}}, keep, duration=0.1).run(
                folder / "warm", client
            )
            run("Dask, four workers, TLS", client)
            run("Dask, four workers, TLS, one of them killed", client, next(iter(client.run(os.getpid).values())))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--lanes", type=int, nargs="+", default=[1000, 10_000, 100_000])
    parser.add_argument("--million", action="store_true", help="also a million lanes")
    parser.add_argument("--bodies", nargs="+", default=["MassSpring"])
    parser.add_argument("--duration", type=float, default=0.2, help="[s] of simulated time a touch")
    parser.add_argument("--study", action="store_true", help="a study on this machine and on a cluster instead")
    parser.add_argument("--points", type=int, default=200, help="of the study")
    parser.add_argument("--measure", nargs=4, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.measure:
        warnings.simplefilter("ignore")
        lanes, body, duration, folder = given.measure
        print(json.dumps(measure(int(lanes), body, float(duration), Path(folder))))
    elif given.study:
        warnings.simplefilter("ignore")
        studies(given)
    else:
        ensembles(given)


if __name__ == "__main__":
    main()
