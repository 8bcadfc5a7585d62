"""A region of another modulus in soft tissue, as a map of stiffness over the surface.

A region changes the indentation under a patch by its share of the strain energy that the load stores. On an
incompressible half-space the displacement under a normal pressure p is, with the shear modulus G and the harmonic
potential psi of p,

    2 G u = e_z psi - z grad psi,   psi(x) = 1/(2 pi) ∫ p(x') / |x - x'| dA

so the density of the energy is z² |grad grad psi|² / (4 G), and the share of a volume V of the whole energy is

    w = ∫_V z² |grad grad psi|² dV / ∫ p psi dA

The pressure is p = 3 a³ F / (2 pi (r² + a²)^{5/2}), for which psi = F/(2 pi) (1/rho + a (z + a)/rho³),
rho² = r² + (z + a)², and both integrals are rational functions. Its width a gives it the mean displacement of the
pressure (1 - r²/R²)² of `spread.Kernel` with the radius R, the reach of the fingertip.

A sphere of `ratio` times the modulus in tissue of strain e has the strain 5 e/(3 + 2 ratio) (J. D. Eshelby, Proc. R.
Soc. London A 241, 1957, 376, incompressible). With the interaction of T. Mori and K. Tanaka (Acta Metall. 21, 1973,
571) the surface is stiffer by

    k = 1 + w (ratio - 1)/(1 + (2/5) (1 - w) (ratio - 1))

which is `ratio` if the region is everything (w = 1), 1 + 5 w/2 for a small rigid one (A. Einstein, Ann. Phys. 19, 1906,
289), 1 - 5 w/3 for a small cavity, and the bound of an isotropic mixture (Z. Hashin, S. Shtrikman, J. Mech. Phys.
Solids 11, 1963, 127).

Neglected: the shape of the region (a long one lies between Eshelby's sphere and a column), the curvature of the surface
and the support of the organ. docs/equations/shape-display.md has the errors next to finite elements.
"""

from typing import NamedTuple

import numpy as np

from palpate.compiler.kernel import ieee_kernel, kernel
from palpate.physics.arrays import Array, Indices, Matrix, Points, Vector
from palpate.physics.special import gauss_legendre

WIDTH = 0.5191
"""[1] a/R for which ∫ p psi dA = 5 F²/(8 pi a) is that of (1 - r²/R²)², 0.3833 F²/R."""
FAR = 8.0  # [1] Parts farther from a vertex than this, over the reach, are left out
NEAR, FINE, COARSE = 3.0, 0.25, 1.0
"""[1] Over the reach: within NEAR of a vertex, a region is a set of points FINE apart, farther away COARSE apart."""
GROUPED = 1.5  # [1] Over the reach: sides of the cubes of points that are compared with a vertex together
SHARPER = 0.75
"""[1] Reach of a map over the radius of the patch, for a body that averages the map over the patch, which widens it."""
MOST_NODES, FAR_NODES = 24, 3  # of the rules in a ball, near to a vertex and far from it


def nodule_centre(vertices: Points, normals: Points, position: Vector, depth: float) -> np.ndarray:
    """Centre [m] (3) of a nodule that lies `depth` [m] below the point of the surface at `position` [m] (3), along the
    normal of the nearest of its vertices [m] (V,3)."""
    nearest = int(np.argmin(np.sum((np.asarray(vertices) - position) ** 2, axis=1)))
    normal = np.asarray(normals)[nearest]
    above = np.sum((np.asarray(position, float) - np.asarray(vertices)[nearest]) * normal)
    return np.asarray(position, float) - (above + depth) * normal


def stiffness_map(
    vertices: Points, normals: Points, centre: Vector, radius: float, ratio: float, reach: float
) -> np.ndarray:
    """Factor k [1] (V) on the stiffness of each surface vertex above a ball; exactly 1 where its centre is farther than
    8 times the reach and its radius.

    vertices [m] (V,3), normals [1] (V,3) outward   undeformed surface
    centre [m] (3), radius [m] > 0                  of the ball; what lies above the tangent plane is ignored
    ratio [1] > 0    its modulus over that of the tissue
    reach [m] > 0    R, radius over which a fingertip spreads its load

    ValueError: an argument out of its range.
    """
    _check(radius=radius, ratio=ratio, reach=reach)
    places, facing = _arrays(vertices, normals)
    shares = np.zeros(len(places))
    rules = _rule(min(5 + int(3.0 * radius / reach), MOST_NODES)), _rule(FAR_NODES)
    _ball(places, facing, np.asarray(centre, float), radius, reach, *rules, shares)
    return stiffening(shares, ratio)


def region_map(
    vertices: Points, normals: Points, points: Points, volumes: np.ndarray, ratio: float, reach: float
) -> np.ndarray:
    """As `stiffness_map`, for a region of any shape: points [m] (P,3) in it, and the volume [m³] (P) of each."""
    _check(ratio=ratio)
    return stiffening(region_shares(vertices, normals, points, volumes, reach), ratio)


def region_shares(vertices: Points, normals: Points, points: Points, volumes: np.ndarray, reach: float) -> np.ndarray:
    """Share w [1] (V) of the energy in a region under a load at each surface vertex; arguments as of `region_map`."""
    _check(reach=reach)
    places, facing = _arrays(vertices, normals)
    shares = np.zeros(len(places))
    if len(points):
        for size in (FINE, COARSE):
            cubes = _cubes(*merged(points, volumes, size * reach), GROUPED * reach)
            _region(places, facing, *cubes, size == FINE, reach, shares)
    return shares


def stiffening(share: np.ndarray, ratio: float) -> np.ndarray:
    """Factor k [1] on the stiffness for the share w [1] of the energy in a region of `ratio` times the modulus."""
    part = np.minimum(share, 1.0)
    return np.asarray(1.0 + part * (ratio - 1.0) / (1.0 + 0.4 * (1.0 - part) * (ratio - 1.0)))


def _cube_of(points: np.ndarray, size: float) -> np.ndarray:
    """Number, from 0, of the cube of the side `size` [m] in which each point (P,3) is."""
    corner = np.floor(points / size).astype(np.int64)
    corner -= corner.min(axis=0)
    return np.unique(np.ravel_multi_index(tuple(corner.T), tuple(corner.max(axis=0) + 1)), return_inverse=True)[1]


def merged(points: Points, volumes: np.ndarray, size: float) -> tuple[np.ndarray, np.ndarray]:
    """Points (Q,3) with their volumes (Q): the centroids of those in each cube of the side `size` [m]."""
    places, weights = np.asarray(points, float), np.asarray(volumes, float)
    cells = _cube_of(places, size)
    sums = [np.bincount(cells, weights * place) for place in places.T]
    volume = np.bincount(cells, weights)
    return np.column_stack(sums) / volume[:, None], volume


class _Cubes(NamedTuple):
    """Points in the order of the cubes that they are in, and balls around these.

    points [m] (P,3), volumes [m³] (P);  begins (C+1)  first point of each cube
    middles [m] (C,3), radii [m] (C)     of balls that contain the points of a cube
    """

    points: np.ndarray
    volumes: np.ndarray
    begins: np.ndarray
    middles: np.ndarray
    radii: np.ndarray


def _cubes(points: np.ndarray, volumes: np.ndarray, size: float) -> _Cubes:
    cells = _cube_of(points, size)
    order = np.argsort(cells, kind="stable")
    points, cells = np.ascontiguousarray(points[order]), cells[order]
    begins = np.searchsorted(cells, np.arange(cells[-1] + 2)).astype(np.int64)
    middles = np.add.reduceat(points, begins[:-1]) / np.diff(begins)[:, None]
    away = np.sum(np.square(points - middles[cells]), axis=1)
    return _Cubes(points, volumes[order], begins, middles, np.sqrt(np.maximum.reduceat(away, begins[:-1])))


def _check(**given: float) -> None:
    for name, value in given.items():
        if not (np.isfinite(value) and value > 0):
            raise ValueError(f"{name}: found {value}, expected a finite number > 0")


def _arrays(*given: Points) -> list[np.ndarray]:
    return [np.ascontiguousarray(each, float) for each in given]


class _Rule(NamedTuple):
    """Gauss's rule on (0, 1) [1] (n): nodes t, weights, and cosines and sines of pi t."""

    nodes: np.ndarray
    weights: np.ndarray
    cosines: np.ndarray
    sines: np.ndarray


def _rule(count: int) -> _Rule:
    nodes, weights = (0.5 * each for each in gauss_legendre(count))
    rule = _Rule(nodes + 0.5, weights, np.zeros(count), np.zeros(count))
    _turn(*rule)
    return rule


@ieee_kernel
def _turn(nodes: Array, weights: Array, cosines: Array, sines: Array):
    """Fill the cosines and sines of a rule with those of kernels, which are the same on every machine."""
    for k in range(len(nodes)):
        cosines[k], sines[k] = np.cos(np.pi * nodes[k]), np.sin(np.pi * nodes[k])


@kernel
def energy_density(lateral: float, depth: float, width: float):
    """Share of the energy per volume [1/m³], z² |grad grad psi|² / ∫ p psi dA.

    lateral [m²]  square of the distance r from the axis of the load;  depth [m] z;  width [m] a
    """
    low = depth + width
    square = low * low
    apart = lateral + square
    radial = (2.0 * lateral - square) * apart - width * low * (3.0 * square - 12.0 * lateral)
    axial = (2.0 * square - lateral) * apart - width * low * (9.0 * lateral - 6.0 * square)
    shear = 3.0 * low * apart - 3.0 * width * (lateral - 4.0 * square)
    whole = radial * radial + axial * axial + (radial + axial) * (radial + axial) + 2.0 * lateral * shear * shear
    third = apart * apart * apart
    return 0.4 / np.pi * width * depth * depth * whole / (third * third * apart)


@kernel
def _below(places: Matrix, facing: Matrix, v: int, point: Vector):
    """Depth of a point below the tangent plane of a vertex, and the squares of its distances from the normal and from
    the vertex."""
    x, y, z = point[0] - places[v, 0], point[1] - places[v, 1], point[2] - places[v, 2]
    depth = -(x * facing[v, 0] + y * facing[v, 1] + z * facing[v, 2])
    away = x * x + y * y + z * z
    return depth, max(away - depth * depth, 0.0), away


@kernel
def _disc(depth: float, level: float, lateral: float, limit: float, width: float, rule: _Rule):
    """Share of the energy per depth [1/m] in a disc of the radius `level` whose middle is `lateral` from the axis of
    the load [m]; circles around the axis, whole ones and arcs, up to the radius `limit`."""
    total = 0.0
    if level > lateral:
        whole = min(level - lateral, limit)
        for j in range(len(rule.nodes)):
            out = whole * rule.nodes[j] * rule.nodes[j]  # denser near the axis
            total += (
                4.0 * np.pi * whole * rule.nodes[j] * rule.weights[j] * out * energy_density(out * out, depth, width)
            )
    low, high = abs(level - lateral), min(level + lateral, limit)
    half = 0.5 * (high - low)
    if half <= 0.0:
        return total
    for j in range(len(rule.nodes)):
        out = 0.5 * (low + high) - half * rule.cosines[j]
        cosine = (out * out + lateral * lateral - level * level) / (2.0 * out * lateral)
        arc = 2.0 * np.arccos(min(max(cosine, -1.0), 1.0))
        total += np.pi * half * rule.sines[j] * rule.weights[j] * arc * out * energy_density(out * out, depth, width)
    return total


@ieee_kernel
def _ball(
    places: Matrix, facing: Matrix, centre: Vector, radius: float, reach: float, fine: _Rule, coarse: _Rule,
    shares: Array,
):  # fmt: skip
    """Fill the shares (V) of a ball, disc by disc parallel to the tangent plane; `fine` and `coarse` as of `_rule`."""
    width, near, limit = WIDTH * reach, NEAR * reach + radius, FAR * reach
    for v in range(len(places)):
        middle, square, away = _below(places, facing, v, centre)
        top, bottom = max(middle - radius, 0.0), min(middle + radius, limit)
        if away > (limit + radius) * (limit + radius) or bottom <= top:
            continue
        rule = fine if away < near * near else coarse
        for i in range(len(rule.nodes)):
            depth = top + (bottom - top) * rule.nodes[i] * rule.nodes[i]  # denser near the surface
            level = np.sqrt(max(radius * radius - (depth - middle) * (depth - middle), 0.0))
            part = _disc(depth, level, np.sqrt(square), limit, width, rule)
            shares[v] += 2.0 * (bottom - top) * rule.nodes[i] * rule.weights[i] * part


@ieee_kernel
def _region(
    places: Matrix, facing: Matrix, points: Matrix, volumes: Array, begins: Indices, middles: Matrix, radii: Array,
    fine: bool, reach: float, shares: Array,
):  # fmt: skip
    """Add to the shares (V) those of points, as of `_Cubes`: the `fine` ones near to a vertex, the others far from
    it."""
    width, near, far = WIDTH * reach, NEAR * reach, FAR * reach
    for v in range(len(places)):
        for c in range(len(radii)):
            away = _below(places, facing, v, middles[c])[2]
            out = (near if fine else far) + radii[c]
            if away > out * out or (not fine and np.sqrt(away) + radii[c] < near):
                continue
            for p in range(begins[c], begins[c + 1]):
                depth, square, away = _below(places, facing, v, points[p])
                if (away < near * near) == fine and depth > 0.0 and away < far * far:
                    shares[v] += volumes[p] * energy_density(square, depth, width)
