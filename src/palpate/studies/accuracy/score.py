"""Errors of an outcome: differences from the reference over the whole touch, relative to the reference peak."""

import numpy as np

from palpate.studies.accuracy.outcome import MethodOutcome
from palpate.studies.accuracy.reference import QUANTITIES, ReferenceSolution

CHARGED = 1.0
"""[1] Error of a method that fails or does not support a test case: that of a result of zero."""
CHARGED_STEP = 10.0  # [s] Its step time


Score = dict[str, dict[str, float]]
"""By quantity: RMS and maximum error, and the RMS uncertainty of the reference, over the peak of the reference."""


def score(outcome: MethodOutcome, solution: ReferenceSolution) -> Score:
    """Errors of all quantities that outcome and reference have in common."""
    errors: Score = {}
    for name in QUANTITIES:
        if name in outcome.values and name in solution.values:
            right, band = solution.value(name, outcome.times), solution.band(name, outcome.times)
            errors[name] = _over(outcome.values[name] - right, band, solution.values[name])
    shapes = [(shape - solution.depth(at, t), solution.shape_band(t)) for t, at, shape in outcome.shapes if len(at)]
    if shapes and "indentation" in solution.values:
        peak = float(np.abs(solution.values["indentation"]).max())
        errors["shape"] = {
            "rms": _rms(np.array([_rms(d) for d, _ in shapes])) / peak,
            "worst": max(float(np.abs(d).max()) for d, _ in shapes) / peak,
            "band": _rms(np.array([b for _, b in shapes])) / peak,
        }
    return errors


def _over(difference: np.ndarray, band: np.ndarray, right: np.ndarray) -> dict[str, float]:
    peak = float(np.abs(right).max())
    return {"rms": _rms(difference) / peak, "worst": float(np.abs(difference).max()) / peak, "band": _rms(band) / peak}


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def missing_score() -> Score:
    """Errors of a method without a result."""
    return {name: {"rms": CHARGED, "worst": CHARGED, "band": 0.0} for name in QUANTITIES}
