"""Contact of two deformable surfaces of one mesh, without friction or with Coulomb's, by an augmented Lagrangian.

Each integration point of the slave faces is projected to the nearest point of the master faces; gap g along the
master's normal, traction t = <l - e g> on the slave and its reaction on the master, as in `fe.contact.rigid`. Choose
the finer or the softer side as slave. T. A. Laursen, Computational Contact and Impact Mechanics, Springer 2002, ch. 5.
"""

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from palpate.compiler.kernel import kernel
from palpate.models.fe.contact import augmented
from palpate.models.fe.element import faces as face_rule
from palpate.models.fe.sparse.tangent import Pattern


@kernel
def _face_shape(x, y, value, slope):
    """Fill the shape functions (6) of a face and their natural derivatives (6,2) at (x, y)."""
    z = 1.0 - x - y
    value[0], value[1], value[2] = z * (2.0 * z - 1.0), x * (2.0 * x - 1.0), y * (2.0 * y - 1.0)
    value[3], value[4], value[5] = 4.0 * z * x, 4.0 * x * y, 4.0 * y * z
    slope[0, 0] = slope[0, 1] = 1.0 - 4.0 * z
    slope[1, 0], slope[1, 1], slope[2, 0], slope[2, 1] = 4.0 * x - 1.0, 0.0, 0.0, 4.0 * y - 1.0
    slope[3, 0], slope[3, 1] = 4.0 * (z - x), -4.0 * x
    slope[4, 0], slope[4, 1] = 4.0 * y, 4.0 * x
    slope[5, 0], slope[5, 1] = -4.0 * y, 4.0 * (z - y)


@kernel
def _place(x, y, points, face, shape, frame):
    """Fill a point of a face [m] (3), its derivatives by x and y [m] (3), and the shape functions there."""
    (value, slope), (at, e1, e2) = shape, frame
    _face_shape(x, y, value, slope)
    at[:], e1[:], e2[:] = 0.0, 0.0, 0.0
    for a in range(6):
        for i in range(3):
            at[i] += value[a] * points[face[a], i]
            e1[i] += slope[a, 0] * points[face[a], i]
            e2[i] += slope[a, 1] * points[face[a], i]


@kernel
def _project(point, points, face, value, slope, normal):
    """Nearest point of a face by Gauss-Newton within the triangle: distance [m], and its part along the normal [m]."""
    x, y = 1.0 / 3.0, 1.0 / 3.0
    at, e1, e2 = np.zeros(3), np.zeros(3), np.zeros(3)
    for _ in range(20):
        _place(x, y, points, face, (value, slope), (at, e1, e2))
        r = point - at
        a11, a12, a22 = np.dot(e1, e1), np.dot(e1, e2), np.dot(e2, e2)
        b1, b2 = np.dot(e1, r), np.dot(e2, r)
        det = max(a11 * a22 - a12 * a12, 1e-300)
        new_x = x + (a22 * b1 - a12 * b2) / det
        new_y = y + (a11 * b2 - a12 * b1) / det
        # active set: an edge that the step would cross is followed instead
        if new_x < 0.0:
            new_x = 0.0
            new_y = y + b2 / max(a22, 1e-300)
        if new_y < 0.0:
            new_y = 0.0
            new_x = x + b1 / max(a11, 1e-300)
        if new_x + new_y > 1.0:
            d = e1 - e2
            step = (np.dot(d, r) - (1.0 - x - y) * np.dot(d, e2)) / max(np.dot(d, d), 1e-300)
            new_x = x + step
            new_y = 1.0 - new_x
        new_x, new_y = min(max(new_x, 0.0), 1.0), min(max(new_y, 0.0), 1.0)
        if new_x + new_y > 1.0:
            new_y = 1.0 - new_x
        moved = abs(new_x - x) + abs(new_y - y)
        x, y = new_x, new_y
        if moved < 1e-12:
            break
    _place(x, y, points, face, (value, slope), (at, e1, e2))
    normal[:] = np.cross(e1, e2)
    normal /= max(np.sqrt(np.dot(normal, normal)), 1e-300)
    r = point - at
    return np.sqrt(np.dot(r, r)), np.dot(r, normal)


@kernel
def _nearest(point, points, faces, among, room, value, normal):
    """The nearest of the faces `among`, a list terminated by a negative number. Returns distance [m], face (-1: none)
    and gap [m]; fills `value` and `normal` with its shape functions (6) and normal (3) at the foot."""
    nearest, hit, gap = np.inf, -1, np.inf
    for b in range(len(among)):
        if among[b] < 0:
            break
        away, g = _project(point, points, faces[among[b]], *room)
        if away < nearest:
            nearest, hit, gap = away, among[b], g
            value[:], normal[:] = room[0], room[2]
    return nearest, hit, gap


@kernel
def _touch(points, start, faces, law, reach, given, traces, met, total, tangent, force, data):
    """Evaluate all points; adds to `force` [N] (N,3) and, if `tangent`, to the blocks `data` [N/m] (B,3,3).

    faces  of the slave (F,6) and the master (G,6); candidates (C,1 + n), a slave face and its possible master faces;
           the nodes that these couple (C,k), their blocks of the tangent (C,k,k); shape functions (6,6) and areas [m²]
           (F,6) of the slave's points
    law    penalty and coefficient of friction;  given  multipliers of normal traction and shear
    met    filled: master face (F,6) and its shape functions (F,6,6) at each foot
    """
    slave, master, candidates, cliques, where, value, area = faces
    penalty, friction = law
    multiplier, sliding = given
    traction, shear, gap, normals, slip = traces
    hits, feet = met
    n, best_n, x, q = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    m, slope, best_m, block = np.zeros(6), np.zeros((6, 2)), np.zeros(6), np.zeros((3, 3))
    share, spot = np.zeros(12), np.zeros(12, dtype=np.int64)
    total[:] = 0.0
    # x: a point of the slave; m, n: shape functions and normal at its foot on the master
    for c in range(len(candidates)):
        f = candidates[c, 0]
        for k in range(value.shape[0]):
            for i in range(3):
                x[i] = 0.0
                for a in range(6):
                    x[i] += value[k, a] * points[slave[f, a], i]
            nearest, hit, best_gap = _nearest(x, points, master, candidates[c, 1:], (m, slope, n), best_m, best_n)
            shear[f, k] = 0.0
            traction[f, k] = 0.0
            slip[f, k] = False
            # no contact past the rim of the master, where the nearest point is not along its normal
            if hit < 0 or nearest > reach or abs(best_gap) < 0.5 * nearest:
                gap[f, k] = np.inf
                continue
            gap[f, k] = best_gap
            # normal traction, augmented Lagrangian: t = max(lambda - penalty gap, 0)
            t = multiplier[f, k] - penalty * best_gap
            if not t > 0.0:
                continue
            traction[f, k], hits[f, k], normals[f, k], feet[f, k] = t, hit, best_n, best_m
            # the pair's 12 nodes: weights N_a of the slave, -N_a of the master; `spot` is their index in the clique
            for a in range(6):
                share[a], share[6 + a] = value[k, a], -best_m[a]
                for b in range(cliques.shape[1]):
                    if cliques[c, b] == slave[f, a]:
                        spot[a] = b
                    if cliques[c, b] == master[hit, a]:
                        spot[6 + a] = b
            # trial traction q from the slip in this step, limited to mu t
            cut, length = 0.0, 0.0
            if friction > 0.0:
                for i in range(3):
                    moved = 0.0
                    for a in range(12):
                        node = cliques[c, spot[a]]
                        moved += share[a] * (points[node, i] - start[node, i])
                    q[i] = sliding[f, k, i] - penalty * moved
                cut, length, slip[f, k] = augmented.cut_to_cone(q, best_n, friction * t, shear[f, k])
            # forces on both surfaces, equal and opposite
            w = area[f, k]
            for i in range(3):
                pull = w * (t * best_n[i] + shear[f, k, i])
                total[i] += pull
                for a in range(12):
                    force[cliques[c, spot[a]], i] -= share[a] * pull
            if not tangent:
                continue
            block[:] = 0.0
            augmented.add_tangent(penalty, best_n, q, cut, length, slip[f, k], block)
            for a in range(12):
                for b in range(12):
                    scale = w * share[a] * share[b]
                    for i in range(3):
                        for j in range(3):
                            data[where[c, spot[a], spot[b]], i, j] += scale * block[i, j]


def _pad_rows(rows: Sequence[Sequence[int] | np.ndarray]) -> np.ndarray:
    """Rows of different lengths as an array (R,n), padded with -1."""
    table = np.full((len(rows), max(map(len, rows), default=2)), -1, dtype=np.int64)
    for k, row in enumerate(rows):
        table[k, : len(row)] = row
    return table


class Pair(augmented.Augmented):
    """Two surfaces of the mesh that may touch.

    slave, master  (F,6), (G,6) outward boundary faces
    friction       Coulomb's coefficient [1] >= 0
    bound          [m] largest accepted penetration; 0: 1/2000 of the mean edge of the slave
    penalty        [Pa/m] initial value; 0: from the stiffness of the softer side
    """

    def __init__(
        self, slave: np.ndarray, master: np.ndarray, friction: float = 0.0, bound: float = 0.0, penalty: float = 0.0
    ) -> None:
        super().__init__(slave, friction, bound, penalty)
        self.master = augmented.checked_faces(master)
        self._candidates = self._cliques = _pad_rows([])

    def bind(self, points: np.ndarray, pattern: Pattern, stiffness: np.ndarray) -> None:
        self.clear(points)
        area = face_rule.areas(points, self.master)
        edge, wide = (np.sqrt(2.0 * x.sum() / len(x)) for x in (self.area, area))
        self._reach = 2.0 * max(edge, wide)
        if not self.penalty > 0.0:
            sides = (self.faces, self.area), (self.master, area)
            self.penalty = augmented.STIFF * min(augmented.stiffness_per_area(f, a, stiffness) for f, a in sides)
        size = self.area.shape
        self._hit, self._feet = np.zeros(size, dtype=np.int64), np.zeros((*size, 6))
        self.couple(pattern)

    def couple(self, pattern: Pattern) -> None:
        self._where = pattern.where(self._cliques)

    def couples(self) -> np.ndarray:
        """Nodes that this contact couples in addition to the elements (C,k), padded with -1."""
        return self._cliques

    def nodes(self) -> np.ndarray:
        return np.concatenate([self.faces, self.master])

    def begin(self, displacement: np.ndarray, load: float) -> None:
        """Start a load step from a converged state: search for faces that may touch."""
        self.remember()
        self._start = self.points + displacement
        tree = cKDTree(self._start[self.master[:, :3]].mean(axis=1))
        middle = self._start[self.faces[:, :3]].mean(axis=1)
        neighbours = tree.query_ball_point(middle, self._reach)
        near = [(f, hits) for f, hits in enumerate(neighbours) if hits]
        self._candidates = _pad_rows([[f, *sorted(hits)] for f, hits in near])
        self._cliques = _pad_rows([np.union1d(self.faces[f], self.master[hits]) for f, hits in near])

    def add(self, displacement: np.ndarray, load: float, tangent: bool, force: np.ndarray, data: np.ndarray) -> None:
        self.traction[:], self.shear[:], self.gap[:], self.slip[:] = 0.0, 0.0, np.inf, False
        faces = (self.faces, self.master, self._candidates, self._cliques, self._where, self.value, self.area)
        _touch(
            self.points + displacement, self._start, faces, (self.penalty, self.friction), self._reach,
            (self.multiplier, self.sliding), self.traces, (self._hit, self._feet), self.force, tangent, force, data,
        )  # fmt: skip

    def skew(self, change: np.ndarray, force: np.ndarray) -> None:
        if not self.slip.any():
            return
        slave = np.einsum("qa,fai->fqi", self.value, change[self.faces])
        master = np.einsum("fqa,fqai->fqi", self._feet, change[self.master[self._hit]])
        pull = self.area[..., None] * self.friction_slope(np.einsum("fqi,fqi->fq", self.normal, slave - master))
        np.add.at(force, self.faces, np.einsum("qa,fqi->fai", self.value, pull))
        np.add.at(force, self.master[self._hit], -self._feet[..., None] * pull[:, :, None])
