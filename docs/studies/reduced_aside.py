"""The reduced kidney under loads with a part along the surface, against its full model.

    python docs/studies/reduced_aside.py [--touches 4] [--share 0.3] [--json]

Each touch is pressed in three directions, evenly spread, the part along the surface `share` of the normal one. What is
compared is the mean displacement along the load, on which it does its work; the surface under it is held as by
`palpate reduce`, in the plane of the touch. The error by normal force, with dents and of the linear body. Some minutes.
"""

from __future__ import annotations

import argparse
import json
import os
import sys

os.environ.setdefault("OMP_NUM_THREADS", "1")

import beside  # noqa: F401
import numpy as np
from reduced_fe import Touch
from scipy.interpolate import CubicSpline
from tables import show

from palpate.models.fe.meshing.organ import Organ
from palpate.models.fe.reduce.dents import sticking
from palpate.models.fe.reduce.indentation import Press
from palpate.models.fe.reduce.reducible import of_organ
from palpate.nodes.deformation import ReducedFE
from palpate.physics.bodies.condensed_body import Basis, CondensedBody

DEPTHS = 1e-3 * np.arange(1, 10)
"""[m] Displacements along the load to which the full model is pressed."""
SHOWN = (0.25, 0.5, 1.0, 1.5, 2.0)
"""[N] Normal forces."""


def directions(touch: Touch) -> np.ndarray:
    """Three unit vectors (3,3) along the surface, evenly spread."""
    normal = np.array(touch.normal)
    _, _, axes = np.linalg.svd(normal[None])
    angle = 2.0 * np.pi / 3.0 * np.arange(3)
    vectors: np.ndarray = np.outer(np.cos(angle), axes[1]) + np.outer(np.sin(angle), axes[2])
    return vectors


def moved(body: CondensedBody, touch: Touch, push: np.ndarray, force: float) -> float:
    """Mean displacement along a load per newton of normal force (k,3), after a long step under `force` of it [m]."""
    body.step(touch.nodes, force * push, touch.foot, touch.normal, 1e6)
    nodes, displacement = body.displaced(touch.foot)
    u = np.zeros_like(body.mesh.vertices)
    u[nodes] = displacement
    return float(np.sum(push * u[touch.nodes]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--touches", type=int, default=4)
    parser.add_argument("--share", type=float, default=0.3)
    parser.add_argument("--seed", type=int, default=5)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    node = ReducedFE(position=(0.0, 0.0, 0.0))
    basis, mesh = node.basis(), node.mesh()
    plain = Basis(basis.vertices, basis.triangles, basis.compliance)
    bodies = {n: CondensedBody(b, mesh, node.young, 0.0, 8e-3, 0.02) for n, b in (("linear", plain), ("dents", basis))}
    upper = np.flatnonzero(mesh.normals[:, 2] > 0.0)
    places = np.random.default_rng(given.seed).choice(upper, given.touches, replace=False)
    touches = [Touch(node, bodies["linear"], int(p), 8e-3) for p in places]
    organ = of_organ(Organ(node.coarse_mesh(), node.poisson, node.bed))
    hats, model = organ.hats, Press(organ)
    works, pushes = [], []
    for touch in touches:
        for way in directions(touch):
            turn = np.eye(3) - given.share * np.outer(touch.normal, way)  # what adds the part along the surface
            pushes.append((touch, touch.push @ turn))
            works.append(model.curve(hats @ (touch.load @ turn), DEPTHS, sticking(hats, touch.load)))
    curves = model.run(works)
    rows: list[dict[str, object]] = []
    for force in SHOWN:
        held = [(p, c) for p, c in zip(pushes, curves, strict=True) if node.young * np.nanmax(c.force) >= force]
        row: dict[str, object] = {"normal N": f"{force:g}", "loads": len(held)}
        for name, body in bodies.items() if held else ():
            missed = []
            for (touch, push), curve in held:
                known = np.isfinite(curve.force)
                full = CubicSpline(np.append(0.0, node.young * curve.force[known]), np.append(0.0, DEPTHS[known]))
                missed.append(abs(moved(body, touch, push, force) / float(full(force)) - 1.0))
            row[f"{name} worst %"], row[f"{name} mean %"] = 100.0 * max(missed), 100.0 * float(np.mean(missed))
        rows.append(row)
    if given.json:
        json.dump(rows, sys.stdout, indent=2)
    else:
        show(f"displacement along the load, {given.share:g} of the normal force along the surface", rows, digits=2)


if __name__ == "__main__":
    main()
