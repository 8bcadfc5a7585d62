"""From measured indentation sessions to settings of nodes: the formulas behind `palpate fit`, and what nodes take.

The launcher reads sessions, prints and draws; it reaches the formulas of `physics` through this module only.
"""

from __future__ import annotations

from typing import Any

from palpate.nodes.probabilistic import LAW_SETTINGS
from palpate.physics.crossvalidation import Choice, choose
from palpate.physics.curve_fit import Fit, FitError, fit_curve
from palpate.physics.force_band import truncated_density, truncated_quantile
from palpate.physics.force_models import LAWS, MODELS, ForceModel
from palpate.physics.synthetic_sessions import DEPTHS, synthetic_sessions

__all__ = [
    "DEPTHS",
    "LAWS",
    "MODELS",
    "Choice",
    "Fit",
    "FitError",
    "ForceModel",
    "choose",
    "fit_curve",
    "law_settings",
    "synthetic_sessions",
    "truncated_density",
    "truncated_quantile",
]


def law_settings(choice: Choice, deepest: float) -> dict[str, Any]:
    """The settings of `contact.Probabilistic` for a fitted subject; `deepest` [m] is its deepest indentation.

    Sessions that do not scatter have the deviation 0.
    """
    spread = choice.deviation
    values = (
        choice.mean.model.name,
        choice.mean.parameters.tolist(),
        "linear" if spread is None else spread.model.name,
        [0.0, 0.0] if spread is None else spread.parameters.tolist(),
        float(deepest),
    )
    return dict(zip(LAW_SETTINGS, values, strict=True))
