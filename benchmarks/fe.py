"""Finite elements: against peers on one block, against Hertz, and the reduced body against the full model.

    python benchmarks/fe.py [--cells 10] [--json]

Peers that are not installed (FElupe with pypardiso; CalculiX's ccx) are left out. Run it on one core, and see what else
the machine does: times are of this run.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import sys
import time

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("MKL_NUM_THREADS", "1")

import numpy as np
from fe_peers import STEPS, calculix, felupe

from palpate.fe import Rigid, Settings, Solver, TetMesh, box, linear, neo_hooke, quadratic, sphere
from palpate.fe.mesh import bricks, grid

YOUNG, POISSON, SQUEEZE = 1e4, 0.3, 0.3
FORCES = (0.1, 0.25, 0.5, 1.0)
"""[N] of the touches of the reduced body."""


def block(cells: int, peers: bool) -> list[dict[str, object]]:
    """Compression of a clamped cube by 30 %: force and time of each solver."""
    material = neo_hooke(YOUNG, POISSON)
    own(box((1.0, 1.0, 1.0), (1, 1, 1)))  # compiles
    mesh = box((1.0, 1.0, 1.0), (cells, cells, cells))
    rows = [own(mesh)]
    shear, bulk = material.parameters
    for peer in (felupe, calculix) if peers else ():
        found = peer(mesh, shear, bulk, SQUEEZE)
        if found is not None:
            rows.append(found)
    for row in rows:
        row["degrees of freedom"] = 3 * len(mesh.points)
        row["difference"] = float(row["force"]) / float(rows[0]["force"]) - 1.0  # type: ignore[arg-type]
    return rows


def own(mesh: TetMesh) -> dict[str, object]:
    """The block with palpate."""
    z = mesh.points[:, 2]
    top = z > 1 - 1e-9
    fixed = np.repeat((top | (z < 1e-9))[:, None], 3, axis=1)
    up = np.outer(top, (0.0, 0.0, 1.0))
    begun = time.perf_counter()
    steps = Settings(step=1 / STEPS, largest=1 / STEPS)
    body = Solver(mesh, {0: neo_hooke(YOUNG, POISSON)}, fixed, lambda load: -SQUEEZE * load * up, settings=steps)
    body.advance(1.0)
    seconds = time.perf_counter() - begun
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return {
        "solver": "palpate",
        "force": float(body.reaction[top, 2].sum()),
        "seconds": seconds,
        "factorisations": body.factorisations,
        "peak MB": peak,
    }


def hertz(poisson: float, near: int, growth: float, ratio: float) -> dict[str, object]:
    """A rigid sphere on a quarter of a large elastic block against Hertz's theory; `ratio` is depth over radius."""
    radius, depth = 0.01, ratio * 0.01
    a = np.sqrt(radius * depth)
    h = 1.25 * a / near
    x = [h * i for i in range(near + 1)]
    while x[-1] < 400 * a:
        h *= growth
        x.append(x[-1] + h)
    points, cells = grid(np.array(x), np.array(x), -np.array(x[::-1]))
    mesh = quadratic(points, bricks(points, cells))
    p = mesh.points
    fixed = np.stack([p[:, 0] < 1e-9 * a, p[:, 1] < 1e-9 * a, np.zeros(len(p), dtype=bool)], axis=1)
    fixed[p[:, 2] < -x[-1] * (1 - 1e-9)] = True
    top = mesh.faces[(p[mesh.faces][:, :, 2] > -1e-9 * a).all(axis=1)]
    top = top[np.linalg.norm(p[top[:, :3]].mean(axis=1), axis=1) < 2 * a]
    touch = Rigid(top, sphere, (radius,), lambda load: np.array([0, 0, radius - load * depth]), bound=depth / 1000)
    body = Solver(mesh, {0: linear(YOUNG, poisson)}, fixed, contacts=[touch], settings=Settings(step=1.0, largest=1.0))
    begun = time.perf_counter()
    body.advance(1.0)
    theory = 4.0 / 3.0 * YOUNG / (1 - poisson**2) * np.sqrt(radius) * depth**1.5
    return {
        "poisson": poisson,
        "depth/radius": ratio,
        "degrees of freedom": 3 * len(p),
        "force/Hertz": 4 * abs(float(touch.force[2])) / theory,
        "area/Hertz": 4 * touch.contact_area(body.displacement) / (np.pi * a**2),
        "penetration/depth": float(-touch.gap.min()) / depth,
        "seconds": time.perf_counter() - begun,
    }


def reduced(touches: int) -> list[dict[str, object]]:
    """The condensed default kidney against the full nonlinear model, on touches at random places."""
    from palpate.fe.organ import Organ
    from palpate.messages import Load
    from palpate.nodes.deformation import ReducedFE
    from palpate.physics.spread import Spreader

    node = ReducedFE(position=(0.0, 0.0, 0.0))
    node.start()
    organ, mesh = Organ(node.coarse_mesh(), node.poisson, node.bed), node.mesh()
    hats, body = organ.hats(), node._body
    spread, rng = Spreader(mesh, 8e-3, "biweight"), np.random.default_rng(7)
    upper = np.flatnonzero(mesh.normals[:, 2] > 0.3)
    rows = []
    for place in rng.choice(upper, touches, replace=False):
        foot, n = tuple(mesh.vertices[place]), mesh.normals[place]
        count = spread.spread(foot, tuple(n), tuple(-n))
        nodes, unit = spread.nodes[:count].copy(), spread.forces[:count].copy()
        coarse = np.zeros((hats.shape[1], 3))
        np.add.at(coarse, body.corners[nodes], body.weights[nodes][:, :, None] * unit[:, None])
        weight = np.linalg.norm(unit, axis=1)
        full = organ.full(node.young, lambda load, coarse=coarse: load * (hats @ coarse))
        for force in FORCES:
            begun = time.perf_counter()
            full.advance(force)
            long = time.perf_counter() - begun
            u = hats.T @ full.displacement
            surface = np.einsum("pa,pai->pi", body.weights[nodes], u[body.corners[nodes]])
            depth = -float(weight @ (surface @ n))
            node.start()
            body = node._body
            load = Load(nodes=nodes, forces=force * unit, foot=foot, normal=tuple(n))
            found = node.step(load, dt=1e6).previous
            rows.append({"force": force, "full mm": 1e3 * depth, "error": found / depth - 1.0, "full seconds": long})
    times = step_times(node, nodes, unit, foot, tuple(n))
    table = []
    for force in FORCES:
        own_rows = [r for r in rows if r["force"] == force]
        table.append(
            {
                "force": force,
                "depth mm": float(np.mean([r["full mm"] for r in own_rows])),
                "mean error": float(np.mean([abs(r["error"]) for r in own_rows])),
                "worst error": float(np.max([abs(r["error"]) for r in own_rows])),
                "full s": float(np.mean([r["full seconds"] for r in own_rows])),
                **times,
            }
        )
    return table


def step_times(node, nodes: np.ndarray, unit: np.ndarray, foot: tuple, normal: tuple) -> dict[str, float]:
    """Step of the node under a load that changes: p50 and p99 [µs]."""
    from palpate.messages import Load

    spent = []
    for k in range(3000):
        load = Load(nodes=nodes, forces=(1.0 + 0.5 * np.sin(0.01 * k)) * unit, foot=foot, normal=normal)
        begun = time.perf_counter()
        node.step(load, dt=1e-3)
        spent.append(time.perf_counter() - begun)
    return {"step p50 us": 1e6 * float(np.percentile(spent, 50)), "step p99 us": 1e6 * float(np.percentile(spent, 99))}


def show(title: str, rows: list[dict[str, object]]) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table(title=title, title_justify="left")
    names = list(dict.fromkeys(n for row in rows for n in row))
    for name in names:
        table.add_column(name, justify="right")
    for row in rows:
        cells = [row.get(n, "") for n in names]
        table.add_row(*(f"{c:.4g}" if isinstance(c, float) else str(c) for c in cells))
    Console().print(table)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cells", type=int, default=10, help="of the block, along an edge")
    parser.add_argument("--touches", type=int, default=4, help="of the reduced body")
    parser.add_argument("--only", choices=("block", "hertz", "reduced"))
    parser.add_argument("--no-peers", action="store_true")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    tables: dict[str, list[dict[str, object]]] = {}
    if given.only in (None, "block"):
        tables["block"] = block(given.cells, not given.no_peers)
    if given.only in (None, "hertz"):
        tables["hertz"] = [hertz(0.3, 4, 2.2, 1e-4), hertz(0.45, 4, 2.2, 1e-4), hertz(0.3, 4, 2.2, 1e-2)]
    if given.only in (None, "reduced"):
        tables["reduced"] = reduced(given.touches)
    if given.json:
        json.dump(tables, sys.stdout, indent=2)
    else:
        for title, rows in tables.items():
            show(title, rows)


if __name__ == "__main__":
    main()
