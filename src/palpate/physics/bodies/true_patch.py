"""Compliance of the true patch on a condensed body, corrected for the wider load on its coarse surface.

Loads and displacements are interpolated with the hat functions of the coarse surface, so that a patch of radius R acts
like a wider one. A half-space gives the correction:

    c = g.C g/E + (c_R - g.H g)/E - hold

g     shares of the normal force at the coarse vertices;  C the body's compliance for a modulus of 1 Pa
c_R   of the half-space under the true load, the pressure 3f/(pi R²) (1 - r²/R²)², R twice the rms distance of the load:
      c_R = I (1 - nu²)/(pi R),   I = integral of (48 J3(x)/x³)² from 0 to inf = 2.40817
H     of the half-space between hat functions: H_ij = (1 - nu²)/pi T_ij, T_ij [1/m] the mean of 1/|x - y| over i and j
      (J. Boussinesq 1885; K. L. Johnson, Contact Mechanics, 1985, eq. 3.19)

Near a nodule or under a capsule C - H is not smooth at the scale of the patch, and a load on both rims of a groove is
not one patch: see `loads`.

`hold` is the reduction of the compliance by sticking,

* of the mean position of the patch: c_zt c_tt^-1 c_tz, with the same correction of c_tt times (1 - nu/2)/(1 - nu), the
  ratio of tangential to normal displacement of a half-space, averaged over directions (Cerruti; Johnson eq. 3.75);
* of each of its points, which the pressure moves inwards by (1 - 2nu)(1 + nu)/(2 pi E r) F(r), F the force within r:
  S_0 (1 - 2nu)²/(1 - nu)² of c_R. With the half-space's response A to radial shear and m = F/(2 pi r),
  S_0 = pi/(2 I) <m, A^-1 m> = 0.17650 (Galerkin's method, exact to 1e-9). 0.6 % at nu = 0.45, 5.8 % at 0.3.

The displayed surface is  u = (C - H) g f/E + n (1 - nu²)/(pi E R) W(r/R) f,  where the mean of W over the patch is I.

Range: R above the spacing of the fine mesh, thickness and radius of curvature above 2R, one modulus within R.
"""

from typing import Annotated, NamedTuple

import numpy as np

from palpate.compiler.kernel import ieee_kernel, kernel
from palpate.compiler.memory import stack_zeros
from palpate.physics.arrays import Array, Indices, Matrix, Record, Vector3
from palpate.physics.bodies.half_space_range import curvature, inverse_thickness
from palpate.physics.bodies.hat_distances import mean_inverse_distance
from palpate.physics.bodies.loads.scattered import Means, hat_means, no_means
from palpate.physics.bodies.patch import LEAST_MOMENT, MEAN
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.kept import keep_results
from palpate.physics.special import patch_depth

HELD = 0.1764960  # S_0, reduction of c_R by sticking of each point, over (1 - 2nu)²/(1 - nu)²
KNOTS = 256  # Number of intervals of the table of W
LEAST_SHARE = 0.05  # [1] Lower limit of the corrected compliance over g.C g


class TruePatch(NamedTuple):
    """Tables of the half-space for the correction of a body; with an empty table nothing is corrected.

    least    [m²] (N,) lower limit of the mean square radius of a load on each vertex of the fine mesh
    apart    [m] (V,) distance of each coarse vertex from another modulus; empty if there is one modulus
    ground   [1/m] (V,2) inverse thickness, and curvature, at each coarse vertex, see `half_space_range`
    means    of the coarse surface, for loads that are not one patch
    """

    table: Annotated[np.ndarray, "<f4", 2]  # [1/m] (V,V) float32, see `mean_inverse_distance`
    profile: Annotated[np.ndarray, "<f8", 1]  # [1] of W, see `depth_profile`
    normal: float  # [1] (1 - nu²)/pi
    tangential: float  # [1] (1 - nu/2)/(1 - nu)
    held: float  # [1] relative reduction of c_R by sticking
    sticks: bool  # [1] whether the patch sticks to the finger
    least: Annotated[np.ndarray, "<f8", 1]
    apart: Annotated[np.ndarray, "<f8", 1]
    ground: Annotated[np.ndarray, "<f8", 2]
    means: Means


def true_patch(
    coarse: Mesh,
    fine: Mesh,
    poisson: float,
    sticks: bool = True,
    apart: np.ndarray | None = None,
    table: np.ndarray | None = None,
) -> TruePatch:
    """The correction of a body that is condensed to `coarse` and touched on `fine`. `table`: if it is known."""
    held = HELD * ((1.0 - 2.0 * poisson) / (1.0 - poisson)) ** 2 if sticks else 0.0
    ratio = (1.0 - 0.5 * poisson) / (1.0 - poisson)
    near = np.zeros(0) if apart is None else apart
    table = _table(coarse) if table is None else table
    return TruePatch(
        table, depth_profile(), (1.0 - poisson**2) / np.pi, ratio, held, sticks, LEAST_MOMENT * fine.areas, near,
        _ground(coarse), _means(coarse, table),
    )  # fmt: skip


@keep_results
def _table(coarse: Mesh) -> np.ndarray:
    return mean_inverse_distance(coarse).astype(np.float32)


@keep_results
def _ground(coarse: Mesh) -> np.ndarray:
    return np.stack([inverse_thickness(coarse), curvature(coarse)], axis=1)


@keep_results
def _means(coarse: Mesh, table: np.ndarray) -> Means:
    return hat_means(coarse, table)


def without_correction(fine: Mesh) -> TruePatch:
    """No correction: the body is that of the full model under the widened load."""
    return TruePatch(
        np.zeros((0, 0), np.float32), np.zeros(0), 0.0, 1.0, 0.0, False, LEAST_MOMENT * fine.areas, np.zeros(0),
        np.zeros((0, 2)), no_means(),
    )  # fmt: skip


def depth_profile() -> np.ndarray:
    """W sqrt(1 + rho²), rho = r/R, at q = 1/(1 + rho²) = 0, 1/`KNOTS` ... 1: finite and smooth to infinity.

    W is the displacement of the half-space under the patch, over (1 - nu²) f/(pi E R): integrals of J3(x) J0(x rho)/x³
    after H. Weber and P. Schafheitlin (Watson, Bessel Functions, 1944, 13.4), see `patch_depth`."""
    q = np.arange(1, KNOTS + 1) / KNOTS
    return np.append(1.0, patch_depth(np.sqrt(1.0 / q - 1.0)) / np.sqrt(q))


@kernel
def sideways(normal: Vector3, along: Matrix):
    """Fill `along` [1] (2,3) with two orthogonal unit vectors along the surface."""
    along[:] = 0.0
    k = 0 if abs(normal[0]) < 0.8 else 1
    along[0, k] = 1.0
    out = normal[k]
    for i in range(3):
        along[0, i] -= out * normal[i]
    size = np.sqrt(along[0, 0] ** 2 + along[0, 1] ** 2 + along[0, 2] ** 2)
    for i in range(3):
        along[0, i] /= size
    along[1, 0] = normal[1] * along[0, 2] - normal[2] * along[0, 1]
    along[1, 1] = normal[2] * along[0, 0] - normal[0] * along[0, 2]
    along[1, 2] = normal[0] * along[0, 1] - normal[1] * along[0, 0]


HOLDS = {"side": (3,), "own": (2, 2), "cross": (2,)}
"""The tangential force that holds the patch, per newton of normal force [1], and c_tt and c_tz [m/N] in the axes of
`sideways`."""


class Holds(NamedTuple):
    """The same as arrays."""

    side: np.ndarray
    own: np.ndarray
    cross: np.ndarray


@kernel
def _held_sideways(block: Matrix, normal: Vector3, more: float, holds: Record):
    """Reduction c_zt c_tt^-1 c_tz of the compliance [m/N] by sticking of the mean position, from g.C g `block` [m/N]
    (3,3) and the correction `more` of the tangential compliance; fills `holds`, see `patch_compliance`."""
    own, cross, along = stack_zeros((2, 2)), stack_zeros((2,)), stack_zeros((2, 3))
    sideways(normal, along)
    for a in range(2):
        for i in range(3):
            for j in range(3):
                cross[a] += along[a, i] * block[i, j] * normal[j]
                for b in range(2):
                    own[a, b] += along[a, i] * block[i, j] * along[b, j]
        own[a, a] += more
    det = own[0, 0] * own[1, 1] - own[0, 1] * own[1, 0]
    if not det > 0.0:
        return 0.0
    first = (own[1, 1] * cross[0] - own[0, 1] * cross[1]) / det
    second = (own[0, 0] * cross[1] - own[1, 0] * cross[0]) / det
    for i in range(3):  # the normal force acts against the normal, so this force opposes its tangential displacement
        holds.side[i] = first * along[0, i] + second * along[1, i]
    for a in range(2):
        holds.cross[a] = cross[a]
        for b in range(2):
            holds.own[a, b] = own[a, b]
    return first * cross[0] + second * cross[1]


@kernel
def gather_compliance(
    compliance: Matrix, table: Matrix, order: Indices, touched: int, measure: Matrix, column: int, block: Matrix
):
    """Fill block [m/N] (3,3) with g.C g of the shares in a column of `measure`; returns g.T g [1/m]."""
    c00 = c01 = c02 = c10 = c11 = c12 = c20 = c21 = c22 = hats = 0.0  # in `block` each sum would wait for a store
    corrects = len(table) > 0
    for k in range(touched):
        v = order[k]
        first, second, third = compliance[3 * v], compliance[3 * v + 1], compliance[3 * v + 2]
        share = measure[v, column]
        for m in range(touched):
            b = order[m]
            both, at = share * measure[b, column], 3 * b
            c00 += both * first[at]
            c01 += both * first[at + 1]
            c02 += both * first[at + 2]
            c10 += both * second[at]
            c11 += both * second[at + 1]
            c12 += both * second[at + 2]
            c20 += both * third[at]
            c21 += both * third[at + 1]
            c22 += both * third[at + 2]
            if corrects:
                hats += both * table[v, b]
    for i, row in enumerate(((c00, c01, c02), (c10, c11, c12), (c20, c21, c22))):
        for j in range(3):
            block[i, j] = row[j]
    return hats


@kernel
def _along(block: Matrix, normal: Vector3):
    own = 0.0
    for i in range(3):
        for j in range(3):
            own += normal[i] * block[i, j] * normal[j]
    return own


@kernel
def patch_compliance(
    true: TruePatch, normal: Vector3, radius: float, block: Matrix, narrow: Matrix, hats: float, holds: Record
):
    """Compliance of a patch for a modulus of 1 Pa [m/N]: g.C g along the normal, and its correction. Fills `holds`.

    radius  [m] R, or that of the patch with the same compliance of the half-space, see `loads.scattered`
    block   g.C g [m/N] (3,3) of the load
    narrow  the same of the load that C and H act on, see `loads.narrowed` and `loads.scattered`, `block` if that is g;
            and its g.T g `hats` [1/m]
    holds   `HOLDS`, or arrays with these names
    """
    for a in range(2):
        holds.cross[a] = holds.own[a, 0] = holds.own[a, 1] = 0.0
    holds.side[0] = holds.side[1] = holds.side[2] = 0.0
    own = _along(block, normal)
    if len(true.table) == 0:
        return own, 0.0
    apart = _along(narrow, normal) - own
    more = true.normal * (MEAN / radius - hats)
    if true.sticks:
        lost = _held_sideways(narrow, normal, true.tangential * more, holds)
        more -= true.held * true.normal * MEAN / radius + lost
    return own, max(more + apart, LEAST_SHARE * own - own)


@ieee_kernel
def depth_at(profile: Array, square: float):
    """W [1] at the square [1] of rho = r/R, by linear interpolation of `profile` in 1/(1 + rho²)."""
    q = 1.0 / (1.0 + square)
    at = q * KNOTS
    k = min(int(at), KNOTS - 1)
    return np.sqrt(q) * (profile[k] + (at - k) * (profile[k + 1] - profile[k]))
