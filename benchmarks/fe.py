"""The full finite elements compared with other solvers on four problems, and with Hertz's theory.

    python benchmarks/fe.py [--cells 10] [--ball 6] [--step 16] [--only block|step|pressed|ball|hertz] [--json]

block    a cube clamped at both ends, compressed by 30 % in four steps
step     a larger cube, compressed by 5 % in one step
pressed  a cube clamped at its top and pressed by 30 % on a rigid plane in ten steps, without friction
ball     a ball pressed on a rigid plane, without friction
hertz    a rigid sphere on a block and an elastic ball on a rigid plane: force and contact area over those of the theory

Each solver has the same mesh, steps and tolerance, and runs in a separate process on one core. `fe_peers.py` explains
how to install the other solvers and how their contact differs. Solvers that are not installed are skipped. Processor
time depends less than wall time on the load of the machine.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path

from fe_hertz import indented
from fe_peers import MISSING
from tables import print_tables

SOLVERS = {
    "block": ("palpate", "felupe", "felupe-cholmod", "calculix"),
    "step": ("palpate", "felupe", "felupe-cholmod"),
    "pressed": ("palpate", "felupe", "felupe-cholmod", "felupe-faces"),
    "ball": ("palpate", "felupe", "felupe-cholmod", "felupe-faces", "calculix"),
}


def against_peers(problem: str, cells: int) -> list[dict[str, object]]:
    """Force, time and peak memory of each solver on a problem, and their ratios to those of palpate."""
    rows = []
    for solver in SOLVERS[problem]:
        command = [sys.executable, str(Path(__file__).with_name("fe_peers.py")), solver, problem, str(cells)]
        result = subprocess.run(command, stdout=subprocess.PIPE, text=True)
        if result.returncode == MISSING:
            continue
        if result.returncode != 0:
            print(f"{solver}: exit code {result.returncode}", file=sys.stderr)
            continue
        rows.append(json.loads(result.stdout))
    for row in rows:
        row["force/ours - 1"] = row["force"] / rows[0]["force"] - 1.0
        row["CPU/ours"] = row["CPU s"] / rows[0]["CPU s"]
        row["memory/ours"] = row["peak MB"] / rows[0]["peak MB"]
    return rows


def hertz() -> list[dict[str, object]]:
    """Force and area over theory, on meshes with 2 to 5 faces across the contact radius, and at a large approach."""
    rows = []
    for body, poisson, faces, ratio in (
        ("block", 0.3, 2, 1e-4), ("block", 0.3, 3, 1e-4), ("block", 0.3, 4, 1e-4), ("block", 0.45, 4, 1e-4),
        ("block", 0.45, 5, 1e-4),
        ("ball", 0.3, 2, 1e-4), ("ball", 0.3, 3, 1e-4), ("ball", 0.3, 4, 1e-4), ("ball", 0.45, 4, 1e-4),
        ("block", 0.3, 4, 1e-2),
    ):  # fmt: skip
        begun = time.process_time()
        ratios = indented(poisson, faces, ratio, body == "ball")
        rows.append({"body": body, "poisson": poisson, "faces over a": faces, "approach/radius": ratio, **ratios})
        rows[-1]["CPU s"] = time.process_time() - begun
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", type=int, default=10, help="cells of the block, along an edge")
    parser.add_argument("--ball", type=int, default=6, help="cells across 1/8 of the ball's circumference")
    parser.add_argument("--only", choices=("block", "step", "pressed", "ball", "hertz"))
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--step", type=int, default=16, help="cells of the larger block, along an edge")
    given = parser.parse_args()
    tables: dict[str, list[dict[str, object]]] = {}
    cells = {"block": given.cells, "step": given.step, "pressed": given.cells, "ball": given.ball}
    for problem, count in cells.items():
        if given.only in (None, problem):
            tables[problem] = against_peers(problem, count)
    if given.only in (None, "hertz"):
        tables["hertz"] = hertz()
    print_tables(tables, given.json)


if __name__ == "__main__":
    main()
