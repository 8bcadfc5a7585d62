"""Contact with a rigid body of any shape, without friction or with Coulomb's, by an augmented Lagrangian.

At each integration point of a face, with gap g, normal n and multiplier l, the normal traction (on undeformed area) is

    t = <l - e g>,      after convergence  l <- t,      until  max <-g>  is below the given bound.

Tangential traction: trial q = l_T - e s with the slip s of the load step; |q| is limited to mu t. The rigid body moves
and rotates; slip and q are components in its frame, so that a common rotation causes neither. The tangent omits the
dependence of the limit on t and is symmetric; `skew` adds this part to Newton's direction.
J. C. Simo, T. A. Laursen, Comput. Struct. 42 (1992) 97-116.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numba
import numpy as np
from numba import types
from scipy.sparse import csr_array

from palpate.compiler.kernel import kernel
from palpate.models.fe.contact.augmented import SMOOTH, STIFF, Augmented, add_tangent, cut_to_cone, stiffness_per_area
from palpate.models.fe.contact.switching import Switching
from palpate.models.fe.element.mesh import point_text
from palpate.models.fe.sparse.tangent import Pattern
from palpate.physics.materials.compiled import compile_law

LEAP = 0.1  # Additional depth in edges, within a load step, above which a rigid body has passed through the faces
LOOKS = 200  # Maximum number of places within a load step at which that is checked

Shape = Callable[..., float]
"""gap = shape(x, p, normal, curvature): signed distance [m] of the point x (3,) from the body, positive outside, with
its gradient into `normal` (3,) and its second derivative [1/m] into `curvature` (3,3); numba.njit."""
SHAPE = types.float64(*[types.float64[::1]] * 3, types.float64[:, ::1])


@numba.njit(cache=True)
def plane(x, p, normal, curvature):
    """Half-space below z = 0 of the frame with unit normal p[0:3]."""
    normal[:], curvature[:] = p, 0.0
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
def capsule(x, p, normal, curvature):
    """Cylinder of radius p[0] along z with rounded ends, its axis from z = -p[1] to p[1]."""
    z = x[2] - min(max(x[2], -p[1]), p[1])
    round_end = z != 0.0
    r = max(np.sqrt(x[0] * x[0] + x[1] * x[1] + z * z), 1e-300)
    normal[0], normal[1], normal[2] = x[0] / r, x[1] / r, z / r
    for i in range(3):
        for j in range(3):
            flat = (1.0 if i == j else 0.0) - normal[i] * normal[j]
            curvature[i, j] = flat / r if round_end or (i < 2 and j < 2) else 0.0
    return r - p[0]


NUMBERS: dict[Any, int] = {plane: 3, sphere: 1, capsule: 2}
"""Number of parameters of these shapes; a compiled function would read beyond the end of a shorter list."""


@kernel
def _touch(shape, p, points, mine, place, law, given, traces, total, tangent, force, data):
    """Evaluate all points; adds to `force` [N] (N,3) and, if `tangent`, to the blocks `data` [N/m] (B,3,3).

    mine   faces (F,6) that may touch, their blocks of the tangent (F,6,6), shape functions (6,6) and areas [m²] (F,6)
           of their points;  place  origin and rotation of the rigid body;  law  penalty and coefficient of friction
    given  multipliers of normal traction and shear, predicted normal traction, and positions before the step in the
           frame of the rigid body;  total (2,3)  filled: force [N] and moment [N m]
    """
    faces, where, value, area = mine
    move, turn = place
    penalty, friction = law
    multiplier, sliding, bend, before = given
    traction, shear, gap, normals, slip = traces
    normal, curvature, x, y = np.zeros(3), np.zeros((3, 3)), np.zeros(3), np.zeros(3)
    q, pull, block, half = np.zeros(3), np.zeros(3), np.zeros((3, 3)), np.zeros((3, 3))
    total[:] = 0.0
    # x: a point relative to the rigid body's origin; y: the same in its frame, in which `shape` gives the gap
    for f in range(len(faces)):
        for k in range(value.shape[0]):
            for i in range(3):
                x[i] = -move[i]
                for a in range(6):
                    x[i] += value[k, a] * points[faces[f, a], i]
            for i in range(3):
                y[i] = turn[0, i] * x[0] + turn[1, i] * x[1] + turn[2, i] * x[2]
            g = shape(y, p, normal, curvature)
            gap[f, k] = g
            for i in range(3):
                normals[f, k, i] = 0.0
                for j in range(3):
                    normals[f, k, i] += turn[i, j] * normal[j]
            # normal traction, augmented Lagrangian: t = max(lambda - penalty gap, 0)
            t = multiplier[f, k] - penalty * g
            shear[f, k] = 0.0
            slip[f, k] = False
            traction[f, k] = max(t, 0.0)
            if not t > 0.0:
                continue
            # trial traction q from the slip in this step, limited to mu t
            cut = length = 0.0
            if friction > 0.0:
                for i in range(3):
                    q[i] = sliding[f, k, i] - penalty * (y[i] - before[f, k, i])
                cut, length, slip[f, k] = cut_to_cone(q, normal, friction * t, shear[f, k])
            # force and moment on the rigid body, and the opposite force on the face's nodes
            w = area[f, k]
            for i in range(3):
                pull[i] = 0.0
                for j in range(3):
                    pull[i] += w * turn[i, j] * (t * normal[j] + shear[f, k, j])
            for i in range(3):
                i1, i2 = (i + 1) % 3, (i + 2) % 3
                total[0, i] += pull[i]
                total[1, i] += x[i1] * pull[i2] - x[i2] * pull[i1]
                for a in range(6):
                    force[faces[f, a], i] -= value[k, a] * pull[i]
            if not tangent:
                continue
            # tangent in the rigid body's frame; the curvature term uses the predicted traction if there is one
            bent = t if np.isnan(bend[f, k]) else bend[f, k]
            for i in range(3):
                for j in range(3):
                    block[i, j] = -bent * curvature[i, j]
            add_tangent(penalty, normal, q, cut, length, slip[f, k], block)
            # rotate into the world frame: R block R'
            for i in range(3):
                for j in range(3):
                    half[i, j] = turn[i, 0] * block[0, j] + turn[i, 1] * block[1, j] + turn[i, 2] * block[2, j]
            for i in range(3):
                for j in range(3):
                    block[i, j] = half[i, 0] * turn[j, 0] + half[i, 1] * turn[j, 1] + half[i, 2] * turn[j, 2]
            for a in range(6):
                for b in range(6):
                    scale = w * value[k, a] * value[k, b]
                    for i in range(3):
                        for j in range(3):
                            data[where[f, a, b], i, j] += scale * block[i, j]


@kernel
def _deepest(shape, points, move, turn, p):
    """Index of the point of (N,3) with the smallest gap, and this gap [m]."""
    normal, curvature, y = np.zeros(3), np.zeros((3, 3)), np.zeros(3)
    deepest, least = 0, np.inf
    for k in range(len(points)):
        for i in range(3):
            y[i] = 0.0
            for j in range(3):
                y[i] += turn[j, i] * (points[k, j] - move[j])
        g = shape(y, p, normal, curvature)
        if g < least:
            deepest, least = k, g
    return deepest, least


class RigidIndenter(Augmented):
    """A rigid body that moves along `path` and touches some faces of the mesh.

    faces       (F,6) outward boundary faces that may touch
    shape       signed distance, see `Shape`; `plane`, `sphere`, `capsule` or a custom function
    parameters  its numbers
    path        load -> position of the body's origin [m] (3), or a tuple of it and the rotation [1] (3,3) from the
                body's frame to the world's
    friction    Coulomb's coefficient [1] >= 0
    bound       [m] largest accepted penetration; 0: 1/2000 of the mean edge of the faces
    penalty     [Pa/m] initial value; 0: from the stiffness of the faces

    `shear` is in the frame of the rigid body.
    """

    def __init__(
        self,
        faces: np.ndarray,
        shape: Shape,
        parameters: Sequence[float] | np.ndarray,
        path: Callable[[float], Any],
        friction: float = 0.0,
        bound: float = 0.0,
        penalty: float = 0.0,
    ) -> None:
        super().__init__(faces, friction, bound, penalty)
        self.parameters, self.path = np.array(parameters, dtype=np.float64), path
        count = NUMBERS.get(shape, self.parameters.size)
        if self.parameters.shape != (count,) or not np.isfinite(self.parameters).all():
            name = getattr(shape, "__name__", "shape")
            raise ValueError(f"{name}: found parameters {self.parameters.tolist()}, expected {count} finite numbers")
        self._shape = compile_law(shape, SHAPE)
        self._turn = np.eye(3)

    def bind(self, points: np.ndarray, pattern: Pattern, stiffness: np.ndarray) -> None:
        self.clear(points)
        self.couple(pattern)
        if not self.penalty > 0.0:
            more = SMOOTH if self.friction == 0.0 else 1.0
            self.penalty = more * STIFF * stiffness_per_area(self.faces, self.area, stiffness)
        self.moment = np.zeros(3)  # Moment of `force` about the rigid body's origin [N m]
        self._before = np.zeros((*self.area.shape, 3))
        self._bend = np.full(self.area.shape, np.nan)

    def leapt(self, start: np.ndarray, load: float, end: np.ndarray, target: float) -> str:
        """As in `Augmented`; also if the rigid body passed through the faces within the step: it was deeper than at
        both ends by `LEAP` edges, relative to the faces at the start."""
        fault = super().leapt(start, load, end, target)
        if fault:
            return fault
        positions = self._touching_points(start)
        ends = [self.rigid_motion(load), self.rigid_motion(target)]
        before, after = ((positions - origin) @ turn for origin, turn in ends)
        pieces = min(int(np.ceil(2.0 * np.linalg.norm(after - before, axis=2).max() / self.edge)), LOOKS)
        if pieces < 2:
            return ""
        points = positions.reshape(-1, 3)
        least = min(_deepest(self._shape, points, *place, self.parameters)[1] for place in ends)
        for k in range(1, pieces):
            place = self.rigid_motion(load + k / pieces * (target - load))
            worst, gap = _deepest(self._shape, points, *place, self.parameters)
            if gap < least - LEAP * self.edge:
                return f"the rigid body passes through the surface at {point_text(points[worst])} within the step"
        return ""

    def _touching_points(self, displacement: np.ndarray) -> np.ndarray:
        return np.einsum("qa,fai->fqi", self.value, (self.points + displacement)[self.faces])

    def begin(self, displacement: np.ndarray, load: float) -> None:
        self.remember()
        self._bend = np.full(self.area.shape, np.nan) if self.friction > 0.0 else self.multiplier.copy()
        origin, turn = self.rigid_motion(load)
        self._before = (self._touching_points(displacement) - origin) @ turn

    def rigid_motion(self, load: float) -> tuple[np.ndarray, np.ndarray]:
        """Position of the rigid body's origin [m] (3) and its rotation (3,3). ValueError: the path returns others."""
        pose = self.path(load)
        origin, turn = pose if isinstance(pose, tuple) else (pose, np.eye(3))
        origin, turn = np.array(origin, dtype=np.float64), np.array(turn, dtype=np.float64)
        if origin.shape != (3,) or turn.shape != (3, 3) or not (np.isfinite(origin).all() and np.isfinite(turn).all()):
            raise ValueError(
                f"path at load {load:.6g}: found {pose!r}, expected a position [m] (3), or a position and a rotation "
                "(3,3), all finite"
            )
        if np.abs(turn @ turn.T - np.eye(3)).max() > 1e-6 or np.linalg.det(turn) < 0:
            raise ValueError(f"path at load {load:.6g}: {turn.tolist()} is not a rotation")
        return origin, turn

    def add(self, displacement: np.ndarray, load: float, tangent: bool, force: np.ndarray, data: np.ndarray) -> None:
        total = np.zeros((2, 3))
        place = self.rigid_motion(load)
        self._turn = place[1]
        _touch(
            self._shape, self.parameters, self.points + displacement, (self.faces, self._where, self.value, self.area),
            place, (self.penalty, self.friction), (self.multiplier, self.sliding, self._bend, self._before),
            self.traces, total, tangent, force, data,
        )  # fmt: skip
        self.force, self.moment = total

    def switching(self) -> Switching | None:
        """Its points, to update the active set within a step; None with friction."""
        if self.friction > 0.0:
            return None
        level = (self.multiplier - self.penalty * self.gap).ravel()
        share = self.value[None, :, :, None] * self.normal[:, :, None, :]
        column = np.broadcast_to((3 * self.faces[:, None, :, None] + np.arange(3)), share.shape)
        start = np.arange(level.size + 1) * 18
        rows = csr_array((share.ravel(), column.ravel(), start), shape=(level.size, self.points.size))
        return Switching(rows, level, np.full(level.size, self.penalty), self.area.ravel())

    def foresee(self, traction: np.ndarray) -> None:
        """Use these tractions [Pa] (P,) for the curvature term of the tangent. They have the right magnitude, whereas
        the penalty can make those of the next state 1000 times too large."""
        self._bend = traction.reshape(self.area.shape)

    def skew(self, change: np.ndarray, force: np.ndarray) -> None:
        if not self.slip.any():
            return
        pressed = np.einsum("fqi,qa,fai->fq", self.normal, self.value, change[self.faces])
        pull = self.area[..., None] * self.friction_slope(pressed) @ self._turn.T
        np.add.at(force, self.faces, np.einsum("qa,fqi->fai", self.value, pull))
