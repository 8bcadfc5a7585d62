"""Bitwise reproducible linear algebra and functions, for everything that is computed at the start of a run.

BLAS and LAPACK (`@`, `np.dot`, `np.linalg` except `norm` over an axis) choose the order of their sums by the processor
and the number of threads. numpy's `exp`, `log`, `tan`, `arctan2`, `sinh`, `power` ... choose their approximation by the
processor; its `sin`, `cos` and `hypot`, Python's `math` and powers of numbers are those of the C library. `np.einsum`
and scipy fuse products and sums on ARM. numpy's sums, products of elements and `sqrt` are reproducible.
`tests/compiler/test_reproducible.py` lists what code between settings and messages must not call.
"""

import math
from functools import lru_cache
from itertools import product as tuples
from typing import Any

import numpy as np

from palpate.compiler.doubles import two_product
from palpate.compiler.kernel import ieee_kernel


def product(a: Any, b: Any) -> np.ndarray:
    """a b, of a (n,k) and b (k,m) or (k,)."""
    return einsum("ik,kj->ij" if np.ndim(b) == 2 else "ik,k->i", a, b)


def einsum(pattern: str, *operands: Any) -> np.ndarray:
    """Sum of products of elements, as `np.einsum` with a result such as "nij,nj->ni", in an order that the pattern
    determines: with two operands that both end with the only summed index that of `row_times`, else one index after
    another. On x86-64 `np.einsum` has the same order for contiguous arrays."""
    summed, layouts, rows = _parse(pattern)
    arrays = [
        np.asarray(each, float).transpose(axes)[places] for each, (axes, places) in zip(operands, layouts, strict=True)
    ]
    size = np.broadcast_shapes(*(array.shape for array in arrays))
    even, odd = np.zeros(size[summed:]), np.zeros(size[summed:])
    for step in _in_pairs(size[0]) if rows else tuples(*map(range, size[:summed])):
        term = 1.0
        for array in arrays:
            term = term * array[tuple(k if n > 1 else 0 for k, n in zip(step, array.shape, strict=False))]
        if rows and step[0] % 2:
            odd += term
        else:
            even += term
    return even + odd if rows else even


@lru_cache(maxsize=128)
def _parse(pattern: str) -> tuple[int, tuple[tuple[Any, Any], ...], bool]:
    """Number of summed indices; for each operand the order of its axes, summed ones first, and the index that adds the
    missing axes; whether the sum is that of `row_times`."""
    left, kept = pattern.split("->")
    terms = left.split(",")
    summed = "".join(dict.fromkeys(name for name in left if name not in kept + ","))
    names = summed + kept
    layouts = tuple(
        (
            sorted(range(len(term)), key=lambda axis, term=term: names.index(term[axis])),  # type: ignore[misc]
            tuple(slice(None) if name in term else None for name in names),
        )
        for term in terms
    )
    rows = len(terms) == 2 and len(summed) == 1 and all(term.endswith(summed) for term in terms)
    return len(summed), layouts, rows


def _in_pairs(count: int) -> list[tuple[int]]:
    """The order of `row_times`: backwards within each whole block of eight."""
    whole = count // 8 * 8
    blocks = [(start + k,) for start in range(0, whole, 8) for k in range(7, -1, -1)]
    return blocks + [(k,) for k in range(whole, count)]


@ieee_kernel
def row_times(a, b):
    """sum_k a_k b_k of two vectors (n,), n <= 16, in a kernel, in the summation order of `product`."""
    even = odd = 0.0
    whole = len(a) // 8 * 8
    for start in range(0, whole, 8):
        for k in range(start + 6, start - 2, -2):
            even += a[k] * b[k]
            odd += a[k + 1] * b[k + 1]
    for k in range(whole, len(a), 2):
        even += a[k] * b[k]
        odd += a[k + 1] * b[k + 1] if k + 1 < len(a) else 0.0
    return even + odd


@ieee_kernel
def distance(a, b):
    """|a - b| of two points (3) in a kernel, correct to the last bit, as `math.dist`."""
    return hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2])


@ieee_kernel
def hypot(x, y, z):
    """sqrt(x² + y² + z²) in a kernel, correct to the last bit, as `math.hypot`; valid up to 1e150."""
    total = rest = 0.0
    for each in (x, y, z):
        square, error = two_product(each, each)
        before, total = total, total + square
        rest += ((before - total) + square if before > square else (square - total) + before) + error
    if not total > 0.0:
        return total
    root = math.sqrt(total)
    square, error = two_product(root, root)
    return root + ((total - square) - error + rest) / (2.0 * root)


@ieee_kernel
def sum_of_squares(x):
    """sum_k x_k² of a vector (n,) in a kernel, in the order of `np.sum`: eight partial sums, two halves above n = 128.
    The same bits as `np.sum` for n <= 256."""
    n = len(x)
    if n <= 128:
        return _eight_sums(x)
    half = n // 2 - n // 2 % 8
    return _eight_sums(x[:half]) + _eight_sums(x[half:])


@ieee_kernel
def _eight_sums(x):
    whole, total = len(x) // 8 * 8, 0.0
    if whole > 0:
        a, b, c, d = x[0] * x[0], x[1] * x[1], x[2] * x[2], x[3] * x[3]
        e, f, g, h = x[4] * x[4], x[5] * x[5], x[6] * x[6], x[7] * x[7]
        for k in range(8, whole, 8):
            a += x[k] * x[k]
            b += x[k + 1] * x[k + 1]
            c += x[k + 2] * x[k + 2]
            d += x[k + 3] * x[k + 3]
            e += x[k + 4] * x[k + 4]
            f += x[k + 5] * x[k + 5]
            g += x[k + 6] * x[k + 6]
            h += x[k + 7] * x[k + 7]
        total = ((a + b) + (c + d)) + ((e + f) + (g + h))
    for k in range(whole, len(x)):
        total += x[k] * x[k]
    return total


def length(x: np.ndarray) -> float:
    """Euclidean norm of all elements of an array."""
    return float(np.sqrt(np.sum(np.square(x))))


def exp(x: Any) -> np.ndarray:
    """e^x of each element (...), by the functions of kernels (`exponentials`, `angles`), as are those below."""
    return _each(0, x)


def expm1(x: Any) -> np.ndarray:
    """e^x - 1."""
    return _each(1, x)


def log(x: Any) -> np.ndarray:
    """Natural logarithm."""
    return _each(2, x)


def arctan2(y: Any, x: Any) -> np.ndarray:
    """Angle [rad] of (x, y)."""
    return _each(3, y, x)


def sin(x: Any) -> np.ndarray:
    """Sine of an angle [rad]."""
    return _each(4, x)


def cos(x: Any) -> np.ndarray:
    """Cosine of an angle [rad]."""
    return _each(5, x)


def arcsin(x: Any) -> np.ndarray:
    """Angle [rad] with this sine, -pi/2 to pi/2."""
    return _each(6, x)


def power(x: Any, y: Any) -> np.ndarray:
    """x^y."""
    return _each(7, x, y)


def _each(which: int, x: Any, y: Any = 0.0) -> np.ndarray:
    first, second = np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float))
    out = np.empty(first.shape)
    _fill(which, first.ravel().copy(), second.ravel().copy(), out.reshape(-1))
    return out


@ieee_kernel
def _fill(which, x, y, out):
    for i in range(len(out)):
        if which == 0:
            out[i] = math.exp(x[i])
        elif which == 1:
            out[i] = math.expm1(x[i])
        elif which == 2:
            out[i] = math.log(x[i])
        elif which == 3:
            out[i] = math.atan2(x[i], y[i])
        elif which == 4:
            out[i] = math.sin(x[i])
        elif which == 5:
            out[i] = math.cos(x[i])
        elif which == 6:
            out[i] = math.asin(x[i])
        else:
            out[i] = x[i] ** y[i]


def solve(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The solution x (...,n,m) of a x = b, a (...,n,n), b (...,n,m). ValueError: a is singular or not finite."""
    x = np.array(b, dtype=float, order="C")
    rows, columns = x.shape[-2:]
    if not solve_in_place(np.array(a, dtype=float, order="C").reshape(-1, rows, rows), x.reshape(-1, rows, columns)):
        raise ValueError("found a singular matrix, expected a regular one")
    return x


@ieee_kernel
def solve_in_place(a, x):
    """Solve a x = b by Gaussian elimination with partial pivoting, in place: a (k,n,n) is overwritten, x (k,n,m)
    contains b and then the solution. False: a pivot is 0 or not finite."""
    count, n, columns = x.shape
    for k in range(count):
        for i in range(n):
            best = i
            for j in range(i + 1, n):
                if abs(a[k, j, i]) > abs(a[k, best, i]):
                    best = j
            if not 0.0 < abs(a[k, best, i]) < np.inf:
                return False
            if best != i:
                for j in range(n):
                    a[k, i, j], a[k, best, j] = a[k, best, j], a[k, i, j]
                for j in range(columns):
                    x[k, i, j], x[k, best, j] = x[k, best, j], x[k, i, j]
            for r in range(i + 1, n):
                factor = a[k, r, i] / a[k, i, i]
                if factor != 0.0:
                    for j in range(i + 1, n):
                        a[k, r, j] -= factor * a[k, i, j]
                    for j in range(columns):
                        x[k, r, j] -= factor * x[k, i, j]
        for i in range(n - 1, -1, -1):
            for j in range(columns):
                total = x[k, i, j]
                for r in range(i + 1, n):
                    total -= a[k, i, r] * x[k, r, j]
                x[k, i, j] = total / a[k, i, i]
    return True
