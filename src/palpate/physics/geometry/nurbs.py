"""NURBS surfaces of any degree: one patch, open or closed in each direction, evaluated by a compiled kernel.

    S(u, v) = sum N_i,p(u) N_j,q(v) w_ij P_ij / sum N_i,p(u) N_j,q(v) w_ij

L. Piegl, W. Tiller, The NURBS Book, 2nd ed., Springer 1997, ch. 2-4.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from palpate.compiler.exact import einsum
from palpate.compiler.fields import blank_record
from palpate.compiler.kernel import kernel
from palpate.physics.arrays import Array, Indices, Matrix, Record, Tensor
from palpate.physics.kept import keep_results

LAYOUT = {
    "degree_u": int, "degree_v": int, "spans_u": int, "spans_v": int, "columns": int,
    "closed_u": bool, "closed_v": bool, "pole_low": bool, "pole_high": bool,
    "ends_v": int, "matrices_u": int, "matrices_v": int, "points": int,
}  # fmt: skip
"""Of a patch: degrees, numbers of spans, number of control points along v; whether each direction is closed, and each
end of v is a pole; where parts of its floats begin (`NurbsPatch.packed`): span ends v, basis matrices, points."""
POLE_LIMIT = 2e-8  # [1] Distance of v from a pole over its domain, below which S_u is lost in rounding and S_uv is used


@dataclass(frozen=True, eq=False)
class NurbsPatch:
    """One NURBS patch; S_u x S_v points outward.

    knots_u, knots_v  [1]  (n+p+1), (m+q+1)  not decreasing; the domain is [knots[p], knots[n]]
    closed_u, closed_v     S is the same at both ends of the direction: the parameter wraps

    A row v = const at an end of the domain whose points coincide is a pole if u is closed. It has a tangent plane if
    the next row of control points is coplanar with it. ValueError: inconsistent shapes, knots or weights.
    """

    points: np.ndarray  # [m] (n,m,3) control points
    weights: np.ndarray  # [1] (n,m) positive
    knots_u: np.ndarray
    knots_v: np.ndarray
    degree_u: int = 3
    degree_v: int = 3
    closed_u: bool = False
    closed_v: bool = False

    def __post_init__(self) -> None:
        n, m = self.weights.shape
        if self.points.shape != (n, m, 3):
            raise ValueError(f"points: found shape {self.points.shape}, expected {(n, m, 3)} to fit the weights")
        if not (np.isfinite(self.points).all() and np.isfinite(self.weights).all() and (self.weights > 0).all()):
            raise ValueError("points must be finite and weights positive")
        for name, knots, p, count in (("u", self.knots_u, self.degree_u, n), ("v", self.knots_v, self.degree_v, m)):
            if p < 1 or count <= p:
                raise ValueError(f"degree_{name}: found {p} with {count} points, expected 1 <= degree < points")
            if len(knots) != count + p + 1:
                raise ValueError(f"knots_{name}: found {len(knots)}, expected {count + p + 1} = points + degree + 1")
            if not np.isfinite(knots).all() or (np.diff(knots) < 0).any() or knots[p] >= knots[count]:
                raise ValueError(f"knots_{name}: expected finite knots that do not decrease, with a domain > 0")

    @property
    def domain(self) -> tuple[float, float, float, float]:
        """u from, u to, v from, v to."""
        p, q, (n, m) = self.degree_u, self.degree_v, self.weights.shape
        return float(self.knots_u[p]), float(self.knots_u[n]), float(self.knots_v[q]), float(self.knots_v[m])

    @cached_property
    def packed(self) -> tuple[np.ndarray, Record, np.ndarray]:
        """Arguments of the kernels: all floats in one array (span ends u, span ends v, basis matrices u, basis matrices
        v, homogeneous points (n,m,4)), as each argument costs 0.1 µs per call; a `LAYOUT`; first control point of each
        span, of u and then of v."""
        m = self.weights.shape[1]
        breaks_u, first_u, matrix_u = basis_matrices(self.knots_u, self.degree_u)
        breaks_v, first_v, matrix_v = basis_matrices(self.knots_v, self.degree_v)
        homogeneous = np.concatenate([self.points * self.weights[..., None], self.weights[..., None]], axis=-1)
        parts = [breaks_u, breaks_v, matrix_u.ravel(), matrix_v.ravel(), homogeneous.ravel()]
        at = np.cumsum([len(p) for p in parts])
        low, high = self._poles()
        layout = blank_record(
            LAYOUT, degree_u=self.degree_u, degree_v=self.degree_v, spans_u=len(first_u), spans_v=len(first_v),
            columns=m, closed_u=self.closed_u, closed_v=self.closed_v, pole_low=low, pole_high=high,
            ends_v=at[0], matrices_u=at[1], matrices_v=at[2], points=at[3],
        )  # fmt: skip
        return np.concatenate(parts), layout, np.concatenate([first_u, first_v])

    def _poles(self) -> tuple[bool, bool]:
        size = np.ptp(self.points.reshape(-1, 3), axis=0).max()
        knots, q, m = self.knots_v, self.degree_v, self.weights.shape[1]
        clamped = (knots[0] == knots[q], knots[m] == knots[-1])
        rows = self.points[:, 0], self.points[:, -1]
        flat = [c and np.ptp(r, axis=0).max() <= 1e-12 * size for c, r in zip(clamped, rows, strict=True)]
        return bool(self.closed_u and flat[0]), bool(self.closed_u and flat[1])

    def derivatives(self, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """S, S_u, S_v, S_uu, S_uv, S_vv at (u, v) [m] (...,6,3); parameters outside the domain wrap or are limited."""
        u, v = np.broadcast_arrays(np.asarray(u, dtype=float), np.asarray(v, dtype=float))
        derivatives = np.empty((u.size, 6, 3))
        _derivatives(*self.packed, u.ravel(), v.ravel(), derivatives)
        return derivatives.reshape(*u.shape, 6, 3)

    def __call__(self, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        return self.derivatives(u, v)[..., 0, :]

    def move(self, rotation: np.ndarray, position: np.ndarray) -> NurbsPatch:
        """The patch rotated by the matrix (3,3), then shifted by `position` [m] (3)."""
        points = einsum("nmk,ik->nmi", self.points, rotation) + np.asarray(position)
        rest = (self.weights, self.knots_u, self.knots_v, self.degree_u, self.degree_v, self.closed_u, self.closed_v)
        return NurbsPatch(points, *rest)


@keep_results
def basis_matrices(knots: np.ndarray, degree: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The basis functions as polynomials on each span: ends of the spans (s+1), index of the first basis function of
    each (s), and coefficients (s,p+1,p+1) of N_{first+k}(u) = sum_m c[span,k,m] t^m, t = (u - from)/(to - from).

    Cox-de Boor recursion, Piegl & Tiller 2.5.
    """
    count = len(knots) - degree - 1
    spans = [i for i in range(degree, count) if knots[i + 1] > knots[i]]
    matrices = np.zeros((len(spans), degree + 1, degree + 1))
    for s, i in enumerate(spans):
        a, h = knots[i], knots[i + 1] - knots[i]
        row = np.zeros((degree + 1, degree + 1))
        row[0, 0] = 1.0  # row[k] is N_{i-d+k, d}
        for d in range(1, degree + 1):
            new = np.zeros_like(row)
            for k in range(d + 1):
                j = i - d + k
                if k > 0:
                    width = knots[j + d] - knots[j]
                    new[k] += ((a - knots[j]) * row[k - 1] + h * np.roll(row[k - 1], 1)) / width
                if k < d:
                    width = knots[j + d + 1] - knots[j + 1]
                    new[k] += ((knots[j + d + 1] - a) * row[k] - h * np.roll(row[k], 1)) / width
            row = new
        matrices[s] = row
    ends = np.array([knots[i] for i in spans] + [knots[spans[-1] + 1]], dtype=float)
    return ends, np.array([i - degree for i in spans], dtype=np.int64), matrices


@kernel
def wrap(x: float, low: float, high: float, closed: bool):
    """The parameter within its domain: wrapped if the direction is closed, limited if it is open."""
    if closed:
        if x < low or x >= high:
            x = low + (x - low) % (high - low)
        return x
    return min(max(x, low), high)


@kernel
def _basis(data: Array, at_ends: int, spans: int, at_matrix: int, degree: int, x: float, work: Array, at: int):
    """Values, first and second derivatives of the basis functions at x, into work[at:]; returns the span."""
    low, high = 0, spans
    while high - low > 1:
        middle = (low + high) // 2
        if data[at_ends + middle] <= x:
            low = middle
        else:
            high = middle
    start = data[at_ends + low]
    scale = 1.0 / (data[at_ends + low + 1] - start)
    t = (x - start) * scale
    order = degree + 1
    for k in range(order):
        c = at_matrix + (low * order + k) * order
        f, d, dd = data[c + degree], 0.0, 0.0
        for m in range(degree - 1, -1, -1):
            dd = dd * t + d
            d = d * t + f
            f = f * t + data[c + m]
        work[at + 3 * k] = f
        work[at + 3 * k + 1] = d * scale
        work[at + 3 * k + 2] = 2.0 * dd * scale * scale
    return low


@kernel
def evaluate(data: Array, layout: Record, first: Indices, u: float, v: float, work: Array, out: Matrix):
    """S, S_u, S_v, S_uu, S_uv, S_vv at a point of the domain into out (6,3). Workspace: at least 24 + 3 (p + q + 2)."""
    # values, first and second derivatives of the basis functions in both directions
    p, q, m = layout.degree_u, layout.degree_v, layout.columns
    at_u = 24
    at_v = at_u + 3 * (p + 1)
    su = _basis(data, 0, layout.spans_u, layout.matrices_u, p, u, work, at_u)
    sv = _basis(data, layout.ends_v, layout.spans_v, layout.matrices_v, q, v, work, at_v)
    i0 = first[su]
    j0 = first[layout.spans_u + sv]
    # sums with the homogeneous control points: (w S, w) and its derivatives
    for k in range(24):
        work[k] = 0.0
    for a in range(p + 1):
        base = layout.points + ((i0 + a) * m + j0) * 4
        n0, n1, n2 = work[at_u + 3 * a], work[at_u + 3 * a + 1], work[at_u + 3 * a + 2]
        for c in range(4):
            s0 = s1 = s2 = 0.0
            for b in range(q + 1):
                h = data[base + 4 * b + c]
                s0 += work[at_v + 3 * b] * h
                s1 += work[at_v + 3 * b + 1] * h
                s2 += work[at_v + 3 * b + 2] * h
            work[c] += n0 * s0
            work[4 + c] += n1 * s0
            work[8 + c] += n0 * s1
            work[12 + c] += n2 * s0
            work[16 + c] += n1 * s1
            work[20 + c] += n0 * s2
    # quotient rule
    w, wu, wv, wuu, wuv, wvv = work[3], work[7], work[11], work[15], work[19], work[23]
    inverse = 1.0 / w
    for c in range(3):
        s = work[c] * inverse
        su_ = (work[4 + c] - wu * s) * inverse
        sv_ = (work[8 + c] - wv * s) * inverse
        out[0, c] = s
        out[1, c] = su_
        out[2, c] = sv_
        out[3, c] = (work[12 + c] - 2.0 * wu * su_ - wuu * s) * inverse
        out[4, c] = (work[16 + c] - wu * sv_ - wv * su_ - wuv * s) * inverse
        out[5, c] = (work[20 + c] - 2.0 * wv * sv_ - wvv * s) * inverse


@kernel
def bounds(data: Array, layout: Record):
    """The domain: u from, u to, v from, v to."""
    b = layout.ends_v
    return data[0], data[layout.spans_u], data[b], data[b + layout.spans_v]


@kernel
def normal_of(data: Array, layout: Record, u: float, v: float, d: Matrix):
    """Outward unit normal at (u, v) from the derivatives d (6,3) there. At a pole or a collapsed border, where S_u or
    S_v vanishes, its derivative across the border replaces it. (0, 0, 1) if the normal is undefined."""
    u0, u1, v0, v1 = bounds(data, layout)
    a0, a1, a2 = d[1, 0], d[1, 1], d[1, 2]
    b0, b1, b2 = d[2, 0], d[2, 1], d[2, 2]
    twist = d[4, 0] * d[4, 0] + d[4, 1] * d[4, 1] + d[4, 2] * d[4, 2]
    if a0 * a0 + a1 * a1 + a2 * a2 < (POLE_LIMIT * (v1 - v0)) ** 2 * twist:
        sign = 1.0 if v - v0 <= v1 - v else -1.0
        a0, a1, a2 = sign * d[4, 0], sign * d[4, 1], sign * d[4, 2]
    elif b0 * b0 + b1 * b1 + b2 * b2 < (POLE_LIMIT * (u1 - u0)) ** 2 * twist:
        sign = 1.0 if u - u0 <= u1 - u else -1.0
        b0, b1, b2 = sign * d[4, 0], sign * d[4, 1], sign * d[4, 2]
    x, y, z = a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0
    length = np.sqrt(x * x + y * y + z * z)
    if length <= 1e-300:
        return 0.0, 0.0, 1.0
    return x / length, y / length, z / length


@kernel
def _derivatives(data: Array, layout: Record, first: Indices, u: Array, v: Array, out: Tensor):
    u0, u1, v0, v1 = bounds(data, layout)
    work = np.empty(24 + 3 * (layout.degree_u + layout.degree_v + 2))
    for k in range(len(u)):
        x = wrap(u[k], u0, u1, layout.closed_u)
        evaluate(data, layout, first, x, wrap(v[k], v0, v1, layout.closed_v), work, out[k])
