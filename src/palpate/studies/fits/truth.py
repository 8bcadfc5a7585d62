"""True forces of random presses, by other formulas and numerics than those of the fit.

elastic     formulas written out; cylinder: the nominal stress of each law in its stretch; layer: the integral equation
            of `physics.contact.layer`, by Simpson's rule and successive substitution; fingertip: the total indentation
            is explicit in the force, and inverted by interpolation; rubber under a ball and between bonded plates:
            finite elements on a finer mesh than those of the fit (`tables`)
relaxation  the motion and the elastic force on a grid `FINER` times finer than the rows; kelvin-voigt: its derivative;
            prony: internal variables q' = F_e' - q/tau by the exponential midpoint rule

The rows sample these forces, so that the discretisation of the fit counts as its error.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.signal import lfilter

from palpate.models.fit.tissue.rigs import FINGER
from palpate.studies.fits.cases import Case

FINER = 16
CORNER = 2  # Rows over which the speed of the indenter changes
POINTS, WAVES, MOST_WAVE = 201, 2001, 60.0  # Points of Simpson's rule over the contact, over waves, and their end [1]


def true_force(case: Case, time: np.ndarray, path: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Depth [m] (n,) and force [N] (n,) at evenly spaced times [s] (n,), along a path [m] (n,) whose corners are
    rounded."""
    n = len(time)
    fine = np.linspace(0.0, n - 1.0, FINER * (n - 1) + 1)
    moved = np.interp(fine, np.arange(n), path)
    window = np.ones(CORNER * FINER + 1) / (CORNER * FINER + 1)
    ends = len(window) - 1
    padded = np.concatenate([moved[0] - (moved[FINER] - moved[0]) / FINER * np.arange(ends, 0, -1), moved,
                             moved[-1] + (moved[-1] - moved[-1 - FINER]) / FINER * np.arange(1, ends + 1)])  # fmt: skip
    moved = np.convolve(np.convolve(padded, window, "valid"), window, "valid")
    moved = np.round(moved / case.reach, 12) * case.reach  # the last bits depend on the memory's alignment
    elastic = np.zeros(len(moved))
    pressed = moved > 0.0
    elastic[pressed] = elastic_force(case)(moved[pressed])
    step = (time[1] - time[0]) / FINER
    return moved[::FINER], _relaxed(case, elastic, moved, step)[::FINER]


def _relaxed(case: Case, elastic: np.ndarray, depth: np.ndarray, step: float) -> np.ndarray:
    """Force [N] (n,) at times `step` [s] apart."""
    kind, truth = case.relaxation, case.truth
    if kind == "none":
        return elastic
    if kind == "kelvin-voigt":
        return np.maximum(elastic + truth["retardation"] * np.gradient(elastic, step), 0.0)
    if kind == "hunt-crossley":
        return elastic * np.maximum(1.0 + truth["damping"] * np.gradient(depth, step), 0.0)
    force, left = np.zeros(len(elastic)), 1.0
    for i in range(1, int(kind.partition(":")[2]) + 1):
        share, decay = left * truth[f"share_{i}"], math.exp(-step / truth[f"time_{i}"])
        left -= share
        force += share * lfilter([math.sqrt(decay)], [1.0, -decay], np.diff(elastic, prepend=0.0))
    return force + left * elastic


def elastic_force(case: Case) -> Callable[[np.ndarray], np.ndarray]:
    """Force [N] (n,) of the case's law at indentations [m] (n,) > 0, without relaxation."""
    rig, truth = case.rig, case.truth
    if case.force is not None:
        return case.force
    if rig.kind == "cylinder":
        assert rig.height is not None  # of every cylinder
        area, height = math.pi * rig.radius**2, rig.height
        if case.law == "linear":
            return lambda s: truth["young"] * area * s / height
        return lambda s: area * _compressive(case.law, truth, 1.0 - s / height)
    if rig.kind == "fingertip":
        return _in_series(truth["stiffness"], truth["exponent"], case.reach)
    if case.law == "power":
        return lambda s: truth["stiffness"] * s ** truth["exponent"]
    if case.law == "exponential":
        m = truth["hardening"]
        return lambda s: truth["stiffness"] / m * (np.exp(m * s) - 1.0)
    if rig.kind == "punch":
        return lambda s: 8.0 / 3.0 * truth["young"] * rig.radius * s
    size = 16.0 / 9.0 * truth["young"] * math.sqrt(rig.radius)
    if case.law == "hertz":
        return lambda s: size * s**1.5
    assert rig.height is not None  # of every layer
    height, factor = rig.height, layer_factor()
    return lambda s: size * s**1.5 * factor(np.sqrt(rig.radius * s) / height)


def _compressive(law: str, truth: dict[str, float], stretch: np.ndarray) -> np.ndarray:
    """Nominal compressive stress [Pa] (n,) of an incompressible body with free sides at stretches (n,) < 1."""
    shear, more = truth["young"] / 3.0, stretch**2 + 2.0 / stretch - 3.0
    if law in ("ogden", "ogden2"):
        terms = [(1.0, truth["alpha"])] if law == "ogden" else [
            (1.0 - truth["share"], truth["alpha_1"]), (truth["share"], truth["alpha_2"])]  # fmt: skip
        parts = [2.0 * shear * part / a * (stretch ** (-0.5 * a - 1.0) - stretch ** (a - 1.0)) for part, a in terms]
        return np.sum(parts, axis=0)
    grown = np.ones(len(stretch))
    if law == "demiray":
        grown = np.exp(truth["b"] * more)
    elif law.startswith("yeoh"):
        grown = 1.0 + 2.0 * truth["c2_over_c1"] * more + 3.0 * truth.get("c3_over_c1", 0.0) * more**2
    return shear * (stretch**-2 - stretch) * grown


def _in_series(stiffness: float, exponent: float, deepest: float) -> Callable[[np.ndarray], np.ndarray]:
    """Force [N] of the finger and a tissue in series at their summed indentation [m] up to 1.1 times the deepest."""
    b, m = FINGER
    most = stiffness * (1.1 * deepest) ** exponent
    force = most * np.geomspace(1e-9, 1.0, 8000)
    total = np.log1p(force * m / b) / m + (force / stiffness) ** (1.0 / exponent)
    inverse = PchipInterpolator(np.log(total), np.log(force))
    return lambda s: np.exp(inverse(np.log(s)))


@lru_cache(maxsize=1)
def layer_factor() -> CubicSpline:
    """f over chi up to 0.9 of an incompressible bonded layer; equations in `physics.contact.layer`."""
    y = np.linspace(0.0, MOST_WAVE, WAVES)
    e = np.exp(-2.0 * y)  # M with numerator and denominator times 4 exp(-2 y)
    M = (1.0 - e**2 - 4.0 * y * e) / (4.0 * (y**2 + 1.0) * e + (1.0 - e) ** 2)
    rows = [(0.0, 1.0)]
    for wide in np.linspace(0.0, 1.0, 26)[1:]:
        x = np.linspace(0.0, wide, POINTS)
        waves = np.cos(np.outer(x, y))
        K = 2.0 / math.pi * (waves * (_simpson(WAVES) * (y[1] - y[0]) * (1.0 - M))) @ waves.T
        weights = _simpson(POINTS) * (x[1] - x[0])
        flat, bent = np.full(POINTS, 2.0 / math.pi), 2.0 / math.pi * x**2
        one, two = flat, bent
        for _ in range(200):
            one, two = flat + K @ (weights * one), bent + K @ (weights * two)
        square = two[-1] / one[-1]
        force = 2.0 * math.pi * float(weights @ (square * one - two))
        rows.append((math.sqrt(square), force / (8.0 / 3.0 * square**1.5)))
    chi, f = np.array(rows).T
    return CubicSpline(chi, f)


def _simpson(count: int) -> np.ndarray:
    """Weights (count,) of Simpson's rule for a spacing of 1; count is odd."""
    weights = np.full(count, 2.0 / 3.0)
    weights[1::2], weights[[0, -1]] = 4.0 / 3.0, 1.0 / 3.0
    return weights
