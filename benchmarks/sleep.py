"""Time saved by nodes that sleep at rest: fused graphs with and without sleep, in alternating runs.

    python benchmarks/sleep.py [--turns N] [--json]

The time of a tick is the mean over a run without recording, the least of N runs. "torques" compares the torques of the
device byte for byte; "asleep" is the share of a node's steps that it slept.
"""

from __future__ import annotations

import dataclasses
import tempfile
from pathlib import Path

from rich.progress import track
from tables import parser, print_tables

from palpate.engine.slot import Slot
from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.launch.run.result import Result
from palpate.records.reader import Recording

GRAPHS: dict[str, tuple[str, ...]] = {
    "kidney": (),
    "kidney, ReducedFE": ("tissue.use=deformation.ReducedFE",),
    "kidney, BeamBundle": ("tissue.use=deformation.BeamBundle",),
    "kidney, finger held 7 mm above": ("scene.hand.path=[{hold: 6}]",),
}
SLEEPERS = ("contact", "friction", "spread", "tissue")


def run(overrides: tuple[str, ...], sleeps: bool, record: Path | None = None) -> Result:
    """One fused run; times are only comparable without a recording."""
    Slot.sleeps = sleeps
    launch = find("kidney").but(place="fused", overrides=overrides, duration=6.3)
    result = execute(dataclasses.replace(launch, record=record)).result
    if not result.ok:
        raise SystemExit(str(result.deaths[0]))
    return result


def compared(name: str, turns: int) -> dict[str, object]:
    """One row of the table."""
    wall: dict[bool, list[float]] = {True: [], False: []}
    torques: dict[bool, list[bytes]] = {}
    asleep: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as folder:
        for sleeps in (False, True):
            file = Path(folder) / f"{sleeps}.mcap"
            health = run(GRAPHS[name], sleeps, file).health
            torques[sleeps] = [payload for _, _, payload in Recording(file).payloads("statics")]
            asleep = {node: health[node]["asleep"] / health[node]["steps"] for node in SLEEPERS}
    for _ in track(range(turns), name, transient=True):
        for sleeps in (False, True):
            wall[sleeps].append(run(GRAPHS[name], sleeps).health["device"]["age"]["mean"])
    awake, saved = min(wall[False]), min(wall[True])
    row: dict[str, object] = {"": name, "tick awake [us]": 1e6 * awake, "with sleep [us]": 1e6 * saved}
    shares = ", ".join(f"{100 * asleep[node]:.0f}" for node in SLEEPERS)
    row |= {"saved [%]": 100 * (1 - saved / awake), f"asleep [%]: {', '.join(SLEEPERS)}": shares}
    return row | {"torques": "same bytes" if torques[True] == torques[False] else "changed"}


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--turns", type=int, default=3)
    given = options.parse_args()
    print_tables({"Time saved by sleep": [compared(name, given.turns) for name in GRAPHS]}, given.json, digits=3)


if __name__ == "__main__":
    main()
