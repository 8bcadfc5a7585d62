"""Organs from images by marching cubes: scatter of the vertices, normals, and the force on the hand.

    python benchmarks/images.py [folder]

An ellipsoid of 90 x 60 x 40 mm, turned by 0.4 rad, in images of grey values and in blurred masks. Needs the extras
`mesh` and `scan`. The meshes remain in the folder.
"""

import sys
import warnings
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter
from skimage.measure import marching_cubes

import palpate
from palpate.physics.geometry.mesh import Mesh, write_ply
from palpate.physics.geometry.refined.divided import SHORTEST, refine_mesh, remove_thin
from palpate.physics.geometry.refined.edges import creases
from palpate.physics.geometry.refined.smoothed import smooth_vertices
from palpate.studies.organs.shapes import star

AXES, TURN, LONGEST = np.array([45e-3, 30e-3, 20e-3]), 0.4, 1.6e-3
TURNED = np.array([[np.cos(TURN), -np.sin(TURN), 0.0], [np.sin(TURN), np.cos(TURN), 0.0], [0.0, 0.0, 1.0]])
IMAGES = [(1.0, 0.0), (2.0, 0.0), (3.0, 0.0), (1.0, 2.0), (1.0, 1.0), (2.0, 1.0)]
"""Size of the voxels [mm], blur of the mask in voxels; 0: grey values."""


def image(voxel: float, blur: float) -> Mesh:
    size = np.ceil(50.0 / voxel) * voxel
    grid = np.stack(np.meshgrid(*[np.arange(-size, size + 0.1, voxel)] * 3, indexing="ij"), -1)
    level = np.linalg.norm(1e-3 * grid @ TURNED / AXES, axis=-1)
    values, at = (gaussian_filter((level < 1.0).astype(float), blur), 0.5) if blur else (-level, -1.0)
    points, triangles, _, _ = marching_cubes(values, at, spacing=(voxel,) * 3)
    mesh = Mesh(1e-3 * (points.astype(float) - size), triangles.astype(np.int32))
    outwards = np.einsum("ij,ij->", mesh.face_vectors, mesh.vertices[mesh.triangles[:, 0]]) > 0.0
    return mesh if outwards else Mesh(mesh.vertices, np.ascontiguousarray(mesh.triangles[:, ::-1]))


def off(points: np.ndarray) -> tuple[float, np.ndarray]:
    """Root mean square of the distances [m] from the ellipsoid about their mean, and its normals (V,3)."""
    slope = points @ TURNED / AXES**2
    away = (np.linalg.norm(points @ TURNED / AXES, axis=1) - 1.0) / np.linalg.norm(slope, axis=1)
    return float(away.std()), (slope / np.linalg.norm(slope, axis=1)[:, None]) @ TURNED.T


def hand(file: Path, body: str) -> float:
    """Greatest change [N] of the force on the hand in a tick, on the path of the kidney."""
    organ = {"file": str(file), "unit": "m"}
    run = palpate.run("kidney", tissue=f"deformation.{body}", organ=organ, record=file.with_suffix(".mcap"))
    return float(np.linalg.norm(np.diff(run.xarray()["controller.force"], axis=0), axis=1).max())


def main() -> None:
    warnings.simplefilter("ignore")
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "images")
    folder.mkdir(parents=True, exist_ok=True)
    meshes = {}
    for voxel, blur in IMAGES:
        meshes[f"{f'mask, blurred by {blur:g}' if blur else 'grey values'}, {voxel:g} mm"] = image(voxel, blur)
    unit = star(lambda way: np.ones(len(way)), 5000)
    meshes["an even mesh"] = Mesh(unit.vertices * AXES @ TURNED.T, unit.triangles)
    print("                          vertices off [um]        normals off [deg]   hand [N per tick]")
    print("image                     of the file, smoothed    rms, largest        BeamBundle, MassSpring")
    for name, mesh in meshes.items():
        given, _ = remove_thin(mesh, SHORTEST * LONGEST)
        before, after = (1e6 * off(each.vertices)[0] for each in (given, smooth_vertices(given, *creases(given))))
        fine = refine_mesh(mesh, LONGEST, 50_000)
        angle = np.degrees(np.arccos(np.clip(np.einsum("ij,ij->i", fine.normals, off(fine.vertices)[1]), -1.0, 1.0)))
        file = folder / (name.replace(",", "").replace(" ", "-") + ".ply")
        write_ply(file, mesh)
        bodies = hand(file, "BeamBundle"), hand(file, "MassSpring")
        print(
            f"{name:25} {before:6.1f}, {after:6.1f}           {np.sqrt((angle**2).mean()):5.2f}, {angle.max():5.1f}"
            f"        {bodies[0]:5.2f}, {bodies[1]:5.2f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
