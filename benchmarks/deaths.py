"""Time from a fault of a node until the device has no torque, while the finger presses the kidney on the real clock.

    python benchmarks/deaths.py [--json] [--rate HZ] [--trials N] [--fault kill --fault spin ...] [--node tissue ...]

A node is killed (SIGKILL), stopped (SIGSTOP) or terminated (SIGTERM), or its step spins or sleeps forever. The table
lists the longest time of all trials until the device works without torque; for the device itself, until its last
sample; and for a kill, the time until the launcher reports it. Without `friction` the other nodes continue. Times begin
before the call that sends the signal, which may be preempted, so they are upper bounds. A trial is repeated if this
time is above 20 ms and the call took more than 1 ms, or if the recording lacks samples of the device.
"""

from __future__ import annotations

import dataclasses
import itertools
import json
import math
import os
import signal
import tempfile
import time
from pathlib import Path

from rich.progress import track
from tables import parser, show

from palpate.engine.provenance import about
from palpate.launch.load.launchfile import find
from palpate.launch.load.plan import plan
from palpate.launch.load.recording import set_recording
from palpate.launch.run.assign import jobs
from palpate.launch.run.launcher import Launcher
from palpate.records.reader import Recording

GOAL, UNSURE = 0.020, 1e-3  # [s]
TRIES = 10
FAULT_AT = 0.9  # [s] of the graph's clock: the hand holds the finger in the tissue
LASTS = 2.0  # [s]
NODES = ("device", "finger", "collision", "contact", "friction", "spread", "tissue", "controller", "statics")
RECORDED = ("device", "statics")  # other streams would make the logger slow on a busy machine
SIGNALS = {"kill": signal.SIGKILL, "stop": signal.SIGSTOP, "term": signal.SIGTERM}
FAULTS = (*SIGNALS, "spin", "hang")
FAULTY = """
import functools, time
from palpate.launch.load.classes import find_class

Shipped = find_class({use!r})

class Faulty(Shipped):
    @functools.wraps(Shipped.step)
    def step(self, *messages, **more):
        each = [one for given in messages for one in (given if isinstance(given, list) else [given])]
        if any(message is not None and message.tick >= {at} for message in each):
            with open({note!r}, "w") as file:
                file.write(str(time.monotonic()))
            while True:
                {how}
        return super().step(*messages, **more)
"""
"""Module of a node whose step writes the time [s] to a file and never returns."""


def worst(node: str, kind: str, folder: Path, rate: float, trials: int) -> dict[str, float]:
    """The longest times of some trials, see `fault`."""
    results = [fault(node, kind, folder, rate) for _ in range(trials)]
    return {name: max(result[name] for result in results) for name in results[0]}


def fault(node: str, kind: str, folder: Path, rate: float) -> dict[str, float]:
    """Time [s] from the fault to the report, and to the first sample of the device without torque (infinite: never)."""
    for _ in range(TRIES):
        result = once(node, kind, folder, rate)
        if result is not None and (result["unsure"] <= UNSURE or result["no torque"] <= GOAL):
            return result
    raise SystemExit(f"{node}, {kind}: {TRIES} runs without a usable trial; the machine is too busy")


def once(node: str, kind: str, folder: Path, rate: float) -> dict[str, float] | None:
    """As `fault`, with the duration of sending the signal [s], `unsure`; None if the run ended before the fault, or if
    the recording lacks samples."""
    file, note = folder / "run.mcap", folder / "note"
    note.unlink(missing_ok=True)
    launch = dataclasses.replace(find("kidney"), record=file).but(overrides=[f"rate={rate}"])
    if kind not in SIGNALS:
        launch = launch.but(overrides=[f"{node}.use={faulty(launch.load().nodes[node].use, kind, note, rate)}"])
    graph = launch.load()
    set_recording(graph, file, [name for name in NODES if name not in RECORDED])
    steps = plan(graph)
    work = jobs(steps, launch.placement(steps), clock="real", ticks=round(LASTS * rate), about=about(steps))
    times: dict[str, float] = {}

    def look(launcher: Launcher) -> None:
        if launcher.result.deaths:
            times.setdefault("report", time.monotonic())
        origin = launcher.result.origin
        if kind in SIGNALS and origin and "fault" not in times and time.monotonic() > origin + FAULT_AT:
            times["before"] = time.monotonic()
            os.kill(launcher.pids[node], SIGNALS[kind])
            times["fault"] = time.monotonic()

    launcher = Launcher(work, patience=0.5, show=look)
    launcher.run()
    if kind not in SIGNALS and note.is_file():
        times["before"] = times["fault"] = float(note.read_text())
    if "fault" not in times:
        return None
    recording = Recording(file)
    if any(recording.counts.get(name, {}).get("lost") for name in RECORDED if name != node):
        return None
    # samples carry the graph's clock, which is 0 at the first tick
    begun = times["before"] - launcher.origin * 1e-9
    torque = {m.tick: any(m.torques) for m in recording.messages("statics")}
    samples = [m for m in recording.messages("device") if m.time * 1e-9 > begun]
    free = [m.time * 1e-9 for m in samples if m.used == (-1,) or not torque.get(m.used[0], True)]
    if node == "device":
        free = [max((m.time * 1e-9 for m in samples), default=begun)]
    return {
        "report": times.get("report", math.nan) - times["before"],
        "no torque": free[0] - begun if free else math.inf,
        "unsure": times["fault"] - times["before"],
    }


def faulty(use: str, kind: str, note: Path, rate: float) -> str:
    """Write a module with a faulty subclass of a shipped class to the current folder; returns the text for `use:`."""
    how = {"spin": "pass", "hang": "time.sleep(1000.0)"}[kind]
    name = f"faulty_{use.replace('.', '_')}_{kind}"
    Path(f"{name}.py").write_text(FAULTY.format(use=use, at=round(FAULT_AT * rate), note=str(note), how=how))
    return f"{name}.Faulty"


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--fault", action="append", choices=FAULTS, help="only this fault; may be repeated")
    options.add_argument("--node", action="append", choices=NODES, help="only this node; may be repeated")
    options.add_argument("--trials", type=int, default=1, help="of each fault")
    options.add_argument("--rate", type=float, default=1000.0, help="base rate [Hz]")
    given = options.parse_args()
    kinds = given.fault or FAULTS
    rows = {}
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        for node, kind in track(list(itertools.product(given.node or NODES, kinds)), "faults", transient=True):
            rows.setdefault(node, {})[kind] = worst(node, kind, Path(folder), given.rate, given.trials)
    if given.json:
        print(json.dumps(rows))
        return
    shown = []
    for node, row in rows.items():
        gone = {kind: 1e3 * row[kind]["no torque"] for kind in kinds}
        report = {"kill reported": 1e3 * row["kill"]["report"]} if "kill" in row else {}
        shown.append({"node": node, **gone, **report})
    show(f"longest of {given.trials}: until the device works without torque [ms]", shown, digits=3)
    print(f"load of the machine at the end: {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
