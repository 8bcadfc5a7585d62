"""The body that keeps to an error, proven on touches that its rungs (`palpate reduce --levels`) were not fitted to.

    python benchmarks/adaptive.py [--surface fingertip] [--modes 80] [--ways 24] [--json]

Ways over the pulp that nothing was fitted to are gone at 1 kHz (the fingertip only), each with its own place, radius,
direction, depth and speed: pressing, sliding with friction, taps. At every fourth tick under force all rungs are
settled to equilibrium; true error is that of the answer against the body of all modes. Some minutes on one core.
"""

from __future__ import annotations

import argparse
import os
import time

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from rich.console import Console
from rich.progress import Progress
from scipy.stats import qmc
from tables import tell

from palpate.models.fe.reduce.reduction import BEHIND, HARDEST, RADII, ROUND
from palpate.nodes.deformation import Adaptive
from palpate.physics.bodies.ladder import FidelityLevels
from palpate.physics.bodies.rungs import Rungs
from palpate.physics.bodies.sampled_body import SampledBasis, SampledBody, gamma
from palpate.physics.bodies.sampled_energy import scratch
from palpate.physics.bodies.sampled_solve import settle, unhurried
from palpate.physics.contact.spread import Spreader

WAYS = 2025
"""Seed of the ways that are gone."""
ERRORS = (0.01, 0.02, 0.05, 0.1, 0.2)
"""[1] That are asked for on the ways."""
TICKS, EVERY = 500, 4
"""Ticks of a way, and those after which true errors are found."""
Row = dict[str, object]


def place(y: float, turn: float, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Foot point [m] and outward normal of the pulp, as in `finger_touches`."""
    tip = max(y, 0.0) / radius
    out = np.array([np.sin(turn) * np.cos(tip), np.sin(tip), np.cos(turn) * np.cos(tip)])
    return np.array([0.0, min(y, 0.0), 0.0]) + radius * out, out


class Settled:
    """The indentation of a body in equilibrium with loads that are held."""

    def __init__(self, basis: SampledBasis, young: float) -> None:
        self.basis, self.young = basis, young
        r = basis.modes.shape[1]
        self.work, self.vectors, self.q, self.g = scratch(basis.points), np.zeros((4, r)), np.zeros(r), np.zeros(r)
        self.H, self.K, self.L, self.energy = np.eye(r), np.zeros((r, r)), np.zeros((r, r)), 0.0

    def at(self, held: np.ndarray, measure: np.ndarray) -> float:
        basis, loaded, told = self.basis, np.flatnonzero(held), np.flatnonzero(measure)
        p = basis.modes[loaded].T @ held[loaded] / self.young
        for _ in range(4):
            self.energy, _, done = settle(
                basis.points, self.work, p, self.q, self.g, self.H, self.K, self.L, self.vectors, self.energy,
                unhurried(),
            )  # fmt: skip
            if done:
                break
        bent_by = basis.residual_compliance[:, loaded] @ held[loaded] / self.young
        gam = gamma(float(held @ bent_by) / self.young, *basis.bend)[0]
        return float(measure[told] @ (basis.modes[told] @ self.q + gam * bent_by[told]))


def gone(x: np.ndarray, k: int, peak: float) -> tuple[float, float, float]:
    """Force [N] and place (y [m], turn [1]) at tick k of a way; x [1] (8,) says which."""
    t, rise = k * 1e-3, 0.02 + 0.15 * x[4]
    y, turn = x[0] * (0.8 * BEHIND + 4e-3) - 0.8 * BEHIND, (1.6 * x[1] - 0.8) * ROUND
    if x[5] < 0.3:  # taps
        return peak * max(np.sin(np.pi * t / rise), 0.0) ** 2, y, turn
    force = peak * float(np.interp(t, [0.01, 0.01 + rise, 0.4, 0.45], [0.0, 1.0, 1.0, 0.0]))
    slid = float(np.clip(t - 0.2, 0.0, 0.2)) * 0.02 * x[6]
    return force, y + slid * np.cos(2 * np.pi * x[7]), turn + slid / 9.8e-3 * np.sin(2 * np.pi * x[7])


def proven(node: Adaptive, basis: SampledBasis, rungs: Rungs, ways: int, progress: Progress) -> list[Row]:
    """What the ladder does on the ways, for each error that is asked for."""
    placed, given = node._placed()
    assert isinstance(placed, SampledBasis)
    mesh, bases = node.mesh(), rungs.cut(placed)
    radius = float(basis.vertices[:, 2].max())
    told: list[list[tuple[float, ...]]] = [[] for _ in ERRORS]
    spent: list[list[float]] = [[] for _ in (*ERRORS, 0)]
    task = progress.add_task("ways", total=ways)
    for x in qmc.Halton(8, seed=WAYS).random(ways):
        patch = RADII[0] + x[2] * (RADII[1] - RADII[0])
        spread, peak = Spreader(mesh, patch, "biweight"), (0.03 + 0.97 * x[3] ** 2) * HARDEST * patch**2 * node.young
        ladders = [FidelityLevels([SampledBody(b, *given) for b in bases], rungs, e, 1000) for e in ERRORS]
        plain, truth = [SampledBody(b, *given) for b in bases], [Settled(b, node.young) for b in bases]
        for k in range(TICKS):
            force, y, turn = gone(x, k, peak)
            foot, out = place(y, turn, radius)
            foot, pull = foot + node.position, -force * out
            if x[5] > 0.6:
                pull = pull + 0.3 * force * np.array([out[2], 0.0, -out[0]]) * np.sign(x[6] - 0.5)
            count = spread.spread(tuple(foot), tuple(out), tuple(pull)) if force > 0.0 else 0
            load = spread.nodes[:count].copy(), spread.forces[:count].copy(), tuple(foot), tuple(out), 1e-3
            answers = []
            for n, ladder in enumerate(ladders):
                begun = time.thread_time()
                answers.append(ladder.step(*load)[3])
                spent[n].append(time.thread_time() - begun)
            for body in plain[:-1]:
                body.step(*load)
            begun = time.thread_time()
            plain[-1].step(*load)
            spent[-1].append(time.thread_time() - begun)
            if k % EVERY or not count or not answers[0] > 0.0:
                continue
            held, measure = plain[-1].held.ravel(), plain[-1].measure.ravel()
            own = np.array([body.at(held, measure) for body in truth])
            for n, (ladder, now) in enumerate(zip(ladders, answers, strict=True)):
                off = np.abs(own / own[-1] - 1.0)
                least = int(np.flatnonzero(off <= ERRORS[n])[0])
                sizes = [b.basis.modes.shape[1] for b in plain]
                cost = float(ladder.evaluations @ sizes)
                told[n].append(
                    (abs(now / own[-1] - 1.0), ladder.estimated_error, cost, plain[least].evaluations * sizes[least],
                     plain[-1].evaluations * sizes[-1], ladder.fidelity, sizes[least])
                )  # fmt: skip
        progress.advance(task)
    rows = []
    for n, error in enumerate(ERRORS):
        true, claimed, cost, least, whole, used, cheapest = np.array(told[n]).T
        ratio = claimed / np.maximum(true, 1e-12)
        low, middle, high = np.quantile(ratio, [0.25, 0.5, 0.75]).tolist()
        rows.append(
            {
                "error %": 1e2 * error,
                "ticks": len(true),
                "true <= claimed %": 1e2 * float(np.mean(true <= claimed)),
                "claimed <= error %": 1e2 * float(np.mean(claimed <= error)),
                "true <= error %": 1e2 * float(np.mean(true <= error)),
                "true p99 %": 1e2 * float(np.quantile(true, 0.99)),
                "claimed/true p25": low,
                "p50": middle,
                "p75": high,
                "1 to 5 %": 1e2 * float(np.mean((ratio >= 1.0) & (ratio <= 5.0))),
                "modes mean": float(used.mean()),
                "cheapest": float(cheapest.mean()),
                "cost over cheapest": float(cost.sum() / least.sum()),
                "over all modes": float(cost.sum() / whole.sum()),
                "step p50 us": 1e6 * float(np.median(spent[n])),
                "all modes": 1e6 * float(np.median(spent[-1])),
            }
        )
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--surface", default="fingertip")
    parser.add_argument("--modes", type=int, default=80)
    parser.add_argument("--ways", type=int, default=24)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    node = Adaptive(surface=given.surface, modes=given.modes, radius=5e-3, reach=12e-3)
    basis = node.basis()
    assert isinstance(basis, SampledBasis)
    finger = given.surface == "fingertip"
    shown: dict[str, list[Row]] = {}
    with Progress(console=Console(stderr=True)) as progress:
        rungs = node.rungs()
        shown["rungs"] = [
            {
                "modes": int(r),
                "w0": float(b[0]),
                "m": float(b[1]),
                "kappa least": float(c.min()),
                "most": float(c.max()),
            }
            for r, b, c in zip(rungs.modes, rungs.bends, rungs.kappa, strict=True)
        ]
        if finger:
            shown["on ways that nothing was fitted to"] = proven(node, basis, rungs, given.ways, progress)
    tell(shown, given.json, digits=3)


if __name__ == "__main__":
    main()
