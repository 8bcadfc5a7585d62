"""What a patch that slides over viscous tissue lacks of its indentation, since it meets material that has not yielded.

In a steady slide at the speed u a Kelvin-Voigt body with the retardation tau indents by its indentation at rest times

    L(q) = integral_0^inf exp(-a) r(q a) da,   q = u tau/R,

r(x/R) being the displacement under a biweight patch of radius R by the same load at the distance x, over that at 0:
the autocorrelation of the patch for independent beams, and with 1/r between both patches for a half-space
(Boussinesq; K. L. Johnson, Contact Mechanics, 1985, ch. 3.2). L of the half-space is 0.92, 0.80, 0.63 at q = 0.25,
0.5, 1, as in `physics.bodies.spring_range`.
"""

from __future__ import annotations

import numpy as np

SPACING, FARTHEST = 0.05, 10.0  # [1] of R: of the grid, and the distance beyond which a half-space moves as 1/r
FASTEST = 8.0  # [1] q


def lag_of_beams() -> np.ndarray:
    """q and 1 - L (2,n) of independent beams."""
    return _lag(_two_patches())


def lag_of_half_space() -> np.ndarray:
    """q and 1 - L (2,n) of a half-space."""
    from scipy.signal import fftconvolve

    both = _two_patches()
    square = _squares(round(FARTHEST / SPACING) + len(both) // 2)
    green = 1.0 / np.sqrt(np.where(square > 0.0, square, np.inf))
    middle = len(green) // 2
    green[middle, middle] = 4.0 * np.log(1.0 + np.sqrt(2.0)) / SPACING  # the mean of 1/r over a cell
    return _lag(fftconvolve(green, both, "valid"))


def _squares(count: int) -> np.ndarray:
    """Squares of the distances [1] (n,n) of a grid of 2 `count` + 1 points to its middle."""
    grid = np.arange(-count, count + 1) * SPACING
    return np.asarray(grid**2 + grid[:, None] ** 2)


def _two_patches() -> np.ndarray:
    """Autocorrelation (n,n) of the patch."""
    from scipy.signal import fftconvolve

    square = _squares(round(1.0 / SPACING))
    patch = np.where(square < 1.0, (1.0 - square) ** 2, 0.0)
    return np.asarray(fftconvolve(patch, patch))


def _lag(moved: np.ndarray) -> np.ndarray:
    """q and 1 - L (2,n), of displacements (m,m) by an equal patch in the middle; beyond the grid they fall as 1/r."""
    row = moved[len(moved) // 2, len(moved) // 2 :]
    places, ages, speeds = np.arange(len(row)) * SPACING, np.linspace(0.0, 12.0, 2401), np.linspace(0.0, FASTEST, 161)

    def share(far: np.ndarray) -> np.ndarray:
        return np.interp(far, places, row) * np.minimum(places[-1] / np.maximum(far, SPACING), 1.0) / row[0]

    return np.array([speeds, 1.0 - np.array([np.trapezoid(np.exp(-ages) * share(q * ages), ages) for q in speeds])])
