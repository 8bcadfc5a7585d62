"""Contact area that grows with the force: laws for its radius a(f), and the approach that goes with them.

    ball        a = (3 f R/4E*)^(1/3) of a rigid ball on a half-space, E* = E/(1 - nu²), up to a = R (H. Hertz 1881; K.
                L. Johnson, Contact Mechanics, 1985, ch. 4.2)
    fingertip   a³ = a_p(f)³ + 3 f R/4E*, a_p on a rigid plate: `PLATE`. Exact for two spheres (Johnson, eq. 4.22)
    table       radii at forces

Between two forces of a law a is a power of f, below the first one a ~ f^(1/3), beyond the last one it is constant.

The pressure keeps the shape of Hertz's, 3f/(2 pi a²) (1 - r²/a²)^(1/2). Let V(f) be the elastic energy of the body
under it, a function of f alone: f² c(a(f))/2 for a linear body with the compliance c(a). The approach d that is
conjugate to the force follows from dV = f dd,

    dd/df = (1/f) dV/df = c + (f/2) dc/df    (linear),    d(f) = V/f + integral of V/f² df

Check: c = 3/(5 E* a) and Hertz's a give dd/df = 5c/6 = 1/(2 E* a) and d = a²/R. d increases with f, so that the body is
passive, if a grows more slowly than f² everywhere. The mean displacement under the load, f c, is smaller: 4/5 of d for
a ball.
"""

import math
from typing import Annotated, NamedTuple

import numpy as np

from palpate.physics.bodies.large_displacement import large_depth, stored_energy
from palpate.physics.kernel import kernel

MEAN = 0.6  # [1] Mean displacement of a half-space under Hertz's pressure, over f/(E* a)
WIDTH = math.sqrt(1.6)  # [1] Radius of the biweight patch with the same second moment, over a
HERTZ = 1.0 / 3.0  # [1] Exponent of a(f) below the first force of a law
STEEPEST = 2.0  # [1] Exponent of a(f) from which on the approach falls while the force rises
STEP, MOST = 1.0 / 128.0, 4.0  # [N^(1/3)] Step and end of the table of d over the cube root of the force
PLATE = (
    (2.282e-3, 7.019e-3, 1.724e-2, 3.631e-2, 6.830e-2, 0.1179, 0.1892, 0.2850, 0.4081, 0.5605, 0.7452, 0.9360, 2.5),
    (1.202e-3, 1.797e-3, 2.250e-3, 2.658e-3, 3.042e-3, 3.364e-3, 3.654e-3, 3.940e-3, 4.189e-3, 4.430e-3, 4.680e-3,
     4.873e-3, 5.8e-3),
)  # fmt: skip
"""[N], [m] Contact of the layered finite-element fingertip with a steel plate, the shipped curve of `tactile.Flow`
(docs/equations/tactile-flow.md); the last point continues it with the exponent of the last seven."""


class AreaLaw(NamedTuple):
    """Radii of the contact at forces, and `table`: d [m], its slope over the cube root of f, and V/f [m]."""

    forces: Annotated[np.ndarray, "<f8", 1]  # [N] (k,)
    radii: Annotated[np.ndarray, "<f8", 1]  # [m] (k,)
    table: Annotated[np.ndarray, "<f8", 2]  # (3,N); empty: the patch is fixed


FIXED = AreaLaw(np.zeros(0), np.zeros(0), np.zeros((3, 0)))


def ball(radius: float, modulus: float) -> AreaLaw:
    """The law of a rigid ball of this radius [m] on a half-space of E* [Pa], up to a = R."""
    return of_table([4.0 / 3.0 * modulus * radius**2], [radius])


def fingertip(radius: float, modulus: float) -> AreaLaw:
    """The law of a fingertip of this radius of curvature [m] on a half-space of E* [Pa]."""
    forces, plate = map(np.array, PLATE)
    return of_table(forces, np.cbrt(plate**3 + 0.75 * forces * radius / modulus))


def of_table(forces: object, radii: object) -> AreaLaw:
    """The law through these radii [m] at rising forces [N]. ValueError: these are not a law."""
    f, a = np.array(forces, float), np.array(radii, float)
    if f.ndim != 1 or f.shape != a.shape or not len(f):
        raise ValueError(f"found {f.size} forces and {a.size} radii, expected a radius for each force, at least one")
    if not (np.isfinite(f).all() and np.isfinite(a).all() and (f > 0.0).all() and (a > 0.0).all()):
        raise ValueError(f"found forces {f.tolist()} N and radii {a.tolist()} m, expected finite numbers above 0")
    for k in range(len(f) - 1):
        if not f[k + 1] > f[k]:
            raise ValueError(f"found {f[k + 1]:g} N after {f[k]:g} N, expected forces that rise")
        if not a[k + 1] >= a[k]:
            raise ValueError(
                f"the area shrinks from {1e3 * a[k]:g} mm at {f[k]:g} N to {1e3 * a[k + 1]:g} mm at {f[k + 1]:g} N, "
                "expected radii that do not fall"
            )
        if a[k + 1] / a[k] >= (f[k + 1] / f[k]) ** STEEPEST:
            raise ValueError(
                f"the radius grows from {1e3 * a[k]:g} to {1e3 * a[k + 1]:g} mm between {f[k]:g} and {f[k + 1]:g} N, "
                "faster than the square of the force: the indentation would fall while the force rises"
            )
    return AreaLaw(f, a, np.zeros((3, 0)))


@kernel(error_model="numpy")
def radius_at(forces, radii, force):
    """a [m] at a force [N] >= 0."""
    last = len(forces) - 1
    if force >= forces[last]:
        return radii[last]
    if force <= forces[0]:
        return radii[0] * np.cbrt(max(force, 0.0) / forces[0])
    k = 0
    while forces[k + 1] < force:
        k += 1
    power = math.log(radii[k + 1] / radii[k]) / math.log(forces[k + 1] / forces[k])
    return radii[k] * (force / forces[k]) ** power


def with_approach(law: AreaLaw, compliance: float, rho: np.ndarray) -> AreaLaw:
    """The law with its table for a half-space.

    compliance  [m²/N] c a of the half-space under Hertz's pressure
    rho         [1] (3,) of large displacement, see `bodies.large_displacement`; empty: the half-space is linear
    """
    table = np.zeros((3, round(MOST / STEP) + 1))
    _fill(law.forces, law.radii, compliance, rho, table)
    return law._replace(table=table)


@kernel(error_model="numpy")
def _energy(forces, radii, compliance, rho, force):
    """V/f² [m/N] of the half-space at a force [N] > 0."""
    a = radius_at(forces, radii, force)
    c, wide = compliance / a, WIDTH * a
    depth, _ = large_depth(c * force / wide, rho)
    return wide * wide / c * stored_energy(depth, rho) / (force * force)


@kernel(error_model="numpy")
def _fill(forces, radii, compliance, rho, table):
    """Fill the table: Simpson's rule for the integral over t = f^(1/3), central differences for the slope."""
    total = before = 0.0
    for k in range(1, table.shape[1]):
        t, middle = k * STEP, (k - 0.5) * STEP
        share = _energy(forces, radii, compliance, rho, t**3)
        now = 3.0 * t * t * share
        total += STEP / 6.0 * (before + 12.0 * middle**2 * _energy(forces, radii, compliance, rho, middle**3) + now)
        table[0, k], table[2, k], before = t**3 * share + total, t**3 * share, now
    last = table.shape[1] - 1
    for k in range(1, last):
        left, right = table[0, k] - table[0, k - 1], table[0, k + 1] - table[0, k]
        table[1, k] = min(0.5 * (left + right), 3.0 * left, 3.0 * right) / STEP  # d stays monotonic between the steps
    table[1, last] = (table[0, last] - table[0, last - 1]) / STEP


@kernel(error_model="numpy")
def approach(table, force):
    """d [m], dd/df [m/N] and V [J] at a force [N] >= 0 by cubic interpolation over t; d is linear beyond `MOST`³."""
    t = max(np.cbrt(max(force, 0.0)), 1e-3)
    last = table.shape[1] - 1
    k = int(t / STEP)
    if k >= last:
        slope, end = table[1, last] / (3.0 * MOST * MOST), MOST**3
        energy = table[2, last] * end + 0.5 * slope * (force * force - end * end)
        return table[0, last] + slope * (force - end), slope, energy
    q = t / STEP - k
    low, high, left, right = table[0, k], table[0, k + 1], STEP * table[1, k], STEP * table[1, k + 1]
    bend = 3.0 * (high - low) - 2.0 * left - right
    twist = left + right - 2.0 * (high - low)
    d = low + q * (left + q * (bend + q * twist))
    slope = (left + q * (2.0 * bend + q * 3.0 * twist)) / (STEP * 3.0 * t * t)
    # V/f likewise, of the slope dd/dt - 3 V/(f t)
    low, high = table[2, k], table[2, k + 1]
    left, right = left - (3.0 * low / k if k > 0 else 0.0), right - 3.0 * high / (k + 1)
    bend = 3.0 * (high - low) - 2.0 * left - right
    return d, slope, t**3 * (low + q * (left + q * (bend + q * (left + right - 2.0 * (high - low)))))


@kernel(error_model="numpy")
def hertz_depth(square):
    """Displacement of a half-space under Hertz's pressure at (r/a)², over 3f/(4 E* a) (Johnson, eq. 3.42)."""
    if square <= 1.0:
        return 1.0 - 0.5 * square
    return ((2.0 - square) * math.asin(1.0 / math.sqrt(square)) + math.sqrt(square - 1.0)) / math.pi
