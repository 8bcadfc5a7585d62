"""Psychometric functions: probability of an answer over the level x of a stimulus.

    ψ(x) = γ + (1 - γ - λ) F(x; a, b)

with the guess rate γ, the lapse rate λ, and for F

    logistic  1/(1 + exp(-(x - a)/b))          a: F = 1/2, b [unit of x]
    normal    Φ((x - a)/b)                     a: F = 1/2, b [unit of x], the standard deviation
    weibull   1 - exp(-(x/a)^b), 0 for x <= 0  a: F = 1 - 1/e, b [1], the shape

(Wichmann & Hill, Perception & Psychophysics 63(8), 2001, eqs. 1 to 3). A trial without signal is x = -inf: F = 0.
"""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import expit, ndtr


def logistic(x: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return expit((x - a) / b)


def normal(x: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return ndtr((x - a) / b)


def weibull(x: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    with np.errstate(over="ignore"):  # far above a, F is 1
        return -np.expm1(-((np.maximum(x, 0.0) / a) ** b))


FUNCTIONS: dict[str, Callable[..., np.ndarray]] = {"logistic": logistic, "normal": normal, "weibull": weibull}
AT = {"logistic": 0.5, "normal": 0.5, "weibull": 1.0 - math.exp(-1.0)}  # F at x = a
HALF = {"logistic": math.log(3.0), "normal": 0.6744897501960817}
"""Half of the distance from F = 1/4 to F = 3/4, over b."""


def proportion(name: str, x: ArrayLike, a: ArrayLike, b: ArrayLike, guess: ArrayLike, lapse: ArrayLike) -> np.ndarray:
    """ψ(x); the arguments are broadcast."""
    core = FUNCTIONS[name](np.asarray(x, float), np.asarray(a, float), np.asarray(b, float))
    low, miss = np.asarray(guess, float), np.asarray(lapse, float)
    return low + (1.0 - low - miss) * core
