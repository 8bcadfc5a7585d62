"""The layered fingertip of Battaglia et al. and its plate: geometry, materials, one pressing.

The layers are capsules about one axis: a cylinder with a rounded tip. Half of it is meshed, cut along the plane of
symmetry. World frame: z up from the plate, origin at the first point of contact, the tip towards -y and lower by
`tilt`.

E. Battaglia et al., A finite element model of tactile flow for softness perception (2015).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from palpate.fe.elements import gradients
from palpate.fe.materials import Material, hencky, mooney_rivlin
from palpate.fe.mesh import MeshError, TetMesh, bricks, edge_nodes, grid, quadratic
from palpate.fe.pair import Pair
from palpate.fe.rigid import Rigid, plane
from palpate.fe.solver import Settings, Solver
from palpate.physics.tactile import equivalent_strain, logarithmic_strain

BONE, SUBCUTIS, DERMIS, EPIDERMIS, NAIL, PLATE = range(6)
REGIONS = ("bone", "subcutis", "dermis", "epidermis", "nail", "plate")

CALIBRATED = 36.4
"""Common divisor of the finger's moduli: the best fit to the two steel points of the paper's Table III, see
`fe.record.fit_divisor` and docs/equations/finite-elements.md."""

PENETRATION = 2e-6
"""[m] that the contact may leave."""

PAPER = {"steel": ((0.11, 1.24e-3), (0.50, 2.08e-3)), "silicone": ((0.11, 1.28e-3), (0.50, 2.30e-3))}
"""Table III of the paper: force [N] and indentation [m]."""


@dataclass(frozen=True)
class Fingertip:
    """Dimensions [m] and fineness of the mesh. The paper leaves open: phalanx length, nail thickness, plate size, how
    far round the upper epidermis is held.

    bone, subcutis, dermis, epidermis   radius of the bone, then thicknesses
    phalanx    length of the cylinder behind the rounded tip
    nail       thickness of the nail, on the upper quarter of the epidermis
    tilt       [rad] between axis and plate
    plate      half-widths of a deformable plate and its thickness
    cells      elements across an eighth of the circumference, 3 and more
    """

    bone: float = 6e-3
    subcutis: float = 2.5e-3
    dermis: float = 0.93e-3
    epidermis: float = 0.41e-3
    nail: float = 0.5e-3
    phalanx: float = 12e-3
    tilt: float = np.deg2rad(15.0)
    plate: tuple[float, float] = (20e-3, 20e-3)
    cells: int = 6

    def __post_init__(self) -> None:
        sizes = (self.bone, self.subcutis, self.dermis, self.epidermis, self.nail, self.phalanx, *self.plate)
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

    @cached_property
    def mesh(self) -> TetMesh:
        """Half of the finger, x >= 0; the edges of its elements follow the capsules."""
        lattice, cells, region = self._lattice()
        corners = bricks(self._place(lattice), cells)
        elements, edges = edge_nodes(len(lattice), corners)
        lattice = np.concatenate([lattice, lattice[edges].mean(axis=1)])
        return TetMesh(self._world(self._place(lattice)), elements, np.repeat(region, 6))

    def _place(self, lattice: np.ndarray) -> np.ndarray:
        """Finger frame [m] (N,3) of lattice coordinates (N,4): three in the box, of which the third runs over -1 ... 0
        along the phalanx and 0 ... 1 in the tip; and 0 ... 1 from the core's surface to the bone's, 1 + depth above it
        in mm outside."""
        box, shell = lattice[:, :3], lattice[:, 3]
        tip = np.maximum(box[:, 2], 0.0)
        along = self.phalanx * (1.0 + np.minimum(box[:, 2], 0.0))
        middle = np.stack([0.0 * along, 0.0 * along, along], axis=1)
        ray = np.stack([box[:, 0], box[:, 1], tip], axis=1)
        direction = np.tan(np.pi / 4 * ray)
        direction /= np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-12)
        inside = np.minimum(shell, 1.0)[:, None]
        radius = self.bone + 1e-3 * np.maximum(shell - 1.0, 0.0)[:, None]
        return middle + (1.0 - inside) * (0.45 * self.bone) * ray + inside * radius * direction

    def _world(self, p: np.ndarray) -> np.ndarray:
        s, c = np.sin(self.tilt), np.cos(self.tilt)
        normal, forward = np.array([0.0, c, -s]), np.array([0.0, s, c])
        lowest = np.array([0.0, 0.0, self.phalanx]) - self.radii[-1] * normal
        moved = p - lowest
        return np.stack([p[:, 0], -moved @ forward, moved @ normal], axis=1)

    def _lattice(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Bricks of an inflated box: a core, and shells over all its faces but the rear and the symmetry plane."""
        n = self.cells
        x = np.linspace(0.0, 1.0, n + 1)
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
        upper = len(quads[0]) + len(quads[1]) + np.arange(len(quads[2]))
        skin = np.concatenate(quads)
        surface, on = np.unique(skin, return_inverse=True)
        on = on.reshape(skin.shape)
        points = [np.column_stack([u, np.zeros(len(u))])]
        every, region = [cells], [np.full(len(cells), BONE)]
        below, total = skin, len(u)
        for k, r in enumerate(self._levels()):
            points.append(np.column_stack([u[surface], np.full(len(surface), 1.0 + 1e3 * (r - self.bone))]))
            every.append(np.concatenate([below, total + on], axis=1))
            region.append(np.full(len(skin), int(np.searchsorted(self.radii, r - 1e-12)) if k else BONE))
            below = total + on
            total += len(surface)
        own, spot = np.unique(on[upper], return_inverse=True)
        nail = 1.0 + 1e3 * (self.radii[-1] + self.nail - self.bone)
        points.append(np.column_stack([u[surface[own]], np.full(len(own), nail)]))
        every.append(np.concatenate([below[upper], total + spot.reshape(-1, 4)], axis=1))
        region.append(np.full(len(upper), NAIL))
        return np.concatenate(points), np.concatenate(every), np.concatenate(region)

    def _levels(self) -> np.ndarray:
        """Radii of the shells, from the bone outwards; a layer is cut where it is thicker than the faces are wide."""
        width = np.pi / 4 * self.radii[-1] / self.cells
        levels = [self.radii[0]]
        for r in self.radii[1:]:
            count = max(1, round((r - levels[-1]) / width))
            levels.extend(np.linspace(levels[-1], r, count + 1)[1:])
        return np.array(levels)

    @cached_property
    def pad(self) -> np.ndarray:
        """Faces of the lower epidermis that may touch (F,6)."""
        mesh = self.mesh
        place = mesh.points[mesh.faces[:, :3]].mean(axis=1)
        edges = mesh.points[mesh.faces]
        normal = np.cross(edges[:, 1] - edges[:, 0], edges[:, 2] - edges[:, 0])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        cut = (edges[:, :, 0] < 1e-9).all(axis=1)
        near = place[:, 2] < 0.6 * self.radii[-1]
        return mesh.faces[~cut & near & (normal[:, 2] < -0.3) & ~self._rear[mesh.faces].all(axis=1)]

    @cached_property
    def _rear(self) -> np.ndarray:
        p = self.mesh.points
        axis = np.array([-np.cos(self.tilt), -np.sin(self.tilt)])
        behind = p[:, 1:] @ axis
        return behind < behind.min() + 1e-6 * self.phalanx

    @cached_property
    def held(self) -> np.ndarray:
        """Nodes of the rear face and of the upper epidermis (N,) bool; the upper epidermis is the quarter of the skin
        that the nail lies on."""
        mesh = self.mesh
        found = self._rear.copy()
        nail = np.unique(mesh.elements[mesh.region == NAIL])
        skin = np.unique(mesh.elements[mesh.region == EPIDERMIS])
        found[np.intersect1d(nail, skin)] = True
        return found


def materials(divisor: float = 1.0) -> dict[int, Material]:
    """The paper's constants, with the bone in GPa and D1 in 1/MPa, all finger moduli divided by `divisor`.

    1 is the literal set, `CALIBRATED` the one fitted to the paper's steel points.
    """
    if not divisor > 0:
        raise MeshError(f"divisor {divisor}: expected a positive number")
    d = divisor
    return {
        BONE: hencky(17e9 / d, 0.3),
        SUBCUTIS: mooney_rivlin(300 / d, 671 / d, 29800 / d, 32700 / d, 9330 / d, 106.5e-6 * d),
        DERMIS: mooney_rivlin(2430 / d, 5420 / d, 239000 / d, 262000 / d, 74700 / d, 13.3e-6 * d),
        EPIDERMIS: hencky(2e6 / d, 0.3),
        NAIL: hencky(170e6 / d, 0.3),
        PLATE: hencky(180e3, 0.48),
    }


@dataclass
class Pressing:
    """A fingertip against a plate that rises: `solver.advance(z)` brings the plate up by z [m].

    plate    "steel" (200 GPa on tissue of kPa: taken as rigid) or "silicone"
    """

    finger: Fingertip
    plate: str = "steel"
    divisor: float = 1.0
    friction: float = 0.2

    def __post_init__(self) -> None:
        if self.plate not in PAPER:
            raise ValueError(f"plate {self.plate!r}: expected one of {', '.join(PAPER)}")
        mesh, pad = self.finger.mesh, self.finger.pad
        held = self.finger.held
        self.touch: Rigid | Pair
        if self.plate == "steel":
            fixed = np.repeat(held[:, None], 3, axis=1)
            lift = None
            self.touch = Rigid(
                pad, plane, (0.0, 0.0, 1.0), lambda load: np.array([0.0, 0.0, load]), self.friction, PENETRATION
            )
        else:
            block = self._block()
            count = len(mesh.points)
            mesh = TetMesh(
                np.concatenate([mesh.points, block.points]),
                np.concatenate([mesh.elements, block.elements + count]),
                np.concatenate([mesh.region, block.region]),
            )
            z = block.points[:, 2]
            bottom = np.concatenate([np.zeros(count, dtype=bool), z < -self.finger.plate[1] * (1 - 1e-9)])
            top = block.faces[(block.points[block.faces][:, :, 2] > -1e-9).all(axis=1)] + count
            fixed = np.repeat((np.concatenate([held, np.zeros(len(z), dtype=bool)]) | bottom)[:, None], 3, axis=1)
            up = np.outer(bottom, (0.0, 0.0, 1.0))

            def lift(load: float) -> np.ndarray:
                return load * up

            self.touch = Pair(pad, top, self.friction, PENETRATION)
        fixed[np.abs(mesh.points[:, 0]) < 1e-9, 0] = True
        steps = Settings(tolerance=1e-5, step=5e-5, largest=2e-4, least=1e-7)
        self.solver = Solver(mesh, materials(self.divisor), fixed, lift, contacts=[self.touch], settings=steps)

    def _block(self) -> TetMesh:
        """The half plate, finest under the finger."""
        half, thick = self.finger.plate
        fine = np.pi / 4 * self.finger.radii[-1] / self.finger.cells
        x = _graded(fine, 4.5e-3, half)
        y = np.concatenate([-x[:0:-1], x])
        z = -_graded(1.2 * fine, 1.2 * fine, thick)[::-1]
        points, cells = grid(x, y, z)
        tets = bricks(points, cells)
        return quadratic(points, tets, np.full(len(tets), PLATE))

    @property
    def force(self) -> float:
        """Normal force of the whole finger on the plate [N]."""
        return 2.0 * float(self.touch.force[2])

    def strain(self) -> tuple[np.ndarray, np.ndarray]:
        """Equivalent strain at the corners of the finger's elements [1] (E,4), and their deformed volumes [m³] (E,),
        both halves together. Effective Poisson ratio: the material's in the elastic layers, 0.5 in the others."""
        mesh = self.finger.mesh
        u = self.solver.displacement[: len(mesh.points)]
        corners = np.array([[0, 0, 0], [1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0]])
        slope, _ = gradients(mesh.points, mesh.elements, corners)
        gradient = np.eye(3) + np.einsum("eai,enaj->enij", u[mesh.elements], slope)
        elastic = np.isin(mesh.region, (BONE, EPIDERMIS, NAIL))
        found = equivalent_strain(logarithmic_strain(gradient), np.where(elastic, 0.3, 0.5)[:, None])
        a, b, c, d = ((mesh.points + u)[mesh.elements[:, i]] for i in range(4))
        return found, np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 3.0

    @property
    def area(self) -> float:
        """Contact area of the whole finger [m²]."""
        return 2.0 * self.touch.contact_area(self.solver.displacement)


def _graded(fine: float, uniform: float, end: float) -> np.ndarray:
    """0 ... end: cells of size `fine` up to `uniform`, then each half as large again."""
    x = list(np.linspace(0.0, uniform, max(1, round(uniform / fine)) + 1))
    h = x[-1] - x[-2]
    while x[-1] < end:
        h *= 1.5
        x.append(x[-1] + h)
    x[-1] = end
    if x[-1] - x[-2] < 0.5 * (x[-2] - x[-3]):
        del x[-2]
    return np.array(x)
