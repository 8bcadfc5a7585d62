"""The full finite elements against peers on two problems, and against Hertz.

    python benchmarks/fe.py [--cells 10] [--ball 6] [--step 16] [--only block|step|pressed|ball|hertz] [--json]

Block: a cube clamped at both ends and squeezed by 30 % in four steps. Step: a larger one, by 5 % in one step.
Pressed: a cube clamped at its top and pressed on a rigid plane by 30 % in ten steps, no friction. Ball: a ball pressed
on a rigid plane, no friction. Each solver has the same mesh, steps and tolerance and runs in a process of its own on
one core; `fe_peers.py` says how peers are installed and what differs in their contact. A peer that is missing is left
out. Seconds of the processor depend less on what else the machine does than seconds on the clock.

Hertz: a rigid sphere on a block and an elastic ball on a rigid plane, force and area of contact over theory.
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
from tables import tell

SOLVERS = {
    "block": ("palpate", "felupe", "felupe-cholmod", "calculix"),
    "step": ("palpate", "felupe", "felupe-cholmod"),
    "pressed": ("palpate", "felupe", "felupe-cholmod", "felupe-faces"),
    "ball": ("palpate", "felupe", "felupe-cholmod", "felupe-faces", "calculix"),
}


def against_peers(problem: str, cells: int) -> list[dict[str, object]]:
    """Force, time and peak memory of each solver on one of the problems, and its ratios to ours."""
    rows = []
    for solver in SOLVERS[problem]:
        words = [sys.executable, str(Path(__file__).with_name("fe_peers.py")), solver, problem, str(cells)]
        told = subprocess.run(words, stdout=subprocess.PIPE, text=True)
        if told.returncode == MISSING:
            continue
        if told.returncode != 0:
            print(f"{solver}: ended with status {told.returncode}", file=sys.stderr)
            continue
        rows.append(json.loads(told.stdout))
    for row in rows:
        row["force/ours - 1"] = row["force"] / rows[0]["force"] - 1.0
        row["CPU/ours"] = row["CPU s"] / rows[0]["CPU s"]
        row["memory/ours"] = row["peak MB"] / rows[0]["peak MB"]
    return rows


def hertz() -> list[dict[str, object]]:
    """Force and area over theory, on meshes of more and more faces over the radius of contact, and where it ends."""
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
    parser.add_argument("--cells", type=int, default=10, help="of the block, along an edge")
    parser.add_argument("--ball", type=int, default=6, help="cells across an eighth of the ball's circumference")
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
    tell(tables, given.json)


if __name__ == "__main__":
    main()
