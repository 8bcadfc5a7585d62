"""A fingerpad that stiffens exponentially, pressed on soft tissue: the target of a tactile shape display.

Hertz contact of the fingerpad (modulus E_f*(x), radius R_f) with tissue (E_t, nu_t, R_t) under a force P:

    1/R = 1/R_f + 1/R_t            1/E* = (1 - nu_t²)/E_t + 1/E_f*
    E_f*(x) = (2b/m) (e^(m x) - 1)
    a = (3 P R / (4 E*))^(1/3)     delta = a²/R
    u_f(r) = (E*/E_f*) (2a² - r²)/(2R)   for r <= a       x = u_f(0) = delta E*/E_f*

The published equation for u_f has E* instead of its square under the cube root; this is the corrected form
(docs/equations/shape-display.md). All quantities follow from the scalar x, the root of

    h(ln x) = ln x + (2/3) ln E_f* + (1/3) ln(1 + E_f*/E_t') - (2/3) ln(3P/4) + (1/3) ln R,   E_t' = E_t/(1 - nu_t²).

As a function of ln x, h is increasing (slope >= 5/3) and convex, so it has exactly one root, to which Newton's method
converges monotonically from above.
"""

import math
from typing import NamedTuple

import numpy as np

from palpate.compiler.kernel import kernel
from palpate.physics.arrays import Numbers

VALID_RATIO = 0.5  # [1] Limit of a/R_f: Hertz theory requires a << R_f

# 4 c_k / (2k + 3), c_k the coefficients of asin(q) = sum c_k q^(2k+1).
_TAIL = np.array([4.0 * math.comb(2 * k, k) / (4**k * (2 * k + 1) * (2 * k + 3)) for k in range(12)])


class Fingerpad(NamedTuple):
    """Fingerpad of modulus E_f*(x) = (2b/m)(e^(m x) - 1)."""

    b: float  # [Pa/m] () half the slope of the modulus at x = 0
    m: float  # [1/m] () rate of stiffening
    radius: float  # [m] () R_f, of the undeformed pad


FINGERPADS = {"canonical": Fingerpad(6.0e6, 500.0, 8.0e-3), "calibrated": Fingerpad(5.672e6, 466.6, 9.84e-3)}
"""Parameter sets by name. `canonical`: assumed round values for tests and comparison. `calibrated`: fitted to a finger
of 9.84 mm radius on a steel plate (1.24 mm at 0.11 N, 2.08 mm at 0.50 N). The parameters of Pawluk & Howe (1996), who
proposed the law, are not publicly available."""


class PadContact(NamedTuple):
    """State of a fingerpad pressed on tissue; all arrays have one shape."""

    deflection: np.ndarray  # [m] (...) x, largest deformation of the fingerpad
    approach: np.ndarray  # [m] (...) delta, rigid-body motion of the finger
    radius: np.ndarray  # [m] (...) a, of the contact
    pad_modulus: np.ndarray  # [Pa] (...) E_f*(x)
    modulus: np.ndarray  # [Pa] (...) E*
    share: np.ndarray  # [1] (...) E*/E_f*, the fingerpad's part of the compliance
    curvature: np.ndarray  # [1/m] (...) 1/R
    valid: np.ndarray  # [1] (...) a <= 0.5 R_f


@kernel
def _log_modulus(x: float, b: float, m: float) -> float:
    """ln E_f*(x), without overflow for large m x or loss of precision for small ones."""
    t = m * x
    if t < 30.0:
        return math.log(2.0 * b * (math.expm1(t) / m))
    return math.log(2.0 * b / m) + t + math.log1p(-math.exp(-t))


@kernel
def _softplus(z: float) -> float:
    return max(z, 0.0) + math.log1p(math.exp(-abs(z)))


@kernel
def deflection_of(product: float, b: float, m: float, compliance: float) -> float:
    """The root x [m] of h(ln x) = 0 (see the module), which is equivalent to

        x E_f*^(2/3) (1 + compliance E_f*)^(1/3) = product

    product     [m Pa^(2/3)]  ()  (3P/4)^(2/3) R^(-1/3), > 0
    b, m                      ()  of the fingerpad
    compliance  [1/Pa]        ()  1/E_t', 0 for a rigid body
    """
    target = math.log(product)
    # start at or above the root: E_f* >= 2 b x; for m x > 1, ln x > -ln m bounds E_f*
    stiff = 1.5 * (target + math.log(m)) - math.log(2.0 * b / m)
    y = min(0.6 * (target - 2.0 / 3.0 * math.log(2.0 * b)), math.log(max(_softplus(stiff), 1.0) / m))
    for _ in range(100):
        x = math.exp(y)
        log_pad = _log_modulus(x, b, m)
        if compliance > 0.0:
            odds = math.log(compliance) + log_pad
            tissue = 1.0 / (1.0 + math.exp(-odds)) if odds > -700.0 else 0.0
            soft = _softplus(odds)
        else:
            tissue = soft = 0.0
        t = m * x
        slope = t / -math.expm1(-t) if t > 1e-300 else 1.0  # d ln E_f* / d ln x
        step = (y + 2.0 / 3.0 * log_pad + soft / 3.0 - target) / (1.0 + slope * (2.0 + tissue) / 3.0)
        y -= step
        if step <= 4e-16 * max(1.0, abs(y)):
            break
    return math.exp(y)


@kernel
def deflection_under(load: float, b: float, m: float) -> float:
    """The root x [m] of x E_f*(x) = load [N/m] > 0: largest deformation of a fingerpad under a given pressure, for
    which the largest u_f times E_f* is known. Newton's method in ln x from above, as in `deflection_of`."""
    target = math.log(load)
    stiff = target + math.log(m) - math.log(2.0 * b / m)
    y = min(0.5 * (target - math.log(2.0 * b)), math.log(max(_softplus(stiff), 1.0) / m))
    for _ in range(100):
        x = math.exp(y)
        t = m * x
        slope = t / -math.expm1(-t) if t > 1e-300 else 1.0
        step = (y + _log_modulus(x, b, m) - target) / (1.0 + slope)
        y -= step
        if step <= 4e-16 * max(1.0, abs(y)):
            break
    return math.exp(y)


@kernel
def press_pad(force: float, b: float, m: float, pad_curvature: float, compliance: float, tissue_curvature: float):
    """(x, delta, a, E_f*, E*, share, 1/R) of `PadContact` for one force [N]; zeros, with share = 1, without force."""
    curvature = pad_curvature + tissue_curvature
    if not force > 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, curvature
    x = deflection_of((0.75 * force) ** (2.0 / 3.0) * curvature ** (1.0 / 3.0), b, m, compliance)
    pad = math.exp(_log_modulus(x, b, m))
    softening = 1.0 + compliance * pad
    approach = x * softening
    return x, approach, math.sqrt(approach / curvature), pad, pad / softening, 1.0 / softening, curvature


def pad_contact(
    force: Numbers,
    modulus: Numbers,
    poisson: Numbers = 0.5,
    radius: Numbers = np.inf,
    pad: Fingerpad = FINGERPADS["canonical"],
) -> PadContact:
    """The fingerpad on tissue under each force: deflection, approach, contact radius and moduli (see the module).

    force    [N]   (...)  >= 0; zeros at 0
    modulus  [Pa]  (...)  E_t of the tissue, > 0; inf for a rigid body
    poisson  [1]   (...)  nu_t, in (-1, 0.5]
    radius   [m]   (...)  R_t of the tissue's surface; inf if flat, negative if concave (then |R_t| > R_f)

    The shapes broadcast. ValueError: an argument out of range; gives the first one and its index.
    D. T. V. Pawluk, R. D. Howe, Harvard Robotics Lab. TR 96-004 (1996); K. L. Johnson, Contact Mechanics (1985).
    """
    if not (pad.b > 0 and pad.m > 0 and pad.radius > 0 and np.isfinite([*pad]).all()):
        raise ValueError(f"pad: found {pad}, expected positive finite b, m and radius")
    given = [np.asarray(v, float) for v in (force, modulus, poisson, radius)]
    with np.errstate(divide="ignore"):
        tissue_curvature = 1.0 / given[3]
    _refuse("force", given[0], (given[0] >= 0) & np.isfinite(given[0]), "a finite force >= 0 N")
    _refuse("modulus", given[1], given[1] > 0, "a modulus > 0 Pa (inf: rigid)")
    _refuse("poisson", given[2], (given[2] > -1) & (given[2] <= 0.5), "Poisson's ratio in (-1, 0.5]")
    curved = np.isfinite(tissue_curvature) & (tissue_curvature > -1.0 / pad.radius)
    _refuse("radius", given[3], curved, "a radius > 0 m or < -R_f (inf: flat)")
    compliance = (1.0 - given[2] ** 2) / given[1]
    contact = np.vectorize(press_pad, otypes=7 * [float])
    with np.errstate(all="ignore"):  # compiled code also evaluates branches that are not taken
        state = contact(given[0], float(pad.b), float(pad.m), 1.0 / pad.radius, compliance, tissue_curvature)
    return PadContact._make([*state, state[2] <= VALID_RATIO * pad.radius])


def _refuse(name: str, value: np.ndarray, good: np.ndarray, expected: str) -> None:
    if not np.all(good):
        place = tuple(int(i) for i in np.argwhere(~good)[0])
        where = f" at index {place if len(place) > 1 else place[0]}" if place else ""
        raise ValueError(f"{name}: found {float(value[place])}{where}, expected {expected}")


@kernel
def bulge(r: float, a: float) -> float:
    """Shape s(r, a) [m²] of the surface displacement under a Hertz pressure of radius a, see `pad_displacement`.

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
        g = total * (q * q * q)
    else:
        g = (2.0 * q * q - 1.0) * math.asin(q) + q * math.sqrt(1.0 - q * q)
    return r * r * g / math.pi


def pad_displacement(r: Numbers, contact: PadContact) -> np.ndarray:
    """Indentation u_f(r) [m] of the fingerpad's surface at r [m] (...) from the axis, which broadcasts with the state.

        u = share s(r, a)/R
        s = a² - r²/2                                          r <= a
        s = (r²/pi) [(2q² - 1) asin(q) + q sqrt(1 - q²)],      q = a/r, r > a

    K. L. Johnson, Contact Mechanics (1985), eqs. 3.41a and 3.42a.
    """
    with np.errstate(all="ignore"):  # compiled code also evaluates branches that are not taken
        shape = np.vectorize(bulge, otypes=[float])(np.asarray(r, float), np.asarray(contact.radius, float))
    return contact.share * contact.curvature * shape
