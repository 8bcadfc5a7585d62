"""The stiffness of an organ next to bone, by springs with their map and by finite elements.

    python benchmarks/bone.py [--cases 4] [--json]

An ellipsoid of 80 x 60 mm, made from voxels of 1.5 mm, lies on bone of another shape in each case. The entries are its
stiffness along its upper side over that without the bone: by the map of deformation.MassSpring under the patch of
8 mm, and by deformation.ReducedFE, whose foundation of 20 mm remains where there is no bone. A case takes a minute.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from tables import parser, print_tables

from palpate.models.build.basis import build_basis, silent
from palpate.nodes.deformation import ReducedFE
from palpate.nodes.deformation.mass_spring import MassSpring
from palpate.physics.geometry.mesh import write_ply
from palpate.physics.segmentation.backing import bone_of
from palpate.physics.segmentation.image import LabelImage, Segment
from palpate.physics.segmentation.region import Region
from palpate.physics.segmentation.surface import label_surface

SIDE, HALF = 1.5e-3, (52e-3, 40e-3, 36e-3)  # [m] of a voxel; half sides of the image
PLACES = 1e-3 * np.array([-24.0, -16.0, -8.0, 0.0, 8.0, 16.0, 24.0])  # [m] along x
Solid = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
CASES: list[tuple[str, float, Solid]] = [
    ("a plate below half of it, 24 mm thick", 12e-3, lambda x, y, z: (x > 0.0) & (z < -6e-3)),
    ("a plate below half of it, 36 mm thick", 18e-3, lambda x, y, z: (x > 0.0) & (z < -10e-3)),
    ("a rib of 12 mm", 12e-3, lambda x, y, z: np.hypot(x, z + 8e-3) < 6e-3),
    ("a ball of 24 mm", 15e-3, lambda x, y, z: np.hypot(np.hypot(x, y), z + 14e-3) < 12e-3),
]
"""Name, half height [m] of the organ, and the bone."""


def image_of(high: float, solid: Solid) -> LabelImage:
    """The organ, 1, and the bone, 2."""
    count = [round(2 * half / SIDE) + 1 for half in HALF]
    x, y, z = (SIDE * (k - 0.5 * (n - 1)) for k, n in zip(np.indices(count), count, strict=True))
    labels = ((x / 40e-3) ** 2 + (y / 30e-3) ** 2 + (z / high) ** 2 < 1.0).astype(np.uint8)
    labels[solid(x, y, z)] = 2
    begin = [-0.5 * SIDE * (n - 1) for n in count]
    return LabelImage("organ", labels[None], np.column_stack([SIDE * np.eye(3), begin]))


def main() -> None:
    arguments = parser(__doc__)
    arguments.add_argument("--cases", type=int, default=len(CASES), help="number of bones")
    given = arguments.parse_args()
    rows: list[dict[str, object]] = []
    with tempfile.TemporaryDirectory() as folder:
        for number, (name, high, solid) in enumerate(CASES[: given.cases]):
            image, organ, bone = image_of(high, solid), Segment(1, "", 0, 1), Segment(2, "", 0, 2)
            mesh, shape = Path(folder, f"{number}.ply"), Path(folder, f"{number}.npz")
            write_ply(mesh, label_surface(image, organ).mesh)
            region: Region = bone_of(image, [bone], organ)[1]
            region.save(shape)
            surface = {"surface": str(mesh)}
            bodies = [ReducedFE(**surface, bone_shape=file, walls=0.0) for file in (str(shape), "")]
            full, plain = (body.stiffness_field(build_basis(body, silent, check=False)[0])[0] for body in bodies)
            springs = MassSpring(**surface, bone_shape=str(shape))
            vertices = springs.mesh().vertices
            top = np.where(springs.mesh().normals[:, 2] > 0.5, 0.0, np.inf)
            feet = [np.argmin((vertices[:, 0] - x) ** 2 + vertices[:, 1] ** 2 + top) for x in PLACES]
            apart = np.linalg.norm(vertices - vertices[feet][:, None], axis=2) / springs.radius
            weight = np.clip(1.0 - apart**2, 0.0, None) ** 2 * springs.mesh().areas
            mapped = weight @ springs.hardness() / weight.sum(axis=1)
            for by, factors in (("finite elements", (full / plain)[feet]), ("map", mapped)):
                at = {f"{1e3 * x:.0f} mm": round(float(k), 3) for x, k in zip(PLACES, factors, strict=True)}
                rows.append({"bone": name, "by": by} | at)
    print_tables({"Stiffness over that without the bone, along the organ": rows}, given.json)


if __name__ == "__main__":
    main()
