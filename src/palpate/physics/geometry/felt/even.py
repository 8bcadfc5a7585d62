"""Even normals near rounded rims, where those of the body and of the ball are uneven from vertex to vertex.

A bridge's normals are exact for the polygons on which the ball rests, and the normals of the body next to a rim are
those of triangles on one side of it. Both differ from those of the smooth surface by the slope of a facet's sagitta,
about 0.001 where a file's edges are 2 mm long, and by others within 0.1 mm, since triangles of the boolean are small.
In the depth d the foot moves 1/(1 - κ d) times as far as the bone, and a jump of a normal by 0.001 within 0.1 mm is a κ
of 1/(100 mm): in a slide 11 mm deep the foot moved 1.07 and 1.29 times as far by turns, and viscous tissue answered to
each change. The pad of a finger averages over 1 mm and more. So each normal there is that of a plane through the
normals n_j of the vertices within e R, fitted by least squares with the weights (1 - |x_j - x|²/(e R)²)²:

    n(x) = c,        sum_j w_j |c + A (x_j - x) - n_j|² = least,

which keeps a constant curvature, however unevenly vertices lie.
"""

import numpy as np

from palpate.compiler.exact import solve_in_place
from palpate.compiler.kernel import ieee_kernel
from palpate.physics.arrays import Array, Indices, Matrix
from palpate.physics.geometry.refined.edge_list import neighbours_of

SAME = (0.7, 0.9)  # [1] cosine between two normals from which they are averaged, and count fully
RIDGE = 1e-6  # [1] regularization of A, where vertices lie in a line


def even_normals(
    points: np.ndarray, normals: np.ndarray, triangles: np.ndarray, reach: np.ndarray, share: np.ndarray
) -> np.ndarray:
    """Normals [1] (V,3) of the vertices at points [m] (V,3), made even over `reach` [m] (V) by a share [1] (V)."""
    at, near = neighbours_of(triangles, len(points))
    found = normals.copy()
    some = np.flatnonzero(share > 0.0)
    _fill(points, normals, at, near, some, reach, share, np.full(len(points), -1), np.empty(len(points), np.int64),
          np.empty((1, 3, 3)), np.empty((1, 3, 3)), found)  # fmt: skip
    return found


@ieee_kernel
def _fill(
    points: Matrix, normals: Matrix, at: Indices, near: Indices, some: Indices, reach: Array, share: Array,
    seen: Indices, queue: Indices, left: Matrix, right: Matrix, found: Matrix,
):  # fmt: skip
    """Fill in the normals of some vertices; seen (V) of -1, queue (V), left and right (1,3,3) are workspaces."""
    low, high = SAME
    axes, row = np.empty((2, 3)), np.empty(3)
    for v in some:
        n, square = normals[v], reach[v] * reach[v]
        _span(n, axes)
        for i in range(3):
            for j in range(3):
                left[0, i, j] = right[0, i, j] = 0.0
        size, k = 1, 0
        queue[0], seen[v] = v, v
        while k < size:
            other = queue[k]
            k += 1
            away = along = across = cosine = 0.0
            for i in range(3):
                out = points[other, i] - points[v, i]
                away, along, across = away + out * out, along + out * axes[0, i], across + out * axes[1, i]
                cosine += normals[other, i] * n[i]
            if not away < square or not cosine > low:
                continue
            weight = (1.0 - away / square) ** 2 * min((cosine - low) / (high - low), 1.0)
            row[0], row[1], row[2] = 1.0, along / reach[v], across / reach[v]
            for i in range(3):
                for j in range(3):
                    left[0, i, j] += weight * row[i] * row[j]
                    right[0, i, j] += weight * row[i] * normals[other, j]
            for m in range(at[other], at[other + 1]):
                if seen[near[m]] != v:
                    seen[near[m]] = v
                    queue[size] = near[m]
                    size += 1
        left[0, 1, 1] += RIDGE * left[0, 0, 0]
        left[0, 2, 2] += RIDGE * left[0, 0, 0]
        if solve_in_place(left, right):
            length = 0.0
            for i in range(3):
                found[v, i] = n[i] + share[v] * (right[0, 0, i] - n[i])
                length += found[v, i] * found[v, i]
            length = np.sqrt(length)
            for i in range(3):
                found[v, i] /= length


@ieee_kernel
def _span(n: Array, axes: Matrix):
    """Fill in two perpendicular axes [1] (2,3) of the plane with the normal n [1] (3)."""
    axis = 0 if abs(n[0]) < 0.6 else 1
    i, j = (axis + 1) % 3, (axis + 2) % 3
    length = np.sqrt(n[i] * n[i] + n[j] * n[j])
    axes[0, axis], axes[0, i], axes[0, j] = 0.0, -n[j] / length, n[i] / length
    for k in range(3):
        a, b = (k + 1) % 3, (k + 2) % 3
        axes[1, k] = n[a] * axes[0, b] - n[b] * axes[0, a]
