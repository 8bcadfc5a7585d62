"""What happens when a process of the kidney loop is killed or stopped while the finger presses, on the real clock.

    python benchmarks/deaths.py [--json]

For each node: time from the kill until the launcher reports the death, and until the device works without torque; and
the latter after SIGSTOP, which looks to the others like a node that hangs. Without `friction` the others go on. Where
the system took this program off the processor while it sent the signal, so that the moment is not known to 1 ms, the
fault is made again.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import os
import signal
import tempfile
import time
from pathlib import Path

from rich.console import Console
from rich.progress import track
from rich.table import Table
from rich.text import Text

from palpate.engine.plan import plan
from palpate.engine.provenance import about
from palpate.launch.load.launchfile import find
from palpate.launch.run.assign import jobs
from palpate.launch.run.execute import set_recording
from palpate.launch.run.launcher import Launcher
from palpate.records.reader import Recording

UNSURE = 1e-3  # [s]
KILL_AT = 0.9  # [s] of the graph's clock: the hand holds the finger in the tissue
NODES = ("finger", "collision", "contact", "friction", "spread", "tissue", "controller", "statics")


def fault(node: str, number: int, file: Path) -> dict[str, float | None]:
    """[s] from the signal to the report, and to the first sample of the device without torque (None: never)."""
    while (told := once(node, number, file))["unsure"] > UNSURE:
        pass
    return told


def once(node: str, number: int, file: Path) -> dict[str, float | None]:
    """See `fault`; `unsure` [s]: how long sending the signal took."""
    launch = dataclasses.replace(find("kidney"), record=file)
    graph = launch.load()
    set_recording(graph, file)
    steps = plan(graph)
    work = jobs(steps, launch.placement(steps), clock="real", ticks=2000, about=about(steps))
    times: dict[str, float] = {}

    def look(launcher: Launcher) -> None:
        if launcher.result.deaths:
            times.setdefault("report", time.monotonic())
        origin = launcher.result.origin
        if origin and "kill" not in times and time.monotonic() > origin + KILL_AT:
            times["before"] = time.monotonic()
            os.kill(launcher.pids[node], number)
            times["kill"] = time.monotonic()

    launcher = Launcher(work, patience=0.5, show=look)
    launcher.run()
    recording = Recording(file)
    first = next(iter(recording.messages("device")))
    # The graph's clock and the machine's differ by the tick 0; the device's samples carry the graph's.
    killed = times["kill"] - launcher.origin * 1e-9
    torque = {m.tick: max(map(abs, m.torques)) for m in recording.messages("statics")}
    last = [
        m.time * 1e-9
        for m in recording.messages("device")
        if m.time > first.time and (m.used == (-1,) or torque.get(m.used[0], 1.0) == 0.0)
    ]
    after = [t for t in last if t > killed]
    return {
        "report": times.get("report", math.nan) - times["kill"],
        "no torque": after[0] - killed if after else None,
        "unsure": times["kill"] - times["before"],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    rows = {}
    with tempfile.TemporaryDirectory() as folder:
        for node in track(NODES, "faults", transient=True):
            killed, stopped = (
                fault(node, number, Path(folder) / "run.mcap") for number in (signal.SIGKILL, signal.SIGSTOP)
            )
            rows[node] = {**killed, "no torque, stopped": stopped["no torque"]}
    if given.json:
        print(json.dumps(rows))
        return
    table = Table(title="after a kill, and after a stop", box=None)
    for title in ("node", "kill reported [ms]", "killed: no torque [ms]", "stopped: no torque [ms]"):
        table.add_column(Text(title), justify="right")
    for node, row in rows.items():
        gone = ("stays" if row[key] is None else f"{row[key] * 1e3:.1f}" for key in ("no torque", "no torque, stopped"))
        table.add_row(node, f"{row['report'] * 1e3:.1f}", *gone)
    Console().print(table)
    print(f"load of the machine at the end: {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
