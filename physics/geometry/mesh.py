"""A triangle mesh with vertex normals and nodal areas."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from palpate.physics.exact import arctan2


@dataclass(frozen=True)
class Mesh:
    """A closed or open surface of triangles, counter-clockwise seen from outside."""

    vertices: np.ndarray  # [m] (V,3) float64
    triangles: np.ndarray  # [1] (T,3) int32, indices of vertices

    @cached_property
    def face_vectors(self) -> np.ndarray:
        """Twice the area of each triangle times its outward normal [m²] (T,3)."""
        a, b, c = (self.vertices[self.triangles[:, i]] for i in range(3))
        return np.cross(b - a, c - a)

    @cached_property
    def edges(self) -> tuple[np.ndarray, np.ndarray]:
        """Ends of each edge (E,2), the lower index first, and its number of triangles (E,)."""
        ends = np.sort(self.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        edges, count = np.unique(ends, axis=0, return_counts=True)
        return edges, count

    @cached_property
    def areas(self) -> np.ndarray:
        """Nodal area [m²] (V,): a third of the triangles round each vertex; they sum to the area of the surface."""
        third = np.linalg.norm(self.face_vectors, axis=1) / 6.0
        return np.bincount(self.triangles.ravel(), np.repeat(third, 3), minlength=len(self.vertices))

    @cached_property
    def normals(self) -> np.ndarray:
        """Outward unit normal at each vertex [1] (V,3), weighted by the angle of each triangle there
        (Baerentzen & Aanaes 2005); (0, 0, 1) at a vertex that only degenerate triangles share."""
        total = np.zeros_like(self.vertices)
        length = np.linalg.norm(self.face_vectors, axis=1)
        unit = self.face_vectors / np.where(length > 0, length, 1.0)[:, None]
        corners = self.vertices[self.triangles]
        for i in range(3):
            p = corners[:, (i + 1) % 3] - corners[:, i]
            q = corners[:, (i + 2) % 3] - corners[:, i]
            across = np.linalg.norm(np.cross(p, q), axis=1)
            angle = arctan2(across, np.einsum("ij,ij->i", p, q))
            for c in range(3):
                total[:, c] += np.bincount(self.triangles[:, i], angle * unit[:, c], minlength=len(total))
        length = np.linalg.norm(total, axis=1)
        total[length == 0] = (0.0, 0.0, 1.0)
        return total / np.where(length > 0, length, 1.0)[:, None]


def plane(size: float, count: int) -> Mesh:
    """A square of side `size` [m] in z = 0, centred on the origin, of about `count` vertices; normal +z."""
    n = max(2, round(np.sqrt(count)))
    x = np.linspace(-size / 2, size / 2, n)
    grid = np.stack([*np.meshgrid(x, x, indexing="ij"), np.zeros((n, n))], axis=-1).reshape(-1, 3)
    i = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    corner = np.stack([i, i + n, i + n + 1, i + 1], axis=1)
    triangles = np.concatenate([corner[:, [0, 1, 2]], corner[:, [0, 2, 3]]]).astype(np.int32)
    return Mesh(grid, triangles)


def write_ply(path: str | Path, mesh: Mesh) -> None:
    """Write a mesh with its vertex normals as a binary PLY file, in metres."""
    names = ("x", "y", "z", "nx", "ny", "nz")
    header = [
        "ply",
        "format binary_little_endian 1.0",
        "comment metres",
        f"element vertex {len(mesh.vertices)}",
        *(f"property double {name}" for name in names),
        f"element face {len(mesh.triangles)}",
        "property list uchar int vertex_indices",
        "end_header",
    ]
    faces = np.empty(len(mesh.triangles), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, mesh.triangles
    points = np.concatenate([mesh.vertices, mesh.normals], axis=1).astype("<f8")
    Path(path).write_bytes("\n".join(header).encode() + b"\n" + points.tobytes() + faces.tobytes())
