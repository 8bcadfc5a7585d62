"""What a finger gains or loses that presses the reduced kidney at one place, slides and lets go at another.

    python docs/studies/reduced_slide.py [--approach 10e-3] [--json]

The finger presses at A to an approach in 0.25 s, slides to B at 50 mm/s with the approach kept, and lets go there in
0.25 s; contact as in contact.Series without friction, steps of 1 ms. Between the softest and the stiffest of sixteen
places that look up, there and in the other direction, and from each there and back. A row: the hand's work in and
out, the force along the surface included, and the share that does not come back, with that force and without it;
without viscosity and with the node's 0.02 s. Seconds.
"""

from __future__ import annotations

import argparse
import json
import sys
from itertools import pairwise

import beside  # noqa: F401
import numpy as np
from tables import show

from palpate.nodes.contact import Series
from palpate.nodes.deformation import ReducedFE
from palpate.physics.bodies.condensed_body import Basis, CondensedBody
from palpate.physics.bodies.place_energy import on_hand
from palpate.physics.contact.series import exponential, series
from palpate.physics.contact.spread import Spreader
from palpate.physics.contact.terminal import Terminal
from palpate.physics.geometry.mesh_closest import MeshClosestPoint

STEP, PRESS, SPEED = 1e-3, 0.25, 0.05
"""[s], [s], [m/s]"""
NO_NODES, NO_FORCES = np.zeros(0, np.int32), np.zeros((0, 3))


class Finger:
    """A fingertip against the body."""

    def __init__(self, node: ReducedFE, basis: Basis, retardation: float, along: bool) -> None:
        self.along = along
        self.mesh = node.mesh()
        self.body = CondensedBody(basis, self.mesh, node.young, retardation, node.radius, node.reach, node.poisson)
        self.spread, self.closest = Spreader(self.mesh, node.radius, "biweight"), MeshClosestPoint(self.mesh)
        self.own = exponential(Series().finger_stiffness, Series().finger_hardening)
        self.compression, self.law = 0.0, Terminal(1.0, 1.0, 0.0, 0.0, 0.0)

    def work(self, way: np.ndarray, approach: np.ndarray) -> tuple[float, float]:
        """Work [J] that the hand puts in and takes out along points (T,3) at approaches [m] (T,)."""
        feet, normals, *_ = self.closest.find(way)
        taken, given, force, before, last = 0.0, 0.0, 0.0, np.zeros(3), np.zeros(3)
        self.step(feet[0], normals[0], 0.0)
        for foot, normal, e in zip(feet, normals, approach.tolist(), strict=True):
            force, self.compression, _ = series(e, STEP, self.compression, self.own, 0.0, self.law)
            self.step(foot, normal, force)
            whole, at = force * normal, foot - e * normal
            if self.along and force > 0.0:
                slope, turning = self.body.along()
                whole = whole + on_hand(slope, turning, e, tuple(normal.tolist()))
            part = -0.5 * float((whole + before) @ (at - last)) if e > 0.0 else 0.0
            taken, given = taken + max(part, 0.0), given - min(part, 0.0)
            before, last = whole, at
        return taken, given

    def step(self, foot: np.ndarray, normal: np.ndarray, force: float) -> None:
        """Load the body for a step and keep its law."""
        at, n = tuple(foot.tolist()), tuple(normal.tolist())
        count = self.spread.spread(at, n, tuple((-force * normal).tolist())) if force > 0.0 else 0
        load = (self.spread.nodes[:count], self.spread.forces[:count]) if count else (NO_NODES, NO_FORCES)
        compliance, free, now = self.body.step(*load, at, n, STEP)
        self.law = Terminal(1.0 / compliance, 1.0, 0.0, free, now)


def run(
    node: ReducedFE, basis: Basis, retardation: float, stops: list[np.ndarray], approach: float, along: bool = True
) -> tuple:
    """Press at the first stop, slide over all, let go at the last."""
    legs = [np.linspace(a, b, max(2, int(np.linalg.norm(b - a) / (SPEED * STEP)))) for a, b in pairwise(stops)]
    ramp = np.linspace(0.0, approach, round(PRESS / STEP))
    slide = np.concatenate([*legs, stops[-1:]])
    way = np.concatenate([np.tile(stops[0], (len(ramp), 1)), slide, np.tile(stops[-1], (len(ramp), 1))])
    return Finger(node, basis, retardation, along).work(
        way, np.concatenate([ramp, np.full(len(slide), approach), ramp[::-1]])
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--approach", type=float, default=10e-3, help="[m]")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    node = ReducedFE(position=(0.0, 0.0, 0.0))
    basis, mesh = node.basis(), node.mesh()
    assert isinstance(basis, Basis)
    up = np.flatnonzero(mesh.normals[:, 2] > 0.7)
    feet = mesh.vertices[np.random.default_rng(5).choice(up, 16, replace=False)]
    held = [run(node, basis, 0.0, [foot, foot], given.approach)[0] for foot in feet]
    soft, stiff = feet[int(np.argmin(held))], feet[int(np.argmax(held))]
    ways = {
        "soft to stiff": [soft, stiff],
        "stiff to soft": [stiff, soft],
        "soft to stiff and back": [soft, stiff, soft],
        "stiff to soft and back": [stiff, soft, stiff],
    }
    rows: list[dict[str, object]] = []
    for name, stops in ways.items():
        for retardation in (0.0, node.retardation):
            taken, out = run(node, basis, retardation, stops, given.approach)
            alone, back = run(node, basis, retardation, stops, given.approach, along=False)
            rows.append(
                {
                    "way": name,
                    "tau s": retardation,
                    "in mJ": 1e3 * taken,
                    "out mJ": 1e3 * out,
                    "lost %": 100 - 100 * out / taken,
                    "normal force alone, lost %": 100 - 100 * back / alone,
                }
            )
    if given.json:
        json.dump(rows, sys.stdout, indent=2)
    else:
        show(f"approach {1e3 * given.approach:g} mm", rows, digits=3)


if __name__ == "__main__":
    main()
