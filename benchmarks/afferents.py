"""Cost of 1000 afferents added to the kidney graph, on one core: simulated time over processor time.

    python benchmarks/afferents.py [--seconds S] [--json]

All nodes run in one process, without a recording. The processor time is that of a long run minus that of a short one,
the smaller of two measurements.
"""

from __future__ import annotations

import dataclasses
import os
import tempfile
from pathlib import Path

from tables import parser, print_tables

from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute

GRAPH = """extends: kidney
nodes:
  stress: {use: tactile.Stress, in: {load: spread}, depths: [0.3 mm, 1.6 mm, 2 mm], reach: 8 mm}
  afferents: {use: tactile.Afferents, in: {stress: stress}, densities: [1.507e+6, 3.014e+6, 0.452e+6]}
"""  # 303, 606 and 91 units
WANTED = {"kidney alone": "[controller]", "with stress": "[controller, stress]",
          "with 1000 afferents": "[controller, afferents]"}  # fmt: skip


def processor_time(graph: Path, wanted: str, seconds: float) -> float:
    """Processor time [s] of this process and its children for a simulated time [s], without the start of the run."""

    def one(duration: float) -> float:
        launch = find(str(graph)).but(
            place="fused", clock="simulated", duration=duration, overrides=("log=null", f"wanted={wanted}")
        )
        begin = sum(os.times()[:4])
        result = execute(dataclasses.replace(launch, record=None)).result
        if not result.ok:
            raise SystemExit(str(result.deaths[0]))
        return sum(os.times()[:4]) - begin

    one(0.1)
    return min(one(seconds + 0.1) - one(0.1) for _ in range(2))


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--seconds", type=float, default=6.0)
    given = options.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        graph = Path(folder) / "graph.yaml"
        graph.write_text(GRAPH, encoding="utf-8")
        ratios = {name: given.seconds / processor_time(graph, wanted, given.seconds) for name, wanted in WANTED.items()}
    rows: list[dict[str, object]] = [{"": name, "x real time": ratio} for name, ratio in ratios.items()]
    print_tables({"Simulated time over processor time, one core": rows}, given.json, digits=3)


if __name__ == "__main__":
    main()
