"""Free impact of a mass on one Hunt-Crossley body, in closed form.

With f = g(x) (1 + c x') and y = c v_in, the outcome depends neither on the law g nor on the mass:

    c v_out = 1 + W0(-(1 + y) e^{-(1 + y)}),    V(x_max) = (m/c²)(y - ln(1 + y)),

W0 the principal branch of the Lambert function, V the elastic energy. v_out < 1/c however hard the impact.
"""

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import lambertw


def restitution(y: ArrayLike) -> np.ndarray:
    """Coefficient of restitution v_out/v_in [1] (...) at y = c v_in >= 0 [1] (...): about 1 - 2y/3, then 1/y."""
    y = np.asarray(y, float)
    small = y < 1e-2
    # Near y = 0 the Lambert function is at its branch point and loses half the digits.
    series = 1 - y * (2 / 3 - y * (4 / 9 - y * (44 / 135 - y * (104 / 405 - y * 40 / 189))))
    safe = np.where(small, 1.0, y)
    exact = (1 + lambertw(-(1 + safe) * np.exp(-(1 + safe))).real) / safe
    return np.where(small, series, exact)


def peak_energy(mass: float, speed: ArrayLike, damping: float) -> np.ndarray:
    """Elastic energy [J] (...) stored at the deepest point; m v²/2 without damping.

    mass [kg], speed [m/s] (...) at first touch, damping c [s/m] >= 0
    """
    v = np.asarray(speed, float)
    y = damping * v
    # y - ln(1+y) cancels below about 1e-2, where (y² /2)(1 - 2y/3 + ...) is exact.
    ratio = 0.5 - y * (1 / 3 - y * (1 / 4 - y * (1 / 5 - y * (1 / 6 - y * (1 / 7 - y / 8)))))
    safe = np.where(y < 1e-2, 1.0, y)
    return mass * v * v * np.where(y < 1e-2, ratio, (safe - np.log1p(safe)) / safe**2)


def peak_indentation(mass: float, speed: ArrayLike, stiffness: float, exponent: float, damping: float) -> np.ndarray:
    """Deepest indentation [m] (...) of a mass [kg] that meets g = K s^n with `speed` [m/s] (...)."""
    return ((exponent + 1) / stiffness * peak_energy(mass, speed, damping)) ** (1 / (exponent + 1))
