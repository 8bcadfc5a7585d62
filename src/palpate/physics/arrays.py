"""Types of arguments that are arrays. The docstring of a function states shape and unit of each.

Numba ignores the types of a kernel: it compiles the kernel for the arguments of each call.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

Numbers = ArrayLike
"""A number, or numbers of any shape, as arrays or nested sequences; the function converts them."""
Vector = Sequence[float] | np.ndarray
"""Numbers along one axis, (n)."""
Array = np.ndarray
"""Numbers along one axis, (n), as an array: kernels read and fill it."""
Vector3 = tuple[float, float, float] | np.ndarray
"""Three numbers, x, y and z: a tuple, as kernels return, or a field of a record."""
Matrix = np.ndarray
"""Numbers along two axes, (n, m); also the coordinates of many points."""
Tensor = np.ndarray
"""Numbers along three axes or more."""
Indices = np.ndarray
"""Integers along one axis or two: indices, counts, corners of cells."""
Points = np.ndarray
"""Coordinates along the last axis, (..., 2) or (..., 3); also normals."""
Triangles = np.ndarray
"""Indices of the corners, (t, 3), int."""
Record = Any
"""A record, an array of records, or a NamedTuple: constants of a law or its state, whose fields have names."""
