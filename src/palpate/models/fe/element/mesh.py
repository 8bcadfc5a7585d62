"""Meshes of quadratic tetrahedra: nodes, elements, boundary faces; checks of meshes and of surfaces to fill."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from palpate.models.fe.element.elements import EDGES
from palpate.models.fe.element.jacobian import find_inverted
from palpate.physics.errors import MeshError
from palpate.physics.geometry.crossing import UncheckedError, crossing
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.indices import check_indices

FACES = np.array([[0, 2, 1, 6, 5, 4], [0, 1, 3, 4, 8, 7], [1, 2, 3, 5, 9, 8], [0, 3, 2, 7, 9, 6]])
"""The local nodes of each face, counter-clockwise seen from outside: three corners, then the nodes between them."""

_QUADS = np.array([[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]])
FOLDED = 0.05
"""[1] Allowed negative determinant over the largest one of an element: if a square is mapped to a triangle, two edges
become collinear and curved sides may cross slightly at a corner, away from the integration points."""


@dataclass(frozen=True)
class TetMesh:
    """Quadratic tetrahedra. Node order of an element: four corners, then the nodes on edges 01, 12, 20, 03, 13, 23.

    region    (E,) number of the material that fills each element
    """

    points: np.ndarray  # [m] (N,3)
    elements: np.ndarray  # (E,10) node indices
    region: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    def __post_init__(self) -> None:
        points = np.ascontiguousarray(self.points, dtype=np.float64)
        elements = _whole("elements", self.elements)
        region = _whole("region", self.region)
        if points.ndim != 2 or points.shape[1] != 3:
            raise MeshError(f"points: found shape {points.shape}, expected (N, 3)")
        if elements.ndim != 2 or elements.shape[1] != 10 or len(elements) == 0:
            raise MeshError(f"elements: found shape {elements.shape}, expected (E, 10) with E > 0")
        if not np.isfinite(points).all():
            bad = int(np.argwhere(~np.isfinite(points))[0][0])
            raise MeshError(f"point {bad}: found {points[bad].tolist()}, expected finite numbers")
        missing = (elements < 0) | (elements >= len(points))
        if missing.any():
            bad = int(np.argmax(missing.any(axis=1)))
            raise MeshError(
                f"element {bad}: refers to node {elements[bad][missing[bad]][0]}, expected 0 ... {len(points) - 1}"
            )
        if len(region) == 0:
            region = np.zeros(len(elements), dtype=np.int64)
        if region.shape != (len(elements),):
            raise MeshError(f"region: found shape {region.shape}, expected ({len(elements)},)")
        for name, value in (("points", points), ("elements", elements), ("region", region)):
            object.__setattr__(self, name, value)
        wrong = find_inverted(points, elements, FOLDED)
        if len(wrong):
            bad, volume = int(wrong[0]), float(self.corner_volumes[wrong[0]])
            if volume > 0.0:
                raise MeshError(
                    f"element {bad} at {self.place(bad)}: its edges are so curved that its Jacobian is negative "
                    "at some points; straighten them or use smaller elements"
                )
            raise MeshError(
                f"element {bad} at {self.place(bad)}: volume {volume:.3g} m³, expected a positive one; swap two "
                "of its corners if it is inverted, remove it if it is flat"
            )

    @cached_property
    def corner_volumes(self) -> np.ndarray:
        """Volume of the straight tetrahedron on the corners of each element [m³] (E,)."""
        return six_volumes(self.points, self.elements) / 6.0

    @cached_property
    def faces(self) -> np.ndarray:
        """Boundary faces (F,6), outward, node order as in `FACES`."""
        return self.boundary(np.arange(len(self.elements)))

    def boundary(self, elements: np.ndarray) -> np.ndarray:
        """Boundary faces (F,6) of these elements. MeshError: a face that more than two elements share."""
        every = self.elements[elements][:, FACES].reshape(-1, 6)
        key = np.sort(every[:, :3], axis=1)
        _, index, count = np.unique(key, axis=0, return_index=True, return_counts=True)
        if (count > 2).any():
            bad = every[index[np.argmax(count > 2)]]
            raise MeshError(f"the face of nodes {bad[:3].tolist()} belongs to more than two elements")
        return every[np.sort(index[count == 1])]

    def place(self, element: int) -> str:
        return point_text(self.points[self.elements[element, :4]].mean(axis=0))

    @cached_property
    def size(self) -> float:
        """Diagonal of the bounding box [m]."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0)))


def _whole(name: str, numbers: np.ndarray) -> np.ndarray:
    """The numbers as int64. MeshError: not integers."""
    integers = np.asarray(numbers)
    if integers.size and integers.dtype.kind not in "iu":
        raise MeshError(f"{name}: found {integers.dtype} numbers, expected integers; use `{name}.astype(int)`")
    return np.ascontiguousarray(integers, dtype=np.int64)


def point_text(at: np.ndarray) -> str:
    """A point [m] (3,) as text."""
    return f"({at[0]:.4g}, {at[1]:.4g}, {at[2]:.4g}) m"


def six_volumes(points: np.ndarray, tets: np.ndarray) -> np.ndarray:
    """Six times the signed volume [m³] (E,) of tetrahedra (E,4...) on points [m] (N,3)."""
    a, b, c, d = (points[tets[:, i]] for i in range(4))
    return np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a)


def turned_out(points: np.ndarray, tets: np.ndarray) -> np.ndarray:
    """Tetrahedra (E,4), with two corners swapped in each inverted one."""
    return np.where(six_volumes(points, tets)[:, None] < 0, tets[:, [0, 2, 1, 3]], tets)


def quadratic(points: np.ndarray, corners: np.ndarray, region: np.ndarray | None = None) -> TetMesh:
    """Quadratic mesh from linear tetrahedra (E,4), with a node in the middle of each edge. MeshError: a corner that is
    no point."""
    try:
        corners = check_indices(_whole("corners", corners), len(points), "an element refers to the point")
    except ValueError as error:
        raise MeshError(str(error)) from None
    elements, edges = edge_nodes(len(points), corners)
    region = np.zeros(len(corners), dtype=np.int64) if region is None else region
    return TetMesh(np.concatenate([points, points[edges].mean(axis=1)]), elements, region)


def edge_nodes(count: int, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Quadratic elements (E,10) from linear ones (E,4), and the ends (M,2) of the edges whose midpoints are the new
    nodes count ... count + M - 1."""
    edges = np.sort(corners[:, EDGES].reshape(-1, 2), axis=1)
    unique, inverse = np.unique(edges, axis=0, return_inverse=True)
    return np.concatenate([corners, count + inverse.reshape(-1, 6)], axis=1), unique


def bricks(points: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Six tetrahedra (6C,4) for each brick (C,8), for bricks in any arrangement; node order of a brick: x fastest, then
    y, then z.

    The diagonal of a face starts at its lowest node, so that neighbours agree; the brick is the cone from its lowest
    node over the three faces without it. J. Dompierre et al., Proc. 8th Int. Meshing Roundtable (1999) 195-204.
    """
    quads = cells[:, _QUADS]
    first = quads.argmin(axis=2)
    turned = np.take_along_axis(quads, (first[:, :, None] + np.arange(4)) % 4, axis=2)
    apex = cells.min(axis=1)
    away = (turned != apex[:, None, None]).all(axis=2)
    far = turned[away].reshape(-1, 3, 4)
    top = np.broadcast_to(apex[:, None, None], (len(cells), 3, 1))
    tets = np.concatenate([np.concatenate([top, far[:, :, k]], axis=2) for k in ([0, 1, 2], [0, 2, 3])], axis=1)
    return turned_out(points, tets.reshape(-1, 4))


def grid(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (N,3) and bricks (C,8) of a grid with these coordinates [m]."""
    points = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1).transpose(2, 1, 0, 3).reshape(-1, 3)
    nx, ny, nz = len(x), len(y), len(z)
    k, j, i = np.meshgrid(np.arange(nz - 1), np.arange(ny - 1), np.arange(nx - 1), indexing="ij")
    corner = (i + nx * (j + ny * k)).reshape(-1, 1)
    return points, corner + np.array([0, 1, nx, nx + 1, nx * ny, nx * ny + 1, nx * ny + nx, nx * ny + nx + 1])


def box(size: tuple[float, float, float], cells: tuple[int, int, int]) -> TetMesh:
    """A box [0, size] of `cells` bricks, six quadratic tetrahedra each."""
    x, y, z = (np.linspace(0.0, s, n + 1) for s, n in zip(size, cells, strict=True))
    points, hexahedra = grid(x, y, z)
    return quadratic(points, bricks(points, hexahedra))


def check_surface(surface: Mesh) -> None:
    """MeshError: a surface that is not closed or intersects itself; states the place."""
    edges, count = surface.edges
    open_ = edges[count != 2]
    if len(open_):
        at = 1e3 * surface.vertices[open_[0]].mean(axis=0)
        raise MeshError(
            f"surface: {len(open_)} edges without two triangles, the first at ({at[0]:.4g}, {at[1]:.4g}, {at[2]:.4g}) "
            "mm: not closed. Close its holes or merge its duplicate vertices"
        )
    try:
        intersection = crossing(surface.vertices, surface.triangles)
    except UncheckedError as error:
        raise MeshError(f"surface: {error}, so that it may intersect itself. Remesh it") from None
    if intersection is not None:
        first, other, place = intersection
        raise MeshError(
            f"surface: triangles {first} and {other} cross at {point_text(place)}: it intersects itself, so that its "
            "interior is undefined. Join the parts into one surface (a union), or remesh it"
        )
