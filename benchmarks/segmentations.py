"""Organs from masks: error of the surface, touches under the invariants of `palpate bench organs`, and the force.

    python benchmarks/segmentations.py [touches]

The masks are made here: turned ellipsoids of several voxels, a liver with lobes and a fissure, holes, islands, a bridge
of one voxel, a label that touches another one, a body cut by the border of its image. The force is compared with that
on a mesh whose vertices lie on the ellipsoid. Needs the extras `mesh` and `scan`.
"""

import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.mesh_closest import MeshClosestPoint
from palpate.physics.segmentation.image import LabelImage, choose_label
from palpate.physics.segmentation.surface import Segmented, label_surface
from palpate.studies.organs import zoo
from palpate.studies.organs.pairs import forces
from palpate.studies.organs.search import search
from palpate.studies.organs.shapes import star
from palpate.studies.organs.touches import USUAL, Setting
from palpate.studies.organs.widths import press_touch

MM = 1e-3
AXES = np.array([45.0, 30.0, 20.0]) * MM  # [m] half axes of the ellipsoids
TURN = Rotation.from_euler("zx", [0.4, 0.3]).as_matrix()
HELD = slice(600, 750)  # [ms] of a press, after 300 ms of motion
Level = Callable[[np.ndarray], np.ndarray]


def ellipsoid(points: np.ndarray, axes: np.ndarray = AXES, middle: tuple[float, ...] = (0.0, 0.0, 0.0)) -> np.ndarray:
    """Below 0 inside; `points` [m] (...,3)."""
    return np.asarray(np.linalg.norm((points - middle) @ TURN / axes, axis=-1) - 1.0)


def liver(points: np.ndarray) -> np.ndarray:
    """A thick and a thin lobe, with a fissure of 4 mm, 20 mm deep, between them."""
    thick = ellipsoid(points, np.array([40, 32, 24]) * MM, (-20 * MM, 0.0, 0.0))
    thin = ellipsoid(points, np.array([36, 24, 12]) * MM, (26 * MM, 4 * MM, 0.0))
    fissure = (np.abs(points[..., 0] - 8 * MM) < 2 * MM) & (points[..., 1] > 4 * MM)
    return np.where(fissure, 1.0, np.minimum(thick, thin))


def bridge(points: np.ndarray) -> np.ndarray:
    """Two balls, joined by a row of single voxels of 1 mm."""
    balls = [np.linalg.norm(points - (x, 0.0, 0.0), axis=-1) - 16 * MM for x in (-22 * MM, 22 * MM)]
    row = np.where(np.abs(points[..., 0]) < 20 * MM, np.abs(points[..., 1:]).max(axis=-1) - 0.5 * MM, 1.0)
    return np.minimum(np.minimum(*balls), row)


def with_holes(points: np.ndarray) -> np.ndarray:
    holes = [np.linalg.norm(points - (x * MM, 0.0, 0.0), axis=-1) < 4 * MM for x in (-25, 0, 25)]
    return np.where(np.any(holes, axis=0), 1.0, ellipsoid(points))


def with_islands(points: np.ndarray) -> np.ndarray:
    specks = [np.linalg.norm(points - np.array(at) * MM, axis=-1) - 2 * MM for at in ((40, 28, 10), (-30, -30, 20))]
    return np.minimum(ellipsoid(points), np.minimum(*specks))


def half(points: np.ndarray) -> np.ndarray:
    """Part of an ellipsoid; the other part is another label."""
    return np.maximum(ellipsoid(points), (points[..., 0] - 10 * MM) / AXES[0])


MASKS: dict[str, tuple[Level, tuple[float, float, float], float]] = {
    "ellipsoid-1mm": (ellipsoid, (1.0, 1.0, 1.0), 0.0),
    "ellipsoid-2mm": (ellipsoid, (2.0, 2.0, 2.0), 0.0),
    "ellipsoid-1x1x3mm": (ellipsoid, (1.0, 1.0, 3.0), 0.0),
    "ellipsoid-1x1x5mm": (ellipsoid, (1.0, 1.0, 5.0), 0.0),
    "liver": (liver, (1.5, 1.5, 1.5), 0.0),
    "holes": (with_holes, (1.5, 1.5, 1.5), 0.0),
    "islands": (with_islands, (1.5, 1.5, 1.5), 0.0),
    "bridge": (bridge, (1.0, 1.0, 1.0), 0.0),
    "touching": (half, (1.5, 1.5, 1.5), 0.0),
    "cut": (ellipsoid, (1.5, 1.5, 1.5), 20.0),
}
"""Level below 0 inside, sides of the voxels [mm], and what the image lacks at one side [mm]."""


def image_of(name: str) -> LabelImage:
    """The image of a mask: label 1, and 2 next to `touching`."""
    level, sides, lacks = MASKS[name]
    spacing = np.array(sides) * MM
    first = -np.ceil((np.array([66.0, 48.0, 40.0]) - (lacks, 0.0, 0.0)) * MM / spacing)
    if lacks:
        first[0] = -np.floor(30 * MM / spacing[0])
    last = np.ceil(np.array([66.0, 48.0, 40.0]) * MM / spacing)
    index = np.moveaxis(np.indices((last - first + 1).astype(int)), 0, -1) + first
    points = index * spacing + np.array([0.31, 0.17, 0.23]) * spacing * (name != "bridge")
    voxels = (level(points) < 0.0).astype(np.uint8)
    if level is half:
        voxels[(voxels == 0) & (ellipsoid(points) < 0.0)] = 2
    affine = np.column_stack([np.diag(spacing), points[0, 0, 0]])
    return LabelImage(name, voxels[None], affine)


def surface_of(name: str) -> Segmented:
    image = image_of(name)
    return label_surface(image, choose_label(image, 1))


def exact(count: int) -> Mesh:
    """A mesh with its vertices on the ellipsoid."""
    unit = star(lambda way: np.ones(len(way)), count)
    return Mesh(unit.vertices * AXES @ TURN.T, unit.triangles)


@contextmanager
def in_zoo() -> Iterator[list[zoo.Specimen]]:
    """The surfaces of the masks, and the ellipsoid, as surfaces of `bench organs`."""
    added = {name: zoo.Specimen(name, lambda _, name=name: surface_of(name).mesh, "from a mask") for name in MASKS}
    added["exact"] = zoo.Specimen("exact", lambda _: exact(20_000), "an ellipsoid")
    zoo.ZOO.update(added)
    zoo.mesh_of.cache_clear()
    try:
        yield [added[name] for name in MASKS]
    finally:
        for name in added:
            del zoo.ZOO[name]
        zoo.mesh_of.cache_clear()


def force_errors(name: str, body: str, count: int, folder: Path, seed: int = 1) -> np.ndarray:
    """Difference of the contact force from that on the ellipsoid [1] (count), at the end of presses along the normal at
    random places of the ellipsoid, 4 to 9 mm deep with the compression of the fingertip."""
    rng = np.random.default_rng(seed)
    setting = Setting("exact", USUAL, body, "", 1000.0, 1)
    mesh = setting.mesh()
    share = np.linalg.norm(mesh.face_vectors, axis=1)
    touches = []
    while len(touches) < count:
        t = rng.choice(len(share), p=share / share.sum())
        place = mesh.vertices[mesh.triangles[t]].mean(axis=0)
        normal = mesh.face_vectors[t] / share[t]
        touches.append(press_touch(setting, place, -normal, float(rng.uniform(4 * MM, 9 * MM))))
    mine = [replace(touch, setting=replace(setting, surface=name)) for touch in touches]
    return np.array([
        a[HELD].mean() / b[HELD].mean() - 1.0
        for a, b in zip(forces(mine, folder), forces(touches, folder), strict=True)
    ])  # fmt: skip


def errors(name: str) -> tuple[float, float, float]:
    """Distances [m] of the surface's vertices from the ellipsoid: mean, root mean square, largest."""
    foot = MeshClosestPoint(exact(80_000)).find(surface_of(name).mesh.vertices)
    away = foot[3]
    return float(away.mean()), float(np.sqrt((away**2).mean())), float(np.abs(away).max())


def main() -> None:
    warnings.simplefilter("ignore")
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 400
    print("mask                 vertices  volume [cm³]  enclosed    off [um]: mean, rms, largest   notes")
    for name in MASKS:
        made = surface_of(name)
        off = "{:6.0f} {:6.0f} {:6.0f}".format(*(1e6 * e for e in errors(name))) if "ellipsoid" in name else ""
        error = made.enclosed / made.volume - 1
        print(f"{name:20} {len(made.mesh.vertices):8}  {1e6 * made.volume:12.2f}  {error:+8.2%}    {off:28}  "
              + "; ".join(made.notes), flush=True)  # fmt: skip
    with in_zoo() as specimens, tempfile.TemporaryDirectory() as folder:
        for body in ("MassSpring", "BeamBundle"):
            for name in (name for name in MASKS if "ellipsoid" in name):
                found = force_errors(name, body, 20, Path(folder))
                print(
                    f"force, {body:10} {name:20} wrong by {np.abs(found).mean():.2%} on average, "
                    f"{np.abs(found).max():.2%} at most"
                )
        results = search(specimens, ["MassSpring", "BeamBundle"], count, 1, Path(folder), fingers=1)
        for key, touched in results.touches.items():
            print(f"{key[0]:20} {key[1]:12} {touched} touches, {results.bad[key]} beyond an invariant")


if __name__ == "__main__":
    main()
