"""The triangles of a level of a signed distance, by the marching cubes of scikit-image (Lewiner et al. 2003)."""

import numpy as np

from palpate.physics.errors import MeshError
from palpate.physics.extras import require_extra
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.segmentation.image import LabelImage
from palpate.physics.segmentation.smoothed import Level

VOLUME = 1e-3  # [1] largest error of the volume, over that of the voxels
TURNS = 4  # of the search for the level that has the volume


def march_cubes(image: LabelImage, level: Level, begin: np.ndarray, volume: float) -> Mesh:
    """The surface of the level that encloses this volume [m³]; `begin` (3): the first voxel of its samples."""
    at, limit = 0.0, 0.5 * float(image.spacing.max())
    mesh = _triangles(image, level, begin, at)
    for _ in range(TURNS):
        enclosed = enclosed_volume(mesh)
        if abs(enclosed - volume) <= VOLUME * volume:
            break
        at = float(np.clip(at + (volume - enclosed) / mesh.areas.sum(), -limit, limit))
        mesh = _triangles(image, level, begin, at)
    return mesh


def _triangles(image: LabelImage, level: Level, begin: np.ndarray, at: float) -> Mesh:
    with require_extra(image.file, "scan", MeshError):
        from skimage.measure import marching_cubes
    try:
        corners, triangles, _, _ = marching_cubes(level.values, at)
    except (ValueError, RuntimeError):  # no surface
        raise MeshError(
            f"{image.file}: the label consists of lines and single voxels, expected an organ of at least two voxels in "
            "each direction"
        ) from None
    points = (begin + corners.astype(float) / level.every) @ image.affine[:, :3].T + image.affine[:, 3]
    # Triangles face the higher values, the outside, in a right-handed frame.
    triangles = triangles if np.linalg.det(image.affine[:, :3]) > 0.0 else triangles[:, ::-1]
    return Mesh(points, np.ascontiguousarray(triangles, dtype=np.int32))


def enclosed_volume(mesh: Mesh) -> float:
    """Enclosed volume [m³], negative if the triangles face inwards."""
    corners = mesh.vertices[mesh.triangles] - mesh.vertices.mean(axis=0)
    return float(np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0)
