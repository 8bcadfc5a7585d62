"""Detection of a nodule from SA1 spikes by its depth: the table of docs/equations/afferents.md.

    python benchmarks/nodule_depth.py [--json]

The finger of `--scene afferents` slides over a nodule of 4 mm at several depths. SA1 spikes are counted during 0.5 s
above it, in trials that differ only in their noise. d' is the change of the mean count over its RMS standard deviation.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from tables import parser, print_tables

from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.records.player import plan_of
from palpate.records.reader import Recording

DEPTHS = (5, 7, 9, 11, 13, 16)  # [mm] of the nodule's centre
TRIALS = 12
BEGIN, END = 1.6, 2.1  # [s] the finger is above the nodule


def rates(folder: Path, depth: float | None) -> tuple[np.ndarray, int]:
    """Mean rate [1/s] of the SA1 afferents in each trial, and their number; `depth` [mm], None: without a nodule."""
    graph = folder / "graph.yaml"
    fingers = "".join(
        f"  finger{k}: {{use: tactile.Afferents, in: {{stress: stress}}, with: $skin, trial: {k}}}\n"
        for k in range(TRIALS)
    )
    graph.write_text(f"extends: nodule\nscene: afferents\nnodes:\n{fingers}", encoding="utf-8")
    nodule = "tissue.nodule_radius=0" if depth is None else f"tissue.nodule_depth={depth} mm"
    launch = find(str(graph)).but(
        place="fused", clock="simulated", duration=END, record=folder / "run.mcap", overrides=(nodule,)
    )
    result = execute(launch).result
    if not result.ok:
        raise SystemExit(str(result.deaths[0]))
    recording = Recording(folder / "run.mcap")
    kind = plan_of(recording).make("finger0").make_population().kind  # type: ignore[attr-defined]
    count = int(np.sum(kind == 0))
    spikes = [
        sum(int(np.sum(kind[sent.unit] == 0)) for sent in recording.messages(f"finger{k}", (BEGIN, END)))  # type: ignore[attr-defined]
        for k in range(TRIALS)
    ]
    return np.array(spikes) / (count * (END - BEGIN)), count


def main() -> None:
    given = parser(__doc__).parse_args()
    with tempfile.TemporaryDirectory() as folder:
        none, count = rates(Path(folder), None)
        rows: list[dict[str, object]] = [{"depth [mm]": "none", "rate [1/s]": float(none.mean())}]
        for depth in DEPTHS:
            found, _ = rates(Path(folder), depth)
            prime = (found.mean() - none.mean()) / np.sqrt(0.5 * (found.var(ddof=1) + none.var(ddof=1)))
            rows.append({
                "depth [mm]": depth, "rate [1/s]": float(found.mean()), f"d' of {count}": float(prime),
                "d' of one": float(prime / np.sqrt(count)),
            })  # fmt: skip
    print_tables({f"SA1 above a nodule, {TRIALS} trials": rows}, given.json, digits=3)


if __name__ == "__main__":
    main()
