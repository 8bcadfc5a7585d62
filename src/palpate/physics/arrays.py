"""Types of arguments that are arrays. The docstring of a function states shape and unit of each.

Kernels have no types: numba ignores them, and takes more than Python could name, such as records.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

Numbers = ArrayLike
"""A number, or numbers of any shape, as arrays or nested sequences; the function converts them."""
Vector = Sequence[float] | np.ndarray
"""Numbers along one axis, (n)."""
Points = np.ndarray
"""Coordinates along the last axis, (..., 2) or (..., 3); also normals."""
Triangles = np.ndarray
"""Indices of the corners, (t, 3), int."""
