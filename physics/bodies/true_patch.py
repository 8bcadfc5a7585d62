"""The compliance of the patch that presses a condensed body, in place of the one that its coarse surface makes of it.

A load passes through the vertices of the coarse surface, spread over the triangles round each (hats), and so does the
displacement: a patch of radius R acts like a wider one. What that loses is taken from a half-space:

    c = g.C g/E + (c_R - g.H g)/E - hold

g     shares of the normal force at the coarse vertices;  C the body's compliance for a modulus of 1 Pa
c_R   of the half-space under the true load, the pressure 3f/(pi R²) (1 - r²/R²)², R twice the rms distance of the load:
      c_R = I (1 - nu²)/(pi R),   I = integral of (48 J3(x)/x³)² from 0 on = 2.40817
H     of the half-space between hats: H_ij = (1 - nu²)/pi T_ij, T_ij [1/m] the mean of 1/|x - y| over hats i and j
      (J. Boussinesq 1885; K. L. Johnson, Contact Mechanics, 1985, eq. 3.19)

Near a nodule or under a capsule C - H is not smooth at the scale of the patch: there C and H take the load

    gamma = g - w b (g - h),    b = (R_w² - R²)/(R_w² - R_h²)

R_w is the radius on the hats of g, R_h that of h, the load drawn together: its share at r times (1 - r²/R²)^8. With
w = 1 gamma has the true second moment on the hats. w falls from 1 where the patch's mean distance from the other
modulus is `WITHIN` R to 0 at `BEYOND` R.

`hold` is what it takes where the patch sticks to the finger, of

* its mean place along the surface: c_zt c_tt^-1 c_tz, c_tt with the same correction times (1 - nu/2)/(1 - nu), which is
  the tangential over the normal displacement of a half-space, averaged over directions (Cerruti; Johnson eq. 3.75);
* each of its points, which the pressure draws inwards by (1 - 2nu)(1 + nu)/(2 pi E r) F(r), F the force within r: to
  undo this takes S_0 (1 - 2nu)²/(1 - nu)² of c_R: with A the half-space's response to radial shear and m = F/(2 pi r),
  S_0 = pi/(2 I) <m, A^-1 m> = 0.17650 (Galerkin's method, exact to 1e-9). 0.6 % at nu = 0.45, 5.8 % at 0.3.

The surface that is shown:  u = (C - H) g f/E + n (1 - nu²)/(pi E R) W(r/R) f,  the mean of W over the patch being I.

Range: R above the spacing of the touched mesh, thickness and radius of curvature above 2R, one modulus within R.
"""

from typing import Annotated, NamedTuple

import numpy as np
import scipy  # its parts are slow to import, and are when they are used

from palpate.physics.bodies.half_space_range import curvature, inverse_thickness
from palpate.physics.bodies.hat_distances import mean_inverse_distance
from palpate.physics.bodies.patch import patch_radius, share_of
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.kept import kept
from palpate.physics.kernel import kernel

MEAN = 2.40816816  # I: mean of W over the patch, weighted as the pressure
HELD = 0.1764960  # S_0, the share of c_R that holding each point under the patch takes, over (1 - 2nu)²/(1 - nu)²
KNOTS = 256  # Intervals of the table of W
LEAST_SHARE = 0.05  # [1] Of g.C g that is left whatever the correction says
WITHIN, BEYOND = 0.5, 2.0
"""[1] Distances from another modulus over R between which the load is drawn together less and less."""
MOST_NARROWED = 3.0
"""[1] Greatest b: beyond, the patch is so much narrower than the hats that too little of it is left to tell."""
LEAST_MOMENT = 0.29  # [1] Mean square distance of a hat's force from its vertex, over the vertex's area: even triangles


class TruePatch(NamedTuple):
    """The half-space that corrects a body; with an empty table nothing is corrected.

    ground   [1/m] (V,2) one over the thickness, and the curvature, at each coarse vertex, see `half_space_range`
    """

    table: Annotated[np.ndarray, "<f4", 2]  # [1/m] (V,V) float32, see `mean_inverse_distance`
    profile: Annotated[np.ndarray, "<f8", 1]  # [1] of W, see `dent_profile`
    normal: float  # [1] (1 - nu²)/pi
    tangential: float  # [1] (1 - nu/2)/(1 - nu)
    held: float  # [1] share of c_R that sticking takes
    sticks: bool  # [1] whether the patch sticks to the finger
    least: Annotated[
        np.ndarray, "<f8", 1
    ]  # [m²] (N,) least mean square radius of a load on each vertex of the touched mesh
    apart: Annotated[
        np.ndarray, "<f8", 1
    ]  # [m] (V,) distance of each coarse vertex from another modulus; none where there is but one
    ground: Annotated[np.ndarray, "<f8", 2]


def true_patch(
    coarse: Mesh, fine: Mesh, poisson: float, sticks: bool = True, apart: np.ndarray | None = None
) -> TruePatch:
    """Of a body that is condensed to `coarse` and touched on `fine`."""
    held = HELD * ((1.0 - 2.0 * poisson) / (1.0 - poisson)) ** 2 if sticks else 0.0
    table = _table(coarse)
    ratio = (1.0 - 0.5 * poisson) / (1.0 - poisson)
    least = LEAST_MOMENT * fine.areas
    near = np.zeros(0) if apart is None else apart
    ground = _ground(coarse)
    return TruePatch(table, dent_profile(), (1.0 - poisson**2) / np.pi, ratio, held, sticks, least, near, ground)


@kept
def _table(coarse: Mesh) -> np.ndarray:
    return mean_inverse_distance(coarse).astype(np.float32)


@kept
def _ground(coarse: Mesh) -> np.ndarray:
    return np.stack([inverse_thickness(coarse), curvature(coarse)], axis=1)


def uncorrected(fine: Mesh) -> TruePatch:
    """Nothing is corrected: the body as its full model is under the widened load."""
    least = LEAST_MOMENT * fine.areas
    return TruePatch(
        np.zeros((0, 0), np.float32), np.zeros(0), 0.0, 1.0, 0.0, False, least, np.zeros(0), np.zeros((0, 2))
    )


def dent_profile() -> np.ndarray:
    """W sqrt(1 + rho²), rho = r/R, at q = 1/(1 + rho²) = 0, 1/`KNOTS` ... 1: finite and smooth to infinity."""
    q = np.arange(1, KNOTS + 1) / KNOTS
    return np.append(1.0, dent_depth(np.sqrt(1.0 / q - 1.0)) / np.sqrt(q))


def dent_depth(rho: np.ndarray) -> np.ndarray:
    """W at these r/R: depth of the half-space under the patch, over (1 - nu²) f/(pi E R).

    Integrals of J3(x) J0(x rho)/x³ after H. Weber and P. Schafheitlin (Watson, Bessel Functions, 1944, 13.4)."""
    out = np.maximum(rho, 1.0)
    inside = 3.2 * scipy.special.hyp2f1(0.5, -2.5, 1.0, np.minimum(rho, 1.0) ** 2)
    return np.where(rho < 1.0, inside, scipy.special.hyp2f1(0.5, 0.5, 4.0, 1.0 / (out * out)) / out)


@kernel
def sideways(normal):
    """Two unit vectors [1] (2,3) along the surface, at right angles."""
    along = np.zeros((2, 3))
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
    return along


@kernel
def _held_sideways(block, normal, more, side):
    """What the compliance of a patch loses [m/N] where its mean place along the surface is held, of the patch's g.C g
    `block` [m/N] (3,3), to which the tangential compliance adds `more`; fills `side` (9,), see `patch_compliance`."""
    along = sideways(normal)
    own, cross = np.zeros((2, 2)), np.zeros(2)
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
    for i in range(3):  # the normal force is against the normal, so this undoes what it drags along
        side[i] = first * along[0, i] + second * along[1, i]
    side[3], side[4], side[5], side[6] = own[0, 0], own[0, 1], own[1, 0], own[1, 1]
    side[7], side[8] = cross
    return first * cross[0] + second * cross[1]


@kernel
def draw_together(model, patch, pull, normal, total, order, touched, measure, radius):
    """Fill the second column of `measure` (V,3), whose first holds g, with gamma. False where both are the same.

    model  a `CondensedModel`;  patch, pull  the load (k,3) on the fine vertices;  radius [m] R
    order (>= touched) coarse vertices of the patch
    """
    apart = model.true.apart
    if len(apart) == 0:
        return False
    away, x = 0.0, np.zeros(3)
    for k in range(touched):
        v = order[k]
        away += measure[v, 0] * apart[v]
        measure[v, 1] = 0.0
    at = min(max((away / radius - WITHIN) / (BEYOND - WITHIN), 0.0), 1.0)
    near = 1.0 - at * at * (3.0 - 2.0 * at)
    if near <= 0.0:
        return False
    for k in range(len(patch)):
        share = abs(share_of(k, pull, normal, total))
        for i in range(3):
            x[i] += share * model.fine[patch[k], i]
    whole = 0.0
    for k in range(len(patch)):
        p = patch[k]
        d0, d1, d2 = model.fine[p, 0] - x[0], model.fine[p, 1] - x[1], model.fine[p, 2] - x[2]
        inside = max(1.0 - (d0 * d0 + d1 * d1 + d2 * d2) / (radius * radius), 0.0)
        share = abs(share_of(k, pull, normal, total)) * inside**8
        whole += share
        for a in range(3):
            measure[model.corners[p, a], 1] += share * model.weights[p, a]
    if not whole > 0.0:
        return False
    for k in range(touched):
        measure[order[k], 1] /= whole
    wide = patch_radius(model.vertices, model.moments, order, touched, measure) ** 2
    drawn = patch_radius(model.vertices, model.moments, order, touched, measure[:, 1:]) ** 2
    by = (wide - radius * radius) / max(wide - drawn, 0.25 * radius * radius)
    by = near * min(max(by, 0.0), MOST_NARROWED)
    for k in range(touched):
        v = order[k]
        measure[v, 1] = measure[v, 0] - by * (measure[v, 0] - measure[v, 1])
    return True


@kernel
def gathered(compliance, table, order, touched, measure, column, block):
    """Fill block [m/N] (3,3) with g.C g of the shares in a column of `measure`; returns g.T g [1/m]."""
    block[:] = 0.0
    hats, corrects = 0.0, len(table) > 0
    for k in range(touched):
        v = order[k]
        for m in range(touched):
            b = order[m]
            both = measure[v, column] * measure[b, column]
            for i in range(3):
                for j in range(3):
                    block[i, j] += both * compliance[3 * v + i, 3 * b + j]
            if corrects:
                hats += both * table[v, b]
    return hats


@kernel
def _along(block, normal):
    own = 0.0
    for i in range(3):
        for j in range(3):
            own += normal[i] * block[i, j] * normal[j]
    return own


@kernel
def patch_compliance(compliance, true, order, touched, measure, narrowed, normal, radius, block, hats, side):
    """Of a patch, for a modulus of 1 Pa [m/N]: g.C g along the normal, and what is added to it; fills `side` (9,): the
    force along the surface that holds the patch there, for each newton of normal force [1] (3), c_tt (2,2) and c_tz (2)
    [m/N] by the axes of `sideways`.

    block, hats  g.C g [m/N] (3,3) and g.T g [1/m], see `gathered`; `block` is changed
    order, measure, narrowed  see `draw_together`
    """
    side[:] = 0.0
    own = _along(block, normal)
    if len(true.table) == 0:
        return own, 0.0
    apart = 0.0
    if narrowed:
        hats = gathered(compliance, true.table, order, touched, measure, 1, block)
        apart = _along(block, normal) - own
    more = true.normal * (MEAN / radius - hats)
    if true.sticks:
        lost = _held_sideways(block, normal, true.tangential * more, side)
        more -= true.held * true.normal * MEAN / radius + lost
    return own, max(more + apart, LEAST_SHARE * own - own)


@kernel(error_model="numpy")
def dent_at(profile, square):
    """W at rho = r/R, of which this is the square."""
    q = 1.0 / (1.0 + square)
    at = q * KNOTS
    k = min(int(at), KNOTS - 1)
    return np.sqrt(q) * (profile[k] + (at - k) * (profile[k + 1] - profile[k]))
