"""The stiffness over a ball of another modulus, by springs with their map and by finite elements.

    python benchmarks/nodule_map.py [--cases 6] [--patch 8] [--json]

A patch (radius 8 mm) presses the kidney over the ball and at 4, 8, 12 and 16 mm from there. The entries are the
stiffness over that of the kidney without the ball, by the map of deformation.MassSpring under the patch, and by the
linear full finite elements of the organ. A case takes half a minute.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from tables import parser, print_tables

from palpate.models.fe.meshing.organ import Nodule, Organ
from palpate.models.fe.reduce.reducible import Reducible, of_organ
from palpate.models.fe.reduce.snapshots import patch
from palpate.nodes.deformation import ReducedFE
from palpate.nodes.deformation.mass_spring import MassSpring
from palpate.physics.geometry.mesh_closest import MeshClosestPoint

DISTANCES = 1e-3 * np.array([0.0, 4.0, 8.0, 12.0, 16.0])
CASES = [(9, 6, 10.0), (9, 6, 0.1), (6, 4, 10.0), (6, 4, 0.1), (15, 8, 10.0), (9, 6, 3.0), (12, 6, 10.0), (12, 6, 0.1)]
"""Depth and radius [mm] and modulus ratio of the balls."""


def stiffness(organ: Reducible, patches: np.ndarray) -> np.ndarray:
    """Of the linear organ under unit loads (P,V,3) for a modulus of 1 Pa [N/m] (P,)."""
    solver = organ.elastic.rest(organ.fixed)
    loads = np.einsum("nv,pvi->nip", organ.hats, patches).reshape(3 * len(organ.mesh.points), -1)
    return np.asarray(1.0 / np.sum(loads * solver.solve(loads), axis=0))


def main() -> None:
    arguments = parser(__doc__)
    arguments.add_argument("--cases", type=int, default=len(CASES), help="number of balls")
    arguments.add_argument("--patch", type=float, default=8.0, help="its radius [mm]")
    given = arguments.parse_args()
    if not 1.0 <= given.patch <= 50.0:
        arguments.error(f"--patch: found {given.patch:g} mm, expected 1 to 50")
    reach = 1e-3 * given.patch
    node = ReducedFE(surface="kidney", coarse=1200)
    surface = node.coarse_mesh()
    line = np.stack([DISTANCES, 0.0 * DISTANCES, np.full(len(DISTANCES), surface.vertices[:, 2].max())], axis=1)
    feet, normals, *_ = MeshClosestPoint(surface).find(line)
    patches = np.stack([patch(surface, foot, n, reach) for foot, n in zip(feet, normals, strict=True)])
    plain = stiffness(of_organ(Organ(surface, node.poisson, node.bed)), patches)
    rows: list[dict[str, object]] = []
    for depth, radius, ratio in CASES[: given.cases]:
        ball = Nodule(tuple((feet[0] - 1e-3 * depth * normals[0]).tolist()), 1e-3 * radius, ratio)
        full = stiffness(of_organ(Organ(surface, node.poisson, node.bed, ball)), patches) / plain
        springs = MassSpring(
            surface="kidney", vertices=10000, position=(0.0, 0.0, 0.0), radius=reach, nodule_radius=1e-3 * radius,
            nodule_position=tuple(feet[0].tolist()), nodule_depth=1e-3 * depth, nodule_ratio=ratio,
        )  # fmt: skip
        apart = np.linalg.norm(springs.mesh().vertices - feet[:, None], axis=2) / reach
        weight = np.clip(1.0 - apart**2, 0.0, None) ** 2
        mapped = weight @ springs.hardness() / weight.sum(axis=1)
        for name, factors in (("finite elements", full), ("map", mapped)):
            at = {f"{1e3 * d:.0f} mm": round(float(k), 3) for d, k in zip(DISTANCES, factors, strict=True)}
            rows.append({"depth, radius [mm], ratio": f"{depth}, {radius}, {ratio:g}", "by": name} | at)
    print_tables({"Stiffness over that without the ball, at distances from its middle": rows}, given.json)


if __name__ == "__main__":
    main()
