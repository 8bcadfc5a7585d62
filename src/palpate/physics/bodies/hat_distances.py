"""Mean inverse distances between the hat functions of a surface: a half-space under loads on its vertices."""

import numpy as np

from palpate.compiler.dot import cross, dot
from palpate.compiler.kernel import kernel
from palpate.physics.arrays import Array, Indices, Matrix, Tensor, Vector3
from palpate.physics.geometry.mesh import Mesh

NEAR = 2.5  # [1] Distance of two triangles over the mean edge, below which 1/r is integrated in closed form
RULE = np.array([
    [1 / 3, 1 / 3, 1 / 3, 0.225],
    [0.059715871789770, 0.470142064105115, 0.470142064105115, 0.132394152788506],
    [0.470142064105115, 0.059715871789770, 0.470142064105115, 0.132394152788506],
    [0.470142064105115, 0.470142064105115, 0.059715871789770, 0.132394152788506],
    [0.797426985353087, 0.101286507323456, 0.101286507323456, 0.125939180544827],
    [0.101286507323456, 0.797426985353087, 0.101286507323456, 0.125939180544827],
    [0.101286507323456, 0.101286507323456, 0.797426985353087, 0.125939180544827],
])  # fmt: skip
"""Radon's rule of degree 5 on a triangle: barycentric coordinates and weight."""


def mean_inverse_distance(mesh: Mesh) -> np.ndarray:
    """T [1/m] (V,V): mean of 1/|x - y| over the hat functions of two vertices, each normalised to the integral 1.

    For close triangles the potential of a linear density on one, in closed form (D. R. Wilton et al., IEEE Trans.
    Antennas Propag. 32 (1984) 276-281), is integrated over the other by `RULE`; for others three points are used each.
    """
    corner = np.ascontiguousarray(mesh.vertices[mesh.triangles])
    area = 0.5 * np.linalg.norm(mesh.face_vectors, axis=1)
    good = area > 1e-12 * area.max()
    edge = float(np.sqrt(area[good].mean() * 4.0 / np.sqrt(3.0)))
    triangles = np.ascontiguousarray(mesh.triangles[good].astype(np.int64))
    total = np.zeros((len(mesh.vertices), len(mesh.vertices)))
    _integrate(corner[good], area[good], triangles, (NEAR * edge) ** 2, RULE, total)
    mass = np.zeros(len(mesh.vertices))
    np.add.at(mass, triangles.ravel(), np.repeat(area[good] / 3.0, 3))
    mass[mass == 0.0] = np.inf
    return 0.5 * (total + total.T) / (mass[:, None] * mass[None])


@kernel
def _integrate(corner: Tensor, area: Array, triangles: Indices, near: float, rule: Matrix, total: Matrix):
    """Add to `total` [m³] (V,V) the double integrals of hat functions over distance, for all pairs of triangles.

    corner [m] (T,3,3), area [m²] (T,), triangles (T,3);  near [m²] squared distance of centres for the closed form
    """
    # three quadrature points of each triangle; their barycentric coordinates are the rows of `inside`
    inside, close = np.array([[2.0, 0.5, 0.5], [0.5, 2.0, 0.5], [0.5, 0.5, 2.0]]) / 3.0, np.zeros(3)
    count = len(corner)
    points = np.zeros((count, 3, 3))
    for t in range(count):
        for q in range(3):
            for i in range(3):
                for k in range(3):
                    points[t, q, i] += inside[q, k] * corner[t, k, i]
    # all ordered pairs of triangles s, t; the distance of their centres selects the integration
    block, point = np.zeros((3, 3)), np.zeros(3)
    for s in range(count):
        for t in range(count):
            square = 0.0
            for i in range(3):
                apart = (corner[s, 0, i] + corner[s, 1, i] + corner[s, 2, i]) / 3.0
                apart -= (corner[t, 0, i] + corner[t, 1, i] + corner[t, 2, i]) / 3.0
                square += apart * apart
            block[:] = 0.0
            # distant triangles: quadrature over both; symmetric, so each pair is computed once
            if square > near:
                if t < s:
                    continue
                share = area[s] * area[t] / 9.0
                for p in range(3):
                    for q in range(3):
                        x = points[s, p, 0] - points[t, q, 0]
                        y = points[s, p, 1] - points[t, q, 1]
                        z = points[s, p, 2] - points[t, q, 2]
                        value = share / np.sqrt(x * x + y * y + z * z)
                        for a in range(3):
                            for b in range(3):
                                block[a, b] += inside[p, a] * inside[q, b] * value
                for a in range(3):
                    for b in range(3):
                        total[triangles[s, a], triangles[t, b]] += block[a, b]
                        total[triangles[t, b], triangles[s, a]] += block[a, b]
            else:  # close triangles: potential of triangle t in closed form at the points of a rule on triangle s
                first, second, third = corner[s, 0], corner[s, 1], corner[s, 2]
                for q in range(len(rule)):
                    for i in range(3):
                        point[i] = rule[q, 0] * first[i] + rule[q, 1] * second[i] + rule[q, 2] * third[i]
                    _potential(point, corner[t], close)
                    for a in range(3):
                        for b in range(3):
                            block[a, b] += rule[q, 3] * area[s] * rule[q, a] * close[b]
                for a in range(3):
                    for b in range(3):
                        total[triangles[s, a], triangles[t, b]] += block[a, b]


@kernel
def _minus(a: Vector3, b: Vector3):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@kernel
def _times(a: Vector3, scale: float):
    return a[0] * scale, a[1] * scale, a[2] * scale


@kernel
def _potential(point: Array, corner: Matrix, out: Array):
    """Fill `out` [m] (3): integral over a triangle [m] (3,3) of each barycentric coordinate over the distance from a
    point [m] (3)."""
    normal = cross(_minus(corner[1], corner[0]), _minus(corner[2], corner[0]))
    double = np.sqrt(dot(normal, normal))
    normal = _times(normal, 1.0 / double)
    height = dot(_minus(point, corner[0]), normal)
    foot = _minus(point, _times(normal, height))
    whole, first0, first1, first2 = 0.0, 0.0, 0.0, 0.0
    # edge by edge: integrals of 1/r (`whole`), and of the in-plane vector from the foot over r (`first`)
    for k in range(3):
        begin = corner[k]
        along = _minus(corner[(k + 1) % 3], begin)
        length = np.sqrt(dot(along, along))
        along = _times(along, 1.0 / length)
        outward = cross(along, normal)
        low = dot(_minus(begin, foot), along)
        high = low + length
        side = dot(_minus(begin, foot), outward)
        square = side * side + height * height
        far, near = np.sqrt(high * high + square), np.sqrt(low * low + square)
        log = 0.0
        if square > 1e-18 * length * length:
            log = np.log((far + high) / (near + low)) if low + high >= 0.0 else np.log((near - low) / (far - high))
        if height != 0.0:
            angle = np.arctan2(side * high, square + abs(height) * far)
            angle -= np.arctan2(side * low, square + abs(height) * near)
            whole -= abs(height) * angle
        whole += side * log
        amount = 0.5 * (square * log + high * far - low * near)
        first0 += amount * outward[0]
        first1 += amount * outward[1]
        first2 += amount * outward[2]
    # a coordinate is linear: its value at the foot times `whole`, plus its gradient times `first`
    for k in range(3):
        climb = _times(cross(normal, _minus(corner[(k + 2) % 3], corner[(k + 1) % 3])), 1.0 / double)
        out[k] = (1.0 + dot(_minus(foot, corner[k]), climb)) * whole + dot((first0, first1, first2), climb)
