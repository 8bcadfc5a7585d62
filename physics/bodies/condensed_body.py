"""A finite-element organ condensed to its surface, one implicit viscoelastic step at a time.

Full model: K u = f, linear, u displacements, f surface loads. Condensed to the vertices of a coarse surface mesh (loads
spread over the triangles round a vertex, displacements averaged the same way) it is

    u = C h/E,        tau dh/dt + h = f

C [m/N] (3V,3V) is the compliance for a modulus of 1 Pa, E the organ's modulus, tau the retardation time of a
Kelvin-Voigt solid whose damping is proportional to its stiffness. Backward Euler: h <- (tau h + T f)/(T + tau). C is
symmetric and positive, so a step is passive whatever its length: the work done on the body is at least the growth of
the energy h.C h/(2E) that it stores. Only the vertices that carry load now or did a few tau ago hold any h, so that a
step costs what the contact covers, not what the mesh holds.

With dents (`physics.dents`) the organ is nonlinear under the patch: u = dV*/dh instead of C h/E. Its V* is convex, so
the same step stays passive at a place: the load's work is at least the growth of h.u - V*.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numba
import numpy as np

from palpate.physics.archive import read_arrays
from palpate.physics.bodies.dents import SPACING, hat_moments, patch_radius, rise, risen
from palpate.physics.bodies.patch import barycentric, carried, normal_force, share_of
from palpate.physics.bodies.place_energy import Ground, along, held, softness, weight_slopes
from palpate.physics.contact.spread import Spreader
from palpate.physics.errors import PalpateError
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.mesh_closest import MeshClosestPoint

FORGOTTEN = 1e-9
"""[N] Remaining load below which a vertex is dropped."""
LEAST_FORCE = 1e-3
"""[N] Least force that the terminal law is taken at."""


class BasisError(PalpateError, ValueError):
    """A stored basis that cannot be used; says why."""


@dataclass(frozen=True)
class Basis:
    """Static condensation of an organ to its surface.

    vertices    [m]   (V,3) of the coarse surface, in the organ's frame
    triangles   [1]   (T,3)
    compliance  [m/N] (3V,3V) float32, for a modulus of 1 Pa
    dents       [1]   (V,L) see `physics.dents`; L = 0 where only the linear organ is known
    """

    vertices: np.ndarray
    triangles: np.ndarray
    compliance: np.ndarray
    dents: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))

    def save(self, path: Path, about: str = "") -> None:
        """Write the lower half in steps of the largest entry over 32767, high bytes and low ones apart: so they
        pack; and a text that says what it was made from."""
        step = float(np.abs(self.compliance).max()) / 32767
        lower = np.rint(self.compliance[np.tril_indices(len(self.compliance))] / step).astype("<i2")
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_name(path.name + ".part.npz")
        np.savez_compressed(
            part, vertices=self.vertices, triangles=self.triangles, step=np.float64(step),
            lower=np.ascontiguousarray(lower.view(np.uint8).reshape(-1, 2).T),
            dents=self.dents.astype(np.float32), about=np.array(about),
        )  # fmt: skip
        part.replace(path)

    @classmethod
    def load(cls, path: Path) -> Basis:
        """Read a stored basis.

        BasisError: not a basis, or a damaged one.
        """
        try:
            archive = read_arrays(path)
            vertices, triangles = archive["vertices"], archive["triangles"]
            size = 3 * len(vertices)
            lower = np.ascontiguousarray(archive["lower"].T).view("<i2").ravel()
            if lower.size != size * (size + 1) // 2:  # before room is made for all of the matrix
                raise ValueError(f"{lower.size} compliances for {len(vertices)} vertices")
            full = np.zeros((size, size), dtype=np.float32)
            full[np.tril_indices(size)] = lower * np.float32(archive["step"])
            dents = archive["dents"].astype(np.float64) if "dents" in archive else np.zeros((0, 0))
            if dents.size and (len(dents) != len(vertices) or not np.isfinite(dents).all()):
                raise ValueError(f"dents of shape {dents.shape} for {len(vertices)} vertices")
        except (KeyError, ValueError, TypeError, AttributeError, IndexError, MemoryError) as error:
            raise BasisError(f"{path}: not a reduced basis: {error}. Rebuild it with `palpate reduce`") from None
        full += np.tril(full, -1).T
        return cls(vertices, triangles, full, dents)


class Model(NamedTuple):
    """What a condensed body is made of.

    compliance, vertices, dents  as in `Basis`
    moments           of the hats of the coarse vertices, see `dents.hat_moments`
    corners, weights  [1] (W,3)  vertices of the triangle that a vertex of the fine mesh lies on, and its share of each
    young [Pa], retardation [s]  E, tau;  margin [m]  longest edge of the coarse surface
    """

    compliance: np.ndarray
    vertices: np.ndarray
    dents: np.ndarray
    moments: np.ndarray
    corners: np.ndarray
    weights: np.ndarray
    young: float
    retardation: float
    margin: float


COMPLIANCE, FREE, NOW, MORE, OWN, BEYOND = range(6)
"""Numbers that a body keeps: compliance [m/N], s_free and s [m] of the law that was told, the load [N] on the patch
that large displacement adds, compliance [m/N] of the linear body at rest, how far beyond the deepest press it is."""


class CondensedBody:
    """The state of a condensed organ under the contact.

    basis     compliance of the coarse surface
    mesh      the surface that loads and displacements are given on, in the same frame as `basis`
    young     [Pa] > 0, modulus E
    retardation  [s] >= 0, tau
    radius    [m] of the patch that the terminal law is taken over while nothing is loaded
    reach     [m] from the foot point within which displacements are computed
    """

    def __init__(self, basis: Basis, mesh: Mesh, young: float, retardation: float, radius: float, reach: float) -> None:
        coarse = Mesh(basis.vertices, basis.triangles)
        foot, _, triangle, _ = MeshClosestPoint(coarse).find(mesh.vertices)
        self.corners, self.weights = barycentric(coarse, triangle, foot)
        self.basis, self.mesh = basis, mesh
        self._spreader = Spreader(mesh, radius, "biweight")
        self.young, self.retardation, self.reach = young, retardation, reach
        count = len(basis.vertices)
        edges = coarse.vertices[coarse.triangles]
        margin = float(np.linalg.norm(edges - np.roll(edges, 1, axis=1), axis=2).max())
        self._count = self._touched = 0
        dents = basis.dents if basis.dents.size else np.zeros((count, 0))
        moments = hat_moments(coarse)
        self._model = Model(
            basis.compliance, basis.vertices, dents, moments, self.corners, self.weights, young, retardation, margin
        )
        self._fields, self._marks = np.zeros((4, count, 3)), np.zeros((2, count), dtype=np.int64)
        self._curve, self._numbers = np.zeros((2, dents.shape[1] + 1)), np.zeros(6)
        self.held = self._fields[0]
        """[N] (V,3) loads that the displacement follows, h."""
        self._normal = (0.0, 0.0, 0.0)
        slopes = weight_slopes(coarse, self.corners)
        soft = softness(coarse, basis.compliance, self._spreader, self.corners, self.weights)
        self._ground = Ground(basis.vertices, coarse.normals, moments, self.corners, slopes, soft, dents)
        self._patch, self._pull = np.zeros(0, dtype=np.int32), np.zeros((0, 3))
        self._slope, self._turning = np.zeros(3), np.zeros((3, 3))
        self._nodes = np.zeros(len(mesh.vertices), dtype=np.int32)
        self._moved = np.zeros((len(mesh.vertices), 3))

    def step(
        self, nodes: np.ndarray, forces: np.ndarray, foot: tuple, normal: tuple, dt: float
    ) -> tuple[float, float, float]:
        """One step of dt > 0 [s] under nodal forces [N] (k,3): (c, s_free, s), the next step's compliance [m/N] and
        free indentation [m] under the patch, and the indentation now [m].

        The indentation is the mean of -n.u over the patch, weighted as the force is, so that force times indentation
        is the work done on the body. With dents c is that of the chord to the next step's indentation at the present
        force (at least `LEAST_FORCE`), or that of the tangent there if it is greater, with the s_free that goes with
        it: so force and indentation there are the body's own, and contact that is solved against it settles.
        """
        if len(nodes) == 0:
            count = self._spreader.spread(foot, normal, (-normal[0], -normal[1], -normal[2]))
            patch, pull, share = self._spreader.nodes[:count], self._spreader.forces[:count], 0.0
        else:
            patch, pull, share = nodes, forces, 1.0
        self._count, self._touched = _step(
            self._model, patch, pull, share, normal, dt, self._fields, self._marks, self._curve, self._numbers,
            self._count,
        )  # fmt: skip
        self._normal = normal
        self._patch, self._pull = nodes, forces
        compliance, free, now = self._numbers[:MORE].tolist()
        return compliance, free, now

    @property
    def beyond(self) -> float:
        """How far the last step's indentation is beyond the deepest that the organ was pressed to: 0 within, 1 at
        twice that; 0 where only the linear organ is known."""
        return float(self._numbers[BEYOND])

    @property
    def still(self) -> bool:
        """Whether no vertex holds a load any more."""
        return self._count == 0

    def stored(self) -> float:
        """Energy [J] held under the last step's patch at its indentation, V(s) of `physics.bodies.place_energy`; what
        tangential loads and places left behind hold is not in it."""
        now, own = float(self._numbers[NOW]), float(self._numbers[OWN])
        if not (now > 0.0 and own > 0.0):
            return 0.0
        if not self._model.dents.shape[1]:
            return 0.5 * now * now / own
        _, _, measure, order = self._fields
        radius = patch_radius(self._model.vertices, self._model.moments, order[:, 0], self._touched, measure)
        return float(radius * radius / own * held(self._curve[0], self._curve[1], now / radius))

    def along(self) -> tuple[tuple[float, float, float], tuple[float, ...]]:
        """What the energy at the force of the last step gains along the surface [N] (3), and how the normal turns there
        [1/m] (9), row by row: see `physics.bodies.place_energy`."""
        _, _, measure, order = self._fields
        along(
            self._ground, order[:, 0], self._touched, measure, self._patch, self._pull, self._normal,
            float(self._numbers[OWN]), self._slope, self._turning,
        )  # fmt: skip
        x, y, z = self._slope.tolist()
        return (x, y, z), tuple(self._turning.ravel().tolist())

    def displaced(self, foot: tuple) -> tuple[np.ndarray, np.ndarray]:
        """Vertices of the mesh within reach of the foot point, and their displacements [m] (k,3)."""
        count = _displaced(
            self._model, self.mesh.vertices, foot, self.reach, self._fields, self._marks[0], self._count,
            self._touched, self._normal, float(self._numbers[MORE]), self._nodes, self._moved,
        )  # fmt: skip
        return self._nodes[:count], self._moved[:count]


@numba.njit(cache=True)
def _step(model, patch, pull, share, normal, dt, fields, marked, curve, numbers, count):
    """`share` is 1 where `pull` is a load, 0 where it only marks the patch. Returns how many vertices hold load, and
    how many the patch touches.

    fields  (4,V,3)    h [N]; the load, later the displacement; shares of the normal force; the vertices of the patch
    marked  [1] (2,V)  the vertices that hold load; 1 for each of these
    curve   (2,D+1)    knots and slopes of the indentation over that of the linear body
    """
    compliance, corners, weights = model.compliance, model.corners, model.weights
    dents, young = model.dents, model.young
    held, load, measure, order = fields[0], fields[1], fields[2], fields[3, :, 0]
    active, marks = marked[0], marked[1]
    touched = 0
    total = normal_force(pull, normal)
    for k in range(len(patch)):
        p = patch[k]
        part = share_of(k, pull, normal, total)
        for a in range(3):
            v = corners[p, a]
            if marks[v] < 2:  # 1: holds load, 2: touched now
                marks[v] += 2
                order[touched] = v
                touched += 1
                load[v] = 0.0
                measure[v] = 0.0
            w = weights[p, a]
            measure[v, 0] += w * part
            for i in range(3):
                load[v, i] += share * w * pull[k, i]
    keep, take = model.retardation / (dt + model.retardation), dt / (dt + model.retardation)
    for k in range(count):
        for i in range(3):
            held[active[k], i] *= keep
    for k in range(touched):
        v = int(order[k])
        marks[v] -= 2
        if share > 0.0:
            for i in range(3):
                held[v, i] += take * load[v, i]
            if marks[v] == 0:
                marks[v] = 1
                active[count] = v
                count += 1
    # drop what has faded
    kept = 0
    for k in range(count):
        v = active[k]
        if abs(held[v, 0]) + abs(held[v, 1]) + abs(held[v, 2]) < FORGOTTEN:
            held[v] = 0.0
            marks[v] = 0
        else:
            active[kept] = v
            kept += 1
    count = kept
    now, static, own = 0.0, 0.0, 0.0
    for k in range(touched):
        v = int(order[k])
        for i in range(3):
            side = -measure[v, 0] * normal[i]
            if side == 0.0:
                continue
            row = compliance[3 * v + i]
            for m in range(count):
                b = active[m]
                now += side * (row[3 * b] * held[b, 0] + row[3 * b + 1] * held[b, 1] + row[3 * b + 2] * held[b, 2])
            for m in range(touched):
                b = int(order[m])
                push = measure[b, 0]
                own -= side * push * (row[3 * b] * normal[0] + row[3 * b + 1] * normal[1] + row[3 * b + 2] * normal[2])
                if share > 0.0:
                    static += side * (
                        row[3 * b] * load[b, 0] + row[3 * b + 1] * load[b, 1] + row[3 * b + 2] * load[b, 2]
                    )
    now /= young
    static /= young
    own /= young
    aside = static - own * total if share > 0.0 and total > 0.0 else 0.0  # what the tangential load adds
    free = keep * now + take * aside
    numbers[COMPLIANCE], numbers[FREE], numbers[NOW] = take * own, free, now
    numbers[MORE], numbers[OWN], numbers[BEYOND] = 0.0, own, 0.0
    if dents.shape[1] == 0 or not own > 0.0:
        return count, touched
    radius = patch_radius(model.vertices, model.moments, order, touched, measure)
    knots, slopes = curve[0], curve[1]
    rise(dents, order, touched, measure, knots, slopes)
    force = max(total * share, LEAST_FORCE)
    numbers[NOW] = radius * risen(now / radius, knots, slopes)[0]
    numbers[FREE] = radius * risen(free / radius, knots, slopes)[0]
    end = SPACING * dents.shape[1]
    numbers[BEYOND] = max(numbers[NOW] / (radius * end) - 1.0, 0.0)
    then, slope = risen((free + take * own * force) / radius, knots, slopes)
    numbers[COMPLIANCE] = (radius * then - numbers[FREE]) / force
    # of a convex s(f): so contact comes to its force from above, and does not swing
    if slope * take * own > numbers[COMPLIANCE]:
        numbers[COMPLIANCE] = slope * take * own
        numbers[FREE] = radius * then - numbers[COMPLIANCE] * force
    numbers[MORE] = (numbers[NOW] - now) / own
    return count, touched


@numba.njit(cache=True)
def _displaced(model, vertices, foot, reach, fields, active, count, touched, normal, more, nodes, moved):
    """`more` [N] is the load on the patch that large displacement adds; the patch is the last step's."""
    compliance, points, held, u, share, order = (
        model.compliance, model.vertices, fields[0], fields[1], fields[2], fields[3, :, 0]
    )  # fmt: skip
    far = (reach + 1.5 * model.margin) ** 2
    for v in range(len(points)):
        d0, d1, d2 = points[v, 0] - foot[0], points[v, 1] - foot[1], points[v, 2] - foot[2]
        if d0 * d0 + d1 * d1 + d2 * d2 > far:
            continue
        for i in range(3):
            total = 0.0
            row = compliance[3 * v + i]
            for k in range(count):
                b = active[k]
                total += row[3 * b] * held[b, 0] + row[3 * b + 1] * held[b, 1] + row[3 * b + 2] * held[b, 2]
            if more != 0.0:
                for k in range(touched):
                    b = int(order[k])
                    along = row[3 * b] * normal[0] + row[3 * b + 1] * normal[1] + row[3 * b + 2] * normal[2]
                    total -= more * share[b, 0] * along
            u[v, i] = total / model.young
    return carried(model.corners, model.weights, u, vertices, foot, reach, nodes, moved)
