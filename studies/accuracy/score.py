"""How wrong an outcome is: differences from the truth over the whole touch, over the peak of the truth."""

import numpy as np

from palpate.studies.accuracy.outcome import MethodOutcome
from palpate.studies.accuracy.truth import QUANTITIES, Truth

CHARGED = 1.0
"""[1] Error of a method that fails or refuses: that of saying nothing, which is off by all of the truth."""
CHARGED_STEP = 10.0  # [s] Its step


Score = dict[str, dict[str, float]]
"""By quantity: rms and worst error, and the rms that the reference may be off by, over the peak of the truth."""


def score(outcome: MethodOutcome, truth: Truth) -> Score:
    """Of everything that both tell."""
    errors: Score = {}
    for name in QUANTITIES:
        if name in outcome.values and name in truth.values:
            right = truth.value(name, outcome.times)
            errors[name] = _over(outcome.values[name] - right, truth.band(name, outcome.times), truth.values[name])
    looks = [(shape - truth.depth(at, t), truth.shape_band(t), t) for t, at, shape in outcome.shapes if len(at)]
    if looks and "indentation" in truth.values:
        peak = float(np.abs(truth.values["indentation"]).max())
        apart = np.array([_rms(d) for d, *_ in looks])
        errors["shape"] = {
            "rms": _rms(apart) / peak,
            "worst": max(float(np.abs(d).max()) for d, *_ in looks) / peak,
            "band": _rms(np.array([b for _, b, _ in looks])) / peak,
        }
    return errors


def _over(apart: np.ndarray, band: np.ndarray, right: np.ndarray) -> dict[str, float]:
    peak = float(np.abs(right).max())
    return {"rms": _rms(apart) / peak, "worst": float(np.abs(apart).max()) / peak, "band": _rms(band) / peak}


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def charged() -> Score:
    """Of a method that gave no answer."""
    return {name: {"rms": CHARGED, "worst": CHARGED, "band": 0.0} for name in QUANTITIES}
