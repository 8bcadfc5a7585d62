"""Contact area that grows with the force: laws for its radius a(f), and the approach that is conjugate to f.

    ball        a = (3 f R/4E*)^(1/3) of a rigid ball on a half-space, E* = E/(1 - nu²), up to a = R (H. Hertz 1881; K.
                L. Johnson, Contact Mechanics, 1985, ch. 4.2)
    fingertip   a³ = a_p(f)³ + 3 f R/4E*, a_p on a rigid plate: `PLATE`. Exact for two spheres (Johnson, eq. 4.22)
    table       radii at forces

Between two forces of a law a is a power of f, below the first one a ~ f^(1/3), beyond the last one it is constant.

The pressure keeps the shape of Hertz's, 3f/(2 pi a²) (1 - r²/a²)^(1/2). A body under it has the elastic energy V(f),
f² c(a(f))/2 if it is linear. The approach d that is conjugate to the force follows from dV = f dd
(docs/equations/reduced-fe.md):

    d(f) = V/f + integral of V/f² df;    dd/df = c + (f/2) dc/df > 0 if a grows more slowly than f²
"""

import math
from typing import Annotated, NamedTuple

import numpy as np

from palpate.compiler.exact import power
from palpate.compiler.exponentials import cbrt
from palpate.compiler.kernel import ieee_kernel
from palpate.physics.arrays import Array, Matrix
from palpate.physics.bodies.large_displacement import large_depth, stored_energy

MEAN = 0.6  # [1] Mean displacement of a half-space under Hertz's pressure, over f/(E* a)
WIDTH = math.sqrt(1.6)  # [1] Radius of the biweight patch with the same second moment, over a
STEEPEST = 1.5  # [1] Largest exponent of a(f); from 2 on d falls while f rises
STEP, MOST = 1.0 / 256.0, 4.0  # [N^(1/3)] Step and end of the table of d over the cube root of the force
PLATE = (
    (2.282e-3, 7.019e-3, 1.724e-2, 3.631e-2, 6.830e-2, 0.1179, 0.2850, 0.5605, 0.9360, 2.5),
    (1.202e-3, 1.797e-3, 2.250e-3, 2.658e-3, 3.042e-3, 3.364e-3, 3.940e-3, 4.430e-3, 4.873e-3, 5.8e-3),
)
"""[N], [m] Contact of the layered finite-element fingertip with a steel plate, the shipped curve of `tactile.Flow`
(docs/equations/tactile-flow.md); the last point continues it with its last exponent, 0.18."""


class AreaLaw(NamedTuple):
    """Radii of the contact at forces, and `table`: d and V/f over f^(2/3) at steps of f^(1/3)."""

    forces: Annotated[np.ndarray, "<f8", 1]  # [N] (k,)
    radii: Annotated[np.ndarray, "<f8", 1]  # [m] (k,)
    table: Annotated[np.ndarray, "<f8", 2]  # [m/N^(2/3)] (2,N)


FIXED = AreaLaw(np.zeros(0), np.zeros(0), np.zeros((2, 0)))


def ball(radius: float, modulus: float) -> AreaLaw:
    """The law of a rigid ball of this radius [m] on a half-space of E* [Pa], up to a = R."""
    return of_table([4.0 / 3.0 * modulus * radius**2], [radius])


def fingertip(radius: float, modulus: float) -> AreaLaw:
    """The law of a fingertip of this radius of curvature [m] on a half-space of E* [Pa]."""
    forces, plate = map(np.array, PLATE)
    return of_table(forces, _join_radii(forces, plate, radius, modulus))


@ieee_kernel
def _join_radii(forces: Array, plate: Array, radius: float, modulus: float):
    """Radii (k,) [m] of the fingertip on a half-space from those on a plate [m] (k,); a kernel, since the last bits of
    numpy's powers depend on the processor."""
    radii = np.empty(len(forces))
    for k in range(len(forces)):
        radii[k] = cbrt(plate[k] ** 3 + 0.75 * forces[k] * radius / modulus)
    return radii


def of_table(forces: object, radii: object) -> AreaLaw:
    """The law through these radii [m] at rising forces [N]. ValueError: these are not a law."""
    f, a = np.array(forces, float), np.array(radii, float)
    if f.ndim != 1 or f.shape != a.shape or not len(f):
        raise ValueError(f"found {f.size} forces and {a.size} radii, expected a radius for each force, at least one")
    if not (np.isfinite([f, a]).all() and (a > 0.0).all() and (np.diff(f, prepend=0.0) > 0.0).all()):
        raise ValueError(
            f"found {f.tolist()} N and {a.tolist()} m, expected forces that rise from above 0, radii above 0"
        )
    for k in range(len(f) - 1):
        if not 1.0 <= a[k + 1] / a[k] <= power(f[k + 1] / f[k], STEEPEST):
            raise ValueError(
                f"the radius goes from {1e3 * a[k]:g} mm at {f[k]:g} N to {1e3 * a[k + 1]:g} mm at {f[k + 1]:g} N, "
                f"expected one that does not fall, and grows at most as f^{STEEPEST}: the indentation must rise with f"
            )
    return AreaLaw(f, a, np.zeros((2, 0)))


@ieee_kernel
def radius_at(forces: Array, radii: Array, force: float):
    """a [m] at a force [N] >= 0."""
    last = len(forces) - 1
    if force >= forces[last]:
        return radii[last]
    if force <= forces[0]:
        return radii[0] * cbrt(max(force, 0.0) / forces[0])
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
    table = np.zeros((2, round(MOST / STEP) + 1))
    _fill(law.forces, law.radii, compliance, rho, table)
    return law._replace(table=table)


@ieee_kernel
def _fill(forces: Array, radii: Array, compliance: float, rho: Array, table: Matrix):
    """Fill the table [m/N^(2/3)] (2,N) of `approach`, by Simpson's rule over t = f^(1/3)."""
    total = before = middle = 0.0
    for k in range(1, 2 * table.shape[1] - 1):
        t = 0.5 * k * STEP
        force = t * t * t
        a = radius_at(forces, radii, force)
        c, wide = compliance / a, WIDTH * a
        share = wide * wide / c * stored_energy(large_depth(c * force / wide, rho)[0], rho) / force  # V/f
        now = 3.0 * share / t
        if k % 2 == 0:
            total += STEP / 6.0 * (before + 4.0 * middle + now)
            table[0, k // 2], table[1, k // 2], before = (share + total) / (t * t), share / (t * t), now
        middle = now
    table[:, 0] = table[:, 1]


@ieee_kernel
def approach(table: Matrix, force: float):
    """d [m], dd/df [m/N] and V [J] at a force [N] >= 0; the table is linear over t, and constant beyond its end."""
    t = max(cbrt(max(force, 0.0)), 1e-3)
    k = min(int(t / STEP), table.shape[1] - 2)
    q = min(t / STEP - k, 1.0)
    rise = table[0, k + 1] - table[0, k]
    d = table[0, k] + q * rise
    slope = (2.0 * d + (t * rise / STEP if q < 1.0 else 0.0)) / (3.0 * t)
    return t * t * d, slope, t * (t * t * (t * t)) * (table[1, k] + q * (table[1, k + 1] - table[1, k]))


@ieee_kernel
def hertz_depth(square: float):
    """Displacement [1] of a half-space under Hertz's pressure at (r/a)², over 3f/(4 E* a) (Johnson, eq. 3.42)."""
    if square <= 1.0:
        return 1.0 - 0.5 * square
    return ((2.0 - square) * math.asin(1.0 / math.sqrt(square)) + math.sqrt(square - 1.0)) / math.pi
