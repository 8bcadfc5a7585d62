"""What else the paper's fingertip could mean: other readings of its printed constants against its Table III.

    python docs/studies/fingertip_readings.py runs/readings [--cells 5] [--depth 2.4] [--json]

Presses the finger on steel under each reading, one thing changed at a time, into folders: what is there is read, what
was broken off goes on. The last columns tell how far one divisor of all moduli would bring the reading to the two steel
points of the paper. From nothing it takes about an hour on one core.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from palpate.models.fe import ConvergenceError
from palpate.models.fe.meshing.fingertip import PAPER, Fingertip, divisor_and_bone, materials
from palpate.models.fe.meshing.layers import DERMIS, EPIDERMIS, SUBCUTIS
from palpate.models.fe.study.press_record import Record, Run, fit_divisor, record
from palpate.models.fe.study.pressing import Pressing
from palpate.physics.materials.hencky import hencky
from palpate.physics.materials.hyperelastic import Material
from palpate.physics.materials.mooney_rivlin import mooney_rivlin

Laws = Callable[[str | float], dict[int, Material]]


class FreeAbove(Fingertip):
    """Held at its rear alone."""

    @property
    def held(self) -> np.ndarray:
        return self.rear


class UpperHalf(Fingertip):
    """Held at its rear and at the whole upper half of its skin."""

    @property
    def held(self) -> np.ndarray:
        at = self._meshed[1]
        return self.rear | ((at[:, 3] > 4.0 - 1e-9) & (at[:, 1] > -1e-9))


def multiplied(quadratic: float = 1.0, d1: float = 1.0) -> Laws:
    """The printed set with the quadratic constants and D1 of dermis and subcutis multiplied."""

    def laws(material: str | float) -> dict[int, Material]:
        layers = materials(material)
        for layer in (SUBCUTIS, DERMIS):
            c10, c01, c20, c11, c02, d = layers[layer].parameters
            layers[layer] = mooney_rivlin(c10, c01, quadratic * c20, quadratic * c11, quadratic * c02, d1 * d)
        return layers

    return laws


def soft_skin(material: str | float) -> dict[int, Material]:
    """A set with an epidermis of a tenth, 0.2 MPa in the printed one."""
    return materials(material) | {EPIDERMIS: hencky(2e5 / divisor_and_bone(material)[0], 0.3)}


READINGS: dict[str, tuple[Callable[..., Fingertip], str, Laws]] = {
    "17 MPa as printed": (Fingertip, "printed", materials),
    "17 GPa, cortical": (Fingertip, "cortical", materials),
    "phalanx of 20 mm": (partial(Fingertip, phalanx=20e-3), "printed", materials),
    "phalanx of 6 mm": (partial(Fingertip, phalanx=6e-3), "printed", materials),
    "free upper surface": (FreeAbove, "printed", materials),
    "upper half held": (UpperHalf, "printed", materials),
    "cortical, D1 in 1/kPa": (Fingertip, "cortical", multiplied(d1=1e3)),
    "cortical, free upper surface": (FreeAbove, "cortical", materials),
    "cortical, epidermis 0.2 MPa": (Fingertip, "cortical", soft_skin),
    "cortical, no quadratic terms": (Fingertip, "cortical", multiplied(quadratic=0.0)),
}
"""Finger, set of constants, and how these are read."""


def press(name: str, cells: int, depth: float, folder: Path) -> tuple[Record, str]:
    """What a reading gives on steel, and why it ended early."""
    finger, material, laws = READINGS[name]
    run = Run(folder / name.replace(" ", "-").replace("/", "-per-"))

    def tell(load: float) -> None:
        print(f"\r{name}: {1e3 * load:.2f} mm", end="", file=sys.stderr, flush=True)

    try:
        return record(Pressing(finger(cells=cells), material=material, laws=laws), depth, run, tell), ""
    except ConvergenceError as error:
        return run.record(), str(error)
    finally:
        print(file=sys.stderr)


def row(name: str, pressing: Record, fault: str) -> dict[str, object]:
    """Indentations at the paper's forces [mm], and what one divisor makes of them."""
    cells: dict[str, object] = {"reading": name}
    for force, _ in PAPER["steel"]:
        cells[f"{force} N"] = 1e3 * pressing.at(force)[0] if force <= pressing.force[-1] else None
    if pressing.indentation[-1] >= max(depth for _, depth in PAPER["steel"]):
        divisor = fit_divisor(pressing)
        cells["divisor"] = divisor
        for force, _ in PAPER["steel"]:
            cells[f"{force} N, divided"] = 1e3 * pressing.softened(divisor).at(force)[0]
    else:
        cells["ends at"] = f"{1e3 * pressing.indentation[-1]:.2f} mm, {pressing.force[-1]:.3g} N" + (
            fault and f": {fault}"
        )
    return cells


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="of the runs")
    parser.add_argument("--cells", type=int, default=5)
    parser.add_argument("--depth", type=float, default=2.4, help="travel of the plate [mm]")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    rows = [row(name, *press(name, given.cells, 1e-3 * given.depth, given.folder)) for name in READINGS]
    if given.json:
        json.dump(rows, sys.stdout, indent=2, ensure_ascii=False)
        return
    from tables import show

    show("Indentation on steel in mm; the paper has 1.24 at 0.11 N and 2.08 at 0.5 N", rows, 3)


if __name__ == "__main__":
    main()
