"""One solver on one problem, in a process of its own, so that its peak of memory is its own:

    python benchmarks/fe_peers.py palpate|felupe|calculix block|ball CELLS

Prints a JSON object: force [N] on the driven nodes, seconds, peak memory [MB]. The peers are for the user to install:
FElupe with `pip install felupe pypardiso` (without PARDISO it takes SuperLU, which is much slower), CalculiX with
`apt install calculix-ccx`. Exit status 3 and a line that says so where one is missing.

What differs where the ball touches the plane: palpate and CalculiX integrate a pressure over the faces, at six and at
seven points a face, palpate raising multipliers until the penetration is below its bound, CalculiX with a stiff
penalty; FElupe holds back the nodes with a stiff penalty.
"""

from __future__ import annotations

import importlib.metadata
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("MKL_NUM_THREADS", "1")

import numpy as np
from fe_problems import POISSON, RADIUS, STEPS, YOUNG, Problem, ball, block

from palpate.fe import Rigid, Settings, Solver, neo_hooke, plane
from palpate.fe.mesh import FACES

MISSING = 3
PENALTY = 2e4
"""[1] Penalty of the peers' contact, Young's moduli per radius: a penetration of about 1e-5 of the radius."""


def palpate(problem: Problem) -> dict[str, object]:
    """With palpate; what numba compiles is compiled before, on a mesh of a few elements."""
    _palpate(ball(2) if len(problem.skin) else block(1))
    begun = time.perf_counter()
    body = _palpate(problem)
    return {
        "solver": "palpate",
        "force": float(body.reaction[problem.driven, 2].sum()),
        "seconds": time.perf_counter() - begun,
        "iterations": body.iterations,
        "penetration/travel": -float(body.contacts[0].gap.min()) / problem.travel if body.contacts else None,
    }


def _palpate(problem: Problem) -> Solver:
    down = np.outer(problem.driven, (0.0, 0.0, -problem.travel))
    place = np.array([0.0, 0.0, problem.floor])
    contacts = [Rigid(problem.skin, plane, (0.0, 0.0, 1.0), lambda load: place)] if len(problem.skin) else []
    body = Solver(
        problem.mesh, {0: neo_hooke(YOUNG, POISSON)}, problem.fixed, lambda load: load * down, contacts=contacts,
        settings=Settings(step=1 / STEPS, largest=1 / STEPS),
    )  # fmt: skip
    body.advance(1.0)
    return body


def felupe(problem: Problem) -> dict[str, object] | None:
    """With FElupe; None where it is not installed."""
    try:
        import felupe as fem
    except ImportError:
        return None
    name, spsolve = _direct()
    begun = time.perf_counter()
    mesh, count = problem.mesh, len(problem.mesh.points)
    points = np.concatenate([mesh.points, [[0.0, 0.0, problem.floor]]])  # the last point carries the plane
    field = fem.FieldContainer([fem.Field(fem.RegionQuadraticTetra(fem.Mesh(points, mesh.elements, "tetra10")), dim=3)])
    shear, bulk = neo_hooke(YOUNG, POISSON).parameters
    items = [fem.SolidBody(fem.NeoHooke(mu=shear, bulk=bulk), field)]
    if len(problem.skin):
        nodes, stiffness = np.unique(problem.skin), PENALTY * YOUNG / RADIUS
        area = np.pi / 4 * (0.3 * RADIUS) ** 2 / np.sum(np.linalg.norm(points[nodes, :2], axis=1) < 0.3 * RADIUS)
        normal = np.array([0.0, 0.0, 1.0])
        items.append(fem.ContactRigidPlane(field, nodes, count, normal, multiplier=stiffness * area))
    held = np.concatenate([problem.fixed, [[True] * 3]])
    move = np.concatenate([problem.driven, [False]])
    held[move, 2] = False
    bounds = {
        f"held{k}": fem.Boundary(field[0], mask=held[:, k], skip=tuple(int(k != i) for i in range(3))) for k in range(3)
    }
    bounds["move"] = fem.Boundary(field[0], mask=move, skip=(1, 1, 0))
    iterations = 0
    for step in range(1, STEPS + 1):
        bounds["move"].update(-problem.travel * step / STEPS)
        dof0, dof1 = fem.dof.partition(field, bounds)
        ext0 = fem.dof.apply(field, bounds, dof0)
        found = fem.newtonraphson(
            items=items, dof0=dof0, dof1=dof1, ext0=ext0, solver=lambda a, b: spsolve(a.tocsr(), b), verbose=0,
            tol=1e-6, maxiter=40,
        )  # fmt: skip
        iterations += found.iterations
    reaction = items[0].assemble.vector(field).toarray().reshape(-1, 3)
    return {
        "solver": f"FElupe, {name}",
        "force": float(reaction[move, 2].sum()),
        "seconds": time.perf_counter() - begun,
        "iterations": iterations,
        "penetration/travel": -float((points + field[0].values)[np.unique(problem.skin), 2].min() - problem.floor)
        / problem.travel
        if len(problem.skin)
        else None,
    }


def _direct():
    """The fastest sparse solver that is there: PARDISO, or SuperLU. pypardiso finds no MKL outside the environment that
    it is installed in, so it is shown where it lies."""
    try:
        if "PYPARDISO_MKL_RT" not in os.environ:
            parts = importlib.metadata.files("mkl") or []
            found = [str(p.locate().resolve()) for p in parts if "mkl_rt" in p.name and p.locate().exists()]
            os.environ.update({"PYPARDISO_MKL_RT": found[0]} if found else {})
        from pypardiso import spsolve

        return "PARDISO", spsolve
    except ImportError:
        from scipy.sparse.linalg import spsolve

        return "SuperLU", spsolve


def calculix(problem: Problem) -> dict[str, object] | None:
    """With CalculiX; None where `ccx` is not installed."""
    program = shutil.which("ccx")
    if program is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "run.inp").write_text("\n".join(_deck(problem)) + "\n")
        begun = time.perf_counter()
        told = subprocess.run([program, "run"], cwd=folder, capture_output=True, text=True, timeout=3600)
        seconds = time.perf_counter() - begun
        peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
        rows = [r.split() for r in Path(folder, "run.dat").read_text().splitlines()] if told.returncode == 0 else []
        forces = [float(r[2]) for r in rows if len(r) == 3]
        if len(forces) != STEPS:
            raise SystemExit(f"ccx ended after {len(forces)} of {STEPS} steps:\n{told.stdout[-2000:]}")
        steps = [r.split() for r in Path(folder, "run.sta").read_text().splitlines()]
    used = sum(int(r[3]) for r in steps if len(r) >= 7 and r[0].isdigit())
    return {"solver": "CalculiX", "force": forces[-1], "seconds": seconds, "iterations": used, "peak MB": peak}


def _deck(problem: Problem) -> list[str]:
    """The input file of CalculiX; the plane is a held brick, whose top is the master surface."""
    mesh, count = problem.mesh, len(problem.mesh.points)
    shear, bulk = neo_hooke(YOUNG, POISSON).parameters
    lines = ["*NODE, NSET=ALL"]
    lines += [f"{i + 1}, {p[0]:.14g}, {p[1]:.14g}, {p[2]:.14g}" for i, p in enumerate(mesh.points)]
    lines.append("*ELEMENT, TYPE=C3D10, ELSET=BODY")
    lines += [f"{i + 1}, " + ", ".join(str(n + 1) for n in e) for i, e in enumerate(mesh.elements)]
    lines += ["*MATERIAL, NAME=M", "*HYPERELASTIC, NEO HOOKE", f"{shear / 2:.12g}, {2 / bulk:.12g}"]
    lines += ["*SOLID SECTION, ELSET=BODY, MATERIAL=M"]
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
        lines += ["*SOLID SECTION, ELSET=FLOOR, MATERIAL=M", "*SURFACE, NAME=MASTER, TYPE=ELEMENT", f"{last}, S2"]
        every = np.sort(mesh.elements[:, FACES[:, :3]], axis=2).reshape(-1, 3)
        key = {tuple(f): k for k, f in enumerate(every.tolist())}
        sides = [key[tuple(sorted(f[:3]))] for f in problem.skin.tolist()]
        lines += ["*SURFACE, NAME=SLAVE, TYPE=ELEMENT", *(f"{s // 4 + 1}, S{s % 4 + 1}" for s in sides)]
        lines += ["*SURFACE INTERACTION, NAME=TOUCH", "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR"]
        lines += [f"{PENALTY * YOUNG / RADIUS:.12g}"]
        lines += ["*CONTACT PAIR, INTERACTION=TOUCH, TYPE=SURFACE TO SURFACE", "SLAVE, MASTER"]
    lines += ["*BOUNDARY", *(f"HELD{k}, {k + 1}, {k + 1}" for k in range(3))]
    lines += ["PLANE, 1, 3"] if len(problem.skin) else []
    lines += ["*STEP, NLGEOM, INC=100", "*STATIC, DIRECT", f"{1 / STEPS:g}, 1.0"]
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
    problem = {"block": block, "ball": ball}[name](int(cells))
    found = {"palpate": palpate, "felupe": felupe, "calculix": calculix}[solver](problem)
    if found is None:
        print(f"{solver} is not installed: {__doc__.split('The peers')[1].split('Exit')[0]}", file=sys.stderr)
        raise SystemExit(MISSING)
    found.setdefault("peak MB", resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
    print(json.dumps(found | {"degrees of freedom": 3 * len(problem.mesh.points)}))


if __name__ == "__main__":
    main()
