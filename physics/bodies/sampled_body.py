"""A finite-element body in a few modes, nonlinear, with what the modes miss added as a local compliance.

    u = Phi q(p) + gamma R h/E,      p = Phi'h/E,      dW/dq = p,      tau dh/dt + h = f

Phi [m] (3V,r)  displacement of the surface in each mode; at rest the modes are orthonormal in the stiffness K0
W               their strain energy, sampled (`sampled.energy`)
R [m/N]         C - Phi Phi' >= 0, C the compliance of the whole surface at rest: a light touch is answered exactly
gamma [1]       (1 + w²/w0²)^((m - 1)/2), w² = h.R h/E²: as the body stiffens or softens, so does what the modes
                miss. w0 and m in [0, 2] are fitted to full solutions; beyond the loads of these gamma w is constant

The complementary energy V*(h) = E [max_q p.q - W(q) + G(w)], dG/dw = gamma w, is convex where W is; u is its
gradient. With backward Euler h <- (tau h + T f)/(T + tau) the body is passive at a place: f.du is at least the
growth of h.u - V*.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from palpate.physics.archive import ArchiveError, read_arrays, replacing
from palpate.physics.bodies.patch import ALONE, CoarseBody, Law, Pressed, carried
from palpate.physics.bodies.sampled.contacts import SampledContacts, coupling_of, laws_of, step_all, together
from palpate.physics.bodies.sampled.energy import Points, scratch
from palpate.physics.bodies.sampled.step import GAMMA, LENGTH, SampledModel, field, step
from palpate.physics.entry_point import NO_NODES, NO_VECTORS, entry_point
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.materials.hyperelastic import law, name_at, place_of

MOST_VERTICES = 2000  # Of a surface that a body is condensed to, as of `deformation.ReducedFE.coarse`
UNNAMED = ("neo_hooke", "mooney_rivlin", "hencky")  # Laws of a stored basis that does not name them


@dataclass(frozen=True)
class SampledBasis:
    """Modes of a body, its sampled points and its surface."""

    vertices: np.ndarray  # [m] (V,3) of the coarse surface, in the body's frame
    triangles: np.ndarray  # [1] (T,3)
    residual_compliance: np.ndarray  # [m/N] (3V,3V) float32, R for a modulus of 1 Pa
    modes: np.ndarray  # [m] (3V,r), Phi
    points: Points  # see `sampled.energy`
    bend: tuple[float, float, float]  # [1] (w0, m) of gamma, and w from which on gamma w is constant

    def save(self, path: Path, about: str = "") -> None:
        """Write it, R's lower half and all modes in half precision, and a text that says what it was made from."""
        kept = np.flatnonzero(np.abs(self.residual_compliance).sum(axis=1) > 0.0)  # held vertices have none
        block = self.residual_compliance[np.ix_(kept, kept)]
        halves = {"lower": block[np.tril_indices(len(kept))], "surface_modes": self.modes, "modes": self.points.modes}
        arrays: dict[str, Any] = {}
        for name, value in halves.items():
            scale = max(float(np.abs(value).max(initial=0.0)), 1e-300) / 3e4
            arrays |= {name: (value / scale).astype(np.float16), f"{name}_scale": np.float64(scale)}
        arrays |= {name: value for name, value in self.points._asdict().items() if name != "modes"}
        arrays["laws"] = np.array([name_at(place) for place in self.points.laws])
        with replacing(path) as part, part.open("wb") as file:
            np.savez_compressed(
                file, vertices=self.vertices, triangles=self.triangles, kept=kept, bend=np.array(self.bend),
                about=np.array(about), **arrays,
            )  # fmt: skip

    @classmethod
    def load(cls, path: Path) -> SampledBasis:
        """Read a stored basis. ArchiveError: not a basis with sampled points, or a damaged one."""
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
            raise ArchiveError(f"{path}: not a sampled basis: {error}. Rebuild it with `palpate build basis`") from None


class SampledBody(CoarseBody):
    """The state of a sampled body under the contact.

    mesh      the surface that loads and displacements are given on, in the frame of the basis
    young [Pa] > 0, retardation [s] >= 0   E, by which all moduli of the basis are multiplied, and tau
    radius    [m] of the patch that the terminal law is taken over while nothing is loaded
    reach     [m] from the foot point within which all displacements are told, fewer farther off
    """

    def __init__(
        self, basis: SampledBasis, mesh: Mesh, young: float, retardation: float, radius: float, reach: float
    ) -> None:
        coarse = Mesh(basis.vertices, basis.triangles)
        super().__init__(coarse, mesh, radius, reach)
        self.basis, self.young, self.retardation, self.reach = basis, young, retardation, reach
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
        self._numbers = np.zeros(8)
        self._numbers[LENGTH] = 1.0
        self._scratch = scratch(basis.points)
        self.contacts: SampledContacts | None = None  # Where there are several
        self._step = entry_point(
            step, self._model, NO_NODES, NO_VECTORS, 0.0, (0.0, 0.0, 0.0), 0.0, self._fields, self._active,
            self._vectors, self._matrices, self._scratch, self._numbers,
        )  # fmt: skip
        self.evaluations = 0  # Evaluations of the energy in the last step
        self.settled = True  # Whether the last step reached equilibrium; what it left over is left to the next

    def step(self, nodes: np.ndarray, forces: np.ndarray, foot: tuple, normal: tuple, dt: float) -> Law:
        """One step of dt > 0 [s] under nodal forces [N] (k,3): K, n and s_free of the next step's terminal law, and the
        indentation now [m]: the mean of -n.u over the patch, weighted as the force is."""
        patch, pull, share = self._patch(nodes, forces, foot, normal)
        self.evaluations, self.settled = self._step(
            self._model, patch, pull, share, normal, dt, self._fields, self._active, self._vectors, self._matrices,
            self._scratch, self._numbers,
        )  # fmt: skip
        stiffness, exponent, free, now = self._numbers[:GAMMA].tolist()
        return stiffness, exponent, free, now

    def step_all(self, loads: Sequence[Pressed], dt: float) -> list[Law]:
        """One step of dt > 0 [s] under the loads of all contacts: of each what `step` gives, with n = 1 where there are
        several; see `sampled.contacts`."""
        if len(loads) == 1:
            return [self.step(*loads[0], dt)]
        if self.contacts is None or len(self.contacts.shares) != len(loads):
            self.contacts = SampledContacts.of(len(loads), len(self.held), len(self.q))
        own, patches = self.contacts, [self._patch(*load) for load in loads]
        own.take([load[3] for load in loads], patches)
        self.evaluations, self.settled = step_all(
            self._model, *together(patches), dt, self._fields, self._active, self._vectors, self._matrices,
            self._scratch, self._numbers, own,
        )  # fmt: skip
        return laws_of(own.compliance, own.depths)

    @property
    def coupling(self) -> np.ndarray:
        """[1] (c,c) O, see `physics.contact.joint`."""
        return ALONE if self.contacts is None else coupling_of(self.contacts.compliance)

    @property
    def extrapolation(self) -> float:
        """How far |q| is beyond the greatest of the full solutions, where half the root of the barrier's limit lies:
        0 within, 1 where the barrier begins."""
        return max(2.0 * float(np.sqrt(np.sum(self.q * self.q) / self.basis.points.limit)) - 1.0, 0.0)

    def displaced(self, *feet: tuple) -> tuple[np.ndarray, np.ndarray]:
        """Vertices of the mesh, all near the foot points and fewer farther off, and their displacements [m] (k,3)."""
        far = (2.0 * self.reach + 1.5 * self._margin) ** 2  # the modes miss little but near the load
        places = np.array(feet)
        field(self._model, places, far, self._fields, self._active, self.q, float(self._numbers[GAMMA]))
        count = carried(
            self.corners, self.weights, self._fields[3], self._reach, places, self._told, self._nodes, self._moved
        )
        return self._nodes[:count], self._moved[:count]
