"""Geometry of a grid of taxels, and the share of a patch's force that each of them carries."""

import numpy as np
from numpy.polynomial.legendre import leggauss

from palpate.physics.contact.spread import kernel_values

POINTS = 24  # Gauss points along each side of a taxel, and 8 times as many along the radius of the patch


def grid(rows: int, columns: int, spacing: float) -> np.ndarray:
    """Centres (rows columns, 2) [m] of a grid about the origin, row by row: x along the columns, y along the rows."""
    y, x = (spacing * (np.arange(count) - 0.5 * (count - 1)) for count in (rows, columns))
    return np.stack([np.tile(x, rows), np.repeat(y, columns)], axis=1)


def neighbours(rows: int, columns: int) -> np.ndarray:
    """(n, n) 1 for taxels next to each other in a row or a column, else 0."""

    def line(count: int) -> np.ndarray:
        return np.eye(count, k=1) + np.eye(count, k=-1)

    out: np.ndarray = np.kron(np.eye(rows), line(columns)) + np.kron(line(rows), np.eye(columns))
    return out


def shares(positions: np.ndarray, side: float, radius: float, kernel: str) -> np.ndarray:
    """Share (n,) of the force of a patch on square taxels of this side [m] at positions (n,2) [m] from its centre:

        w = integral of k(r/R) over the taxel / integral of k(r/R) over the patch,

    with the pressure k of `contact.spread.kernel_value` and R the radius of the patch [m], by Gauss's quadrature. Their
    sum is 1 if the taxels cover the patch.
    """
    at, weight = leggauss(POINTS)
    x = 0.5 * side * at
    apart = np.hypot(positions[:, 0, None, None] + x[:, None], positions[:, 1, None, None] + x[None, :])
    carried = np.einsum("nij,i,j->n", kernel_values(kernel, apart / radius), weight, weight) * 0.25 * side**2
    at, weight = leggauss(8 * POINTS)
    q = 0.5 * (at + 1.0)
    whole = np.pi * radius**2 * float(np.sum(weight * kernel_values(kernel, q) * q))
    out: np.ndarray = carried / whole
    return out
