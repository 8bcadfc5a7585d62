"""Hertz contact of two elastic bodies of revolution: pressure and surface displacements."""

import math

import numpy as np

from palpate.physics.kernel import kernel

# 4 c_k / (2k + 3), c_k the coefficients of asin(q) = sum c_k q^(2k+1).
_TAIL = np.array([4.0 * math.comb(2 * k, k) / (4.0**k * (2 * k + 1) * (2 * k + 3)) for k in range(12)])


@kernel
def bulge(r: float, a: float) -> float:
    """Shape s(r, a) [m²] of the surface displacement under a Hertz pressure of contact radius a, see `displacement`.

    Far from the contact the two terms of the closed form cancel, so a series of g(q) = 4 integral_0^q t asin(t) dt is
    used there.
    """
    if r <= a:
        return a * a - 0.5 * r * r
    q = a / r
    if q < 0.2:
        total = 0.0
        for k in range(_TAIL.size - 1, -1, -1):
            total = total * q * q + _TAIL[k]
        g = total * q**3
    else:
        g = (2.0 * q * q - 1.0) * math.asin(q) + q * math.sqrt(1.0 - q * q)
    return r * r * g / math.pi


def displacement(r, a, curvature, share=1.0):
    """Normal displacement [m] of the surface of one of two bodies in Hertz contact, positive into that body.

        u = share * curvature * s(r, a)
        s = a² - r²/2                                          r <= a
        s = (r²/pi) [(2q² - 1) asin(q) + q sqrt(1 - q²)],      q = a/r, r > a

    r          [m]    (...)  distance from the axis, >= 0
    a          [m]    (...)  contact radius, >= 0
    curvature  [1/m]  (...)  1/R = 1/R_1 + 1/R_2
    share      [1]    (...)  E*/E_i*, the part of the body in the joint compliance; 1 when the other is rigid

    The shapes broadcast. K. L. Johnson, Contact Mechanics (1985), eqs. 3.41a and 3.42a.
    """
    with np.errstate(all="ignore"):  # compiled code also evaluates branches that are not taken
        shape = np.vectorize(bulge, otypes=[float])(np.asarray(r, float), np.asarray(a, float))
    return share * curvature * shape
