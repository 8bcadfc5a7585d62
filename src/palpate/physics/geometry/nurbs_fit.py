"""Construction of NURBS surfaces: interpolation of points in two 1-D passes; exact spheres, capsules and planes.

L. Piegl, W. Tiller, The NURBS Book, 2nd ed., Springer 1997, ch. 7 (circles, revolution) and 9 (interpolation).
"""

import numpy as np

from palpate.compiler.exact import cos, einsum, sin, solve
from palpate.physics.geometry.nurbs import NurbsPatch, basis_matrices


def interpolate(points: np.ndarray, slopes: tuple[np.ndarray, np.ndarray]) -> NurbsPatch:
    """The bicubic B-spline surface through a grid of points [m] (n,m,3) at uniform parameters, closed in u (the first
    row is not repeated), with dS/dv at both ends of v given by `slopes` [m] (n,3), (n,3).

    ValueError: fewer than four points along a direction.
    """
    if min(points.shape[:2]) < 4:
        raise ValueError(f"points: found shape {points.shape}, expected at least 4 along each direction")
    control_v, knots_v = _open(np.swapaxes(points, 0, 1), slopes)
    control, knots_u = _closed_cubics(np.swapaxes(control_v, 0, 1))
    return NurbsPatch(control, np.ones(control.shape[:2]), knots_u, knots_v, 3, 3, True, False)


def _even(count: int) -> np.ndarray:
    """Uniform parameters 0 ... 1 with `count` steps."""
    return np.concatenate([[0.0], np.cumsum(np.full(count, 1.0 / count))[:-1], [1.0]])


def _closed_cubics(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Control points (axis 0) and knots of the closed cubics through points (k,...)."""
    count = len(points)
    t = _even(count)[:-1]
    knots = np.concatenate([t - 1.0, t, t + 1.0, t + 2.0])[count - 3 : 2 * count + 4]
    matrix = np.zeros((count, count))
    for row, value in enumerate(collocation(knots, 3, t)):
        np.add.at(matrix[row], np.arange(len(value)) % count, value)
    control = solve(matrix, points.reshape(count, -1))
    return np.concatenate([control, control[:3]]).reshape(count + 3, *points.shape[1:]), knots


def _open(points: np.ndarray, slopes: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Control points (axis 0) and knots of the cubics through points (k,...) with given slopes at both ends."""
    count = len(points)
    t = _even(count - 1)
    inner = [t[j : j + 3].mean() for j in range(count - 2)]
    knots = np.concatenate([np.zeros(4), inner, np.ones(4)])
    matrix = [collocation(knots, 3, t), collocation(knots, 3, np.array([0.0, 1.0]), derivative=1)]
    right = [points.reshape(count, -1), slopes[0].reshape(1, -1), slopes[1].reshape(1, -1)]
    control = solve(np.concatenate(matrix), np.concatenate(right))
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
    np.put_along_axis(design, columns, einsum("tkm,tm->tk", matrix[span], powers), axis=1)
    return design


def _arc(quarters: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Exact unit arc of quarter circles from angle 0: points (2q+1,2), weights, knots of degree 2."""
    angle = np.arange(2 * quarters + 1) * np.pi / 4
    weights = np.where(np.arange(len(angle)) % 2, np.sqrt(0.5), 1.0)
    points = np.stack([cos(angle), sin(angle)], axis=-1) / weights[:, None]
    inner = np.repeat(np.arange(1, quarters), 2)
    knots = np.concatenate([np.zeros(3), inner, np.full(3, quarters)]) / quarters
    return np.round(points, 15), weights, knots


def _revolve_profile(radius: np.ndarray, height: np.ndarray, weights: np.ndarray, knots: np.ndarray) -> NurbsPatch:
    """A profile of degree 2 (radius, height) revolved round z; u runs round the axis, v along the profile."""
    circle, circle_weights, circle_knots = _arc(4)
    points = np.empty((len(circle), len(radius), 3))
    points[..., :2] = circle[:, None] * radius[:, None]
    points[..., 2] = height
    return NurbsPatch(points, circle_weights[:, None] * weights, circle_knots, knots, 2, 2, True)


def sphere(radius: float) -> NurbsPatch:
    """The exact sphere [m] round the origin, poles on the z axis at both ends of v."""
    arc, weights, knots = _arc(2)
    return _revolve_profile(arc[:, 1] * radius, -arc[:, 0] * radius, weights, knots)


def capsule(radius: float, length: float) -> NurbsPatch:
    """The exact capsule [m]: a cylinder from the origin along z with hemispherical ends; poles at both ends of v."""
    half = np.sqrt(0.5)
    across = radius * np.array([0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0])
    along = np.array([-radius, -radius, 0.0, length / 2, length, length + radius, length + radius])
    knots = np.array([0.0, 0.0, 0.0, 1.0, 1.0, 2.0, 2.0, 3.0, 3.0, 3.0]) / 3.0
    return _revolve_profile(across, along, np.array([1.0, half, 1.0, 1.0, 1.0, half, 1.0]), knots)


def plane_patch(size: float) -> NurbsPatch:
    """A square of side `size` [m] in z = 0, centred on the origin; normal +z."""
    x = np.array([-size / 2, size / 2])
    points = np.stack([*np.meshgrid(x, x, indexing="ij"), np.zeros((2, 2))], axis=-1)
    knots = np.array([0.0, 0.0, 1.0, 1.0])
    return NurbsPatch(points, np.ones((2, 2)), knots, knots, 1, 1)
