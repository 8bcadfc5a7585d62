"""Silicone cylinders between plates, fitted with a graph and with the closed forms of `palpate fit tissue`.

    python benchmarks/measured/phantoms.py FOLDER

Reads EF10_0T_A1.csv to EF30_0T_A3.csv of A. B. Dawood et al., Tissue Phantom Material Database 1.0.0 (CC BY 4.0,
https://github.com/abubakardawood/tissue-phantom-material-database). The graph is `nodule` without its nodule: a body on
springs, K s^n, in series with a fingertip that is as rigid as a plate. The three presses of a silicone are fitted
together, each with its zero of the indentation; K s^n and a fingertip in series are fitted to the first. A small strain
of a cylinder of area A and height H has K = E A/H. Takes five minutes.
"""

from __future__ import annotations

import math
import sys
import warnings

import numpy as np
from scipy.optimize import least_squares
from source import parser

import palpate
from palpate.models.fit.tissue.fit import fit_tissue
from palpate.models.fit.tissue.measured import read_presses
from palpate.models.fit.tissue.rigs import Rig
from palpate.studies.inverse.fit import fit_run
from palpate.studies.inverse.table import read_table_run

SILICONES, PRESSES = ("EF10_50T", "EF10_0T", "EF30_0T"), (1, 2, 3)
RADIUS, HEIGHT = 25e-3, 30e-3  # [m]
SPEED = 10e-3 / 60.0  # [m/s] of the machine
E_OF_K = HEIGHT / (math.pi * RADIUS**2)  # [1/m]
DEPTHS = (1.5e-3, 3e-3, 6e-3)  # [m] 5, 10 and 20 % of the height
SETS = ["scene.nodule.nodule_radius=0", "tissue.retardation=0", "contact.finger_damping=0", "rate=50"]
PLATE = ["contact.finger_stiffness=1e8", "contact.finger_hardening=1"]
"""A fingertip of 100 kN/mm."""


def by_graph(files, deepest: float, free: list[str], plate: bool):
    """The fit of a graph to presses up to a depth [m]."""
    sets = SETS + PLATE * plate
    until = deepest / SPEED
    return fit_run(
        [read_table_run(file, ["contact.force"], "nodule", None, sets, until) for file in files], free, starts=1
    )


def neo_hooke(presses, deepest: float) -> float:
    """Young's modulus [Pa] of a neo-Hookean cylinder, with the unknowns of the graph: the zero of each indentation."""
    parts = [(p.depth[p.depth <= deepest], p.force[p.depth <= deepest]) for p in presses]

    def residuals(x):
        found = []
        for (depth, force), zero in zip(parts, x[1:], strict=True):
            stretch = 1.0 - np.maximum(depth - 1e-3 * zero, 0.0) / HEIGHT
            law = 1e3 * x[0] * math.pi * RADIUS**2 * (stretch**-2 - stretch) / 3.0
            found.append((law - force) / np.abs(force).max())
        return np.concatenate(found)

    return 1e3 * float(least_squares(residuals, [30.0, *[0.05] * len(parts)], x_scale=[10.0, *[0.1] * len(parts)]).x[0])


def error(residuals, presses) -> float:
    """RMS of residuals [N], over the peaks."""
    return float(
        np.sqrt(np.mean([np.mean((r / np.abs(f).max()) ** 2) for r, f in zip(residuals, presses, strict=True)]))
    )


def shown(value: float, low: float, high: float, factor: float = 1e-3) -> str:
    return f"{factor * value:.1f} ({factor * low:.1f} to {factor * high:.1f})"


def main() -> None:
    folder = parser(__doc__).parse_args().folder
    if folder is None or not (folder / f"{SILICONES[0]}_A1.csv").is_file():
        sys.exit(f"give the folder with {SILICONES[0]}_A1.csv and the others; this script names its source")
    warnings.simplefilter("ignore", palpate.PalpateWarning)
    for silicone in SILICONES:
        files = [folder / f"{silicone}_A{k}.csv" for k in PRESSES]
        presses = [press for file in files for press in read_presses(file, {}, {})]
        for deepest in DEPTHS:
            graph = by_graph(files, deepest, ["tissue.stiffness"], True)
            at = graph.estimate.intervals["tissue.stiffness"]
            punch = fit_tissue(presses, Rig("punch", radius=RADIUS), "hertz", deepest=deepest, drift="none")
            slope = 2.0 * RADIUS / (1.0 - 0.25) * punch.estimate.values["young"]  # K of F = K s
            plates = fit_tissue(presses, Rig("cylinder", RADIUS, HEIGHT), "neo_hooke", deepest=deepest)
            young = plates.estimate.intervals["young"]
            same, end = neo_hooke(presses, deepest), 1.0 - deepest / HEIGHT
            factor = (end**-2 - end) / 3.0 / (1.0 - end)
            forces = [each.values[0] for each in graph.measured]
            print(
                f"{silicone}, to {1e3 * deepest:g} mm, E [kPa]: "
                f"graph {shown(at.value, at.low, at.high, 1e-3 * E_OF_K)}, "
                f"closed form K s {1e-3 * E_OF_K * slope:.1f}, "
                f"neo-Hooke with the same zero {1e-3 * same:.1f}, {factor:.2f} times {1e-3 * factor * same:.1f}, "
                f"by fit tissue {shown(young.value, young.low, young.high)}; "
                f"error of the graph {100 * error(graph.estimate.residuals, forces):.2f} % of the peak",
                flush=True,
            )
        deepest = DEPTHS[1]
        power = by_graph(files[:1], deepest, ["tissue.stiffness", "tissue.exponent"], True).estimate.values
        closed = fit_tissue(
            presses, Rig("punch", radius=RADIUS), "power", deepest=deepest, drift="none"
        ).estimate.values
        forces = [
            stiffness * 2e-3**exponent
            for stiffness, exponent in (
                (power["tissue.stiffness"], power["tissue.exponent"]), (closed["stiffness"], closed["exponent"])
            )
        ]  # fmt: skip
        print(
            f"{silicone}, first press, K s^n to {1e3 * deepest:g} mm: graph K {power['tissue.stiffness']:.4g}, "
            f"n {power['tissue.exponent']:.3f}; closed form K {closed['stiffness']:.4g}, n {closed['exponent']:.3f}; "
            f"force at 2 mm {forces[0]:.2f} and {forces[1]:.2f} N",
            flush=True,
        )
        finger = by_graph(files[:1], DEPTHS[0], ["tissue.stiffness"], False)
        measured = [each.values[0] for each in finger.measured]
        print(
            f"{silicone}, with the scene's fingertip in series, to {1e3 * DEPTHS[0]:g} mm: "
            f"{finger.open_ or finger.estimate.values}, "
            f"error {100 * error(finger.estimate.residuals, measured):.1f} % of the peak",
            flush=True,
        )


if __name__ == "__main__":
    main()
