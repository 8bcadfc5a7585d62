"""Normal contact: Hunt-Crossley laws, and fingertip and body in series over one step.

    f = g(s) <1 + c s'>,    <x> = max(0, x)

Unlike a spring with a parallel dashpot it has no force jump at impact and no suction at release
(K. H. Hunt, F. R. E. Crossley, J. Appl. Mech. 42, 1975, 440-445).
"""

import math
from typing import NamedTuple

import numpy as np

from palpate.compiler.kernel import ieee_kernel
from palpate.physics.arrays import Array
from palpate.physics.contact.terminal import free_recovery, indentation, power_of, terminal_force
from palpate.physics.special import gauss_legendre

POWER, EXPONENTIAL, HERTZ = 0, 1, 2
GAUSS_POINTS, GAUSS_WEIGHTS = gauss_legendre(64)
MOST_FORCE = 1e300  # [N] Replaces a force that overflows


class ElasticLaw(NamedTuple):
    """An elastic law g(s), made by `power`, `exponential` or `hertz_exponential`."""

    kind: int
    first: float
    second: float
    radius: float


def kernel_form(law: ElasticLaw, damping: float) -> np.ndarray:
    """A fingertip's law and its damping [s/m] as one array (5), the form that kernels take."""
    return np.array([*law, damping], dtype=float)


def power(stiffness: float, exponent: float) -> ElasticLaw:
    """g = K s^n; K [N/m^n] > 0, n [1] >= 1 (1.5 for a sphere: Hertz)."""
    return ElasticLaw(POWER, float(stiffness), float(exponent), 0.0)


def exponential(stiffness: float, hardening: float) -> ElasticLaw:
    """g = (b/m)(e^{ms} - 1); b [N/m] > 0, m [1/m] > 0.

    Quasi-static law of the human fingerpad: D. T. V. Pawluk, R. D. Howe, J. Biomech. Eng. 121 (1999) 178-183.
    """
    return ElasticLaw(EXPONENTIAL, float(stiffness), float(hardening), 0.0)


def hertz_exponential(modulus_slope: float, hardening: float, radius: float) -> ElasticLaw:
    """g = (8b/3m)(e^{ms} - 1) sqrt(R) s^{3/2}: a Hertz sphere with E* = (2b/m)(e^{ms} - 1).

    b [Pa/m] > 0, m [1/m] > 0, R [m] > 0.
    """
    return ElasticLaw(HERTZ, float(modulus_slope), float(hardening), float(radius))


@ieee_kernel
def elastic(s: float, kind: int, first: float, second: float, radius: float):
    """g [N] and dg/ds [N/m] at the compression s [m]; zero for s <= 0."""
    if s <= 0.0:
        return 0.0, 0.0
    if kind == 0:
        g = first * power_of(s, second)
        return g, second * g / s
    grown = math.expm1(second * s)
    if kind == 1:
        return first / second * grown, first * (1.0 + grown)
    scale = 8.0 * first / (3.0 * second) * math.sqrt(radius * s)
    return scale * grown * s, scale * (second * (1.0 + grown) * s + 1.5 * grown)


@ieee_kernel
def series_energy(s: float, kind: int, first: float, second: float, radius: float):
    """Stored energy V(s) [J], the integral of g from 0 to s [m]; zero where s <= 0."""
    depth = max(s, 0.0)
    if kind == 0:
        return first * depth ** (second + 1.0) / (second + 1.0)
    if kind == 1:
        x = second * depth
        # expm1(x) - x cancels below about 1e-2; six terms of its series reach rounding there.
        series = x * x / 2 * (1 + x / 3 * (1 + x / 4 * (1 + x / 5 * (1 + x / 6 * (1 + x / 7)))))
        return first / second**2 * (series if x < 1e-2 else math.expm1(x) - x)
    # s = t^2 removes the square root from the integrand; 64 points resolve e^{ms} up to ms of a few hundred.
    root, scale = math.sqrt(depth), 8.0 * first / (3.0 * second) * math.sqrt(radius)
    low = (_eighth(0, root, scale, second) + _eighth(1, root, scale, second)) + (
        _eighth(2, root, scale, second) + _eighth(3, root, scale, second)
    )
    high = (_eighth(4, root, scale, second) + _eighth(5, root, scale, second)) + (
        _eighth(6, root, scale, second) + _eighth(7, root, scale, second)
    )
    return (low + high) * root


@ieee_kernel
def _eighth(start: int, root: float, scale: float, second: float):
    """The sum of every eighth term of the quadrature in `series_energy`, in numpy's order of summation."""
    total = 0.0
    for i in range(start, len(GAUSS_POINTS), 8):
        t = root * (GAUSS_POINTS[i] + 1) / 2
        total += scale * math.expm1(second * t * t) * t * t * t * t * GAUSS_WEIGHTS[i]
    return total


@ieee_kernel
def series_step(
    approach: float,
    dt: float,
    s1: float,
    finger: Array,
    stiffness: float,
    exponent: float,
    c2: float,
    free: float,
    previous: float,
):
    """One step of fingertip and body in series, without other contacts, see `balance`. Returns (f, s1, s2)
    [N, m, m]."""
    f, x, s, _ = balance(approach, dt, s1, finger, stiffness, exponent, c2, free, previous, 0.0)
    return f, x, s


@ieee_kernel
def balance(
    approach: float,
    dt: float,
    s1: float,
    finger: Array,
    stiffness: float,
    exponent: float,
    c2: float,
    free: float,
    previous: float,
    others: float,
):
    """One step of fingertip and body in series: s1 + s2 = approach, one common force. Returns (f, s1, s2) [N, m, m],
    and -df/d(others) [1].

    approach  [m]  e at the end of the step; negative above the undeformed surface, where a body that another contact
                   lifts is touched
    dt        [s]  T > 0; infinite gives the static split
    s1        [m]  fingertip compression before the step
    finger    (5)  the fingertip's law and its damping c1 [s/m], see `kernel_form`
    stiffness, exponent, c2, free, previous  the body's terminal law
    others    [N]  >= 0, force of other contacts on the body here: F2(s2) = f + others

    Without contact both recover to r1 and r2 (the body under `others`); they touch if r1 + r2 < e. Then

        h(s2) = F2(s2) - others - F1(e - s2) = 0,   F1(s) = g1(s) <1 + c1 (s - s1)/T>,

    is <= 0 at s2 = r2, >= 0 at s2 = e - r1, and never decreases: a root always exists. The step is implicit Euler:
    f >= 0 and s1 >= 0 for any T, and f (ds1 + ds2) >= dV1 + dV2 because V is convex.
    """
    # recovery without contact
    kind, first, second, radius, c1 = int(finger[0]), finger[1], finger[2], finger[3], finger[4]
    r1 = free_recovery(s1, 0.0, c1, dt)
    r2 = indentation(others, dt, stiffness, exponent, c2, free, previous)
    if not r1 + r2 < approach:
        return 0.0, r1, r2, 0.0
    # safeguarded Newton's method: the bracket [low, high] always contains the root
    low, high = r2, approach - r1
    s = previous if low < previous < high else 0.5 * (low + high)
    f1 = f2 = slope1 = slope2 = 0.0
    for _ in range(200):
        x = approach - s
        g, slope = elastic(x, kind, first, second, radius)
        rate = max(0.0, 1.0 + c1 * (x - s1) / dt)
        f1 = g * rate
        slope1 = slope * rate + g * c1 / dt
        f2, slope2 = terminal_force(s, dt, stiffness, exponent, c2, free, previous)
        f2 = max(f2 - others, 0.0)
        if f2 < f1:
            low = s
        else:
            high = s
        following = 0.5 * (low + high)
        # Newton step on ln F2 - ln F1, nearly linear for power and exponential laws; else bisection
        if 0.0 < f1 < math.inf and 0.0 < f2 < math.inf:
            steep = slope2 / f2 + slope1 / f1
            guess = s - math.log(f2 / f1) / steep
            if steep < math.inf and low <= guess <= high:  # infinite at a subnormal s, where Newton would stall
                following = guess
            if abs(f2 - f1) <= 2e-16 * f1:
                break
        if abs(following - s) <= 2e-16 * abs(s):
            break
        s = following
    # close to the root, the force of the softer law has the smaller rounding error
    force = min(f2 if slope2 < slope1 or not f1 < math.inf else f1, MOST_FORCE)
    return force, approach - s, s, slope1 / (slope1 + slope2)
