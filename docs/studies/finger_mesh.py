"""What the mesh of the reduced fingertip's full model costs: plain against mixed elements, coarse against fine.

    python docs/studies/finger_mesh.py [--touches 6] [--deep 2] [--json]

Indentation at rest under the unit loads of touches of the pulp, by the fineness of the mesh and the kind of its
elements, over that of the mesh that is reduced; and with mixed elements, level by level, over that with plain ones. Two
minutes on one core.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from dataclasses import replace

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import beside  # noqa: F401
import numpy as np
from tables import show

from palpate.models.fe.meshing.fingertip import Fingertip, materials
from palpate.models.fe.meshing.layers import DERMIS, SUBCUTIS
from palpate.models.fe.reduce.reducible import SUBCUTIS_MODULUS, Reducible, of_finger
from palpate.models.fe.reduce.reduction import CELLS, SEED, finger_touches
from palpate.models.fe.reduce.snapshots import STIFFENING, pressed


def finger(cells: int, mixed: bool) -> Reducible:
    """The full model, as it is reduced or with mixed elements."""
    body = of_finger(Fingertip(cells=cells))
    if mixed:
        body.materials = lambda young: {
            region: replace(law, mixed=region in (SUBCUTIS, DERMIS))
            for region, law in materials(SUBCUTIS_MODULUS / young).items()
        }
    return body


def at_rest(body: Reducible, count: int) -> np.ndarray:
    """Indentation [m] (count,) for 1 N and 1 Pa."""
    solver, indentations = body.rest(), []
    for own in finger_touches(body, count, SEED):
        load = np.where(body.fixed, 0.0, body.hats @ own.load)
        indentations.append(float(load.ravel() @ solver.solve(load.ravel())))
    return np.array(indentations)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--touches", type=int, default=6)
    parser.add_argument("--deep", type=int, default=2)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    usual = at_rest(finger(CELLS, False), given.touches)
    rest = [
        {"cells": cells, "mixed": mixed, "least": float(ratio.min()), "greatest": float(ratio.max())}
        for cells, mixed in ((CELLS, True), (2 * CELLS, False), (2 * CELLS, True))
        for ratio in (at_rest(finger(cells, mixed), given.touches) / usual,)
    ]
    deep: list[dict[str, object]] = []
    plain, other = finger(CELLS, False), finger(CELLS, True)
    for k, own in enumerate(finger_touches(plain, given.deep, SEED)):
        load = plain.hats @ own.load
        one, two = (np.einsum("ni,lni->l", load, pressed(body, own).solutions) for body in (plain, other))
        ratios = {f"{share:g}": float(x) for share, x in zip(STIFFENING, two / one, strict=False)}
        deep.append({"touch": k, **ratios})
    if given.json:
        json.dump({"at rest": rest, "mixed over plain": deep}, sys.stdout, indent=2)
    else:
        show("indentation at rest over that of the mesh that is reduced", rest)
        show("indentation with mixed elements over that with plain ones, by share of the greatest load", deep)


if __name__ == "__main__":
    main()
