"""The block of `studies.peers.continuum` by CalculiX: its program `ccx` on a file of ours.

The tetrahedra are those of `fe.Solver`, as elements C3D10 with the same energy, so that the two differ by their solvers
alone. The bed is lumped: a face of six nodes carries a pressure by the nodes on its edges, a third of its area each.

G. Dhondt, The Finite Element Method for Three-Dimensional Thermomechanical Applications, Wiley 2004;
http://www.calculix.de. Lengths are in mm, forces in N and moduli in MPa there.
"""

import re
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np

from palpate.models.fe.element.mesh import TetMesh
from palpate.physics.materials.hyperelastic import moduli
from palpate.studies.peers import MissingError, continuum
from palpate.studies.peers.continuum import BED, LEVELS, POISSON, YOUNG, Block, ContinuumCurve, Tetrahedra

INSTALL = "apt-get install calculix-ccx"
MM = 1e3  # [mm/m]
MPA = 1e-6  # [MPa/Pa]
LAST = 400  # Characters of what it printed that are told of a failed run


@lru_cache(maxsize=1)
def version() -> str | None:
    """Of CalculiX; None where its program is not on the path."""
    program = shutil.which("ccx")
    if program is None:
        return None
    told = subprocess.run([program, "-v"], capture_output=True, text=True, check=False).stdout
    found = re.search(r"Version\s+(\S+)", told)
    return found[1] if found else "of unknown version"


def press(block: Block, levels: np.ndarray = LEVELS) -> ContinuumCurve:
    """Press the block with CalculiX. The time of a load step is that of the whole run over its load steps.

    MissingError: it is not installed. ArithmeticError: it gave up; says what it printed last.
    """
    cut = continuum.tetrahedra(block)
    with tempfile.TemporaryDirectory() as folder:
        whole, status, said = run(deck(cut, levels), Path(folder))
        seconds = whole / len(levels)
        moved = _read(Path(folder) / "run.dat", np.sort(cut.top.ravel()), cut.mesh.points.shape)
    if status or len(moved) != len(levels):
        raise ArithmeticError(f"CalculiX came to {len(moved)} of {len(levels)} forces; it said last: {said}")
    depth = [float(np.sum(cut.unit * u)) for u in moved]
    shape = [-u[cut.top, 2] for u in moved]
    return continuum.curve(levels, depth, shape, (cut.x, cut.y, cut.top), cut.unit.size, [seconds] * len(levels))


def run(cards: Iterable[str], folder: Path) -> tuple[float, int, str]:
    """Run CalculiX on these cards; results lie in the folder's files `run.*`. Seconds that it took, its exit status,
    and what it printed last.

    MissingError: it is not installed.
    """
    program = shutil.which("ccx")
    if program is None:
        raise MissingError(f"CalculiX is not installed: there is no program ccx. Install it: {INSTALL}")
    (folder / "run.inp").write_text("\n".join(cards) + "\n", encoding="ascii")
    begun = time.perf_counter()
    ran = subprocess.run([program, "-i", "run"], cwd=folder, capture_output=True, text=True, check=False)
    return time.perf_counter() - begun, ran.returncode, " ".join(ran.stdout.split())[-LAST:]


def solids(mesh: TetMesh, laws: Sequence[tuple[float, float]], scale: float = 1.0) -> Iterator[str]:
    """Cards of a mesh and of the neo-Hookean solids in its regions: `laws` has shear and bulk modulus of each, `scale`
    is the length of a metre in the cards."""
    yield "*NODE"
    yield from (f"{k},{x:.14g},{y:.14g},{z:.14g}" for k, (x, y, z) in enumerate((scale * mesh.points).tolist(), 1))
    for region, (shear, bulk) in enumerate(laws):
        yield f"*ELEMENT,TYPE=C3D10,ELSET=R{region}"
        for k in np.flatnonzero(mesh.region == region):
            yield ",".join(str(n + 1) for n in (k, *mesh.elements[k]))
        yield f"*MATERIAL,NAME=M{region}\n*HYPERELASTIC,NEO HOOKE\n{shear / 2:.12e},{2 / bulk:.12e}"
        yield f"*SOLID SECTION,ELSET=R{region},MATERIAL=M{region}"


def deck(cut: Tetrahedra, levels: np.ndarray) -> Iterator[str]:
    """Lines of its input: mesh, materials, bed, supports, and a step for each force [N]."""
    yield from solids(cut.mesh, [moduli(MPA * YOUNG * float(ratio), POISSON) for ratio in cut.ratios], MM)
    yield from _bed(cut, len(cut.mesh.elements))
    yield "*BOUNDARY"
    yield from (f"{node + 1},{axis + 1}" for node, axis in np.argwhere(cut.fixed))
    yield "*NSET,NSET=TOP"
    yield from (f"{node + 1}," for node in np.sort(cut.top.ravel()))
    loaded = np.flatnonzero(cut.unit[:, 2])
    for level in levels:
        yield "*STEP,NLGEOM\n*STATIC\n1.,1.\n*CLOAD"
        yield from (f"{k + 1},3,{0.5 * level * cut.unit[k, 2]:.12e}" for k in loaded)
        yield "*NODE PRINT,NSET=TOP\nU\n*END STEP"


def _bed(cut: Tetrahedra, count: int) -> Iterator[str]:
    """Springs at the nodes of the underside, numbered from `count` on; those of one stiffness [N/mm] share a card."""
    stiffness = np.zeros(len(cut.mesh.points))
    np.add.at(stiffness, cut.under[:, 3:], BED * YOUNG * cut.areas()[:, None] / 3.0 / MM)
    held = np.flatnonzero(stiffness)
    for k, value in enumerate(np.unique(stiffness[held].round(12))):
        for axis in (1, 2, 3):
            name = f"S{k}X{axis}"
            yield f"*ELEMENT,TYPE=SPRING1,ELSET={name}"
            for node in held[stiffness[held].round(12) == value]:
                count += 1
                yield f"{count},{node + 1}"
            yield f"*SPRING,ELSET={name}\n{axis}\n{value:.12e}"


def _read(path: Path, nodes: np.ndarray, shape: tuple[int, ...]) -> list[np.ndarray]:
    """Displacements [m] (N,3) of the top after each step that it came to; zero elsewhere."""
    if not path.is_file():
        return []
    rows = [line.split() for line in path.read_text(encoding="ascii").splitlines() if line and "displ" not in line]
    numbers = np.array([row for row in rows if len(row) == 4], dtype=float)
    moved = []
    for k in range(len(numbers) // len(nodes)):
        own = numbers[k * len(nodes) : (k + 1) * len(nodes)]
        u = np.zeros(shape)
        u[own[:, 0].astype(np.int64) - 1] = own[:, 1:] / MM
        moved.append(u)
    return moved
