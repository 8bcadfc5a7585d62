"""A triangle mesh with vertex normals and nodal areas; its height above points of the horizontal plane."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, wraps
from pathlib import Path
from typing import Any, Concatenate, ParamSpec, TypeVar

import numpy as np

from palpate.compiler.exact import arctan2, cos, einsum, sin
from palpate.compiler.kernel import ieee_kernel, kernel
from palpate.physics.archive import replacing
from palpate.physics.arrays import Array, Indices, Matrix
from palpate.physics.geometry.pieces import pieces
from palpate.physics.geometry.refined.edge_list import edges_of

P = ParamSpec("P")
T = TypeVar("T")


@dataclass(frozen=True)
class Mesh:
    """A closed or open surface of triangles, counter-clockwise seen from outside."""

    vertices: np.ndarray  # [m] (V,3) float64
    triangles: np.ndarray  # [1] (T,3) int32, indices of vertices
    facing: np.ndarray | None = None  # [1] (V,3) unit normals that are known better than by the triangles; else 0

    @cached_property
    def kept(self) -> dict[Any, Any]:
        """Results of functions of this mesh, see `once_per_mesh`."""
        return {}

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
        ends, of, _ = edges_of(self.triangles, len(self.vertices))
        return ends.astype(self.triangles.dtype), np.bincount(of.ravel(), minlength=len(ends))

    @property
    def border(self) -> np.ndarray:
        """The vertices (B,) of edges of one triangle only, in ascending order; none: the surface is closed."""
        ends, count = self.edges
        return np.unique(ends[count == 1])

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


def once_per_mesh(compute: Callable[Concatenate[Mesh, P], T]) -> Callable[Concatenate[Mesh, P], T]:
    """Decorator: keep the results of a function of a mesh, and of further arguments that have a hash, as long as the
    mesh exists. Nodes that start again with another stiffness need the same tables. Nothing may write in them."""

    @wraps(compute)
    def known(mesh: Mesh, *args: P.args, **named: P.kwargs) -> T:
        key = (compute, args, tuple(named.items()))
        if key not in mesh.kept:
            mesh.kept[key] = compute(mesh, *args, **named)
        found: T = mesh.kept[key]
        return found

    return known


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
    found = np.full(len(places), -np.inf)
    _raise(mesh.vertices, mesh.triangles, np.ascontiguousarray(places, dtype=float), found)
    return np.where(np.isinf(found), np.nan, found)


@ieee_kernel
def _raise(points: Matrix, triangles: Indices, places: Matrix, found: Array):
    """Raise each of the heights [m] (n) to the highest triangle above its place [m] (n,2)."""
    for t in range(len(triangles)):
        a, b, c = points[triangles[t, 0]], points[triangles[t, 1]], points[triangles[t, 2]]
        left, right = min(a[0], b[0], c[0]), max(a[0], b[0], c[0])
        front, back = min(a[1], b[1], c[1]), max(a[1], b[1], c[1])
        for n in range(len(places)):
            x, y = places[n]
            if not (left <= x <= right and front <= y <= back):
                continue
            u, v, w = _turn(b, c, x, y), _turn(c, a, x, y), _turn(a, b, x, y)
            twice = u + v + w  # signed area of the projection
            side, least = np.sign(twice), -1e-12 * abs(twice)
            if twice != 0.0 and u * side >= least and v * side >= least and w * side >= least:
                found[n] = max(found[n], (u * a[2] + v * b[2] + w * c[2]) / twice)


@kernel
def _turn(u: Array, v: Array, x: float, y: float):
    """Twice the projected area of the triangle of two corners (3) and a place; > 0 if counter-clockwise."""
    return (u[0] - x) * (v[1] - y) - (u[1] - y) * (v[0] - x)


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
