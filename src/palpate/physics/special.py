"""Special functions by elementary operations and square roots alone, so that all processors give the same bits."""

from functools import lru_cache

import numpy as np

HALVINGS = 12  # Steps of the arithmetic-geometric mean: enough for a complementary modulus above 1e-150
TERMS = 50  # Terms of a cosine, which is the first guess of a node, and of Gauss's series up to z = 1/2


@lru_cache(maxsize=64)
def gauss_legendre(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and weights [1] (count) of Gauss-Legendre quadrature on [-1, 1], ascending. Errors up to 400 nodes: 1e-16,
    and 1e-11 of a weight.

    Newton's method for the zeros of P_n, from cos(pi (4i - 1)/(4n + 2)). (`np.polynomial.legendre.leggauss` computes
    eigenvalues by LAPACK, with other last bits on each processor.)
    """
    half = np.arange(1, (count + 1) // 2 + 1)
    square = np.square(np.pi * (4.0 * half - 1.0) / (4.0 * count + 2.0))
    x = np.ones_like(square)
    for k in range(TERMS, 0, -2):
        x = 1.0 - square / (k * (k - 1.0)) * x
    for _ in range(5):
        before, value = np.ones_like(x), x
        for k in range(2, count + 1):
            before, value = value, ((2.0 * k - 1.0) * x * value - (k - 1.0) * before) / k
        slope = count * (before - x * value) / (1.0 - x * x)
        x = x - value / slope
    if count % 2:
        x[-1] = 0.0
    weight = 2.0 / ((1.0 - x * x) * slope * slope)
    rest = slice(None) if count % 2 == 0 else slice(-1)
    nodes, weights = np.concatenate([-x[rest], x[::-1]]), np.concatenate([weight[rest], weight[::-1]])
    nodes.flags.writeable = weights.flags.writeable = False
    return nodes, weights


def elliptic_integrals(complement: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Complete elliptic integrals K and E [1] (...) of the complementary modulus k' = sqrt(1 - k²) [1] (...), in
    [1e-150, 1].

    R. Bulirsch, Numer. Math. 13 (1969) 305-315, `cel`: all sums are of positive numbers.
    """
    scale, mean = np.asarray(complement, float), np.ones_like(complement)
    product, third = scale, mean
    parts = [[mean, mean], [mean, scale * scale]]  # a and b of cel for K and E
    for step in range(HALVINGS):
        if step > 0:
            scale = 2.0 * np.sqrt(product)
            product = scale * mean
        turn = product / third
        parts = [[a + b / third, 2.0 * (b + a * turn)] for a, b in parts]
        third, mean = turn + third, mean + scale
    first, second = (0.5 * np.pi * (b + a * mean) / (mean * (mean + third)) for a, b in parts)
    return first, second


def patch_depth(rho: np.ndarray) -> np.ndarray:
    """16/5 F(1/2, -5/2; 1; rho²) for rho < 1, else F(1/2, 1/2; 4; 1/rho²)/rho [1] (...), F Gauss's hypergeometric
    function; relative error below 1e-14.

    By recurrences from F(1/2, 1/2; 1; k²) = 2 K/pi and F(1/2, -1/2; 1; k²) = 2 E/pi (M. Abramowitz, I. A. Stegun,
    Handbook of Mathematical Functions, 1964, 15.2.10 and 15.2.12, 17.3.9 f.), for 1/rho² < 1/2 by the series.
    """
    out = np.maximum(rho, 1.0)
    z = np.where(rho < 1.0, np.square(np.minimum(rho, 1.0)), 1.0 / (out * out))
    rest = 1.0 - z
    first, second = (2.0 / np.pi * each for each in elliptic_integrals(np.sqrt(np.maximum(rest, 1e-300))))
    cubic = 2.0 / 3.0 * ((1.0 + rest) * second - 0.5 * rest * first)
    inside = 1.28 * (2.0 * (1.0 + rest) * cubic - 1.5 * rest * second)
    near = np.maximum(z, 0.5)  # else digits cancel
    two = 2.0 * (second - rest * first) / near
    three = (rest * first - (1.0 - 2.0 * z) * two) / (1.125 * near)
    four = 0.96 * (rest * two - (1.0 - 2.0 * z) * three) / near
    far, small = np.ones_like(z), np.minimum(z, 0.5)
    for n in range(TERMS, 0, -1):
        far = 1.0 + (n - 0.5) * (n - 0.5) / (n * (n + 3.0)) * small * far
    return np.where(rho < 1.0, inside, np.where(z < 0.5, far, four) / out)
