"""What happens when a process of the kidney loop is killed while the finger presses, on the real clock.

    python benchmarks/deaths.py [--json]

For each node: time from the kill until the launcher reports the death, and until the device works without torque.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import signal
import tempfile
import time
from pathlib import Path

from rich.console import Console
from rich.progress import track
from rich.table import Table
from rich.text import Text

from palpate.launch.loading.launchfile import find
from palpate.launch.loading.plan import plan
from palpate.launch.recording.reader import Recording
from palpate.launch.running.about import about
from palpate.launch.running.execute import set_recording
from palpate.launch.running.jobs import jobs
from palpate.launch.running.launcher import Launcher

KILL_AT = 0.9  # [s] of the graph's clock: the hand holds the finger in the tissue
NODES = ("finger", "collision", "contact", "friction", "spread", "tissue", "controller", "statics")


def kill(node: str, file: Path) -> dict[str, float | None]:
    """[s] from the kill to the report, and to the first sample of the device without torque (None: never)."""
    launch = dataclasses.replace(find("kidney"), record=file)
    graph = launch.load()
    set_recording(graph, file)
    found = plan(graph)
    work = jobs(found, launch.placement(found), clock="real", ticks=2000, about=about(found))
    times: dict[str, float] = {}

    def look(launcher: Launcher) -> None:
        origin = launcher.result.origin
        if origin and "kill" not in times and time.monotonic() > origin + KILL_AT:
            times["kill"] = time.monotonic()
            os.kill(launcher.pids[node], signal.SIGKILL)

    launcher = Launcher(work, show=look, died=lambda _: times.setdefault("report", time.monotonic()))
    launcher.run()
    recording = Recording(file)
    first = next(iter(recording.messages("device")))
    # The graph's clock and the machine's differ by the tick 0; the device's samples carry the graph's.
    killed = times["kill"] - launcher.origin * 1e-9
    last = [m.time * 1e-9 for m in recording.messages("device") if m.used == (-1,) and m.time > first.time]
    after = [t for t in last if t > killed]
    return {"report": times["report"] - times["kill"], "no torque": after[0] - killed if after else None}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        rows = {node: kill(node, Path(folder) / "run.mcap") for node in track(NODES, "kills", transient=True)}
    if given.json:
        print(json.dumps(rows))
        return
    table = Table(title="after a kill", box=None)
    for title in ("node", "reported [ms]", "no torque [ms]"):
        table.add_column(Text(title), justify="right")
    for node, row in rows.items():
        gone = "stays" if row["no torque"] is None else f"{row['no torque'] * 1e3:.1f}"
        table.add_row(node, f"{row['report'] * 1e3:.1f}", gone)
    Console().print(table)


if __name__ == "__main__":
    main()
