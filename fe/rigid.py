"""Contact with a rigid body of any shape, without friction or with Coulomb's, by an augmented Lagrangian.

At each integration point of a face, with gap g, normal n and multiplier l, the normal traction (on undeformed area) is

    t = <l - e g>,      after convergence  l <- t,      until  max <-g>  is below the stated bound.

Tangential traction: trial q = l_T - e s with the slip s of the load step; |q| is cut off at mu t. The cut-off's
dependence on t is left out of the tangent, which stays symmetric.
J. C. Simo, T. A. Laursen, Comput. Struct. 42 (1992) 97-116.
"""

from __future__ import annotations

from collections.abc import Callable

import numba
import numpy as np

from palpate.fe import faces as face_rule
from palpate.fe.augmented import Augmented
from palpate.fe.compiled import SHAPE, compiled
from palpate.fe.pattern import Pattern

Shape = Callable[..., float]
"""gap = shape(x, p, normal, curvature): signed distance [m] of the point x (3,) from the body, positive outside, with
its gradient into `normal` (3,) and its second derivative [1/m] into `curvature` (3,3); numba.njit."""


@numba.njit(cache=True)
def plane(x, p, normal, curvature):
    """Half-space below z = 0 of the frame with unit normal p[0:3]."""
    normal[:] = p[:3]
    curvature[:] = 0.0
    return x[0] * p[0] + x[1] * p[1] + x[2] * p[2]


@numba.njit(cache=True)
def sphere(x, p, normal, curvature):
    """Ball of radius p[0] about the origin."""
    r = max(np.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]), 1e-300)
    for i in range(3):
        normal[i] = x[i] / r
    for i in range(3):
        for j in range(3):
            curvature[i, j] = ((1.0 if i == j else 0.0) - normal[i] * normal[j]) / r
    return r - p[0]


@numba.njit(cache=True)
def _touch(
    shape, points, start, faces, value, area, move, before, p, penalty, friction, multiplier, sliding, traction, shear,
    gap, slip, total, tangent, where, force, data,
):  # fmt: skip
    normal, curvature, x = np.zeros(3), np.zeros((3, 3)), np.zeros(3)
    total[:] = 0.0
    d, s, q, block = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros((3, 3))
    for f in range(len(faces)):
        for k in range(value.shape[0]):
            for i in range(3):
                x[i], d[i] = -move[i], before[i] - move[i]
                for a in range(6):
                    x[i] += value[k, a] * points[faces[f, a], i]
                    d[i] += value[k, a] * (points[faces[f, a], i] - start[faces[f, a], i])
            g = shape(x, p, normal, curvature)
            gap[f, k] = g
            t = multiplier[f, k] - penalty * g
            shear[f, k] = 0.0
            slip[f, k] = False
            if not t > 0.0:
                traction[f, k] = 0.0
                continue
            traction[f, k] = t
            along = normal[0] * d[0] + normal[1] * d[1] + normal[2] * d[2]
            cut = 0.0
            length = 0.0
            if friction > 0.0:
                for i in range(3):
                    s[i] = d[i] - along * normal[i]
                    q[i] = sliding[f, k, i] - penalty * s[i]
                along = normal[0] * q[0] + normal[1] * q[1] + normal[2] * q[2]
                for i in range(3):
                    q[i] -= along * normal[i]
                length = np.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2])
                cut = 1.0
                if length > friction * t:
                    cut = friction * t / length
                    slip[f, k] = True
                for i in range(3):
                    shear[f, k, i] = cut * q[i]
            w = area[f, k]
            for i in range(3):
                total[i] += w * (t * normal[i] + shear[f, k, i])
            for a in range(6):
                for i in range(3):
                    force[faces[f, a], i] -= w * value[k, a] * (t * normal[i] + shear[f, k, i])
            if not tangent:
                continue
            for i in range(3):
                for j in range(3):
                    square = normal[i] * normal[j]
                    block[i, j] = penalty * square - t * curvature[i, j]
                    if friction > 0.0:
                        x_ij = (1.0 if i == j else 0.0) - square
                        if slip[f, k]:
                            x_ij -= q[i] * q[j] / (length * length)
                        block[i, j] += penalty * cut * x_ij
            for a in range(6):
                for b in range(6):
                    scale = w * value[k, a] * value[k, b]
                    for i in range(3):
                        for j in range(3):
                            data[where[f, a, b], i, j] += scale * block[i, j]


class Rigid(Augmented):
    """A rigid body that moves along `path` and touches some faces of the mesh.

    faces       (F,6) outward boundary faces that may touch
    shape       signed distance, see `Shape`; `plane`, `sphere` or an own function
    parameters  its numbers
    path        load -> place of the body's origin [m] (3)
    friction    Coulomb's coefficient [1] >= 0
    bound       [m] greatest penetration that is left; 0: 1/2000 of the mean edge of the faces
    penalty     [Pa/m] to begin with; 0: from the stiffness of the faces
    """

    def __init__(
        self,
        faces: np.ndarray,
        shape: Shape,
        parameters: tuple[float, ...],
        path: Callable[[float], np.ndarray],
        friction: float = 0.0,
        bound: float = 0.0,
        penalty: float = 0.0,
    ) -> None:
        if not friction >= 0.0:
            raise ValueError(f"friction {friction}: expected a number >= 0")
        self.faces = np.ascontiguousarray(faces)
        self.parameters = np.array(parameters, dtype=np.float64)
        self.path = path
        self.friction = float(friction)
        self.bound = bound
        self.penalty = penalty
        self._shape = compiled(shape, SHAPE)
        self._value, _ = face_rule.shape(face_rule.POINTS)

    def bind(self, points: np.ndarray, pattern: Pattern, stiffness: np.ndarray) -> None:
        """Make the state for a mesh whose nodes have this stiffness [N/m] (N,)."""
        self.points = points
        self.area = face_rule.areas(points, self.faces)
        self.couple(pattern)
        edge = np.sqrt(2.0 * self.area.sum() / len(self.faces))
        if not self.bound > 0.0:
            self.bound = edge / 2000.0
        if not self.penalty > 0.0:
            nodes = np.unique(self.faces)
            self.penalty = 10.0 * float(np.median(stiffness[nodes])) * len(nodes) / self.area.sum()
        size = self.area.shape
        self.multiplier = np.zeros(size)
        self.sliding = np.zeros((*size, 3))
        self.traction = np.zeros(size)
        self.shear = np.zeros((*size, 3))
        self.gap = np.full(size, np.inf)
        self.slip = np.zeros(size, dtype=bool)
        self.force = np.zeros(3)
        """Force of the rigid body on the mesh [N]."""
        self._start = points.copy()
        self._before: np.ndarray | None = None

    def couple(self, pattern: Pattern) -> None:
        """Take up a new pattern."""
        self._where = pattern.where(self.faces)

    def couples(self) -> np.ndarray:
        """Nodes that this contact couples beyond the elements (C,k)."""
        return np.zeros((0, 6), dtype=np.int64)

    def begin(self, displacement: np.ndarray, load: float) -> None:
        """Start of a load step from a converged state."""
        self._start = self.points + displacement
        self._before = np.asarray(self.path(load), dtype=np.float64)
        self._saved = self.multiplier.copy(), self.sliding.copy()

    def back(self) -> None:
        """Forget a load step that failed."""
        self.multiplier, self.sliding = (x.copy() for x in self._saved)

    def add(self, displacement: np.ndarray, load: float, tangent: bool, force: np.ndarray, data: np.ndarray) -> None:
        """Add the contact to the residual (N,3) and, if asked, to the tangent's blocks."""
        move = np.asarray(self.path(load), dtype=np.float64)
        _touch(
            self._shape, self.points + displacement, self._start, self.faces, self._value, self.area, move,
            self._before, self.parameters, self.penalty, self.friction, self.multiplier, self.sliding, self.traction,
            self.shear, self.gap, self.slip, self.force, tangent, self._where, force, data,
        )  # fmt: skip

    def contact_area(self, displacement: np.ndarray) -> float:
        """Deformed area of the integration points that carry pressure or are closed to within the bound [m²]."""
        closed = (self.traction > 0.0) | (self.gap <= self.bound)
        return float(face_rule.areas(self.points + displacement, self.faces)[closed].sum())
