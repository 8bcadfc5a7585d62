"""The layered fingertip of Battaglia et al.: its geometry and its materials.

The layers are coaxial capsules: cylinders with a rounded tip. One half is meshed, cut along the plane of symmetry: the
lattice is an inflated box, a core and shells of bricks over all its faces except the rear and the plane of symmetry.
World frame: z up from the plate, origin at the first point of contact, the tip towards -y and inclined by `tilt`.

E. Battaglia et al., A finite element model of tactile flow for softness perception (2015).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from palpate.models.fe.element.mesh import MeshError, TetMesh, bricks, edge_nodes, grid
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.materials.hencky import hencky
from palpate.physics.materials.hyperelastic import Material
from palpate.physics.materials.mooney_rivlin import mooney_rivlin

BONE, SUBCUTIS, DERMIS, EPIDERMIS, NAIL, PLATE = range(6)

CORE = 0.45  # Half width of the lattice's core over the bone's radius

BONE_AS_PRINTED, BONE_CORTICAL = 17e6, 17e9
"""[Pa] Young's modulus of the bone: as printed in the paper, and that of cortical bone."""

CALIBRATED = 16.3
"""Common divisor of the printed moduli, bone included, of the calibrated set (docs/equations/finite-elements.md)."""

SETS = {
    "printed": (1.0, BONE_AS_PRINTED), "calibrated": (CALIBRATED, BONE_AS_PRINTED), "cortical": (1.0, BONE_CORTICAL),
}  # fmt: skip
"""Sets of the finger's constants by name: divisor of all its moduli, and the bone's modulus [Pa] before division."""

PAPER = {"steel": ((0.11, 1.24e-3), (0.50, 2.08e-3)), "silicone": ((0.11, 1.28e-3), (0.50, 2.30e-3))}
"""Table III of the paper: force [N] and indentation [m]."""


@dataclass(frozen=True)
class FingertipDimensions:
    """Dimensions [m] and fineness of the mesh. The paper does not specify phalanx length, nail thickness, plate size,
    and which part of the upper epidermis is fixed.

    bone, subcutis, dermis, epidermis   radius of the bone, then thicknesses
    """

    bone: float = 6e-3
    subcutis: float = 2.5e-3
    dermis: float = 0.93e-3
    epidermis: float = 0.41e-3
    nail: float = 0.5e-3  # thickness of the nail, on the upper quarter of the epidermis
    phalanx: float = 12e-3  # length of the cylinder behind the rounded tip
    tilt: float = np.deg2rad(15.0)  # [rad] between axis and plate
    plate: tuple[float, float] = (20e-3, 20e-3)  # half-width of a deformable plate, and its thickness
    cells: int = 6  # elements across an eighth of the circumference, 3 and more

    def __post_init__(self) -> None:
        sizes = self.bone, self.subcutis, self.dermis, self.epidermis, self.nail, self.phalanx, *self.plate
        if not all(np.isfinite(sizes)) or min(sizes) <= 0:
            raise MeshError(f"fingertip: found sizes {sizes} m, expected positive ones")
        if not 0.0 <= self.tilt <= np.pi / 4:
            raise MeshError(f"fingertip: tilt {self.tilt} rad, expected 0 ... pi/4")
        if self.cells < 3:
            raise MeshError(f"fingertip: cells {self.cells}, expected 3 or more")

    @cached_property
    def radii(self) -> np.ndarray:
        """Outer radius of bone, subcutis, dermis and epidermis [m] (4,)."""
        return np.cumsum([self.bone, self.subcutis, self.dermis, self.epidermis])

    def place(self, points: np.ndarray) -> np.ndarray:
        """World coordinates [m] (N,3) of points of the lattice (N,4)."""
        p = self.upright(points)
        s, c = np.sin(self.tilt), np.cos(self.tilt)
        normal, forward = np.array([0.0, c, -s]), np.array([0.0, s, c])
        moved = p - np.array([0.0, 0.0, self.phalanx]) + self.radii[-1] * normal
        return np.stack([p[:, 0], -moved @ forward, moved @ normal], axis=1)

    def upright(self, points: np.ndarray) -> np.ndarray:
        """Coordinates [m] (N,3) across, up and along the axis from the rear, of points of the lattice (N,4)."""
        box, shell = points[:, :3], points[:, 3]
        along = self.phalanx * (1.0 + np.minimum(box[:, 2], 0.0))
        middle = np.stack([0.0 * along, 0.0 * along, along], axis=1)
        ray = np.column_stack([box[:, :2], np.maximum(box[:, 2], 0.0)])
        inside = np.minimum(shell, 1.0)[:, None]
        radius = np.interp(shell, range(1, 6), [*self.radii, self.radii[-1] + self.nail])[:, None]
        core = (1.0 - inside) * (CORE * self.bone) * ray
        return np.asarray(middle + core + inside * radius * directions(box))

    @cached_property
    def meshed(self) -> tuple[TetMesh, np.ndarray]:
        """The mesh, whose edges follow the surfaces, and its nodes' lattice coordinates (N,4)."""
        points, cells, region = lattice(self.cells, self.radii)
        elements, edges = edge_nodes(len(points), bricks(self.place(points), cells))
        points = np.concatenate([points, points[edges].mean(axis=1)])
        return TetMesh(self.place(points), elements, np.repeat(region, 6)), points

    @property
    def mesh(self) -> TetMesh:
        """The finger; its edges follow its curved surfaces."""
        return self.meshed[0]

    @cached_property
    def cut(self) -> np.ndarray:
        """Nodes on the plane of symmetry (N,) bool."""
        return self.meshed[1][:, 0] < 1e-12

    @cached_property
    def rear(self) -> np.ndarray:
        """Nodes of the rear face (N,) bool."""
        return self.meshed[1][:, 2] < -1.0 + 1e-12

    @cached_property
    def pad(self) -> np.ndarray:
        """Faces of the lower epidermis that may touch (F,6)."""
        mesh = self.mesh
        place = mesh.points[mesh.faces[:, :3]].mean(axis=1)
        normal = Mesh(mesh.points, mesh.faces[:, :3]).face_vectors
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        inner = self.cut[mesh.faces].all(axis=1) | self.rear[mesh.faces].all(axis=1)
        near = place[:, 2] < 0.6 * self.radii[-1]
        return mesh.faces[~inner & near & (normal[:, 2] < -0.3)]

    @cached_property
    def held(self) -> np.ndarray:
        """Fixed nodes (N,) bool: the rear face and the upper epidermis, the quarter of the skin under the nail."""
        mesh = self.mesh
        held = self.rear.copy()
        nail = np.unique(mesh.elements[mesh.region == NAIL])
        skin = np.unique(mesh.elements[mesh.region == EPIDERMIS])
        held[np.intersect1d(nail, skin)] = True
        return held


def divisor_and_bone(material: str | float) -> tuple[float, float]:
    """Divisor of the finger's moduli, and the bone's modulus [Pa] before division, for a material: a name of `SETS`, a
    name with a further divisor ("cortical/36.4"), or a number, the divisor of the printed set. MeshError: none of
    these."""
    name, slash, number = ("printed", "/", material) if not isinstance(material, str) else material.partition("/")
    if not slash and name not in SETS:
        name, number = "printed", name
    try:
        divisor = float(number) if slash or number else 1.0
    except ValueError:
        divisor = np.nan
    if name not in SETS or not 0.0 < divisor < np.inf:
        raise MeshError(
            f"material {material!r}: expected {', '.join(SETS)}, one of them with a divisor of all moduli as in "
            '"cortical/36.4", or a number above 0, the divisor of the printed moduli'
        )
    common, bone = SETS[name]
    return common * divisor, bone


def materials(material: str | float = "printed") -> dict[int, Material]:
    """The paper's constants, with all moduli of the finger divided by a number, see `divisor_and_bone`. MeshError: an
    unknown set."""
    d, bone = divisor_and_bone(material)
    return {
        BONE: hencky(bone / d, 0.3),
        SUBCUTIS: mooney_rivlin(300 / d, 671 / d, 29800 / d, 32700 / d, 9330 / d, 106.5e-6 * d),
        DERMIS: mooney_rivlin(2430 / d, 5420 / d, 239000 / d, 262000 / d, 74700 / d, 13.3e-6 * d),
        EPIDERMIS: hencky(2e6 / d, 0.3),
        NAIL: hencky(170e6 / d, 0.3),
        PLATE: hencky(180e3, 0.48),
    }


def lattice(fine: int, radii: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The lattice of half a finger, a bone, three shells round it and a nail, across >= 0 of the plane of symmetry:
    points (N,4), bricks (C,8) and their layers (C,).

    A point is the point of the box [-1, 1] that a ray passes: across, up, and from the rear (-1) through the centre of
    the rounded tip (0) to its front (1); the fourth coordinate increases from 0 at the core to 1 at the bone's surface,
    and by 1 in each layer: 2 subcutis, 3 dermis, 4 epidermis, 5 nail.

    fine   cells across an eighth of the circumference
    radii  [m] (4,) outer radii of bone, subcutis, dermis, epidermis; a layer thicker than the width of the faces is
           divided into several
    """
    # the core: a box
    n = fine
    x = np.linspace(0.0, 1.0, n + 1)
    y = np.linspace(-1.0, 1.0, 2 * max(2, n // 2) + 1)
    tip = np.linspace(0.0, 1.0, n + 1)
    back = np.cumsum(1.35 ** np.arange(max(3, n - 1)))
    z = np.concatenate([-back[::-1] / back[-1], tip])
    u, cells = grid(x, y, z)
    # its outer faces: front, lower, upper, side
    nx, ny, nz = len(x), len(y), len(z)
    corner = np.array([[0, 1, nx, nx + 1], [0, 1, nx * ny, nx * ny + 1], [0, nx, nx * ny, nx * ny + nx]])
    node = np.arange(len(u)).reshape(nz, ny, nx)
    quads = [
        node[-1, :-1, :-1].ravel()[:, None] + corner[0],
        node[:-1, 0, :-1].ravel()[:, None] + corner[1],
        node[:-1, -1, :-1].ravel()[:, None] + corner[1],
        node[:-1, :-1, -1].ravel()[:, None] + corner[2],
    ]
    upper = len(quads[0]) + len(quads[1]) + np.arange(len(quads[2]))
    skin = np.concatenate(quads)
    surface, on = np.unique(skin, return_inverse=True)
    on = on.reshape(skin.shape)
    # shells of bricks on these faces, layer by layer
    points = [np.column_stack([u, np.zeros(len(u))])]
    every, region = [cells], [np.full(len(cells), BONE)]
    below, total = skin, len(u)
    for layer, level in _levels(radii, n):
        points.append(np.column_stack([u[surface], np.full(len(surface), level)]))
        every.append(np.concatenate([below, total + on], axis=1))
        region.append(np.full(len(skin), layer))
        below = total + on
        total += len(surface)
    # the nail on the upper face
    nail, spot = np.unique(on[upper], return_inverse=True)
    points.append(np.column_stack([u[surface[nail]], np.full(len(nail), 5.0)]))
    every.append(np.concatenate([below[upper], total + spot.reshape(-1, 4)], axis=1))
    region.append(np.full(len(upper), NAIL))
    return np.concatenate(points), np.concatenate(every), np.concatenate(region)


def _levels(radii: np.ndarray, fine: int) -> list[tuple[int, float]]:
    """Layer below each shell, and the shell's fourth coordinate, from the bone outwards."""
    width = np.pi / 4 * radii[-1] / fine
    levels = [(BONE, 1.0)]
    for layer, thickness in enumerate(np.diff(radii), start=SUBCUTIS):
        count = max(1, round(thickness / width))
        levels += [(layer, layer + k / count) for k in range(1, count + 1)]
    return levels


def directions(box: np.ndarray) -> np.ndarray:
    """Unit rays [1] (N,3) (across, up, forward) through points of the box (N,3), perpendicular to the axis behind the
    tip."""
    ray = np.column_stack([box[:, :2], np.maximum(box[:, 2], 0.0)])
    direction = np.tan(np.pi / 4 * ray)
    return direction / np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-12)
