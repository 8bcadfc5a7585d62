"""The law of large displacement against full finite elements on kidney and slab, with a nodule, and under a capsule.

    python benchmarks/large_strain.py                    # all cases, about 7 minutes on a quiet core
    python benchmarks/large_strain.py --cases 0 4        # some of them

A patch that sticks presses until s is about its radius R. The law gets the full solution's compliance at small s, so
the error is that of large displacement alone. Printed: force error at equal depth, RMS in % of the largest force and
worst in % of the force: linear organ; half-space's law with R; as shipped, with R (c/c_R)² unless there is a nodule or
a capsule.
"""

from __future__ import annotations

import argparse
from typing import NamedTuple

import numpy as np

from palpate.physics.bodies.large_displacement import linear_depth, nonlinearity
from palpate.physics.bodies.true_patch import HELD, MEAN
from palpate.studies.accuracy import kidney
from palpate.studies.peers.continuum import YOUNG, ContinuumCurve, TissueBlock, press_block

DEEPEST = 1.05  # [1] s/R up to which the errors count
SHARES = np.array([0.004, 0.17, 0.33, 0.54, 0.75, 1.0])  # [1] Forces over the largest one
LARGEST = 2.05  # [N] under a patch of 8 mm


class Case(NamedTuple):
    """A press: organ, radius [m] of the patch, place [m] on it, Poisson's ratio."""

    organ: str
    radius: float
    place: float
    poisson: float


CASES = (
    Case("kidney", 8e-3, 12e-3, 0.45),
    Case("kidney", 12e-3, 0.0, 0.45),
    Case("kidney", 12e-3, 0.0, 0.3),
    Case("kidney", 8e-3, 0.0, 0.49),
    Case("kidney", 12e-3, 12e-3, 0.49),
    Case("slab", 8e-3, 0.0, 0.49),
    Case("nodule", 8e-3, 5e-3, 0.45),
    Case("nodule", 12e-3, 0.0, 0.45),
    Case("capsule", 8e-3, 0.0, 0.45),
    Case("capsule", 12e-3, 0.0, 0.45),
    Case("capsule", 8e-3, 0.0, 0.49),
)
THIN, HARD = 1e-3, 10.0  # [m] Thickness of the capsule, [1] its modulus over that of the tissue


class CoveredBlock(TissueBlock):
    """A slab under a capsule, a separate layer of cells."""

    def axes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        x, y, z = super().axes()
        return x, y, np.concatenate([z[z < -1.5 * THIN], [-THIN, 0.0]])

    def hardness(self) -> np.ndarray:
        x, y, z = self.axes()
        layers = np.where(z[1:] > -0.5 * THIN, HARD, 1.0)
        return np.repeat(layers, (len(x) - 1) * (len(y) - 1))


def full(case: Case, cells: int) -> ContinuumCurve:
    """Force and indentation of the full model."""
    levels = SHARES * LARGEST * (case.radius / 8e-3) ** 2 * (1.3 if case.poisson < 0.35 else 1.0)
    if case.organ == "kidney":
        kidney.RADIUS, kidney.POISSON = case.radius, case.poisson
        return kidney.press_kidney(kidney.Kidney(case.place, cells), levels)
    block = CoveredBlock if case.organ == "capsule" else TissueBlock
    return press_block(block(case.place, cells, case.organ == "nodule", case.radius, case.poisson), levels)


def half_space(case: Case) -> float:
    """Compliance [m/N] of a half-space under the patch that sticks."""
    nu = case.poisson
    return (1.0 - nu**2) * MEAN * (1.0 - HELD * ((1.0 - 2.0 * nu) / (1.0 - nu)) ** 2) / (np.pi * case.radius * YOUNG)


def forces(depths: np.ndarray, compliance: float, radius: float, poisson: float) -> np.ndarray:
    """[N] of the law with this radius [m] at depths [m]."""
    rho = nonlinearity(poisson)
    return np.array([radius * linear_depth(s / radius, rho)[0] for s in depths]) / compliance


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, nargs="+", default=range(len(CASES)))
    parser.add_argument("--cells", type=int, default=2, help="cells across the radius of the patch")
    given = parser.parse_args()
    for case in (CASES[k] for k in given.cases):
        curve = full(case, given.cells)
        within = curve.indentation < DEEPEST * case.radius
        force, depth = curve.force[within], curve.indentation[within]
        rest = depth[0] / force[0] * forces(depth[:1], 1.0, case.radius, case.poisson)[0] / depth[0]
        ratio = rest / half_space(case)
        wide = 1.0 if case.organ in ("nodule", "capsule") else ratio**2
        print(f"{case.organ}, R {1e3 * case.radius:g} mm, at {1e3 * case.place:g} mm, nu {case.poisson}, "
              f"s/R to {depth[-1] / case.radius:.2f}, c/c_R {ratio:.3f}")  # fmt: skip
        laws = {
            "linear": depth / rest,
            "with R": forces(depth, rest, case.radius, case.poisson),
            "as shipped": forces(depth, rest, wide * case.radius, case.poisson),
        }
        for name, found in laws.items():
            rms = np.sqrt(np.mean((found - force) ** 2)) / force[-1]
            print(
                f"  {name:10s} {100 * rms:5.1f} % RMS, {100 * np.abs(found / force - 1.0).max():5.1f} % worst",
                flush=True,
            )


if __name__ == "__main__":
    main()
