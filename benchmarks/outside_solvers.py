"""Solvers that others wrote on the slab of `palpate bench accuracy`: indentation against the reference, and time.

    python benchmarks/outside_solvers.py [--place middle] [--cells 2]

Each presses the same block with the same load on meshes of 1 to `--cells` cells across the patch's radius. The error is
the worst over the loads, over the indentation of the stored reference; the time is that of a load step. A solver that
is not installed is named with what installs it.

To add one: a module with `version()`, `INSTALL` and `press(block, levels) -> ContinuumCurve` as `peer_felupe.py`, and a
line in `SOLVERS`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import peer_calculix
import peer_felupe
import peer_mujoco
import tables

from palpate.studies.accuracy import MissingError, continuum, places
from palpate.studies.accuracy.continuum import Block, ContinuumCurve

SOLVERS: dict[str, Callable[[Block, np.ndarray], ContinuumCurve]] = {
    "palpate": continuum.press,
    "FElupe": peer_felupe.press,
    "CalculiX": peer_calculix.press,
    "MuJoCo, neo-Hookean": peer_mujoco.press,
    "MuJoCo, its own material": partial(peer_mujoco.press, material="Saint Venant-Kirchhoff"),
}


def row(name: str, block: Block, right: places.ReferenceSite) -> dict[str, object]:
    """One solver on one mesh."""
    told: dict[str, object] = {"solver": name, "cells a radius": block.cells}
    try:
        curve = SOLVERS[name](block, right.force)
    except (MissingError, ArithmeticError) as error:
        return told | {"why not": str(error)}
    off = np.abs(curve.indentation / right.indentation - 1.0).max()
    seconds = float(np.median(curve.seconds))
    return told | {"unknowns": curve.unknowns, "error [%]": 100.0 * float(off), "load step [s]": seconds}


def main() -> None:
    parser = tables.parser(__doc__)
    blocks = {name: block for name, block in places.PLACES.items() if isinstance(block, Block)}
    parser.add_argument("--place", choices=blocks, default="middle")
    parser.add_argument("--cells", type=int, default=2, help="of the finest mesh, across the patch's radius")
    given = parser.parse_args()
    right = places.stored(given.place)
    band = 100.0 * float((right.band / right.indentation).max())
    meshes = [replace(blocks[given.place], cells=n) for n in range(1, given.cells + 1)]
    rows = [row(name, block, right) for name in SOLVERS for block in meshes]
    tables.tell({f"{given.place}, known within {band:.1f} %": rows}, given.json)


if __name__ == "__main__":
    main()
