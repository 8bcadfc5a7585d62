"""Area of contact from the gaps at the integration points: level lines of the gap, extrapolated to the edge.

At the edge of a smooth contact the gap grows with the distance d from it as d^(3/2) (K. L. Johnson, Contact Mechanics,
Cambridge 1985, ch. 4, 5), which a mesh resolves from about half an edge length on. The area A within a level g, with
faces cut along the level line, is measured there and extrapolated to d = 0: sqrt(A) is linear in d round a compact
contact, exactly for a circle. The levels g and 3^(3/2) g are at d and 3 d; g is chosen so that their lines are one edge
length apart. A contact narrower than about half an edge is not detected.
"""

import numpy as np

from palpate.models.fe.element import faces as face_rule

RATIO = 3.0  # Ratio of the distances of the two level lines from the edge of contact
_CUTS = 4


def _subdivide_triangle(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (P,2) and triangles (T,3) of a triangle whose sides are cut in n."""
    places = [(i, j) for j in range(n + 1) for i in range(n + 1 - j)]
    at = {place: k for k, place in enumerate(places)}
    up = [(at[i, j], at[i + 1, j], at[i, j + 1]) for i, j in places if i + j < n]
    down = [(at[i + 1, j], at[i + 1, j + 1], at[i, j + 1]) for i, j in places if i + j < n - 1]
    return np.array(places) / n, np.array(up + down)


_PLACES, _TRIANGLES = _subdivide_triangle(_CUTS)
_PLACED, _ = face_rule.shape(_PLACES)
_FROM_POINTS = _PLACED @ np.linalg.inv(face_rule.VALUES)
"""Matrix of quadratic interpolation from the six integration points to the places."""


class _Levels:
    """Areas and lines of gap levels over faces (F,6) of deformed nodes [m] (F,6,3)."""

    def __init__(self, nodes: np.ndarray, gap: np.ndarray) -> None:
        whole = np.isfinite(gap).all(axis=1)
        placed = np.einsum("pa,fai->fpi", _PLACED, nodes[whole])
        value = (gap[whole] @ _FROM_POINTS.T)[:, _TRIANGLES].reshape(-1, 3)
        corner = placed[:, _TRIANGLES].reshape(-1, 3, 3)
        order = np.argsort(value, axis=1)
        self.value = np.take_along_axis(value, order, axis=1)
        self.corner = np.take_along_axis(corner, order[:, :, None], axis=1)
        sides = self.corner[:, 1:] - self.corner[:, :1]
        self.area = 0.5 * np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
        # faces that extend past the other body's rim: sums over integration points
        self.rim_area = face_rule.areas(nodes.reshape(-1, 3), np.arange(nodes.size // 3).reshape(-1, 6))[~whole]
        self.rim_gap = gap[~whole]

    def at(self, level: float) -> tuple[float, float]:
        """Area with a gap below a level [m²], and length [m] of its boundary inside the faces."""
        low, middle, high = (self.value - level).T
        cut = (low < 0.0) & (high > 0.0)
        first = cut & (middle >= 0.0)
        a, b, c = low[cut], middle[cut], high[cut]
        p, q, r = (self.corner[cut, k] for k in range(3))
        across = p + (a / (a - c))[:, None] * (r - p)
        near = first[cut]
        d, e = np.where(near, a, b), np.where(near, b, c)
        f, g = np.where(near[:, None], p, q), np.where(near[:, None], q, r)
        along = f + (d / np.where(d == e, 1.0, d - e))[:, None] * (g - f)
        share = np.where(
            near, a * a / np.where(near, (a - b) * (a - c), 1.0), 1.0 - c * c / np.where(near, 1.0, (c - a) * (c - b))
        )
        area = self.area[high <= 0.0].sum() + (self.area[cut] * share).sum() + self.rim_area[self.rim_gap < level].sum()
        return float(area), float(np.linalg.norm(along - across, axis=1).sum())


def contact_area(nodes: np.ndarray, gap: np.ndarray, traction: np.ndarray) -> float:
    """Area of contact [m²] of faces with deformed nodes [m] (F,6,3), gaps [m] (F,6), inf if the other body is out of
    range, and normal tractions [Pa] (F,6); 0 if none is positive."""
    if not (traction > 0.0).any():
        return 0.0
    weight = face_rule.areas(nodes.reshape(-1, 3), np.arange(nodes.size // 3).reshape(-1, 6))
    edge = np.sqrt(2.0 * weight.sum(axis=1))
    apart = float((edge * (traction * weight).sum(axis=1)).sum() / (traction * weight).sum())
    levels = _Levels(nodes, gap)
    far = RATIO**1.5

    def measure_areas(level: float) -> tuple[float, float, float]:
        """Areas within the two levels, and the distance of their lines; inf if the outer one is outside the faces."""
        (inner, short), (outer, long) = levels.at(level), levels.at(far * level)
        if long == 0.0:
            return inner, outer, np.inf if outer > 0.0 else 0.0
        return inner, outer, 2.0 * (outer - inner) / (short + long)

    low, high = max(1e-6 * apart, float(gap[traction > 0.0].max())), apart
    for _ in range(40):
        level = np.sqrt(low * high)
        if measure_areas(level)[2] < apart:
            low = level
        else:
            high = level
    inner, outer, _ = measure_areas(low)
    share = 1.0 / (RATIO - 1.0)
    return max(0.0, (1.0 + share) * np.sqrt(inner) - share * np.sqrt(outer)) ** 2
