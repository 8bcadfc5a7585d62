"""A rigid ball on an elastic layer bonded to a rigid base: Hertz's law with a factor f for the thickness.

    F = (4/3) E/(1 - nu²) sqrt(R) s^1.5 f(chi),    chi = sqrt(R s)/h

With the pressure's Hankel transform P(xi) = int_0^a phi(t) cos(xi t) dt the contact of a paraboloid is the integral
equation of the second kind

    phi(x) - (2/pi) int_0^a K(x, t) phi(t) dt = (2/pi) G/(1 - nu) (s - x²/R),    phi(a) = 0,    F = 2 pi int_0^a phi dt
    K(x, t) = int_0^inf (1 - M(xi h)) cos(xi x) cos(xi t) dxi
    M(y) = ((3 - 4 nu) sinh y cosh y - y)/(y² + 4 (1 - nu)² + (3 - 4 nu) sinh² y)

W. C. Hayes, L. M. Keer, G. Herrmann, L. F. Mockros, J. Biomech. 5 (1972) 541-551. Small strains, no friction under the
ball; solved to 1e-12 by Gaussian quadrature. For nu = 0.5, f = 1 + 1.13 chi + 1.48 chi² + 1.47 chi³ + ...
"""

from functools import lru_cache

import numpy as np
from scipy.interpolate import CubicSpline

from palpate.compiler.exact import cos, einsum, expm1, solve
from palpate.physics.special import gauss_legendre

MOST = 2.0  # [1] Largest contact radius over the thickness
POINTS, WAVES, END = 60, 300, 50.0  # Gauss points over the contact, and over xi h from 0 to `END`, where 1 - M is 1e-18


def solve_layer(wide: float, poisson: float) -> tuple[float, float]:
    """chi and f [1] at a contact radius over the thickness [1]."""
    x, w = _gauss(POINTS, wide)
    y, dy = _gauss(WAVES, END)
    grown = expm1(y)
    sinh, cosh = 0.5 * (grown + grown / (1.0 + grown)), 0.5 * (1.0 + grown + 1.0 / (1.0 + grown))
    less = 1.0 - ((3 - 4 * poisson) * sinh * cosh - y) / (y**2 + 4 * (1 - poisson) ** 2 + (3 - 4 * poisson) * sinh**2)
    waves = cos(np.multiply.outer(np.append(x, wide), y))
    K = 2.0 / np.pi * einsum("ik,jk->ij", waves * (less * dy), waves[:-1]) * w
    flat, bent = np.full(POINTS + 1, 2.0 / np.pi), 2.0 / np.pi * np.append(x, wide) ** 2
    phi = solve(np.eye(POINTS) - K[:-1], np.stack([flat, bent], 1)[:-1])
    ends = np.array([flat[-1], bent[-1]]) + np.sum(K[-1][:, None] * phi, axis=0)
    square = ends[1] / ends[0]  # s R/h²
    force = 2.0 * np.pi * np.sum(w * (square * phi[:, 0] - phi[:, 1]))
    return float(np.sqrt(square)), float(force / (8.0 / 3.0 * square * np.sqrt(square)))


@lru_cache(maxsize=8)
def thickness_factor(poisson: float) -> CubicSpline:
    """f over chi, for Poisson's ratio [1] in [0, 0.5]; from 0 to `thickness_factor(nu).x[-1]`."""
    rows = np.array([solve_layer(wide, poisson) for wide in np.linspace(0.0, MOST, 41)[1:]])
    return CubicSpline(np.r_[0.0, rows[:, 0]], np.r_[1.0, rows[:, 1]])


def _gauss(count: int, end: float) -> tuple[np.ndarray, np.ndarray]:
    at, weight = gauss_legendre(count)
    return 0.5 * end * (at + 1.0), 0.5 * end * weight
