"""Run one solver on one problem; a separate process per solver, because peak memory is counted per process.

    python benchmarks/fe_peers.py palpate|felupe|felupe-cholmod|felupe-faces|calculix block|step|pressed|ball CELLS

Prints a JSON object: force [N] on the driven nodes, processor time and wall time [s] from the mesh to the result, peak
memory [MB]. All solvers use one core and the same steps and tolerance. Exit code 3: the solver is not installed.

palpate needs no other package. Install FElupe with `pip install felupe pypardiso`; without PARDISO it uses SuperLU,
which is much slower. CHOLMOD: `pip install 'scikit-sparse<0.5'`, which needs the headers of SuiteSparse 5; use OpenBLAS
as the system's BLAS, since the reference BLAS is several times slower. CalculiX: `apt install calculix-ccx`.

The contact of the ball with the plane differs. palpate and CalculiX integrate the pressure over faces, palpate at six
points each. FElupe's contact acts at nodes; this is softer on quadratic faces, whose corner nodes carry no force under
uniform pressure. `felupe-faces` adds six points per face to FElupe. All use the same stiff penalty; palpate also
updates Lagrange multipliers where the penetration would exceed its bound.
"""

from __future__ import annotations

import json
import os
import resource
import sys
import tempfile
import time
from functools import partial
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("MKL_NUM_THREADS", "1")

import numpy as np
from fe_felupe import felupe
from fe_problems import POISSON, RADIUS, YOUNG, FEProblem, ball, block, pressed, step

from palpate.models.fe import RigidIndenter, Settings, Solver, neo_hooke, plane
from palpate.models.fe.element.mesh import FACES
from palpate.physics.materials.hyperelastic import moduli
from palpate.studies.peers import MissingError
from palpate.studies.peers import calculix as peer

MISSING = 3


def palpate(problem: FEProblem) -> dict[str, object]:
    """Figures of palpate; a run on a mesh of few elements compiles the kernels first."""
    _palpate(ball(2) if len(problem.skin) else block(1))
    begun = time.perf_counter()
    used = time.process_time()
    body = _palpate(problem)
    return {
        "solver": "palpate",
        "force": float(body.reaction[problem.driven, 2].sum()),
        "CPU s": time.process_time() - used,
        "clock s": time.perf_counter() - begun,
        "iterations": body.iterations,
        "penetration/travel": -float(body.contacts[0].gap.min()) / problem.travel if body.contacts else None,
    }


def _palpate(problem: FEProblem) -> Solver:
    down = np.outer(problem.driven, (0.0, 0.0, -problem.travel))
    place = np.array([0.0, 0.0, problem.floor])
    contacts = []
    if len(problem.skin):
        up = (0.0, 0.0, 1.0)
        contacts.append(RigidIndenter(problem.skin, plane, up, lambda load: place, penalty=problem.penalty))
    body = Solver(
        problem.mesh, {0: neo_hooke(YOUNG, POISSON)}, problem.fixed, lambda load: load * down, contacts=contacts,
        settings=Settings(step=1 / problem.steps, largest=1 / problem.steps),
    )  # fmt: skip
    body.advance(1.0)
    return body


def calculix(problem: FEProblem) -> dict[str, object] | None:
    """Figures of CalculiX; None if `ccx` is not installed."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            seconds, status, output = peer.run(_deck(problem), Path(folder))
        except MissingError:
            return None
        child = resource.getrusage(resource.RUSAGE_CHILDREN)
        rows = [r.split() for r in Path(folder, "run.dat").read_text().splitlines()] if status == 0 else []
        forces = [float(r[2]) for r in rows if len(r) == 3]
        if len(forces) != problem.steps:
            raise SystemExit(f"ccx ended after {len(forces)} of {problem.steps} steps: {output}")
        steps = [r.split() for r in Path(folder, "run.sta").read_text().splitlines()]
    used = sum(int(r[3]) for r in steps if len(r) >= 7 and r[0].isdigit())
    return {
        "solver": "CalculiX",
        "force": forces[-1],
        "CPU s": child.ru_utime + child.ru_stime,
        "clock s": seconds,
        "iterations": used,
        "peak MB": child.ru_maxrss / 1024,
    }


def _deck(problem: FEProblem) -> list[str]:
    """The input file of CalculiX; the plane is a fixed brick, whose top is the master surface."""
    mesh, count = problem.mesh, len(problem.mesh.points)
    lines = list(peer.solids(mesh, [moduli(YOUNG, POISSON)]))
    lines += ["*NSET, NSET=TOP", *(f"{n + 1}," for n in np.flatnonzero(problem.driven))]
    for k in range(3):
        held = np.flatnonzero(problem.fixed[:, k] & ~(problem.driven & (k == 2)))
        lines += [f"*NSET, NSET=HELD{k}", *(f"{n + 1}," for n in held)]
    if len(problem.skin):
        low, high, wide = problem.floor - RADIUS, problem.floor, 3 * RADIUS
        corners = [
            (x, y, z) for z in (low, high) for x, y in ((-wide, -wide), (wide, -wide), (wide, wide), (-wide, wide))
        ]
        lines += ["*NODE, NSET=PLANE", *(f"{count + 1 + i}, {x}, {y}, {z}" for i, (x, y, z) in enumerate(corners))]
        last = len(mesh.elements) + 1
        lines += ["*ELEMENT, TYPE=C3D8, ELSET=FLOOR", f"{last}, " + ", ".join(str(count + 1 + i) for i in range(8))]
        lines += ["*SOLID SECTION, ELSET=FLOOR, MATERIAL=M0", "*SURFACE, NAME=MASTER, TYPE=ELEMENT", f"{last}, S2"]
        every = np.sort(mesh.elements[:, FACES[:, :3]], axis=2).reshape(-1, 3)
        key = {tuple(f): k for k, f in enumerate(every.tolist())}
        sides = [key[tuple(sorted(f[:3]))] for f in problem.skin.tolist()]
        lines += ["*SURFACE, NAME=SLAVE, TYPE=ELEMENT", *(f"{s // 4 + 1}, S{s % 4 + 1}" for s in sides)]
        lines += ["*SURFACE INTERACTION, NAME=TOUCH", "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR"]
        lines += [f"{problem.penalty:.12g}"]
        lines += ["*CONTACT PAIR, INTERACTION=TOUCH, TYPE=SURFACE TO SURFACE", "SLAVE, MASTER"]
    lines += ["*BOUNDARY", *(f"HELD{k}, {k + 1}, {k + 1}" for k in range(3))]
    lines += ["PLANE, 1, 3"] if len(problem.skin) else []
    lines += ["*STEP, NLGEOM, INC=100", "*STATIC, DIRECT", f"{1 / problem.steps:g}, 1.0"]
    lines += [
        "*BOUNDARY",
        f"TOP, 3, 3, {-problem.travel:.12g}",
        "*NODE PRINT, NSET=TOP, TOTALS=ONLY",
        "RF",
        "*END STEP",
    ]
    return lines


def main() -> None:
    solver, name, cells = sys.argv[1:]
    problem = {"block": block, "step": step, "pressed": pressed, "ball": ball}[name](int(cells))
    solvers = {
        "palpate": palpate, "felupe": felupe, "felupe-faces": partial(felupe, faces=True),
        "felupe-cholmod": partial(felupe, cholmod=True), "calculix": calculix,
    }  # fmt: skip
    answer = solvers[solver](problem)
    if answer is None:
        how = "apt install calculix-ccx" if solver == "calculix" else "pip install felupe pypardiso scikit-sparse"
        print(f"skipped {solver}, which is not installed: {how}", file=sys.stderr)
        raise SystemExit(MISSING)
    answer.setdefault("peak MB", resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
    print(json.dumps(answer | {"degrees of freedom": 3 * len(problem.mesh.points)}))


if __name__ == "__main__":
    main()
