"""Cases whose law is tabulated by finite elements: rubber-like layers under a ball, and between bonded plates.

Forces scale with lengths, F = E L² f(s/L), so that one geometry of each rig serves for every size. The true force is
that of a table on the finer mesh with which a fit checks its table; the fit takes a ready table on its mesh. Both are
computed once and kept in a folder.
"""

from __future__ import annotations

import math
import zipfile
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from palpate.models.fit.tissue.rigs import SHAPES, Law, Rig, Values
from palpate.models.fit.tissue.tabulated import FINE, REFERENCE, ForceTable, compute_table, law_of_table, scale_law
from palpate.studies.fits.cases import Case

GEOMETRY = {"ball": (Rig("ball", 8e-3, 8e-3), 1.5e-3, 6), "bonded": (Rig("cylinder", 20e-3, 20e-3, "bonded"), 6e-3, 8)}
"""Rig, depth of the table [m] and elements across of a fit (`fit.fit_tissue`)."""
SHAPE = {"ogden": (2.0, 10.0), "demiray": (0.3, 1.8), "yeoh": (0.05, 0.9)}
"""Range of the true shape parameter, within the table of a fit."""
MIDDLE = {"ogden": 6.0, "demiray": 0.8, "yeoh": 0.5}  # Shape parameters that frictionless plates give a fit
TABULATED = tuple(f"{kind} {law}" for kind in GEOMETRY for law in ("neo_hooke", "ogden", "demiray", "yeoh"))


def draw_tabulated(name: str, rng: np.random.Generator, folder: Path | None) -> Case:
    """A random case of `TABULATED`, with size, modulus and shape; `folder` has the tables."""
    kind, _, law = name.partition(" ")
    unit, _, _ = GEOMETRY[kind]
    used, fine = laws_of(name, folder)
    factor = math.exp(rng.uniform(math.log(0.3), math.log(3.0)))
    assert unit.height is not None  # of both
    rig = replace(unit, radius=factor * unit.radius, height=factor * unit.height)
    truth = {"young": math.exp(rng.uniform(math.log(5e2), math.log(1e5)))}
    for p in SHAPES[law]:
        low, high = (p.to_search(v) for v in SHAPE[law])
        truth[p.name] = p.value(rng.uniform(low, high))
    true, reach = scale_law(fine, rig, factor), rng.uniform(0.6, 0.95) * min(used.reach, fine.reach) * factor
    return Case(rig, law, "none", truth, reach, lambda s: true.force(truth, s), scale_law(used, rig, factor))


def make_tables(names: tuple[str, ...], folder: Path, show: Callable[[float, str], object]) -> None:
    """Compute and keep the tables of these cases that the folder does not have."""
    for done, name in enumerate(names, 1):
        laws_of(name, folder)
        show(done / len(names), f"table of {name}")


@lru_cache(maxsize=len(TABULATED))
def laws_of(name: str, folder: Path | None) -> tuple[Law, Law]:
    """The law on the mesh of a fit, whose finer mesh is that of the second one, the true law; for the unit rig."""
    kind, _, law = name.partition(" ")
    rig, deepest, count = GEOMETRY[kind]
    middle = MIDDLE.get(law) if kind == "bonded" else None
    coarse, fine = (_table(rig, law, deepest, middle, each, folder) for each in (count, FINE))
    true = law_of_table(rig, law, fine, middle)
    used = law_of_table(rig, law, coarse, middle)

    def finer(shape: Values, s: np.ndarray) -> np.ndarray:
        return np.where(s <= true.reach, true.force({**shape, "young": REFERENCE}, s), np.nan)

    return replace(used, finer=finer), true


def _table(rig: Rig, law: str, deepest: float, middle: float | None, count: int, folder: Path | None) -> ForceTable:
    """A table from the folder, else computed and kept there."""
    path = folder / f"table-{rig.kind}-{law}-{count}.npz" if folder else None
    if path and path.exists():
        try:
            with np.load(path) as kept:
                return ForceTable(kept["nodes"], kept["depths"], kept["forces"])
        except (OSError, ValueError, KeyError, zipfile.BadZipFile):
            pass  # cut off: computed again
    made = compute_table(rig, law, deepest, middle, count)
    if path:
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_suffix(".part.npz")
        np.savez(part, nodes=made.nodes, depths=made.depths, forces=made.forces)
        part.replace(path)
    return made
