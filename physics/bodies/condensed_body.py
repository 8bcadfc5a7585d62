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

import zipfile
import zlib
from dataclasses import dataclass, field
from pathlib import Path

import numba
import numpy as np

from palpate.physics.bodies.dents import SPACING, hat_moments, patch_radius, rise, risen
from palpate.physics.bodies.patch import barycentric, carried, normal_force, share_of
from palpate.physics.bodies.place_energy import Ground, along, softness, weight_slopes
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
            with np.load(path) as found:
                vertices, triangles = found["vertices"], found["triangles"]
                size = 3 * len(vertices)
                full = np.zeros((size, size), dtype=np.float32)
                lower = np.ascontiguousarray(found["lower"].T).view("<i2").ravel()
                full[np.tril_indices(size)] = lower * np.float32(found["step"])
                dents = found["dents"].astype(np.float64) if "dents" in found else np.zeros((0, 0))
                if dents.size and (len(dents) != len(vertices) or not np.isfinite(dents).all()):
                    raise ValueError(f"dents of shape {dents.shape} for {len(vertices)} vertices")
        except (OSError, KeyError, ValueError, EOFError, zlib.error, zipfile.BadZipFile) as error:
            raise BasisError(f"{path}: not a reduced basis: {error}. Rebuild it with `palpate reduce`") from None
        full += np.tril(full, -1).T
        return cls(vertices, triangles, full, dents)


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
        self._margin = float(np.linalg.norm(edges - np.roll(edges, 1, axis=1), axis=2).max())
        self.held = np.zeros((count, 3))
        """[N] (V,3) loads that the displacement follows, h."""
        self._active = np.zeros(count, dtype=np.int64)
        self._state = np.zeros(count, dtype=np.int64)
        self._count = 0
        self._work = np.zeros((3, count, 3))
        self._dents = basis.dents if basis.dents.size else np.zeros((count, 0))
        self._moments = hat_moments(coarse)
        self._curve = np.zeros((2, self._dents.shape[1] + 1))
        self._found = np.zeros(6)
        self._touched = 0
        self._normal = (0.0, 0.0, 0.0)
        slopes = weight_slopes(coarse, self.corners)
        soft = softness(coarse, basis.compliance, self._spreader, self.corners, self.weights)
        self._ground = Ground(basis.vertices, coarse.normals, self._moments, self.corners, slopes, soft, self._dents)
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
            self.basis.compliance, self.corners, self.weights, patch, pull, share, normal, dt, self.young,
            self.retardation, self.held, self._active, self._state, self._count, self._work, self._found,
            self.basis.vertices, self._moments, self._dents, self._curve,
        )  # fmt: skip
        self._normal = normal
        self._patch, self._pull = nodes, forces
        return float(self._found[0]), float(self._found[1]), float(self._found[2])

    @property
    def beyond(self) -> float:
        """How far the last step's indentation is beyond the deepest that the organ was pressed to: 0 within, 1 at
        twice that; 0 where only the linear organ is known."""
        return float(self._found[5])

    def along(self) -> tuple[tuple[float, float, float], tuple[float, ...]]:
        """What the energy at the force of the last step gains along the surface [N] (3), and how the normal turns there
        [1/m] (9), row by row: see `physics.bodies.place_energy`."""
        along(
            self._ground, self._work[2, :, 0], self._touched, self._work[1], self._patch, self._pull, self._normal,
            float(self._found[4]), self._slope, self._turning,
        )  # fmt: skip
        x, y, z = self._slope.tolist()
        return (x, y, z), tuple(self._turning.ravel().tolist())

    def displaced(self, foot: tuple) -> tuple[np.ndarray, np.ndarray]:
        """Vertices of the mesh within reach of the foot point, and their displacements [m] (k,3)."""
        count = _displaced(
            self.basis.compliance, self.basis.vertices, self.corners, self.weights, self.mesh.vertices, foot,
            self.reach, self._margin, self.young, self.held, self._active, self._count, self._work, self._nodes,
            self._moved, self._touched, self._normal, float(self._found[3]),
        )  # fmt: skip
        return self._nodes[:count], self._moved[:count]


@numba.njit(cache=True)
def _step(
    compliance, corners, weights, patch, pull, share, normal, dt, young, retardation, held, active, state, count,
    work, found, points, moments, dents, curve,
):  # fmt: skip
    """`share` is 1 where `pull` is a load, 0 where it only marks the patch. Returns how many vertices hold load, and
    how many the patch touches."""
    load, measure = work[0], work[1]
    touched = 0
    order = work[2, :, 0]
    total = normal_force(pull, normal)
    for k in range(len(patch)):
        p = patch[k]
        part = share_of(k, pull, normal, total)
        for a in range(3):
            v = corners[p, a]
            if state[v] < 2:  # 1: holds load, 2: touched now
                state[v] += 2
                order[touched] = v
                touched += 1
                load[v] = 0.0
                measure[v] = 0.0
            w = weights[p, a]
            measure[v, 0] += w * part
            for i in range(3):
                load[v, i] += share * w * pull[k, i]
    keep, take = retardation / (dt + retardation), dt / (dt + retardation)
    for k in range(count):
        for i in range(3):
            held[active[k], i] *= keep
    for k in range(touched):
        v = int(order[k])
        state[v] -= 2
        if share > 0.0:
            for i in range(3):
                held[v, i] += take * load[v, i]
            if state[v] == 0:
                state[v] = 1
                active[count] = v
                count += 1
    # drop what has faded
    kept = 0
    for k in range(count):
        v = active[k]
        if abs(held[v, 0]) + abs(held[v, 1]) + abs(held[v, 2]) < FORGOTTEN:
            held[v] = 0.0
            state[v] = 0
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
    found[0], found[1], found[2], found[3] = take * own, free, now, 0.0
    found[4], found[5] = own, 0.0
    if dents.shape[1] == 0 or not own > 0.0:
        return count, touched
    radius = patch_radius(points, moments, order, touched, measure)
    knots, slopes = curve[0], curve[1]
    rise(dents, order, touched, measure, knots, slopes)
    force = max(total * share, LEAST_FORCE)
    found[2] = radius * risen(now / radius, knots, slopes)[0]
    found[1] = radius * risen(free / radius, knots, slopes)[0]
    end = SPACING * dents.shape[1]
    found[5] = max(found[2] / (radius * end) - 1.0, 0.0)
    then, slope = risen((free + take * own * force) / radius, knots, slopes)
    found[0] = (radius * then - found[1]) / force
    if slope * take * own > found[0]:  # of a convex s(f): so contact comes to its force from above, and does not swing
        found[0] = slope * take * own
        found[1] = radius * then - found[0] * force
    found[3] = (found[2] - now) / own
    return count, touched


@numba.njit(cache=True)
def _displaced(
    compliance, points, corners, weights, vertices, foot, reach, margin, young, held, active, count, work, nodes, moved,
    touched, normal, more,
):  # fmt: skip
    """`more` [N] is the load on the patch that large displacement adds; the patch is the last step's, in `work`."""
    u, share, order = work[0], work[1], work[2, :, 0]
    far = (reach + 1.5 * margin) ** 2
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
            u[v, i] = total / young
    return carried(corners, weights, u, vertices, foot, reach, nodes, moved)
