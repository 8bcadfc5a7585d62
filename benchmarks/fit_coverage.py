"""How often the 95 % intervals of `palpate fit-tissue` hold the truth, and
how often a press without a flaw gets a
note: synthetic presses, white and correlated noise.

A ball of 8 mm on a layer of 20 mm, E = 10 kPa, bonded; noise of 1 % of the peak, the touch point 0.1 mm off
what the file says; once white, once with a correlation of 0.9 from row to row, and a press and hold where it relaxes.

python benchmarks/fit_coverage.py [trials]
"""

from __future__ import annotations

import sys

import numpy as np

from palpate.models.fit.tissue import relaxing
from palpate.models.fit.tissue.fit import fit_tissue
from palpate.models.fit.tissue.measured import Press, prepared
from palpate.models.fit.tissue.rigs import Rig, closed_form

RIG = Rig("ball", 8e-3, 20e-3)
TRUTH = {"young": 1e4, "share_1": 0.5, "time_1": 2.0}
OFFSET = 1e-4
"""[m] How far the indentation of the file is off."""


def trial(seed: int, kind: str = "none", correlation: float = 0.0, noise: float = 0.01, rows: int = 300) -> Press:
    """A press of 10 s: 2 s in, then held where something relaxes; 1 s of free motion before."""
    rng = np.random.default_rng(seed)
    time = np.linspace(-1.0, 9.0 if kind != "none" else 2.0, rows)
    depth = np.clip(time / 2.0, -0.5, 1.0) * 2e-3
    ideal = Press("synthetic", time, depth, np.zeros(rows), 0.0, 1e-4, 0.0)
    force = relaxing.force(kind, closed_form(RIG, "layer"), TRUTH, ideal, 0.0)
    step = rng.standard_normal(rows)
    for k in range(1, rows):
        step[k] = correlation * step[k - 1] + np.sqrt(1.0 - correlation**2) * step[k]
    return prepared("synthetic", time, depth + OFFSET, force + noise * force.max() * step)


def covered(trials: int, kind: str = "none", correlation: float = 0.0) -> dict[str, float]:
    """Share of the trials whose interval holds the truth, for each parameter; and of those with a false alarm."""
    held: dict[str, list[bool]] = {}
    for seed in range(trials):
        fit = fit_tissue([trial(seed, kind, correlation)], RIG, "layer", kind)
        for name, own in fit.estimate.intervals.items():
            held.setdefault(name, []).append(own.low <= TRUTH[name] <= own.high)
        held.setdefault("false alarm", []).append(bool(fit.notes))
    return {name: float(np.mean(each)) for name, each in held.items()}


def main() -> None:
    trials = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    for kind in ("none", "prony:1"):
        for correlation in (0.0, 0.9):
            shares = covered(trials, kind, correlation)
            text = ", ".join(f"{name} {100 * share:.1f} %" for name, share in shares.items())
            print(f"{trials} trials, relaxation {kind}, correlation {correlation:g}: {text}", flush=True)


if __name__ == "__main__":
    main()
