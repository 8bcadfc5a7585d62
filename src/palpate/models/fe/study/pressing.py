"""A finger pressed on a plate: boundary conditions, contact, and the resulting strain."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from palpate.models.fe.contact.pair import Pair
from palpate.models.fe.contact.rigid import RigidIndenter, plane
from palpate.models.fe.element.files import write_vtu
from palpate.models.fe.element.mesh import TetMesh, bricks, grid, quadratic
from palpate.models.fe.meshing.fingertip import PAPER, PLATE, FingertipDimensions, divisor_and_bone, materials
from palpate.models.fe.solve.solver import Settings, Solver
from palpate.models.fe.study.isostrain import strain, volumes_above

PENETRATION = 2e-6  # [m] Largest accepted penetration
SIDES = 2.0  # [1] Factor on forces and areas: half of the finger is meshed


@dataclass
class Pressing:
    """A fingertip against a plate that rises: `solver.advance(z)` brings the plate up by z [m].

    material  one of the finger's sets of constants, see `fe.meshing.fingertip.divisor_and_bone`
    """

    finger: FingertipDimensions
    plate: str = "steel"  # "steel" (200 GPa, rigid compared with tissue) or "silicone"
    material: str | float = "printed"
    friction: float = 0.2

    def __post_init__(self) -> None:
        if self.plate not in PAPER:
            raise ValueError(f"plate {self.plate!r}: expected one of {', '.join(PAPER)}")
        mesh, pad = self.finger.mesh, self.finger.pad
        held = self.finger.held
        self.touch: RigidIndenter | Pair
        if self.plate == "steel":
            fixed = np.repeat(held[:, None], 3, axis=1)
            lift = None
            self.touch = RigidIndenter(
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
        steps = Settings(tolerance=1e-5, step=5e-5, largest=1e-4, least=1e-7)
        self.solver = Solver(mesh, materials(self.material), fixed, lift, contacts=[self.touch], settings=steps)

    def _block(self) -> TetMesh:
        """The half of the plate under half a finger, refined under the finger."""
        half, thick = self.finger.plate
        fine = np.pi / 4 * self.finger.radii[-1] / self.finger.cells
        x = _graded_cells(fine, 4.5e-3, half)
        y = np.concatenate([-x[:0:-1], x])
        z = -_graded_cells(1.2 * fine, 1.2 * fine, thick)[::-1]
        points, cells = grid(x, y, z)
        tets = bricks(points, cells)
        return quadratic(points, tets, np.full(len(tets), PLATE))

    def settings(self) -> dict[str, Any]:
        """The settings that identify this pressing, as plain data."""
        divisor, bone = divisor_and_bone(self.material)
        return {
            "plate": self.plate, "divisor": divisor, "bone": bone, "friction": self.friction,
            "finger": asdict(self.finger),
        }  # fmt: skip

    @property
    def force(self) -> float:
        """Normal force of the whole finger on the plate [N]."""
        return SIDES * float(self.touch.force[2])

    @property
    def area(self) -> float:
        """Contact area of the whole finger [m²]."""
        return SIDES * self.touch.contact_area(self.solver.displacement)

    def strain(self) -> np.ndarray:
        """Equivalent strain at the corners of the finger's elements [1] (E,4)."""
        return strain(self.finger.mesh, self.solver.displacement[: len(self.finger.mesh.points)])

    def volumes(self, levels: np.ndarray) -> np.ndarray:
        """Deformed volumes of the whole finger in which the equivalent strain is at least a level [m³] (L,)."""
        moved = self.solver.displacement[: len(self.finger.mesh.points)]
        return SIDES * volumes_above(self.finger.mesh, moved, levels)

    def write(self, path: Path) -> None:
        """Write the current displacement, equivalent strain and contact pressure as a VTK file."""
        mesh, moved = self.finger.mesh, self.solver.displacement
        count = len(mesh.points)
        nodes = {"displacement": moved[:count], "pressure": self.touch.nodal_pressure(moved)[:count]}
        write_vtu(path, mesh, nodes, {"equivalent_strain": self.strain().mean(axis=1)})


def _graded_cells(fine: float, uniform: float, end: float) -> np.ndarray:
    """0 ... end: cells of size `fine` up to `uniform`, then with a growth ratio of 1.5."""
    x = list(np.linspace(0.0, uniform, max(1, round(uniform / fine)) + 1))
    h = x[-1] - x[-2]
    while x[-1] < end:
        h *= 1.5
        x.append(x[-1] + h)
    x[-1] = end
    if x[-1] - x[-2] < 0.5 * (x[-2] - x[-3]):
        del x[-2]
    return np.array(x)
