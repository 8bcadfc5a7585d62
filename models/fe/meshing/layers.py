"""A finger in layers: a bone, three shells round it and a nail, meshed on one lattice whatever the surfaces' shape.

The lattice is an inflated box: a core, and shells of bricks over all its faces but the rear. A subclass says where a
point of the lattice lies; which brick is of which layer, what is held and what may touch is the same for all.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from palpate.models.fe.element.mesh import MeshError, TetMesh, bricks, edge_nodes, grid

BONE, SUBCUTIS, DERMIS, EPIDERMIS, NAIL, PLATE = range(6)

CORE = 0.45  # Half width of the lattice's core, as a share of the bone's radius


@dataclass(frozen=True)
class Lattice:
    """Bricks between layers.

    points  [1] (N,4) three coordinates of the box's face that a ray goes through, in [-1, 1]: across, up, and from the
            rear (-1) over the centre of the rounded tip (0) to its front (1); the fourth runs over 0 ... 1 from the
            core to the bone's surface, and by 1 through each layer: 2 subcutis, 3 dermis, 4 epidermis, 5 nail
    """

    points: np.ndarray
    cells: np.ndarray  # (C,8)
    region: np.ndarray  # (C,)


def lattice(fine: int, radii: np.ndarray, whole: bool) -> Lattice:
    """The lattice of a finger.

    fine   cells across an eighth of the circumference
    radii  [m] (4,) outer ones of bone, subcutis, dermis, epidermis; a layer that is thicker than the faces are wide is
           cut into several
    whole  both sides of the plane of symmetry, or the half with across >= 0
    """
    n = fine
    x = np.linspace(-1.0, 1.0, 2 * n + 1) if whole else np.linspace(0.0, 1.0, n + 1)
    y = np.linspace(-1.0, 1.0, 2 * max(2, n // 2) + 1)
    tip = np.linspace(0.0, 1.0, n + 1)
    back = np.cumsum(1.35 ** np.arange(max(3, n - 1)))
    z = np.concatenate([-back[::-1] / back[-1], tip])
    u, cells = grid(x, y, z)
    nx, ny, nz = len(x), len(y), len(z)
    corner = np.array([[0, 1, nx, nx + 1], [0, 1, nx * ny, nx * ny + 1], [0, nx, nx * ny, nx * ny + nx]])
    node = np.arange(len(u)).reshape(nz, ny, nx)
    quads = [
        node[-1, :-1, :-1].ravel()[:, None] + corner[0],
        node[:-1, 0, :-1].ravel()[:, None] + corner[1],
        node[:-1, -1, :-1].ravel()[:, None] + corner[1],
        node[:-1, :-1, -1].ravel()[:, None] + corner[2],
    ]
    if whole:
        quads.append(node[:-1, :-1, 0].ravel()[:, None] + corner[2])
    upper = len(quads[0]) + len(quads[1]) + np.arange(len(quads[2]))
    skin = np.concatenate(quads)
    surface, on = np.unique(skin, return_inverse=True)
    on = on.reshape(skin.shape)
    points = [np.column_stack([u, np.zeros(len(u))])]
    every, region = [cells], [np.full(len(cells), BONE)]
    below, total = skin, len(u)
    for layer, level in _levels(radii, n):
        points.append(np.column_stack([u[surface], np.full(len(surface), level)]))
        every.append(np.concatenate([below, total + on], axis=1))
        region.append(np.full(len(skin), layer))
        below = total + on
        total += len(surface)
    own, spot = np.unique(on[upper], return_inverse=True)
    points.append(np.column_stack([u[surface[own]], np.full(len(own), 5.0)]))
    every.append(np.concatenate([below[upper], total + spot.reshape(-1, 4)], axis=1))
    region.append(np.full(len(upper), NAIL))
    return Lattice(np.concatenate(points), np.concatenate(every), np.concatenate(region))


def _levels(radii: np.ndarray, fine: int) -> list[tuple[int, float]]:
    """Layer below each shell, and the shell's fourth coordinate, from the bone outwards."""
    width = np.pi / 4 * radii[-1] / fine
    levels = [(BONE, 1.0)]
    for layer, thickness in enumerate(np.diff(radii), start=SUBCUTIS):
        count = max(1, round(thickness / width))
        levels += [(layer, layer + k / count) for k in range(1, count + 1)]
    return levels


def directions(box: np.ndarray) -> np.ndarray:
    """Unit rays [1] (N,3) - across, up, forward - through points of the box (N,3); square to the axis behind the
    tip."""
    ray = np.column_stack([box[:, :2], np.maximum(box[:, 2], 0.0)])
    direction = np.tan(np.pi / 4 * ray)
    return direction / np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-12)


class Layers(ABC):
    """A meshed finger. World frame: z up from the plate, origin where it first touches, the tip towards -y.

    tilt   [rad] between axis and plate
    cells  elements across an eighth of the circumference, 3 and more
    plate  [m] half-widths of a deformable plate and its thickness
    whole  whether both sides are meshed, or half of it, x >= 0
    """

    tilt: float
    cells: int
    plate: tuple[float, float]
    whole: bool

    def check(self, finger: str, *sizes: float) -> None:
        """MeshError: one of the sizes [m], the tilt or the fineness is out of range."""
        if not all(np.isfinite(sizes)) or min(sizes) <= 0:
            raise MeshError(f"{finger}: found sizes {sizes} m, expected positive ones")
        if not 0.0 <= self.tilt <= np.pi / 4:
            raise MeshError(f"{finger}: tilt {self.tilt} rad, expected 0 ... pi/4")
        if self.cells < 3:
            raise MeshError(f"{finger}: cells {self.cells}, expected 3 or more")

    @property
    @abstractmethod
    def radii(self) -> np.ndarray:
        """Outer radius of bone, subcutis, dermis and epidermis [m] (4,), typical ones where they vary."""

    @abstractmethod
    def place(self, points: np.ndarray) -> np.ndarray:
        """World coordinates [m] (N,3) of points of the lattice (N,4), see `Lattice`."""

    @abstractmethod
    def describe(self) -> dict[str, Any]:
        """What distinguishes this finger from others, as plain data."""

    @cached_property
    def _meshed(self) -> tuple[TetMesh, np.ndarray]:
        """The mesh, whose edges follow the surfaces, and its nodes' lattice coordinates (N,4)."""
        blocks = lattice(self.cells, self.radii, self.whole)
        count = len(blocks.points)
        corners = bricks(self.place(blocks.points), blocks.cells)
        elements, edges = edge_nodes(count, corners)
        points = np.concatenate([blocks.points, blocks.points[edges].mean(axis=1)])
        return TetMesh(self.place(points), elements, np.repeat(blocks.region, 6)), points

    @property
    def mesh(self) -> TetMesh:
        """The finger; its edges are bent as its surfaces are."""
        return self._meshed[0]

    @cached_property
    def cut(self) -> np.ndarray:
        """Nodes on the plane of symmetry (N,) bool; none in a whole finger."""
        return np.zeros(len(self.mesh.points), dtype=bool) if self.whole else self._meshed[1][:, 0] < 1e-12

    @cached_property
    def rear(self) -> np.ndarray:
        """Nodes of the rear face (N,) bool."""
        return self._meshed[1][:, 2] < -1.0 + 1e-12

    @cached_property
    def pad(self) -> np.ndarray:
        """Faces of the lower epidermis that may touch (F,6)."""
        mesh = self.mesh
        place = mesh.points[mesh.faces[:, :3]].mean(axis=1)
        edges = mesh.points[mesh.faces]
        normal = np.cross(edges[:, 1] - edges[:, 0], edges[:, 2] - edges[:, 0])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        inner = self.cut[mesh.faces].all(axis=1) | self.rear[mesh.faces].all(axis=1)
        near = place[:, 2] < 0.6 * self.radii[-1]
        return mesh.faces[~inner & near & (normal[:, 2] < -0.3)]

    @cached_property
    def held(self) -> np.ndarray:
        """Nodes of the rear face and of the upper epidermis (N,) bool; the upper epidermis is the quarter of the skin
        that the nail lies on."""
        mesh = self.mesh
        held = self.rear.copy()
        nail = np.unique(mesh.elements[mesh.region == NAIL])
        skin = np.unique(mesh.elements[mesh.region == EPIDERMIS])
        held[np.intersect1d(nail, skin)] = True
        return held
