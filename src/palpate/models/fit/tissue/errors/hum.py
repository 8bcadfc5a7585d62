"""Hum: a line in the spectrum of the noise of a press, from mains, a motor or a resonance, fitted with the parameters.

    F(t) = law + baselines + a sin(2 pi f t) + b cos(2 pi f t)

A line changes an average far less than noise of its size does, but its error is not normal, and depends on its phase:
no interval for random noise has the right width. So the line is fitted: a and b are linear unknowns, and a small change
of f is a third one. Correlated noise and misfits of a law have less of their squares at one frequency.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from palpate.models.fit.tissue.estimate import LEAST_PER_UNKNOWN, Estimate, Problem, estimate, from_minima
from palpate.models.fit.tissue.measured import Hum, MeasuredPress

SHARE = 0.5  # [1] Share of the squares of the residuals in a line from which it is hum
LEAST_CYCLES = (
    5.0  # Cycles within the rows from which correlated noise and a misfit of the law have no line of this share
)
HIGHEST = 0.48  # [1] Highest frequency, in cycles per row
PADDED = 4  # Frequencies per cycle of the spectrum


def include_hum(problem: Problem, best: Estimate) -> tuple[Problem, Estimate, list[str]]:
    """The problem, its estimate, and notes, with the hum of each press whose residuals show one."""
    J, presses, notes = problem.jacobian(best.at), [], list[str]()
    for i, (press, residual, w) in enumerate(zip(problem.presses, best.residuals, problem.weight, strict=True)):
        rows = J[problem.ends[i] : problem.ends[i + 1]] / np.where(w > 0.0, w, 1.0)[:, None]
        hum = find_hum(press, residual, rows)
        presses.append(press if hum is None else replace(press, hum=hum))
        if hum is not None:
            size = math.hypot(hum.sine, hum.cosine)
            rate = "" if press.time is None else f" ({hum.cycles / float(np.ptp(press.time)):.3g} Hz)"
            notes.append(
                f"{press.name}: the residuals have a line of {hum.cycles:.3g} cycles{rate}, {size:.2g} N: a hum was "
                "fitted with the parameters"
            )
    humming = problem.with_changes(presses)
    if not notes or humming.count < LEAST_PER_UNKNOWN * len(humming.names):
        return problem, best, []
    return humming, estimate(humming, begin=from_minima(humming, best)), notes


def find_hum(press: MeasuredPress, residual: np.ndarray, columns: np.ndarray) -> Hum | None:
    """The line that explains most of the residuals [N] (n,) of a fit with these derivatives (n, p); None: no line has
    the share `SHARE` of their squares."""
    n = len(residual)
    scaled = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    basis, sizes, _ = np.linalg.svd(scaled, full_matrices=False)
    basis = basis[:, sizes > 1e-9 * sizes[0]]
    rest = residual - basis @ (basis.T @ residual)
    squares = float(rest @ rest)
    if squares <= 0.0 or n * HIGHEST <= LEAST_CYCLES:
        return None
    power = np.abs(np.fft.rfft(rest, PADDED * n)) ** 2
    cycles = np.arange(len(power)) / PADDED  # over n rows
    power[(cycles < LEAST_CYCLES) | (cycles > HIGHEST * n)] = 0.0
    if 2.0 / n * float(power.max()) < 0.8 * SHARE * squares:  # the columns may follow a part of a line
        return None
    first = float(cycles[int(np.argmax(power))]) * (n - 1) / n  # over the time of these rows

    def line(at: float) -> tuple[np.ndarray, np.ndarray]:
        waves = np.stack(
            [np.sin(2.0 * math.pi * at * press.elapsed), np.cos(2.0 * math.pi * at * press.elapsed)], axis=1
        )
        free = waves - basis @ (basis.T @ waves)
        found = np.linalg.lstsq(free, rest, rcond=None)[0]
        return found, rest - free @ found

    def left(at: float) -> float:
        return float(np.sum(line(at)[1] ** 2))

    near = np.linspace(first - 1.0 / PADDED, first + 1.0 / PADDED, 5)
    middle = float(near[int(np.argmin([left(at) for at in near]))])
    at = float(minimize_scalar(left, bounds=(middle - 0.5 / PADDED, middle + 0.5 / PADDED), method="bounded",
                               options={"xatol": 1e-5}).x)  # fmt: skip
    if left(at) > (1.0 - SHARE) * squares:
        return None
    sine, cosine = -line(at)[0]
    return Hum(at, float(sine), float(cosine))
