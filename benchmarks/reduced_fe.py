"""The reduced finite-element body of the default kidney against its full model, on touches that it was not made from.

    python benchmarks/reduced_fe.py [--touches 6] [--json]

Three tables. Error of the indentation under a spread load and error of the force with a fingertip in series
(contact.Series' own, the approach given), each by load and by the number of modes that the dents are cut to; no mode is
the linear body. Times of a step against one of the full model. Takes some minutes on one core, most of it for the full
model.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from scipy.interpolate import CubicSpline

from palpate.fe.curves import dents
from palpate.fe.organ import Organ
from palpate.messages import Load
from palpate.nodes.contact import Series
from palpate.nodes.deformation import ReducedFE
from palpate.physics.contact import exponential, series
from palpate.physics.reduced_fe import Basis, CondensedBody
from palpate.physics.spread import Spreader
from palpate.physics.terminal import Terminal

FORCES = 0.125 * np.arange(1, 13)
"""[N] Up to where the full model gives way."""
SHOWN = (0.25, 0.5, 0.75, 1.0, 1.25, 1.5)


class Touch:
    """A spread unit load on the node's surface, and what the full model answers."""

    def __init__(self, node: ReducedFE, body: CondensedBody, place: int, radius: float) -> None:
        mesh = node.mesh()
        self.foot, self.normal = tuple(mesh.vertices[place]), tuple(mesh.normals[place])
        spread = Spreader(mesh, radius, "biweight")
        count = spread.spread(self.foot, self.normal, tuple(-mesh.normals[place]))
        self.nodes, self.push = spread.nodes[:count].copy(), spread.forces[:count].copy()
        self.load = np.zeros((len(body.basis.vertices), 3))
        np.add.at(self.load, body.corners[self.nodes], body.weights[self.nodes][:, :, None] * self.push[:, None])
        g = self.load.ravel()
        self.linear = float(g @ (body.basis.compliance @ g)) / body.young
        self.indentation = np.zeros(0)

    def settled(self, body: CondensedBody, force: float) -> tuple[float, float, float]:
        """The body's law after a long step under this force."""
        return body.step(self.nodes, force * self.push, self.foot, self.normal, 1e6)


def indentations(touches: list[Touch], bodies: dict[str, CondensedBody]) -> list[dict[str, object]]:
    """Error of each body, by load."""
    rows: list[dict[str, object]] = []
    for force in SHOWN:
        k = int(np.argmin(np.abs(FORCES - force)))
        held = [t for t in touches if np.isfinite(t.indentation[k])]
        row: dict[str, object] = {"force N": force, "touches that hold": len(held)}
        if held:
            row["depth mm"] = 1e3 * float(np.mean([t.indentation[k] for t in held]))
        for name, body in bodies.items() if held else ():
            missed = [abs(t.settled(body, force)[2] / t.indentation[k] - 1) for t in held]
            row[f"{name} mean"], row[f"{name} worst"] = float(np.mean(missed)), float(np.max(missed))
        rows.append(row)
    return rows


def in_series(touches: list[Touch], bodies: dict[str, CondensedBody]) -> list[dict[str, object]]:
    """Error of the static force of a fingertip against each body, by the approach that loads the full one."""
    finger = exponential(Series().finger_stiffness, Series().finger_hardening)
    rows: list[dict[str, object]] = []
    for force in SHOWN:
        missed: dict[str, list[float]] = {name: [] for name in bodies}
        for touch in touches:
            known = np.isfinite(touch.indentation)
            if FORCES[known].max(initial=0.0) < force:
                continue
            deep = CubicSpline(np.r_[0.0, FORCES[known]], np.r_[0.0, touch.indentation[known]])(force)
            own = np.log1p(force * finger.second / finger.first) / finger.second
            for name, body in bodies.items():
                law, found = touch.settled(body, force), 0.0
                for _ in range(60):
                    found, _, _ = series(deep + own, np.inf, own, finger, 0.0, Terminal(1 / law[0], 1, 0, law[1], 0))
                    law = touch.settled(body, found)
                missed[name].append(abs(found / force - 1))
        row: dict[str, object] = {"force N": force, "touches that hold": len(next(iter(missed.values())))}
        for name, values in missed.items():
            if values:
                row[f"{name} mean"], row[f"{name} worst"] = float(np.mean(values)), float(np.max(values))
        rows.append(row)
    return rows


def times(node: ReducedFE, touch: Touch, full: float) -> list[dict[str, object]]:
    """Step of the node, pressed and sliding, against the full model's seconds for one load step."""
    load = Load(nodes=touch.nodes, forces=0.7 * touch.push, foot=touch.foot, normal=touch.normal)
    spent = []
    for _ in range(5000):
        begun = time.perf_counter()
        node.step(load, dt=1e-3)
        spent.append(time.perf_counter() - begun)
    middle = float(np.percentile(spent, 50))
    return [
        {
            "step p50 us": 1e6 * middle,
            "step p99 us": 1e6 * float(np.percentile(spent, 99)),
            "full model s a load step": full,
            "ratio": full / middle,
        }
    ]


def show(title: str, rows: list[dict[str, object]]) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table(title=title, title_justify="left", box=None, padding=(0, 1))
    names = list(dict.fromkeys(n for row in rows for n in row))
    for name in names:
        table.add_column(name, justify="right")
    for row in rows:
        cells = [row.get(n, "") for n in names]
        table.add_row(*(f"{c:.2g}" if isinstance(c, float) else str(c) for c in cells))
    Console().print(table)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--touches", type=int, default=6)
    parser.add_argument("--radius", type=float, default=8e-3, help="[m] of the spread load")
    parser.add_argument("--seed", type=int, default=11)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    node = ReducedFE(position=(0.0, 0.0, 0.0))
    node.start()
    basis, mesh = node.basis(), node.mesh()
    left, size, right = np.linalg.svd(basis.dents, full_matrices=False)
    tables = {"linear": np.zeros((len(basis.dents), 0))}
    for modes in (1, 2):
        tables[f"{modes} mode" + "s" * (modes > 1)] = (left[:, :modes] * size[:modes]) @ right[:modes]
    tables["all modes"] = basis.dents
    bodies = {
        name: CondensedBody(
            Basis(basis.vertices, basis.triangles, basis.compliance, table), mesh, node.young, 0.0, 8e-3, 0.02
        )
        for name, table in tables.items()
    }
    upper = np.flatnonzero(mesh.normals[:, 2] > 0.0)
    places = np.random.default_rng(given.seed).choice(upper, given.touches, replace=False)
    touches = [Touch(node, bodies["linear"], int(p), given.radius) for p in places]
    organ = Organ(node.coarse_mesh(), node.poisson, node.bed)
    begun = time.perf_counter()
    found = dents(organ, np.stack([t.load for t in touches]), np.tile(FORCES / node.young, (len(touches), 1)))
    seconds = (time.perf_counter() - begun) / found.size
    for touch, beyond in zip(touches, found, strict=True):
        touch.indentation = touch.linear * FORCES + beyond
    shown = {
        "error of the indentation": indentations(touches, bodies),
        "error of the force, fingertip in series": in_series(touches, bodies),
        "times": times(node, touches[0], seconds),
    }
    if given.json:
        json.dump(shown, sys.stdout, indent=2)
    else:
        for title, rows in shown.items():
            show(title, rows)


if __name__ == "__main__":
    main()
