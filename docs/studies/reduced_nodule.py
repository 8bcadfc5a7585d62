"""How much stiffer the finite-element organ is over a hard nodule, beside the estimate of `physics.nodule`.

    python docs/studies/reduced_nodule.py [--surface kidney] [--depth 9e-3] [--radius 6e-3] [--json]

The linear organ is pressed with the kernel of 8 mm on a line over the nodule. A row: distance of the touch from the
place over the nodule's middle, stiffness over that of the plain organ for some ratios of modulus, and the factor of
`stiffness_map` for the last. The head gives the volume that the mesh makes of the nodule. Half a minute.
"""

from __future__ import annotations

import argparse
import json
import os
import sys

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from palpate.models.fe.meshing.organ import Nodule, Organ
from palpate.models.fe.reduce.dents import RADIUS, patch
from palpate.models.fe.reduce.reducible import Reducible, of_organ
from palpate.nodes.deformation import ReducedFE
from palpate.physics.bodies.nodule import stiffness_map
from palpate.physics.geometry.mesh_closest import MeshClosestPoint

RATIOS = (1.01, 2.0, 5.0, 10.0)
DISTANCES = 1e-3 * np.array([0.0, 4.0, 8.0, 12.0, 16.0, 24.0, 32.0])


def stiffness(organ: Reducible, patches: np.ndarray) -> np.ndarray:
    """Of the linear organ under unit loads (P,V,3), for a modulus of 1 Pa [N/m] (P,)."""
    solver = organ.rest()
    loads = np.einsum("nv,pvi->nip", organ.hats, patches).reshape(3 * len(organ.mesh.points), -1)
    return np.asarray(1.0 / np.sum(loads * solver.solve(loads), axis=0))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--surface", default="kidney")
    parser.add_argument("--depth", type=float, default=9e-3, help="[m] of the nodule's centre")
    parser.add_argument("--radius", type=float, default=6e-3, help="[m] of the nodule")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    node = ReducedFE(surface=given.surface)
    surface = node.coarse_mesh()
    line = np.stack([DISTANCES, 0.0 * DISTANCES, np.full(len(DISTANCES), surface.vertices[:, 2].max())], axis=1)
    feet, normals, *_ = MeshClosestPoint(surface).find(line)
    patches = np.stack([patch(surface, foot, n, RADIUS) for foot, n in zip(feet, normals, strict=True)])
    centre = tuple((feet[0] - given.depth * normals[0]).tolist())
    plain = stiffness(of_organ(Organ(surface, node.poisson, node.bed)), patches)
    rows: list[dict[str, float]] = [{"distance mm": 1e3 * float(d)} for d in DISTANCES]
    for ratio in RATIOS:
        organ = of_organ(Organ(surface, node.poisson, node.bed, Nodule(centre, given.radius, ratio)))
        for row, factor in zip(rows, stiffness(organ, patches) / plain, strict=True):
            row[f"ratio {ratio:g}"] = float(factor)
    for row, factor in zip(rows, stiffness_map(feet, normals, centre, given.radius, RATIOS[-1], RADIUS), strict=True):
        row["estimate"] = float(factor)
    meshed = float(organ.mesh.corner_volumes[organ.mesh.region == 1].sum())
    if given.json:
        json.dump({"volume over the ball's": meshed / (4.19 * given.radius**3), "rows": rows}, sys.stdout, indent=2)
        return
    print(f"nodule of {1e6 * meshed:.3g} ml in the mesh, {1e6 * 4.19 * given.radius**3:.3g} ml as a ball")
    print("  ".join(rows[0]))
    for row in rows:
        print("  ".join(f"{row[name]:{len(name)}.3f}" for name in row))


if __name__ == "__main__":
    main()
