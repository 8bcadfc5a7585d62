"""The voxels of a label inside of an organ, as a file that a body reads in place of a sphere.

An archive with the bits of the voxels of a box, its sides, and the affine map from their indices to metres in the
coordinates of the segmentation.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from palpate.compiler.exact import einsum, solve
from palpate.physics.archive import ArchiveError, read_arrays, replacing
from palpate.physics.arrays import Points
from palpate.physics.nearest import nearest, tree_of

MOST = 1 << 25  # voxels of a box, as of an organ
MOST_PARTS = 4  # of the side of a voxel


class Region(NamedTuple):
    """Voxels (i,j,k) bool, and the affine map (3,4) [m] from the index of a voxel to its centre."""

    voxels: np.ndarray
    affine: np.ndarray

    def points(self, size: float) -> tuple[np.ndarray, float]:
        """Points [m] (n,3) of the label, and the volume [m³] of each: the middles of its voxels, or of equal parts of
        them no longer than `size` [m], at most `MOST_PARTS` along each side."""
        sides = np.linalg.norm(self.affine[:, :3], axis=0)
        parts = np.clip(np.ceil(sides / size), 1.0, MOST_PARTS).astype(np.int64)
        within = (np.moveaxis(np.indices(parts), 0, -1).reshape(-1, 3) + 0.5) / parts - 0.5
        index = (np.argwhere(self.voxels)[:, None] + within).reshape(-1, 3)
        x, y, z = self.affine[:, :3].T
        volume = abs(float(einsum("i,i->", x, np.cross(y, z)))) / float(parts.prod())
        return einsum("nj,ij->ni", index, self.affine[:, :3]) + self.affine[:, 3], volume

    def contains(self, points: Points) -> np.ndarray:
        """Whether points [m] (n,3) lie in a voxel of the label."""
        away = np.asarray(points, float) - self.affine[:, 3]
        index = np.rint(einsum("nj,ij->ni", away, solve(self.affine[:, :3], np.eye(3)))).astype(np.int64)
        there = ((index >= 0) & (index < self.voxels.shape)).all(axis=-1)
        i, j, k = np.moveaxis(np.where(there[..., None], index, 0), -1, 0)
        return np.asarray(there & self.voxels[i, j, k])

    def border_distance(self, points: Points) -> np.ndarray:
        """Distance [m] (n) of points (n,3) to the nearest face between a voxel of the label and another one."""
        return np.asarray(np.sqrt(np.sum(np.square(self.nearest_border(points) - points), axis=1)))

    def nearest_border(self, points: Points) -> np.ndarray:
        """Middle [m] (n,3) of this face."""
        whole = np.pad(self.voxels, 1)
        middles = []
        for axis in range(3):
            low = np.argwhere(np.diff(whole.astype(np.int8), axis=axis)) - 1.0
            low[:, axis] += 0.5
            middles.append(low)
        places = einsum("nj,ij->ni", np.concatenate(middles), self.affine[:, :3]) + self.affine[:, 3]
        return np.asarray(places[nearest(tree_of(places), np.asarray(points, float))[1][:, 0]])

    def save(self, path: Path) -> None:
        """Write it. OSError: it cannot be written."""
        with replacing(path, cached=True) as part:
            np.savez_compressed(
                part, bits=np.packbits(self.voxels), sides=np.array(self.voxels.shape), affine=self.affine
            )


def read_region(file: str) -> Region:
    """The region of a file. ArchiveError: it cannot be read, or is no such file."""
    try:
        now = Path(file).stat()
    except OSError as error:
        raise ArchiveError(f"{file}: {error.strerror}") from None
    return _read_region(file, (now.st_mtime_ns, now.st_size))


@lru_cache(maxsize=4)
def _read_region(file: str, stamp: tuple[int, int]) -> Region:
    """`read_region`, kept because all lanes of an ensemble have the same one. stamp: time of last change, size"""
    found = read_arrays(file, "bits", "sides", "affine")
    expected = f"{file}: expected the voxels of a label, as `--label liver+vessel` writes them"
    if found.keys() != {"bits", "sides", "affine"}:
        raise ArchiveError(f"{expected}; found the arrays {', '.join(found) or 'none'}")
    bits, sides, affine = found["bits"], found["sides"], found["affine"]
    whole = sides.shape == (3,) and sides.dtype.kind == "i" and bool((sides > 0).all()) and int(sides.prod()) <= MOST
    if not whole or bits.dtype != np.uint8 or bits.shape != (-(-int(sides.prod()) // 8),):
        raise ArchiveError(f"{expected}; found {bits.size} bytes of voxels for the sides {sides.tolist()}")
    if affine.shape != (3, 4) or affine.dtype != float or not np.isfinite(affine).all():
        raise ArchiveError(f"{expected}; found an affine map of the shape {affine.shape}")
    x, y, z = affine[:, :3].T
    volume = einsum("ni,ni->n", x[None], np.cross(y, z)[None])[0]
    if abs(volume) < 1e-18:
        raise ArchiveError(f"{expected}; found an affine map without volume")
    voxels = np.unpackbits(bits, count=int(sides.prod())).astype(bool).reshape(sides)
    return Region(voxels, affine)
