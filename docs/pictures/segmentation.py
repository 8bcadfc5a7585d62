"""Draw the surface of a liver with a fissure over its voxels: python docs/pictures/segmentation.py [folder]

segmentation.png   `palpate picture organ liver.seg.nrrd --label liver`, of a mask that is made here
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from palpate.launch.load.organ_file import OrganFile
from palpate.nodes.base.felt import WIDTH
from palpate.views.pictures.models.organ import describe_organ, draw_organ

VOXEL = 1.5  # [mm]
NAMES = {1: "liver", 2: "tumour", 3: "gallbladder"}
TURN = np.array([[0.921, -0.372, 0.115], [0.389, 0.880, -0.272], [0.0, 0.296, 0.955]])


def inside(points: np.ndarray, middle: tuple[float, ...], axes: tuple[float, ...]) -> np.ndarray:
    """Whether points [mm] (...,3) are in a turned ellipsoid."""
    return np.asarray(np.linalg.norm((points - middle) @ TURN / axes, axis=-1) < 1.0)


def write_labels(path: Path) -> None:
    """A file of 3D Slicer with a liver of two lobes, a tumour in it, and a gallbladder next to it."""
    import nrrd

    half = np.array([46, 34, 28])
    points = VOXEL * (np.moveaxis(np.indices(2 * half + 1), 0, -1) - half)
    lobes = inside(points, (-20, 0, 0), (40, 32, 24)) | inside(points, (26, 4, 0), (36, 24, 12))
    fissure = (np.abs(points[..., 0] - 8) < 2) & (points[..., 1] > 4)
    labels = np.where(lobes & ~fissure, 1, 0)
    labels[inside(points, (-25, 0, 5), (8, 8, 8))] = 2
    labels[(labels == 0) & inside(points, (0, -38, 0), (16, 12, 14))] = 3
    segments = {f"Segment{k}_Name": NAMES[k + 1] for k in range(3)}
    segments |= {f"Segment{k}_LabelValue": str(k + 1) for k in range(3)}
    nrrd.write(str(path), labels.astype(np.uint8), {
        "space": "right-anterior-superior", "space directions": VOXEL * np.eye(3), "space origin": -VOXEL * half,
        "encoding": "gzip", **segments,
    })  # fmt: skip


def main(target: Path) -> list[Path]:
    """Write the mask, make its surface, draw it."""
    target.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="palpate-") as scratch:
        file = Path(scratch) / "liver.seg.nrrd"
        write_labels(file)
        return [draw_organ(describe_organ(OrganFile(file, label="liver")), WIDTH, target / "segmentation.png")]


if __name__ == "__main__":
    from target import folder

    for written in main(folder(__doc__)):
        print(written)
