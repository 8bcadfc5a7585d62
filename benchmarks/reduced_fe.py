"""The reduced finite-element body of the default kidney against its full model, on touches that it was not made from.

    python benchmarks/reduced_fe.py [--touches 6] [--json]

Four tables. Error of the indentation under a spread load and error of the force with a fingertip in series
(contact.Series' own, the approach given), each by load and by the number of modes that the dents are cut to; no mode is
the linear body. The pressing (`fe.indent`) that both are measured against, itself against `fe.Solver` at one touch.
Times of a step against a load step of that solver. Takes some minutes on one core, all of it for the full model.
"""

from __future__ import annotations

import argparse
import os
import pickle
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq
from tables import tell

from palpate.messages import Load
from palpate.models.fe.meshing.organ import Organ
from palpate.models.fe.reduce.dents import press, sticking
from palpate.models.fe.reduce.indentation import PressCurve
from palpate.models.fe.reduce.reducible import Reducible, of_organ
from palpate.nodes.contact import Series
from palpate.nodes.deformation import ReducedFE
from palpate.physics.bodies.condensed_body import Basis, CondensedBody
from palpate.physics.contact.series import ElasticLaw, exponential
from palpate.physics.contact.spread import Spreader

DEPTHS = 0.5e-3 * np.arange(1, 22)
"""[m] To which the full model is pressed."""
SHOWN = (0.25, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0)
CHECKED = (2e-3, 2.5e-3, 3e-3)
"""[m] Indentations at which the pressing is held against `fe.Solver`."""


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
        self.most = 0.0

    def pressed(self, young: float, curve: PressCurve) -> None:
        """Take what the full model of modulus 1 Pa answers at `DEPTHS`."""
        known = np.isfinite(curve.force)
        force, self.multipliers = young * curve.force, young * curve.multipliers[known]
        self.most = float(force[known].max(initial=0.0))
        if known.any():
            self.depths, self.forces = np.append(0.0, DEPTHS[known]), np.append(0.0, force[known])
            self.full = CubicSpline(self.forces, self.depths)

    def settled(self, body: CondensedBody, force: float) -> tuple[float, float, float]:
        """The body's law after a long step under this force."""
        return body.step(self.nodes, force * self.push, self.foot, self.normal, 1e6)


def indentations(touches: list[Touch], bodies: dict[str, CondensedBody]) -> list[dict[str, object]]:
    """Error of each body, by load."""
    rows: list[dict[str, object]] = []
    for force in SHOWN:
        held = [t for t in touches if t.most >= force]
        row: dict[str, object] = {"N": f"{force:g}", "touches": len(held)}
        if held:
            row["mm"] = 1e3 * float(np.mean([t.full(force) for t in held]))
        for name, body in bodies.items() if held else ():
            missed = [abs(t.settled(body, force)[2] / t.full(force) - 1) for t in held]
            row[f"{name} worst %"] = 100.0 * float(np.max(missed))
            if name == "all":
                row["all mean %"] = 100.0 * float(np.mean(missed))
        rows.append(row)
    return rows


def in_series(touches: list[Touch], bodies: dict[str, CondensedBody]) -> list[dict[str, object]]:
    """Error of the static force of a fingertip against each body, by the approach that loads the full one."""
    finger = exponential(Series().finger_stiffness, Series().finger_hardening)
    rows: list[dict[str, object]] = []
    for force in SHOWN:
        held = [t for t in touches if t.most >= force]
        row: dict[str, object] = {"N": f"{force:g}", "touches": len(held)}
        for name, body in bodies.items() if held else ():
            missed = [abs(_common(t, body, finger, force) / force - 1) for t in held]
            row[f"{name} worst %"] = 100.0 * float(np.max(missed))
            if name == "all":
                row["all mean %"] = 100.0 * float(np.mean(missed))
        rows.append(row)
    return rows


def _common(touch: Touch, body: CondensedBody, finger: ElasticLaw, force: float) -> float:
    """Force of finger and body in series at the approach at which the full model takes `force`."""

    def compressed(f: float) -> float:
        return float(np.log1p(f * finger.second / finger.first) / finger.second)

    approach = float(touch.full(force)) + compressed(force)
    return float(brentq(lambda f: compressed(f) + touch.settled(body, f)[2] - approach, 1e-6, 5.0 * force, xtol=1e-9))


def solved(organ: Reducible, young: float, touch: Touch) -> tuple[list[dict[str, object]], float]:
    """The pressing against `fe.Solver` under the forces that the pressing found, and the seconds of a load step of the
    latter."""
    hats = organ.hats
    load, held = hats @ touch.load, sticking(hats, touch.load)
    follow = CubicSpline(touch.depths, np.vstack([np.zeros(touch.multipliers.shape[1]), touch.multipliers]))
    force = CubicSpline(touch.depths, touch.forces)

    def loads(share: float) -> np.ndarray:
        own = follow(CHECKED[0] * share)
        return np.asarray(own[0] * load + (own[1:] @ held).reshape(-1, 3))

    model = organ.solver(young, loads)
    rows: list[dict[str, object]] = []
    spent = []
    for depth in CHECKED:
        begun, before = time.perf_counter(), model.iterations
        model.advance(depth / CHECKED[0])
        spent.append(time.perf_counter() - begun)
        rows.append(
            {
                "mm": 1e3 * depth,
                "force N": float(force(depth)),
                "normal force over it": float(follow(depth)[0] / force(depth)),
                "fe.Solver off by": float(np.sum(load * model.displacement)) / depth - 1,
                "Newton iterations": model.iterations - before,
            }
        )
    return rows, float(np.mean(spent[1:]))


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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--touches", type=int, default=6)
    parser.add_argument("--radius", type=float, default=8e-3, help="[m] of the spread load")
    parser.add_argument("--seed", type=int, default=11)
    parser.add_argument("--keep", type=Path, help="file of the full model's curves, written or, if there, read")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    node = ReducedFE(position=(0.0, 0.0, 0.0))
    node.start()
    basis, mesh = node.basis(), node.mesh()
    left, size, right = np.linalg.svd(basis.dents, full_matrices=False)
    tables = {"linear": np.zeros((len(basis.dents), 0))}
    for modes in (1, 2):
        tables[f"{modes} mode" + "s" * (modes > 1)] = (left[:, :modes] * size[:modes]) @ right[:modes]
    tables["all"] = basis.dents
    bodies = {
        name: CondensedBody(
            Basis(basis.vertices, basis.triangles, basis.compliance, table), mesh, node.young, 0.0, 8e-3, 0.02
        )
        for name, table in tables.items()
    }
    upper = np.flatnonzero(mesh.normals[:, 2] > 0.0)
    places = np.random.default_rng(given.seed).choice(upper, given.touches, replace=False)
    touches = [Touch(node, bodies["linear"], int(p), given.radius) for p in places]
    organ = of_organ(Organ(node.coarse_mesh(), node.poisson, node.bed))
    if given.keep is not None and given.keep.exists():
        curves: list[PressCurve] = pickle.loads(given.keep.read_bytes())
    else:
        curves = press(organ, np.stack([t.load for t in touches]), np.tile(DEPTHS, (len(touches), 1)))
        if given.keep is not None:
            given.keep.write_bytes(pickle.dumps(curves))
    for touch, curve in zip(touches, curves, strict=True):
        touch.pressed(node.young, curve)
    against, seconds = solved(organ, node.young, touches[0])
    shown = {
        "error of the indentation": indentations(touches, bodies),
        "error of the force, fingertip in series": in_series(touches, bodies),
        "pressing against fe.Solver": against,
        "times": times(node, touches[0], seconds),
    }
    tell(shown, given.json, digits=2)


if __name__ == "__main__":
    main()
