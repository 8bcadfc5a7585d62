"""A finite-element body in a few modes, nonlinear, with what the modes miss added as a local compliance.

    u = Phi q(p) + gamma R h/E,      p = Phi'h/E,      dW/dq = p,      tau dh/dt + h = f

Phi [m] (3V,r)  displacement of the surface in each mode; at rest the modes are orthonormal in the stiffness K0
W               their strain energy, sampled (`physics.sampled_energy`)
R [m/N]         C - Phi Phi', C the compliance of the whole surface at rest: positive semidefinite, since the
                Galerkin solution lies in a subspace. So a light touch is answered exactly, at every place
gamma [1]       (1 + w²/w0²)^((m - 1)/2), w² = h.R h/E²: as the body stiffens or softens, so does what the modes
                miss. w0 and m in [0, 2] are fitted to full solutions; beyond the loads of these gamma w is constant

The complementary energy V*(h) = E [max_q p.q - W(q) + G(w)], dG/dw = gamma w, is convex where W is, whatever R, w0
and m; u is its gradient. With backward Euler h <- (tau h + T f)/(T + tau) the load's work f.du is then at least the
growth of h.u - V*: the body is passive at a place.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from palpate.physics.archive import ArchiveError, read_arrays
from palpate.physics.bodies.condensed_body import FORGOTTEN, LEAST_FORCE
from palpate.physics.bodies.patch import barycentric, carried, normal_force, reaches, share_of
from palpate.physics.bodies.sampled_energy import Points, forces, scratch
from palpate.physics.bodies.sampled_solve import EACH, at_rest, settle
from palpate.physics.contact.spread import Spreader
from palpate.physics.contact.terminal import LEAST_DEPTH, fit_terminal
from palpate.physics.entry_point import NO_NODES, NO_VECTORS, entry_point
from palpate.physics.geometry.graded import ranges
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.mesh_closest import MeshClosestPoint
from palpate.physics.kernel import kernel
from palpate.physics.materials.hyperelastic import law, name_at, place_of

MOST_VERTICES = 2000
"""Of a surface that a body is condensed to, as of `deformation.ReducedFE.coarse`."""
UNNAMED = ("neo_hooke", "mooney_rivlin", "hencky")
"""Laws of a stored basis that does not name them."""


@dataclass(frozen=True)
class SampledBasis:
    """Modes of a body, its sampled points and its surface.

    vertices   [m]   (V,3) of the coarse surface, in the body's frame
    triangles  [1]   (T,3)
    residual_compliance  [m/N] (3V,3V) float32, R for a modulus of 1 Pa
    modes      [m]   (3V,r), Phi
    points     see `physics.sampled_energy`
    bend       [1]   (w0, m) of gamma, and w from which on gamma w is constant
    """

    vertices: np.ndarray
    triangles: np.ndarray
    residual_compliance: np.ndarray
    modes: np.ndarray
    points: Points
    bend: tuple[float, float, float]

    def save(self, path: Path, about: str = "") -> None:
        """Write it, R's lower half and all modes in half precision, and a text that says what it was made from."""
        kept = np.flatnonzero(np.abs(self.residual_compliance).sum(axis=1) > 0.0)  # held vertices have none
        block = self.residual_compliance[np.ix_(kept, kept)]
        halves = {"lower": block[np.tril_indices(len(kept))], "surface_modes": self.modes, "modes": self.points.modes}
        arrays: dict[str, Any] = {}
        for name, value in halves.items():
            scale = max(float(np.abs(value).max(initial=0.0)), 1e-300) / 3e4
            arrays |= {name: (value / scale).astype(np.float16), f"{name}_scale": np.float64(scale)}
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_name(path.name + ".part.npz")
        arrays |= {name: value for name, value in self.points._asdict().items() if name != "modes"}
        arrays["laws"] = np.array([name_at(place) for place in self.points.laws])
        np.savez_compressed(
            part,
            vertices=self.vertices,
            triangles=self.triangles,
            kept=kept,
            bend=np.array(self.bend),
            about=np.array(about),
            **arrays,
        )
        part.replace(path)

    @classmethod
    def load(cls, path: Path) -> SampledBasis:
        """Read a stored basis.

        ArchiveError: not a basis with sampled points, or a damaged one.
        """
        try:
            archive = read_arrays(path)
            size, kept = 3 * len(archive["vertices"]), archive["kept"]
            lower, surface_modes, modes = (
                archive[name].astype(np.float32) * np.float32(archive[f"{name}_scale"])
                for name in ("lower", "surface_modes", "modes")
            )
            if lower.size != len(kept) * (len(kept) + 1) // 2 or size > 3 * MOST_VERTICES:  # before room is made
                raise ValueError(f"{lower.size} compliances of {len(kept)}, {size // 3} vertices")
            half = np.zeros((len(kept), len(kept)), dtype=np.float32)
            half[np.tril_indices(len(kept))] = lower
            residual_compliance = np.zeros((size, size), dtype=np.float32)
            residual_compliance[np.ix_(kept, kept)] = half + np.tril(half, -1).T
            names = archive["laws"].tolist() if "laws" in archive else UNNAMED
            points = Points(
                modes, archive["weights"], archive["kinds"], archive["constants"], archive["springs"],
                float(archive["limit"]), np.array([place_of(law(name), name) for name in names]),
            )  # fmt: skip
            scale, power, most = archive["bend"].tolist()
            return cls(
                archive["vertices"], archive["triangles"], residual_compliance,
                surface_modes.astype(np.float64), points, (scale, power, most),
            )  # fmt: skip
        except (KeyError, ValueError, TypeError, AttributeError, IndexError, MemoryError) as error:
            raise ArchiveError(f"{path}: not a sampled basis: {error}. Rebuild it with `palpate reduce`") from None


class SampledModel(NamedTuple):
    """What a sampled body is made of: its basis, where the fine mesh lies on its surface, its material.

    residual_compliance, modes, points, bend, vertices  as in `SampledBasis`
    corners, weights  [1] (W,3)  vertices of the triangle that a vertex of the fine mesh lies on, and its share of each
    young [Pa], retardation [s]  E, tau
    """

    residual_compliance: np.ndarray
    modes: np.ndarray
    points: Points
    bend: tuple[float, float, float]
    vertices: np.ndarray
    corners: np.ndarray
    weights: np.ndarray
    young: float
    retardation: float


STIFFNESS, EXPONENT, FREE, NOW, GAMMA, ENERGY, LINEAR, ALLOWED, LENGTH = range(9)
"""Numbers that a body keeps: K, n, s_free and s of the law that was told, gamma, the energy of the modes, s of
the linear body, and the budget of `sampled_solve.settle`: evaluations, and length of the first step to try."""


class SampledBody:
    """The state of a sampled body under the contact.

    basis     its modes and points
    mesh      the surface that loads and displacements are given on, in the same frame
    young     [Pa] > 0, modulus E: all moduli of the body are E times those of the basis
    retardation  [s] >= 0, tau
    radius    [m] of the patch that the terminal law is taken over while nothing is loaded
    reach     [m] from the foot point within which all displacements are told, fewer farther off
    """

    def __init__(
        self, basis: SampledBasis, mesh: Mesh, young: float, retardation: float, radius: float, reach: float
    ) -> None:
        coarse = Mesh(basis.vertices, basis.triangles)
        foot, _, triangle, _ = MeshClosestPoint(coarse).find(mesh.vertices)
        self.corners, self.weights = barycentric(coarse, triangle, foot)
        self.basis, self.mesh = basis, mesh
        self._spreader = Spreader(mesh, radius, "biweight")
        self.young, self.retardation, self.reach = young, retardation, reach
        self._reaches, self._told = reaches(mesh.vertices, ranges(mesh.vertices, reach))
        edges = coarse.vertices[coarse.triangles]
        self._margin = float(np.linalg.norm(edges - np.roll(edges, 1, axis=1), axis=2).max())
        count, r = len(basis.vertices), basis.modes.shape[1]
        self._model = SampledModel(
            basis.residual_compliance, basis.modes, basis.points, basis.bend, basis.vertices, self.corners,
            self.weights, young, retardation,
        )  # fmt: skip
        self._fields, self._active = np.zeros((4, count, 3)), np.zeros(count, dtype=np.int64)
        self._vectors, self._matrices = np.zeros((9, r)), np.stack([np.eye(r), np.zeros((r, r)), np.zeros((r, r))])
        self.held, self.q = self._fields[0], self._vectors[1]
        """Loads that the displacement follows, h [N] (V,3), and the amounts of the modes."""
        self.measure = self._fields[2]
        """Shares of the normal force (V,3) in the last step: its product with displacements is the indentation."""
        self._numbers = np.zeros(9)
        self._numbers[LENGTH] = 1.0
        self._scratch = scratch(basis.points)
        self._nodes = np.zeros(len(mesh.vertices), dtype=np.int32)
        self._moved = np.zeros((len(mesh.vertices), 3))
        self._step = entry_point(
            _step, self._model, NO_NODES, NO_VECTORS, 0.0, (0.0, 0.0, 0.0), 0.0, self._fields, self._active,
            self._vectors, self._matrices, self._scratch, self._numbers,
        )  # fmt: skip
        self.evaluations = 0
        """Evaluations of the energy in the last step."""
        self.settled = True
        """Whether the last step reached equilibrium; what it left over is left to the next."""

    def step(
        self, nodes: np.ndarray, forces: np.ndarray, foot: tuple, normal: tuple, dt: float
    ) -> tuple[float, float, float, float]:
        """One step of dt > 0 [s] under nodal forces [N] (k,3): K, n and s_free of the next step's terminal law, and the
        indentation now [m].

        The indentation is the mean of -n.u over the patch, weighted as the force is, so that force times indentation
        is the work done on the body.
        """
        if len(nodes) == 0:
            count = self._spreader.spread(foot, normal, (-normal[0], -normal[1], -normal[2]))
            patch, pull, share = self._spreader.nodes[:count], self._spreader.forces[:count], 0.0
        else:
            patch, pull, share = nodes, forces, 1.0
        self.evaluations, self.settled = self._step(
            self._model, patch, pull, share, normal, dt, self._fields, self._active, self._vectors, self._matrices,
            self._scratch, self._numbers,
        )  # fmt: skip
        stiffness, exponent, free, now = self._numbers[:GAMMA].tolist()
        return stiffness, exponent, free, now

    @property
    def extrapolation(self) -> float:
        """How far |q| is beyond the greatest of the full solutions, where half the root of the barrier's limit lies:
        0 within, 1 where the barrier begins."""
        return max(2.0 * float(np.sqrt(self.q @ self.q / self.basis.points.limit)) - 1.0, 0.0)

    @property
    def linear(self) -> float:
        """[m] Indentation of the linear body under the loads that are held."""
        return float(self._numbers[LINEAR])

    def left_over(self, measure: np.ndarray) -> float:
        """[m] How much farther the indentation would go with the next iteration; measure [m] (r,) in modes."""
        p, _, g = self._vectors[:3]
        return float(measure @ (self._matrices[0] @ (p - g)))

    def take_over(self, other: SampledBody, held: np.ndarray, p: np.ndarray) -> None:
        """Go on where another body of the same modes, more or fewer of them, is: with loads that are `held`, h [N]
        (V,3), of which p [m] (r,) is the share of all modes. What that one lacks gives way as its gamma says; the rest
        and its tangent are as they are."""
        both, gam = min(len(self.q), len(other.q)), float(other._numbers[GAMMA])
        self.held[:] = held
        self.q[:both] = other.q[:both]
        self.q[both:] = gam * p[both : len(self.q)]
        inverse = self._matrices[0]
        inverse[:] = gam * np.eye(len(self.q))
        inverse[:both, :both] = other._matrices[0, :both, :both]
        gradient = self._vectors[2]
        energy = forces(self.basis.points, self.q, self._scratch, gradient)
        if not energy < np.inf:  # what was added turned a point inside out
            self.q[both:] = 0.0
            energy = forces(self.basis.points, self.q, self._scratch, gradient)
        if not energy < np.inf:
            self.q[:] = 0.0
            energy = forces(self.basis.points, self.q, self._scratch, gradient)
        self._numbers[ENERGY], self._numbers[LENGTH] = energy, 1.0

    def displaced(self, foot: tuple) -> tuple[np.ndarray, np.ndarray]:
        """Vertices of the mesh, all near the foot point and fewer farther off, and their displacements [m] (k,3)."""
        count = _displaced(
            self._model, self._reaches, self._told, np.array([foot]), self.reach, self._margin, self._fields,
            self._active, self.q, float(self._numbers[GAMMA]), self._nodes, self._moved,
        )  # fmt: skip
        return self._nodes[:count], self._moved[:count]


@kernel(error_model="numpy")
def gamma(square, scale, power, most):
    """gamma [1] at `square` = w² [1], and its derivative by w over w; gamma w is constant from w = most on.

    gamma = (1 + (w/scale)²)^((power - 1)/2)
    """
    if square > most * most:
        x = 1.0 + (most / scale) ** 2
        value = x ** (0.5 * (power - 1.0)) * most / np.sqrt(square)
        return value, -value / square
    x = 1.0 + square / (scale * scale)
    return x ** (0.5 * (power - 1.0)), (power - 1.0) / (scale * scale) * x ** (0.5 * (power - 3.0))


@kernel(error_model="numpy")
def _gather(corners, weights, patch, pull, share, normal, load, measure):
    """Load and shares of the normal force on the coarse vertices; the normal force [N]."""
    load[:] = 0.0
    measure[:] = 0.0
    total = normal_force(pull, normal)
    for k in range(len(patch)):
        v = patch[k]
        part = share_of(k, pull, normal, total)
        for a in range(3):
            w = weights[v, a]
            for i in range(3):
                measure[corners[v, a], i] -= w * part * normal[i]
                load[corners[v, a], i] += share * w * pull[k, i]
    return max(total, 0.0) * share


@kernel(error_model="numpy")
def _residual_displacement(residual_compliance, x, active, count, v):
    """R x at one vertex, x (V,3) zero but where it is active."""
    row0, row1, row2 = residual_compliance[3 * v], residual_compliance[3 * v + 1], residual_compliance[3 * v + 2]
    out0 = out1 = out2 = 0.0
    for k in range(count):
        b = 3 * active[k]
        x0, x1, x2 = x[active[k], 0], x[active[k], 1], x[active[k], 2]
        out0 += row0[b] * x0 + row0[b + 1] * x1 + row0[b + 2] * x2
        out1 += row1[b] * x0 + row1[b + 1] * x1 + row1[b + 2] * x2
        out2 += row2[b] * x0 + row2[b + 1] * x1 + row2[b + 2] * x2
    return out0, out1, out2


@kernel(error_model="numpy")
def _apply_residual_compliance(residual_compliance, x, active, count, out):
    """R x (V,3) at the vertices where the measure or the load is."""
    for k in range(count):
        v = active[k]
        out[v, 0], out[v, 1], out[v, 2] = _residual_displacement(residual_compliance, x, active, count, v)


@kernel(error_model="numpy")
def _project(modes, x, active, count, out):
    """Phi'x (r,)."""
    out[:] = 0.0
    for k in range(count):
        v = active[k]
        for i in range(3):
            if x[v, i] != 0.0:
                for m in range(len(out)):
                    out[m] += modes[3 * v + i, m] * x[v, i]


@kernel(error_model="numpy")
def _dot(x, y, active, count):
    total = 0.0
    for k in range(count):
        v = active[k]
        total += x[v, 0] * y[v, 0] + x[v, 1] * y[v, 1] + x[v, 2] * y[v, 2]
    return total


@kernel(error_model="numpy")
def _step(model, patch, pull, share, normal, dt, fields, active, vectors, matrices, room, numbers):
    """`share` is 1 where `pull` is a load, 0 where it only marks the patch. Returns evaluations of the energy, and
    whether it settled.

    fields   [N]   (4,V,3)  h, the load, shares of the normal force; R times one of them
    active   [1]   (V,)     room for the vertices that hold load
    vectors  (9,r)          Phi'h/E, the modes' amounts q, the gradient of W there, and room
    matrices (3,r,r)        inverse of the tangent d2W/dq2, and room
    room, numbers           of the energy's evaluation; by their names
    """
    residual, modes, bend, young, retardation = (
        model.residual_compliance, model.modes, model.bend, model.young, model.retardation,
    )  # fmt: skip
    # history h of the load (Kelvin-Voigt retardation), and the vertices where anything acts
    held, load, measure, bent = fields[0], fields[1], fields[2], fields[3]
    p, q, g, inverse = vectors[0], vectors[1], vectors[2], matrices[0]
    force = _gather(model.corners, model.weights, patch, pull, share, normal, load, measure)
    keep, take = retardation / (dt + retardation), dt / (dt + retardation)
    count, holds = 0, False
    for v in range(len(held)):
        size = touched = 0.0
        for i in range(3):
            held[v, i] = keep * held[v, i] + take * load[v, i]
            size += abs(held[v, i])
            touched += abs(measure[v, i]) + abs(load[v, i])
        if size < FORGOTTEN:
            held[v] = 0.0
        else:
            holds = True
        if size >= FORGOTTEN or touched > 0.0:
            active[count] = v
            count += 1
    r = len(q)
    used, settled = 0, True
    # equilibrium of the modes, dW/dq = Phi'h/E
    budget = numbers[ALLOWED:]
    budget[0] = EACH
    if holds:
        _project(modes, held, active, count, p)
        for k in range(r):
            p[k] /= young
        numbers[ENERGY], used, settled = settle(
            model.points, room, p, q, g, inverse, matrices[1], matrices[2], vectors[3:], numbers[ENERGY], budget
        )
    else:  # at rest the tangent is known
        for k in range(r):
            p[k] = q[k] = g[k] = 0.0
        at_rest(inverse)
        numbers[ENERGY] = 0.0
    # static correction: compliance R outside the reduced basis, scaled by gamma of its own energy h.R h
    _apply_residual_compliance(residual, held, active, count, bent)
    strain = max(_dot(held, bent, active, count), 0.0) / (young * young)
    gam, dgam = gamma(strain, bend[0], bend[1], bend[2])
    m_R_h = _dot(measure, bent, active, count) / young  # measure.R h/E
    f_R_h = _dot(load, bent, active, count) / young
    c = vectors[7]  # Phi'm, the patch weights m in the modes
    _project(modes, measure, active, count, c)
    # indentation s, its compliance on the patch, and s of the linear body
    modal = compliance = modal_linear = 0.0
    K_inv_c = vectors[8]  # K^-1 c, K the tangent
    np.dot(inverse, c, K_inv_c)
    for k in range(r):
        compliance += c[k] * K_inv_c[k]
        modal += c[k] * q[k]
        modal_linear += c[k] * p[k]
    s = modal + gam * m_R_h
    m_D_h = 0.0  # measure.D h, D = d²V*
    for k in range(r):
        m_D_h += K_inv_c[k] * p[k]
    m_D_h += gam * m_R_h + dgam * m_R_h * strain
    numbers[GAMMA], numbers[LINEAR] = gam, modal_linear + m_R_h
    # the same for the unit normal force and for the rest of the load
    _apply_residual_compliance(residual, measure, active, count, bent)
    compliance = compliance / young + gam * _dot(measure, bent, active, count) / young + dgam * m_R_h * m_R_h / young
    tangential = 0.0
    if force > 0.0:
        m_D_f = gam * _dot(load, bent, active, count) / young
        m_D_f += dgam * m_R_h * f_R_h / young
        _project(modes, load, active, count, c)
        for k in range(r):
            m_D_f += K_inv_c[k] * c[k] / young
        tangential = m_D_f - compliance * force
    # along the ray t h from rest: its slope at rest is that of the body at rest
    free = _ray(keep, s, modal_linear + m_R_h, m_D_h) + take * tangential
    f_n = max(force, LEAST_FORCE)
    s_next = s + take * (f_n * compliance + tangential - m_D_h)
    slope = 1.0 / max(take * compliance, 1e-12)
    numbers[STIFFNESS], numbers[EXPONENT] = fit_terminal(free, max(s_next, free + LEAST_DEPTH), slope, f_n)
    numbers[FREE], numbers[NOW] = free, s
    return used, settled


@kernel(error_model="numpy")
def _ray(t, end, start_slope, end_slope):
    """The cubic from 0 to `end` with these slopes, held where they would let it turn back, at t in [0, 1]."""
    if not abs(end) > 0.0:
        return 0.0
    a, b = min(max(start_slope / end, 0.0), 3.0), min(max(end_slope / end, 0.0), 3.0)
    u = 1.0 - t
    return end * (t * t * (3.0 - 2.0 * t) + a * t * u * u - b * t * t * u)


@kernel(error_model="numpy")
def _displaced(model, reaches, room, feet, reach, margin, fields, active, q, more, nodes, moved):
    residual_compliance, points, held, u = model.residual_compliance, model.vertices, fields[0], fields[3]
    scale = more / model.young
    foot, count = feet[0], 0
    for v in range(len(held)):
        if held[v, 0] != 0.0 or held[v, 1] != 0.0 or held[v, 2] != 0.0:
            active[count] = v
            count += 1
    np.dot(model.modes, q, u.reshape(-1))
    far = (2.0 * reach + 1.5 * margin) ** 2  # the modes miss little but near the load
    for v in range(len(points)):
        d0, d1, d2 = points[v, 0] - foot[0], points[v, 1] - foot[1], points[v, 2] - foot[2]
        if d0 * d0 + d1 * d1 + d2 * d2 > far:
            continue
        out0, out1, out2 = _residual_displacement(residual_compliance, held, active, count, v)
        u[v, 0] += scale * out0
        u[v, 1] += scale * out1
        u[v, 2] += scale * out2
    return carried(model.corners, model.weights, u, reaches, feet, room, nodes, moved)
