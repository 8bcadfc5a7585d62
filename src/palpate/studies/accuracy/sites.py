"""Test sites with stored static curves, computed by two solvers, each on two meshes (`benchmarks/references.py`)."""

import json
from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from palpate.nodes.deformation import basis_store
from palpate.physics.errors import ArgumentError
from palpate.studies.accuracy import kidney
from palpate.studies.accuracy.kidney import Kidney
from palpate.studies.peers import MissingError, calculix, continuum, felupe, mujoco
from palpate.studies.peers.continuum import LEVELS, LIGHT, ContinuumCurve, TissueBlock

SHIPPED = Path(__file__).parent / "references"
SITES: dict[str, TissueBlock | Kidney] = {
    "middle": TissueBlock(0.0),
    "slip": TissueBlock(0.0, sticks=False),
    "edge": TissueBlock(0.04),
    **{f"nodule-{mm:02d}": TissueBlock(1e-3 * mm, nodule=True) for mm in (0, 10)},
    **{f"kidney{mm:+03d}": Kidney(1e-3 * mm) for mm in (-12, 0, 12)},
}
"""[m] `slip` is the middle, with a surface free to slide under the patch; `edge` is 10 mm from the border of the block;
`nodule-NN` is NN mm from a nodule; `kidney+NN` is NN mm from the middle of the top towards the upper pole."""
SOLVERS: dict[str, Callable[[TissueBlock, np.ndarray], ContinuumCurve]] = {
    "fe": continuum.press_block,
    "felupe": felupe.press_block,
    "calculix": calculix.press_block,
    "mujoco": mujoco.press_block,
    "mujoco, its own material": partial(mujoco.press_block, material="Saint Venant-Kirchhoff"),
}
"""The first two compute the references; the others are compared with them."""
ON_KIDNEY: dict[str, Callable[[Kidney], ContinuumCurve]] = {
    "fe": kidney.press_kidney,
    "felupe": kidney.press_kidney_felupe,
}
PATHS = {"kidney": ("kidney-12", "kidney+00", "kidney+12")}
"""Sites along a path on which the static curve changes."""


def on_path(name: str) -> tuple[str, ...]:
    """The sites of a reference: those of the path of this name, or the site itself."""
    return PATHS.get(name, (name,))


def cells_text(cells: int) -> str:
    return f"{cells} cell{'' if cells == 1 else 's'} a radius"


def cache() -> Path:
    """Folder of results computed on this machine."""
    return basis_store.cache().with_name("bench")


@dataclass(frozen=True)
class ReferenceSite:
    """A stored reference.

    force, indentation, work  [N], [m], [J] (L,);  band [m] (L,) of the indentation
    x, y, shape               as in `ContinuumCurve`;  shape_band [m] (L,) RMS near the site; empty for a kidney
    about                     provenance
    """

    force: np.ndarray
    indentation: np.ndarray
    work: np.ndarray
    band: np.ndarray
    x: np.ndarray
    y: np.ndarray
    shape: np.ndarray
    shape_band: np.ndarray
    about: dict[str, Any]


@lru_cache(maxsize=32)
def load_reference(name: str) -> ReferenceSite:
    """The reference of this name. MissingError: it is not stored. ArgumentError: its file is damaged."""
    path = SHIPPED / f"{name}.npz"
    if not path.is_file():
        raise MissingError(
            f"{path}: this reference is missing. Build it: python benchmarks/references.py. "
            f"Stored: {', '.join(sorted(p.stem for p in SHIPPED.glob('*.npz'))) or 'none'}"
        )
    try:
        with np.load(path) as file:
            arrays = {f.name: file[f.name] for f in fields(ReferenceSite) if f.name != "about"}
            return ReferenceSite(**arrays, about=json.loads(str(file["about"])))
    except (OSError, KeyError, ValueError, EOFError) as error:
        raise ArgumentError(f"{path}: damaged ({error}). Build it again: python benchmarks/references.py") from None


@lru_cache(maxsize=64)
def compute_curve(block: TissueBlock | Kidney, solver: str) -> ContinuumCurve:
    """The curve of a site by a solver."""
    if isinstance(block, Kidney):
        return ON_KIDNEY[solver](block)
    return SOLVERS[solver](block, LEVELS if block.sticks else LIGHT)
