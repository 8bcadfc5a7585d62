"""The block of `studies.peers.continuum` in CalculiX: writes an input file and runs `ccx`.

The mesh is that of `fe.Solver`, with C3D10 elements of the same energy, so the two differ only in the solver. The
elastic foundation is lumped: each mid-side node of a six-node face supports one third of the area of the face.

G. Dhondt, The Finite Element Method for Three-Dimensional Thermomechanical Applications, Wiley 2004;
http://www.calculix.de. Input files use mm, N and MPa.
"""

import re
import shutil
import subprocess
import time
from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np

from palpate.models.fe.element.mesh import TetMesh
from palpate.physics.materials.hyperelastic import moduli
from palpate.physics.scratch import ScratchFolder
from palpate.studies.peers import MissingError, continuum
from palpate.studies.peers.continuum import BED, LEVELS, POISSON, YOUNG, ContinuumCurve, Tetrahedra, TissueBlock

INSTALL = "apt-get install calculix-ccx"
MM = 1e3  # [mm/m]
MPA = 1e-6  # [MPa/Pa]
LAST = 400  # Number of characters of the output that an error quotes


@lru_cache(maxsize=1)
def version() -> str | None:
    """Version of CalculiX; None if `ccx` is not on the path."""
    program = shutil.which("ccx")
    if program is None:
        return None
    output = subprocess.run([program, "-v"], capture_output=True, text=True, check=False).stdout
    found = re.search(r"Version\s+(\S+)", output)
    return found[1] if found else "of unknown version"


def press_block(block: TissueBlock, levels: np.ndarray = LEVELS) -> ContinuumCurve:
    """Press the block with CalculiX. The time of a load step is the time of the run over the number of load steps.

    MissingError: CalculiX is not installed. ArithmeticError: it did not converge; quotes the end of its output.
    """
    cut = continuum.tetrahedra(block)
    with ScratchFolder("calculix") as folder:
        whole, status, output = run(deck(cut, levels), Path(folder))
        seconds = whole / len(levels)
        moved = _read(Path(folder) / "run.dat", np.sort(cut.top.ravel()), cut.mesh.points.shape)
    if status or len(moved) != len(levels):
        raise ArithmeticError(f"CalculiX solved {len(moved)} of {len(levels)} forces; end of its output: {output}")
    depth = [float(np.sum(cut.unit * u)) for u in moved]
    shape = [-u[cut.top, 2] for u in moved]
    return continuum.curve(levels, depth, shape, (cut.x, cut.y, cut.top), cut.unit.size, [seconds] * len(levels))


def run(cards: Iterable[str], folder: Path) -> tuple[float, int, str]:
    """Run CalculiX on these cards; it writes its results to the files `run.*` of the folder.

    Returns the duration [s], the exit status and the end of its output. MissingError: CalculiX is not installed.
    """
    program = shutil.which("ccx")
    if program is None:
        raise MissingError(f"CalculiX is not installed: the program ccx is missing. Install it: {INSTALL}")
    (folder / "run.inp").write_text("\n".join(cards) + "\n", encoding="ascii")
    begun = time.perf_counter()
    ran = subprocess.run([program, "-i", "run"], cwd=folder, capture_output=True, text=True, check=False)
    return time.perf_counter() - begun, ran.returncode, " ".join(ran.stdout.split())[-LAST:]


def solids(mesh: TetMesh, laws: Sequence[tuple[float, float]], scale: float = 1.0) -> Iterator[str]:
    """Cards of a mesh with neo-Hookean regions. `laws` has the shear and bulk modulus of each region; `scale` is the
    length of one metre in the cards."""
    yield "*NODE"
    yield from (f"{k},{x:.14g},{y:.14g},{z:.14g}" for k, (x, y, z) in enumerate((scale * mesh.points).tolist(), 1))
    for region, (shear, bulk) in enumerate(laws):
        yield f"*ELEMENT,TYPE=C3D10,ELSET=R{region}"
        for k in np.flatnonzero(mesh.region == region):
            yield ",".join(str(n + 1) for n in (k, *mesh.elements[k]))
        yield f"*MATERIAL,NAME=M{region}\n*HYPERELASTIC,NEO HOOKE\n{shear / 2:.12e},{2 / bulk:.12e}"
        yield f"*SOLID SECTION,ELSET=R{region},MATERIAL=M{region}"


def deck(cut: Tetrahedra, levels: np.ndarray) -> Iterator[str]:
    """Lines of the input file: mesh, materials, foundation, supports, and one step per force [N]."""
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
    """Springs at the nodes of the underside, numbered from `count` on; springs of one stiffness [N/mm] share a card."""
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
    """Displacements [m] (N,3) of the top after each solved step; zero elsewhere."""
    if not path.is_file():
        return []
    rows = [line.split() for line in path.read_text(encoding="ascii").splitlines() if line and "displ" not in line]
    numbers = np.array([row for row in rows if len(row) == 4], dtype=float)
    moved = []
    for k in range(len(numbers) // len(nodes)):
        part = numbers[k * len(nodes) : (k + 1) * len(nodes)]
        u = np.zeros(shape)
        u[part[:, 0].astype(np.int64) - 1] = part[:, 1:] / MM
        moved.append(u)
    return moved
