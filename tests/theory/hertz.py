"""Two elastic bodies as one Hertz pair: their contact compliances add, not their indentations.

    f = (4/3) E* sqrt(R) e^{3/2},    1/E* = 1/E1* + 1/E2*,    E_i* = E_i/(1 - nu_i²)

Each body takes the share s_i = e E*/E_i* of the approach (Johnson, Contact Mechanics, 1985, ch. 4). The series rule of
`contact` adds the indentations that each body shows under a rigid probe; for equal bodies it gives 2^{1/3} times the
approach of the pair. Which one is right depends on what the bodies were measured against.
"""

import math

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq


def pair_modulus(first: float, second: float) -> float:
    """E* [Pa] of two contact moduli E_i/(1 - nu_i²) [Pa] > 0; one of them may be infinite."""
    return 1.0 / (1.0 / first + 1.0 / second)


def pair_force(approach: ArrayLike, modulus: float, radius: float) -> np.ndarray:
    """Force [N] (...) of a pair E* [Pa] at the approach [m] (...) of a sphere of radius [m]; zero where apart."""
    return 4 / 3 * modulus * math.sqrt(radius) * np.maximum(np.asarray(approach, float), 0.0) ** 1.5


def pair_approach(force: float, modulus: float, radius: float) -> float:
    """Approach [m] of a pair E* [Pa] under a force [N]; zero where force <= 0."""
    return (0.75 * max(force, 0.0) / (modulus * math.sqrt(radius))) ** (2 / 3)


def finger_pair(approach: float, modulus_slope: float, hardening: float, radius: float, body: float):
    """Force [N] and the shares s1, s2 [m] of a fingertip with E1* = (2b/m)(e^{m s1} - 1) on a body E2* [Pa].

    approach [m], b `modulus_slope` [Pa/m], m `hardening` [1/m], R `radius` [m] of the pair (1/R = 1/R1 + 1/R2); body
    may be infinite. The fingertip's share solves s1 (E1*(s1)/E2* + 1) = e, whose left side strictly increases.
    """
    if not approach > 0.0:
        return 0.0, 0.0, 0.0

    def modulus(s: float) -> float:
        # Beyond this the fingertip is as good as rigid; it keeps the search free of overflow.
        return 2 * modulus_slope / hardening * math.expm1(min(hardening * s, 600.0))

    s1 = brentq(lambda s: s * (modulus(s) / body + 1.0) - approach, 0.0, approach, xtol=1e-18, rtol=1e-14)
    if s1 <= 0.0:
        return 0.0, 0.0, approach
    return float(pair_force(approach, pair_modulus(modulus(s1), body), radius)), s1, approach - s1
