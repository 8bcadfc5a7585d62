"""Validity of curved elements: whether the Jacobian determinant det dX/dxi is positive in the whole element.

The determinant of a quadratic tetrahedron is a cubic polynomial. It is bounded by its smallest and largest Bernstein
coefficients; if these do not determine its sign, the element is subdivided into eight. A. Johnen, J.-F. Remacle,
C. Geuzaine, J. Comput. Phys. 233 (2013) 359-372.
"""

from math import factorial

import numpy as np

from palpate.models.fe.element.elements import shape

DEPTH = 4  # Levels of subdivision; an element whose sign is then unknown counts as inverted

_POWERS = np.array([(i, j, k, 3 - i - j - k) for i in range(4) for j in range(4 - i) for k in range(4 - i - j)])
_AT = _POWERS[:, :3] / 3.0


def _bernstein(at: np.ndarray) -> np.ndarray:
    """The twenty cubic Bernstein polynomials at natural coordinates (n,3): (n,20)."""
    every = np.column_stack([at, 1.0 - at.sum(axis=1)])
    weight = [6.0 / np.prod([factorial(p) for p in power]) for power in _POWERS.tolist()]
    return np.prod(every[:, None, :] ** _POWERS, axis=2) * weight


_COEFFICIENTS = np.linalg.inv(_bernstein(_AT))
CORNERS = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
_MIDDLES = {(i, j): 0.5 * (CORNERS[i] + CORNERS[j]) for i in range(4) for j in range(i + 1, 4)}
_A, _B, _C, _D, _E, _F = (_MIDDLES[i, j] for i, j in ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)))
_EIGHT = np.array([
    [CORNERS[0], _A, _C, _D], [_A, CORNERS[1], _B, _E], [_C, _B, CORNERS[2], _F], [_D, _E, _F, CORNERS[3]],
    [_A, _B, _C, _D], [_A, _D, _B, _E], [_B, _E, _F, _D], [_B, _F, _C, _D],
])  # fmt: skip


def _determinants(points: np.ndarray, elements: np.ndarray, at: np.ndarray) -> np.ndarray:
    """det dX/dxi [m³] (E,n)."""
    _, natural = shape(at)
    return np.linalg.det(np.einsum("eai,nak->enik", points[elements], natural))


def find_inverted(points: np.ndarray, elements: np.ndarray, folded: float) -> np.ndarray:
    """Indices (K,) of the elements (E,10) whose determinant is not positive everywhere, in ascending order.

    points [m] (N,3);  folded [1]  allowed negative determinant, as a fraction of the largest one of the element
    """
    size = np.abs(_determinants(points, elements, _AT)).max(axis=1)
    bad = np.zeros(len(elements), dtype=bool)
    asked, parts = np.arange(len(elements)), [CORNERS]
    for _ in range(DEPTH):
        low, least = np.full(len(asked), np.inf), np.full(len(asked), np.inf)
        for corner in parts:
            at = corner[0] + _AT @ (corner[1:] - corner[0])
            value = _determinants(points, elements[asked], at)
            least = np.minimum(least, value.min(axis=1))
            low = np.minimum(low, (value @ _COEFFICIENTS.T).min(axis=1))
        floor = -folded * size[asked]
        bad[asked[least <= floor]] = True
        asked = asked[(least > floor) & (low <= floor)]
        if not len(asked):
            break
        parts = [corner[0] + part @ (corner[1:] - corner[0]) for corner in parts for part in _EIGHT]
    bad[asked] = True
    return np.flatnonzero(bad)
