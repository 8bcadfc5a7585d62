"""Integration over the six-node faces of quadratic tetrahedra."""

import numpy as np

from palpate.models.fe.element import elements

_A, _B = 0.445948490915965, 0.091576213509771
POINTS = np.array(
    [[_A, _A], [1 - 2 * _A, _A], [_A, 1 - 2 * _A], [_B, _B], [1 - 2 * _B, _B], [_B, 1 - 2 * _B]]
)  # fmt: skip
WEIGHTS = np.repeat([0.223381589678011, 0.109951743655322], 3) / 2.0
"""Six points, exact to degree 4. D. A. Dunavant, Int. J. Numer. Methods Eng. 21 (1985) 1129-1148."""


def shape(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Shape functions (n,6) and natural gradients (n,6,2) at natural coordinates (n,2); corners, then midpoints of the
    sides 01, 12, 20."""
    return elements.shape(at, elements.EDGES[:3])


VALUES, _GRADIENTS = shape(POINTS)  # Shape functions at the integration points (6,6)
HATS = np.column_stack([1.0 - POINTS[:, 0] - POINTS[:, 1], POINTS])
"""The three linear functions at the integration points (6,3)."""


def normals(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Outward normals at the integration points (F,6,3); their length is the Jacobian, twice the area [m²] of a flat
    face."""
    tangents = np.einsum("fai,qak->fqik", points[faces], _GRADIENTS)
    return np.cross(tangents[..., 0], tangents[..., 1])


def areas(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Area of each integration point [m²] (F,6)."""
    return np.linalg.norm(normals(points, faces), axis=-1) * WEIGHTS
