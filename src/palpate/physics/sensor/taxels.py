"""Geometry of a grid of taxels, and the share of a patch's force that each of them carries."""

import numpy as np

from palpate.compiler.exact import einsum
from palpate.physics.contact.spread import kernel_values
from palpate.physics.special import gauss_legendre

POINTS = 24  # Gauss points along each side of a taxel, and 8 times as many along the radius of the patch


def grid(rows: int, columns: int, spacing: float) -> np.ndarray:
    """Centres (rows columns, 2) [m] of a grid about the origin, row by row: x along the columns, y along the rows."""
    y, x = (spacing * (np.arange(count) - 0.5 * (count - 1)) for count in (rows, columns))
    return np.stack([np.tile(x, rows), np.repeat(y, columns)], axis=1)


def neighbours(rows: int, columns: int) -> np.ndarray:
    """(n, n) 1 for taxels next to each other in a row or a column, else 0."""
    row, column = np.divmod(np.arange(rows * columns), columns)
    away = np.abs(row[:, None] - row) + np.abs(column[:, None] - column)
    return np.asarray(away == 1, float)


def shares(positions: np.ndarray, side: float, radius: float, kernel: str) -> np.ndarray:
    """Share (n,) of the force of a patch on square taxels of this side [m] at positions (n,2) [m] from its centre:

        w = integral of k(r/R) over the taxel / integral of k(r/R) over the patch,

    with the pressure k of `contact.spread.kernel_value` and R the radius of the patch [m], by Gauss's quadrature. Their
    sum is 1 if the taxels cover the patch.
    """
    at, weight = gauss_legendre(POINTS)
    x = 0.5 * side * at
    across, along = positions[:, 0, None, None] + x[:, None], positions[:, 1, None, None] + x[None, :]
    pressure = kernel_values(kernel, np.sqrt(across * across + along * along) / radius)
    carried = einsum("nij,ij->n", pressure, weight[:, None] * weight) * 0.25 * side**2
    at, weight = gauss_legendre(8 * POINTS)
    q = 0.5 * (at + 1.0)
    whole = np.pi * radius**2 * float(np.sum(weight * kernel_values(kernel, q) * q))
    out: np.ndarray = carried / whole
    return out
