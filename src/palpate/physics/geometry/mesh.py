"""A triangle mesh with vertex normals and nodal areas; its height above points of the horizontal plane."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from palpate.compiler.exact import arctan2, cos, einsum, sin
from palpate.physics.archive import replacing
from palpate.physics.geometry.pieces import pieces


@dataclass(frozen=True)
class Mesh:
    """A closed or open surface of triangles, counter-clockwise seen from outside."""

    vertices: np.ndarray  # [m] (V,3) float64
    triangles: np.ndarray  # [1] (T,3) int32, indices of vertices
    facing: np.ndarray | None = None  # [1] (V,3) unit normals that are known better than by the triangles; else 0

    @cached_property
    def face_vectors(self) -> np.ndarray:
        """Twice the area of each triangle times its outward normal [m²] (T,3)."""
        a, b, c = (self.vertices[self.triangles[:, i]] for i in range(3))
        return np.cross(b - a, c - a)

    @cached_property
    def closed(self) -> bool:
        """Whether the surface encloses a volume: its area vectors sum to zero."""
        return bool(np.abs(self.face_vectors.sum(axis=0)).max() < 1e-6 * np.abs(self.face_vectors).sum())

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
        """Outward unit normal at each vertex [1] (V,3): the known one, or the mean weighted by the angle of each
        triangle there (Baerentzen & Aanaes 2005); (0, 0, 1) at a vertex that only degenerate triangles share."""
        total = np.zeros_like(self.vertices)
        length = np.linalg.norm(self.face_vectors, axis=1)
        unit = self.face_vectors / np.where(length > 0, length, 1.0)[:, None]
        corners = self.vertices[self.triangles]
        for i in range(3):
            p = corners[:, (i + 1) % 3] - corners[:, i]
            q = corners[:, (i + 2) % 3] - corners[:, i]
            across = np.linalg.norm(np.cross(p, q), axis=1)
            angle = arctan2(across, einsum("ij,ij->i", p, q))
            for c in range(3):
                total[:, c] += np.bincount(self.triangles[:, i], angle * unit[:, c], minlength=len(total))
        length = np.linalg.norm(total, axis=1)
        total[length == 0] = (0.0, 0.0, 1.0)
        mean = total / np.where(length > 0, length, 1.0)[:, None]
        if self.facing is None:
            return mean
        return np.where((self.facing != 0.0).any(axis=1, keepdims=True), self.facing, mean)

    @cached_property
    def thicknesses(self) -> np.ndarray:
        """Mean thickness [m] (V) of the piece to which each vertex belongs, twice its volume over its area: that of a
        plate, the radius of a tube, two thirds of the radius of a ball; inf for an open piece, and without a
        triangle."""
        label = pieces(self.triangles, len(self.vertices))
        area = np.bincount(label, 0.5 * np.linalg.norm(self.face_vectors, axis=1))
        middle = self.vertices - self.vertices.mean(axis=0)
        volume = np.bincount(label, einsum("ij,ij->i", self.face_vectors, middle[self.triangles[:, 0]])) / 6.0
        holder = np.full(len(self.vertices), -1)
        holder[self.triangles] = label[:, None]
        ends, count = self.edges
        mean = 2.0 * np.abs(volume) / np.maximum(area, 1e-300)
        mean[holder[ends[count == 1]]] = np.inf
        return np.where(holder < 0, np.inf, mean[holder])


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
    with replacing(Path(path)) as part:
        part.write_bytes("\n".join(header).encode() + b"\n" + points.tobytes() + faces.tobytes())


def heights(mesh: Mesh, places: np.ndarray) -> np.ndarray:
    """Height z [m] (n) of the highest point of a mesh above each place (x, y) [m] (n,2); NaN outside the mesh."""
    a, b, c = (mesh.vertices[mesh.triangles[:, i]] for i in range(3))
    low, high = np.minimum(np.minimum(a, b), c)[:, :2], np.maximum(np.maximum(a, b), c)[:, :2]
    found = np.full(len(places), np.nan)
    for i, place in enumerate(places):
        near = np.flatnonzero(((low <= place) & (place <= high)).all(axis=1))
        weights = np.stack([_turn(u[near], v[near], place) for u, v in ((b, c), (c, a), (a, b))])
        twice = weights.sum(axis=0)  # signed area of the projection
        over = (weights * np.sign(twice) >= -1e-12 * np.abs(twice)).all(axis=0) & (twice != 0.0)
        if over.any():
            z = np.stack([p[near, 2] for p in (a, b, c)])
            found[i] = ((weights * z).sum(axis=0)[over] / twice[over]).max()
    return found


def _turn(u: np.ndarray, v: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Twice the projected area of the triangles of two corners (n,3) and a place (2); > 0 if counter-clockwise."""
    p, q = u[:, :2] - place, v[:, :2] - place
    return np.asarray(p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0])


def summit(mesh: Mesh, radius: float) -> np.ndarray:
    """The highest vertex [m] (3) on which a finger of this radius [m] fits: on a circle of this radius round it, the
    surface is lower or higher by less than the radius. The highest vertex of all if it fits on none."""
    order = np.argsort(-mesh.vertices[:, 2], kind="stable")
    angle = np.arange(8) * np.pi / 4
    ring = radius * np.stack([cos(angle), sin(angle)], axis=1)
    left = np.ones(len(order), dtype=bool)
    for v in order:
        if not left[v]:
            continue
        point = mesh.vertices[v]
        around = heights(mesh, point[:2] + ring)
        if (np.abs(around - point[2]) < radius).all():
            return np.asarray(point)
        left &= np.linalg.norm(mesh.vertices - point, axis=1) > 0.25 * radius
    return np.asarray(mesh.vertices[order[0]])
