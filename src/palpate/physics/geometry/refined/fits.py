"""Cubic height functions of the mean normal, fitted to the vertices round each of some vertices of a mesh."""

import numpy as np

from palpate.compiler.exact import row_times, solve_in_place
from palpate.compiler.kernel import ieee_kernel, kernel
from palpate.physics.arrays import Array, Indices, Matrix, Record, Vector3
from palpate.physics.geometry.refined.edge_list import sort_few

DEGREE = 3
TERMS = 9  # of a cubic without c_00
POWERS = (2 * DEGREE + 1) * (DEGREE + 1)  # 28, of x and y up to the sixth degree
RIDGE = 1e-9  # [1] regularization of coefficients that few neighbours do not determine
FIT = np.dtype({
    "names": ["one", "two", "wide", "number", "terms", "noise"],
    "formats": [("<f8", 3), ("<f8", 3), "<f8", "<f8", ("<f8", TERMS + 1), "<f8"],
})  # fmt: skip
"""z = sum c_ij x^i y^j with x, y and z over `wide`: axes of x and y [1] (3); `wide` [m], the root mean square distance
of the neighbours; their number, at least 1; c_10, c_01, ..., or c_00 and these; variance of the residual [1]."""


@kernel
def within_edges(at: Indices, near: Indices, vertex: int, edges: int, itself: bool, found: Indices, seen: Indices):
    """Fill `found` with the vertices within some edges of a vertex, in ascending order; returns their number.

    at, near  see `neighbours_of`;  itself  whether the vertex is one of them, if it has any
    seen      (V) workspace: all below 0, and again afterwards
    """
    found[0], seen[vertex] = vertex, 0
    size, begin = 1, 0
    for _ in range(edges):
        end = size
        for k in range(begin, end):
            for n in range(at[found[k]], at[found[k] + 1]):
                other = near[n]
                if seen[other] < 0:
                    found[size], seen[other] = other, 0
                    size += 1
        begin = end
    for k in range(size):
        seen[found[k]] = -1
    if size == 1 or not itself:
        size -= 1
        found[0] = found[size]
    sort_few(found, 0, size)
    return size


@ieee_kernel
def fit_cubic(
    points: Matrix, along: Vector3, vertex: int, found: Indices, size: int, near: float, free: bool,
    fit: Record, places: Matrix, left: Matrix, right: Matrix,
):  # fmt: skip
    """Weighted least squares for a vertex with the neighbours found[:size]; False: the equations are singular.

    points [m] (V,3);  along [1] (3) axis of z;  near [1] in the weights 1/((r/wide)² + near), r the distance
    free   whether c_00 is fitted; else the surface goes through the vertex
    places (n,3), left (1,n,n) and right (1,n,1) are workspaces
    """
    fill_places(points, along, vertex, found, size, fit, places)
    wide, number = fit.wide, fit.number
    # by the moments of x and y up to the sixth
    terms = TERMS + 1 if free else TERMS
    skipped = 0 if free else 1
    moments, powers = np.zeros(POWERS), np.ones(POWERS)
    for i in range(terms):
        right[0, i, 0] = 0.0
    total = 0.0
    for k in range(size):
        x, y, z = places[k, 0] / wide, places[k, 1] / wide, places[k, 2] / wide
        weight = 1.0 / (x * x + y * y + near)
        places[k, 0], places[k, 1], places[k, 2] = x, y, z
        total += weight
        _raise(x, y, 2 * DEGREE, powers)
        for m in range(POWERS):
            moments[m] += weight * powers[m]
        for i in range(terms):
            right[0, i, 0] += weight * z * powers[skipped + i]
    _fill_equations(moments, skipped, left)
    if not solve_in_place(left[:, :terms, :terms], right[:, :terms]):
        return False
    noise = 0.0
    for k in range(size):
        x, y, z = places[k, 0], places[k, 1], places[k, 2]
        weight = 1.0 / (x * x + y * y + near)
        _raise(x, y, DEGREE, powers)
        for i in range(terms):
            z -= right[0, i, 0] * powers[skipped + i]
        noise += weight * z * z
    for i in range(terms):
        fit.terms[i] = right[0, i, 0]
    fit.noise = noise / max(total, 1e-300) * (number / max(number - terms, 1.0))
    return True


@ieee_kernel
def fill_places(points: Matrix, along: Vector3, vertex: int, found: Indices, size: int, fit: Record, places: Matrix):
    """Fill in the axes, the width and the number of neighbours of a fit, and their places [m] (n,3) along the axes."""
    one, two = fit.one, fit.two
    x_axis = abs(along[0]) < 0.6
    _cross(along, (1.0, 0.0, 0.0) if x_axis else (0.0, 1.0, 0.0), one)
    length = max(np.sqrt(one[0] * one[0] + one[1] * one[1] + one[2] * one[2]), 1e-300)
    for i in range(3):
        one[i] /= length
    _cross(along, one, two)
    square = count = 0.0
    away = np.empty(3)
    for k in range(size):
        for i in range(3):
            away[i] = points[found[k], i] - points[vertex, i]
        x, y = row_times(away, one), row_times(away, two)
        places[k, 0], places[k, 1], places[k, 2] = x, y, row_times(away, along)
        square += x * x + y * y
        count += 1.0
    number = max(count, 1.0)
    wide = max(np.sqrt(square / number), 1e-300)
    fit.wide, fit.number = wide, number


@kernel
def _fill_equations(moments: Array, skipped: int, left: Matrix):
    """Fill the matrix (1,n,n) of the normal equations of the terms x^i y^j, i + j >= `skipped`, from the moments (28),
    in the order of `_raise`."""
    row, most = 0, -np.inf
    for one in range(skipped, DEGREE + 1):
        for j in range(one + 1):
            column = 0
            for other in range(skipped, DEGREE + 1):
                first = (one + other) * (one + other + 1) // 2 + j
                for l in range(other + 1):
                    value = moments[first + l]
                    left[0, row, column] = value
                    most = max(most, value)
                    column += 1
            row += 1
    for i in range(row):
        left[0, i, i] += 1e-30 + RIDGE * most


@kernel
def _raise(x: float, y: float, most: int, powers: Array):
    """Fill in 1, x, y, x², xy, y², ...: x^i y^j, i + j <= `most`, by degree."""
    begin = 0
    for degree in range(1, most + 1):
        end = begin + degree  # of the powers of the degree before, where those of this degree begin
        for j in range(degree):
            powers[end + j] = powers[begin + j] * x
        powers[end + degree] = powers[end - 1] * y
        begin = end


@kernel
def _cross(a: Vector3, b: Vector3, out: Array):
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]
