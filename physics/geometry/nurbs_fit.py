"""Making NURBS surfaces: through points by two 1-D passes, and exact spheres, tori and planes.

L. Piegl, W. Tiller, The NURBS Book, 2nd ed., Springer 1997, ch. 7 (circles, revolution) and 9 (interpolation).
"""

import numpy as np

from palpate.physics.exact import solve
from palpate.physics.geometry.nurbs import Nurbs, basis_matrices


def interpolate(
    points: np.ndarray,
    degree_u: int = 3,
    degree_v: int = 3,
    closed_u: bool = False,
    closed_v: bool = False,
    parameters: str = "chord",
    ends_v: tuple[np.ndarray, np.ndarray] | None = None,
) -> Nurbs:
    """The B-spline surface through a grid of points: a pass of 1-D interpolation in v, one in u.

    points      [m] (n,m,3)  in a closed direction the first point is not repeated at the end
    parameters  "chord", "centripetal" or "uniform" spacing, averaged over the rows; S takes point (i, j) at the
                parameters of `grid_parameters`. A closed direction has period 1
    ends_v      [m] (n,3), (n,3)  dS/dv at both ends of an open direction v, if they are to be prescribed

    ValueError: fewer points than the degree needs, an unknown spacing, end slopes in a closed direction.
    """
    points = np.asarray(points, dtype=float)
    if points.ndim != 3 or points.shape[2] != 3:
        raise ValueError(f"points: found shape {points.shape}, expected (n, m, 3)")
    if ends_v is not None and closed_v:
        raise ValueError("ends_v: a closed direction has no ends")
    u, v = grid_parameters(points, closed_u, closed_v, parameters)
    control_v, knots_v = _curve(np.swapaxes(points, 0, 1), v, degree_v, closed_v, ends_v)
    control, knots_u = _curve(np.swapaxes(control_v, 0, 1), u, degree_u, closed_u, None)
    return Nurbs(control, np.ones(control.shape[:2]), knots_u, knots_v, degree_u, degree_v, closed_u, closed_v)


def grid_parameters(
    points: np.ndarray, closed_u: bool, closed_v: bool, parameters: str = "chord"
) -> tuple[np.ndarray, np.ndarray]:
    """Parameters in [0, 1] of the rows and columns of a grid of points; a closed direction has one more, 1 itself."""
    if parameters not in ("chord", "centripetal", "uniform"):
        raise ValueError(f"parameters: found {parameters!r}, expected 'chord', 'centripetal' or 'uniform'")
    power = {"chord": 1.0, "centripetal": 0.5, "uniform": 0.0}[parameters]
    return _parameters(points, closed_u, power), _parameters(np.swapaxes(points, 0, 1), closed_v, power)


def _parameters(points: np.ndarray, closed: bool, power: float) -> np.ndarray:
    """Spacing along axis 0, averaged over the rows that have a length (a pole has none)."""
    if closed:
        points = np.concatenate([points, points[:1]])
    chord = np.linalg.norm(np.diff(points, axis=0), axis=-1)
    chord = chord[:, chord.sum(axis=0) > 0]
    step = np.ones((len(points) - 1, 1)) if power == 0 or not chord.size else chord**power
    share = (step / step.sum(axis=0)).mean(axis=1)
    if (share <= 0).any():
        raise ValueError("points: neighbouring rows of points coincide, expected distinct points")
    return np.concatenate([[0.0], np.cumsum(share)[:-1], [1.0]])


def _curve(
    points: np.ndarray, t: np.ndarray, p: int, closed: bool, ends: tuple[np.ndarray, np.ndarray] | None
) -> tuple[np.ndarray, np.ndarray]:
    """Control points (axis 0) and knots of the curves through points (k,...) at the parameters t."""
    count = len(points)
    if count < p + 1:
        raise ValueError(f"points: found {count} along one direction, expected at least {p + 1} for degree {p}")
    if closed:
        before = np.concatenate([[t[-2] - 1.0], t[:-2]])
        t = t[:-1]
        cut = t if p % 2 else (before + t) / 2  # at an even degree the knots lie between the points
        around = np.concatenate([cut - 1.0, cut, cut + 1.0, cut + 2.0])
        knots = around[count - p : 2 * count + p + 1]
        matrix = np.zeros((count, count))
        for row, value in enumerate(collocation(knots, p, t)):
            np.add.at(matrix[row], np.arange(len(value)) % count, value)
        control = solve(matrix, points.reshape(count, -1))
        return np.concatenate([control, control[:p]]).reshape(count + p, *points.shape[1:]), knots
    right = points.reshape(count, -1)
    first = 1 if ends is None else 0
    inner = [t[j : j + p].mean() for j in range(first, count - p + 1 - first)]
    knots = np.concatenate([np.zeros(p + 1), inner, np.ones(p + 1)])
    matrix = collocation(knots, p, t)
    if ends is not None:
        slopes = collocation(knots, p, np.array([0.0, 1.0]), derivative=1)
        matrix = np.concatenate([matrix, slopes])
        right = np.concatenate([right, ends[0].reshape(1, -1), ends[1].reshape(1, -1)])
    control = solve(matrix, right)
    return control.reshape(len(control), *points.shape[1:]), knots


def collocation(knots: np.ndarray, degree: int, t: np.ndarray, derivative: int = 0) -> np.ndarray:
    """Basis functions (or their first derivative) at the parameters t, (k, number of basis functions)."""
    ends, first, matrix = basis_matrices(knots, degree)
    span = np.clip(np.searchsorted(ends, t, side="right") - 1, 0, len(first) - 1)
    width = np.diff(ends)[span]
    x = (t - ends[span]) / width
    m = np.arange(degree + 1)
    powers = np.cumprod(np.stack([np.ones_like(x), *degree * [x]], axis=1), axis=1)
    if derivative:
        powers = m * powers[:, np.maximum(m - 1, 0)] / width[:, None]
    design = np.zeros((len(t), len(knots) - degree - 1))
    columns = first[span][:, None] + m
    np.put_along_axis(design, columns, np.einsum("tkm,tm->tk", matrix[span], powers), axis=1)
    return design


def _arc(quarters: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Exact unit arc of quarter circles from angle 0: points (2q+1,2), weights, knots of degree 2."""
    angle = np.arange(2 * quarters + 1) * np.pi / 4
    weights = np.where(np.arange(len(angle)) % 2, np.sqrt(0.5), 1.0)
    points = np.stack([np.cos(angle), np.sin(angle)], axis=-1) / weights[:, None]
    inner = np.repeat(np.arange(1, quarters), 2)
    knots = np.concatenate([np.zeros(3), inner, np.full(3, quarters)]) / quarters
    return np.round(points, 15), weights, knots


def _revolved(radius: np.ndarray, height: np.ndarray, weights: np.ndarray, knots: np.ndarray, closed: bool) -> Nurbs:
    """A profile of degree 2 (radius, height) revolved round z; u goes round, v along the profile."""
    circle, circle_weights, circle_knots = _arc(4)
    points = np.empty((len(circle), len(radius), 3))
    points[..., :2] = circle[:, None] * radius[:, None]
    points[..., 2] = height
    return Nurbs(points, circle_weights[:, None] * weights, circle_knots, knots, 2, 2, True, closed)


def sphere(radius: float) -> Nurbs:
    """The exact sphere [m] round the origin, poles on the z axis at both ends of v."""
    arc, weights, knots = _arc(2)
    return _revolved(arc[:, 1] * radius, -arc[:, 0] * radius, weights, knots, False)


def capsule(radius: float, length: float) -> Nurbs:
    """The exact capsule [m]: a cylinder of this length from the origin along z, with a half sphere at either end; poles
    at both ends of v."""
    half = np.sqrt(0.5)
    across = radius * np.array([0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0])
    along = np.array([-radius, -radius, 0.0, length / 2, length, length + radius, length + radius])
    knots = np.array([0.0, 0.0, 0.0, 1.0, 1.0, 2.0, 2.0, 3.0, 3.0, 3.0]) / 3.0
    return _revolved(across, along, np.array([1.0, half, 1.0, 1.0, 1.0, half, 1.0]), knots, False)


def plane_patch(size: float) -> Nurbs:
    """A square of side `size` [m] in z = 0, centred on the origin; normal +z."""
    x = np.array([-size / 2, size / 2])
    points = np.stack([*np.meshgrid(x, x, indexing="ij"), np.zeros((2, 2))], axis=-1)
    knots = np.array([0.0, 0.0, 1.0, 1.0])
    return Nurbs(points, np.ones((2, 2)), knots, knots, 1, 1)
