"""Time of one hop between processes: nodes of palpate, compiled and in Python, compared with the same pattern in plain
pyzmq and in C.

A message travels around a ring of eight processes on one core; figures are medians per hop. palpate decodes, steps,
checks and encodes at each hop; the other programs only forward the bytes. The C program needs a compiler and ZeroMQ's
headers (Debian: libzmq3-dev); without them its row is missing.

    python benchmarks/hops.py [--turns N] [--json]
"""

from __future__ import annotations

import itertools
import multiprocessing
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Collection
from functools import partial
from pathlib import Path

import zmq
from tables import parser, print_tables

sys.path.insert(0, str(Path(__file__).parent))

COUNT, SIZE = 8, 200


def plain(turns: int, core: int) -> float:
    """Time [us] of a hop with pyzmq: one publisher and one subscriber per process, blocking."""
    context = multiprocessing.get_context("fork")
    answer = context.SimpleQueue()
    workers = [context.Process(target=_pass_on, args=(rank, turns, core, answer, os.getpid())) for rank in range(COUNT)]
    for worker in workers:
        worker.start()
    duration = answer.get()
    for worker in workers:
        worker.join()
    return duration / COUNT


def _pass_on(rank: int, turns: int, core: int, answer, key: int) -> None:
    os.sched_setaffinity(0, {core})
    context = zmq.Context()
    out, inbox = context.socket(zmq.XPUB), context.socket(zmq.SUB)
    out.bind(f"ipc://@plain-{key}-{rank}")
    inbox.connect(f"ipc://@plain-{key}-{(rank - 1) % COUNT}")
    inbox.subscribe(b"r")
    out.recv()
    if rank:
        for _ in range(turns):
            out.send(inbox.recv())
    else:
        data, times = b"r" * SIZE, []
        for _ in range(turns):
            begun = time.perf_counter_ns()
            out.send(data)
            inbox.recv()
            times.append(time.perf_counter_ns() - begun)
        answer.put(statistics.median(times) * 1e-3)
    context.destroy(linger=500)


def in_c(turns: int, core: int) -> float | None:
    """Time [us] of a hop in C; None if the program cannot be built."""
    compiler = shutil.which("cc")
    with tempfile.TemporaryDirectory() as folder:
        program = str(Path(folder) / "ring")
        source = str(Path(__file__).parent / "ring.c")
        built = compiler and subprocess.run([compiler, "-O2", source, "-o", program, "-lzmq"], capture_output=True)
        if not built or built.returncode:
            return None
        printed = subprocess.run(
            [program, str(COUNT), str(turns), str(core)], capture_output=True, text=True, check=True
        )
        return float(printed.stdout) / COUNT


def ours(turns: int, core: int, compiled: Collection[int]) -> float:
    """Time [us] of a hop in palpate with one process per node: the median tick over the number of nodes; compiled nodes
    run many ticks in a call, so the median is that of the calls.

    compiled  numbers of the compiled nodes
    """
    from palpate.launch.load.launchfile import LaunchFile
    from palpate.launch.run.execute import execute

    names = [f"n{i}" for i in range(COUNT)]
    forms = ["Compiled" if number in compiled else "" for number in range(COUNT)]
    lines = [f"  n0: {{use: relays.{forms[0]}FirstRelay, in: {{torque: {names[-1]}}}}}"]
    lines += [
        f"  {name}: {{use: relays.{form}Relay, in: {{torque: {before}}}}}"
        for (before, name), form in zip(itertools.pairwise(names), forms[1:], strict=True)
    ]
    with tempfile.TemporaryDirectory() as folder:
        graph = Path(folder) / "ring.yaml"
        graph.write_text("nodes:\n" + "\n".join(lines) + "\n")
        place = Path(folder) / "place.yaml"
        place.write_text("\n".join(f"{name}: {{nodes: [{name}], core: {core}}}" for name in names) + "\n")
        outcome = execute(LaunchFile(graph=graph, place=place, duration=turns / 1000.0))
    if not outcome.result.ok:
        raise SystemExit(str(outcome.result.deaths[0]))
    return outcome.result.health["n0"]["age"]["p50"] * 1e6 / COUNT


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--turns", type=int, default=5000)
    given = options.parse_args()
    core = max(os.sched_getaffinity(0))
    measures = {
        "C": in_c,
        "pyzmq": plain,
        "palpate, compiled": partial(ours, compiled=range(COUNT)),
        "palpate, one of eight in Python": partial(ours, compiled=[n for n in range(COUNT) if n != 4]),
        "palpate, in Python": partial(ours, compiled=()),
    }
    hops: dict[str, list[float]] = {name: [] for name in measures}
    for _ in range(3):  # alternating, so that other programs slow all of them equally
        for name, measure in measures.items():
            value = measure(given.turns, core)
            if value is not None:
                hops[name].append(value)
    best = {name: min(values) for name, values in hops.items() if values}
    base = best.get("C", best["pyzmq"])
    load = os.getloadavg()[0]
    part, whole = (best[f"palpate, {name}"] for name in ("one of eight in Python", "compiled"))
    python = whole + COUNT * (part - whole)
    rows = [{"": name, "us a hop": value, "ratio": value / base, "load": load} for name, value in best.items()]
    rows.append({"": "palpate, the one in Python", "us a hop": python, "ratio": python / base, "load": load})
    print_tables({"one hop between two processes on one core": rows}, given.json, digits=3)


if __name__ == "__main__":
    main()
