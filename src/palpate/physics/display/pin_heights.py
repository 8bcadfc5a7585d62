"""Target heights of a display's pins: the deformation of the fingerpad due to a force, a surface or a pressure."""

import math

import numpy as np

from palpate.compiler.exact import einsum, exp
from palpate.compiler.kernel import kernel
from palpate.physics.arrays import Array, Matrix, Numbers, Points
from palpate.physics.display.shape_display import bulge, deflection_under, press_pad


@kernel
def heights_from_force(
    distance: Array,
    force: float,
    b: float,
    m: float,
    pad_curvature: float,
    compliance: float,
    tissue_curvature: float,
    out: Array,
):
    """Fill `out` [m] (n) with u_f at each pin for a force; returns (rigid-body motion [m], contact radius [m]).

    distance  [m]  (n)  of each pin from the centre of contact; other arguments as of `shape_display.press_pad`
    """
    _, approach, radius, _, _, share, curvature = press_pad(force, b, m, pad_curvature, compliance, tissue_curvature)
    for i in range(distance.size):
        out[i] = share * curvature * bulge(distance[i], radius)
    return approach, radius


def heights_from_surface(
    points: Numbers, tissue: Numbers, approach: float, pad_radius: float, neighbours: float
) -> np.ndarray:
    """Deformation of the fingerpad [m] (n) at each pin due to a deformed tissue surface, never negative:

        u_f = <z + approach - r²/(2 R_f)>

    z is the height of the deformed surface above the foot point, interpolated at each pin (`local_plane`).

    points      [m]  (n,2)  pins in the tangent plane at the foot point
    tissue      [m]  (n,q,3)  q deformed surface points near each pin: two tangential coordinates, height z
    approach    [m]  ()     rigid-body motion of the finger from first touch
    pad_radius  [m]  ()     R_f
    neighbours  [m]  ()     width of the weights; about the spacing of the surface points
    """
    points, tissue = np.asarray(points, float), np.asarray(tissue, float)
    z = local_plane(points, tissue[..., :2], tissue[..., 2], neighbours)
    return np.maximum(z + approach - np.sum(points**2, axis=-1) / (2.0 * pad_radius), 0.0)


def local_plane(points: Points, places: Points, values: np.ndarray, width: float) -> np.ndarray:
    """Linear moving least squares: the value (n) at `points` (n,2) from values (n,q) at `places` (n,q,2).

    Weights are Gaussian in the distance over `width`, relative to the nearest place, so that they do not vanish far
    away. A slope that the places do not determine (all on one line) is 0.
    """
    square = np.sum(((places - points[:, None, :]) / width) ** 2, axis=-1)
    weight = exp(-(square - square.min(axis=1, keepdims=True)))
    weight /= weight.sum(axis=1, keepdims=True)
    centre = einsum("nq,nqi->ni", weight, places)
    level = einsum("nq,nq->n", weight, values)
    away = (places - centre[:, None, :]) / width
    spread = einsum("nq,nqi,nqj->nij", weight, away, away)
    along = einsum("nq,nqi,nq->ni", weight, away, values - level[:, None])
    # pseudo-inverse of the symmetric matrices (a, b; b, c), whose eigenvalues are middle +- half
    a, b, c = spread[:, 0, 0], spread[:, 0, 1], spread[:, 1, 1]
    middle, half = 0.5 * (a + c), np.sqrt((0.5 * (a - c)) ** 2 + b * b)
    flat = middle - half <= 1e-10 * (middle + half)
    turned = np.stack([c * along[:, 0] - b * along[:, 1], a * along[:, 1] - b * along[:, 0]], axis=1)
    line = einsum("nij,nj->ni", spread, along)
    most, area = np.square(middle + half), a * c - b * b
    slope = np.where(flat[:, None], line, turned) / np.where(flat, np.where(most > 0.0, most, 1.0), area)[:, None]
    return level + einsum("ni,ni->n", slope, (points - centre) / width)


@kernel
def heights_from_pressure(pins: Matrix, places: Matrix, forces: Array, radii: Array, b: float, m: float, out: Array):
    """Fill `out` [m] (n) with the fingerpad's deformation at each pin under a pressure. Returns the largest one, x [m].

        u_f(r) = U(r)/E_f*(x),     x = max u_f,     x E_f*(x) = max U

    U/E is the half-space's displacement under the pressure, with the nodal forces spread over Hertzian patches.

    pins    [m]  (n,2)  in the tangent plane        places  [m]  (k,2)  of the loaded nodes
    forces  [N]  (k)    pressure times nodal area   radii   [m]  (k)    of the patches, about the spacing of the nodes

    x is the maximum over the pins and the centre of pressure. With patches of radius 1.2 sqrt(nodal area) the error of
    the Hertz deflection is 0.1 % for 1400 nodes in the contact, 2 % for 30. K. L. Johnson, Contact Mechanics (1985),
    eq. 3.42a.
    """
    top = 0.0
    for i in range(pins.shape[0]):
        out[i] = _spread(pins[i, 0], pins[i, 1], places, forces, radii)
        top = max(top, out[i])
    total = x = y = 0.0
    for j in range(places.shape[0]):
        if forces[j] > 0.0:
            total += forces[j]
            x += forces[j] * places[j, 0]
            y += forces[j] * places[j, 1]
    if total > 0.0:
        top = max(top, _spread(x / total, y / total, places, forces, radii))
    if not top > 0.0:
        return 0.0
    deflection = deflection_under(top, b, m)
    for i in range(pins.shape[0]):
        out[i] *= deflection / top
    return deflection


@kernel
def _spread(x: float, y: float, places: Matrix, forces: Array, radii: Array):
    """U [N/m] at a point; for a patch of force f and radius c, u = 3 f s(r, c)/(4 E c³)."""
    total = 0.0
    for j in range(places.shape[0]):
        if forces[j] > 0.0:
            r = math.hypot(x - places[j, 0], y - places[j, 1])
            total += 0.75 * forces[j] * bulge(r, radii[j]) / (radii[j] * radii[j] * radii[j])
    return total
