"""A nonlinear finite-element body in a reduced basis, with a residual compliance for the truncated modes.

    u = Phi q(p) + gamma R h/E,      p = Phi'h/E,      dW/dq = p,      tau dh/dt + h = f

Phi [m] (3V,r)  displacement of the surface in each mode; at rest the modes are orthonormal in the stiffness K0
W               their strain energy, by empirical cubature (`sampled.energy`)
R [m/N]         C - Phi Phi' >= 0, C the compliance of the whole surface at rest, so that light loads are exact
gamma [1]       (1 + w²/w0²)^((m - 1)/2), w² = h.R h/E², for stiffening or softening of the residual compliance. w0 and
                m in [0, 2] are fitted to full solutions; beyond their loads gamma w is constant

The complementary energy V*(h) = E [max_q p.q - W(q) + G(w)], dG/dw = gamma w, is convex if W is; u is its gradient.
With backward Euler h <- (tau h + T f)/(T + tau) the body is passive for a constant foot point: f.du is at least the
increase of h.u - V*.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np

from palpate.compiler.exact import sum_of_squares
from palpate.compiler.kernel import ieee_kernel
from palpate.physics.archive import ArchiveError, read_arrays, replacing
from palpate.physics.arrays import Indices, Matrix, Vector3
from palpate.physics.bodies.patch import FineMesh, fine_mesh, interpolate_fine, lies_on, patch_of
from palpate.physics.bodies.sampled import step
from palpate.physics.bodies.sampled.border import shares_past_border
from palpate.physics.bodies.sampled.contacts import SampledContacts, step_all
from palpate.physics.bodies.sampled.energy import Points, SampledWorkspace, scratch
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.indices import check_indices
from palpate.physics.materials.hyperelastic import law, name_at, place_of

MOST_VERTICES = 2000  # Limit of the vertices of a coarse surface, as of `deformation.ReducedFE.coarse`
UNNAMED = ("neo_hooke", "mooney_rivlin", "hencky")  # Laws of a stored basis without their names


@dataclass(frozen=True)
class SampledBasis:
    """Modes of a body, its sampled points and its surface."""

    vertices: np.ndarray  # [m] (V,3) of the coarse surface, in the body's frame
    triangles: np.ndarray  # [1] (T,3)
    residual_compliance: np.ndarray  # [m/N] (3V,3V) float32, R for a modulus of 1 Pa
    modes: np.ndarray  # [m] (3V,r), Phi
    points: Points  # see `sampled.energy`
    bend: tuple[float, float, float]  # [1] w0 and m of gamma, and w above which gamma w is constant

    def save(self, path: Path, about: str = "") -> None:
        """Write the basis, with R's lower half and all modes in half precision; `about` describes the origin."""
        kept = np.flatnonzero(np.abs(self.residual_compliance).sum(axis=1) > 0.0)  # 0 at fixed vertices
        block = self.residual_compliance[np.ix_(kept, kept)]
        halves = {"lower": block[np.tril_indices(len(kept))], "surface_modes": self.modes, "modes": self.points.modes}
        arrays: dict[str, Any] = {}
        for name, value in halves.items():
            scale = max(float(np.abs(value).max(initial=0.0)), 1e-300) / 3e4
            arrays |= {name: (value / scale).astype(np.float16), f"{name}_scale": np.float64(scale)}
        arrays |= {name: value for name, value in self.points._asdict().items() if name != "modes"}
        arrays["laws"] = np.array([name_at(place) for place in self.points.laws])
        with replacing(path, cached=True) as part, part.open("wb") as file:
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
            if lower.size != len(kept) * (len(kept) + 1) // 2 or size > 3 * MOST_VERTICES:  # before allocation
                raise ValueError(f"{lower.size} compliances of {len(kept)}, {size // 3} vertices")
            half = np.zeros((len(kept), len(kept)), dtype=np.float32)
            half[np.tril_indices(len(kept))] = lower
            check_indices(kept, size, "a compliance is kept for the freedom")
            residual_compliance = np.zeros((size, size), dtype=np.float32)
            residual_compliance[np.ix_(kept, kept)] = half + np.tril(half, -1).T
            names = archive["laws"].tolist() if "laws" in archive else UNNAMED
            points = Points(
                modes, archive["weights"], archive["kinds"], archive["constants"], archive["springs"],
                float(archive["limit"]), np.array([place_of(law(name), name) for name in names]),
            )  # fmt: skip
            _check_points(archive, points, surface_modes, size)
            scale, power, most = archive["bend"].tolist()
            return cls(
                archive["vertices"], archive["triangles"], residual_compliance,
                surface_modes.astype(np.float64), points, (scale, power, most),
            )  # fmt: skip
        except (KeyError, ValueError, TypeError, AttributeError, IndexError, MemoryError) as error:
            raise ArchiveError(f"{path}: not a sampled basis: {error}. Rebuild it with `palpate build basis`") from None


def _check_points(archive: dict[str, np.ndarray], points: Points, surface_modes: np.ndarray, size: int) -> None:
    """ValueError: arrays of a file that do not fit each other. Kernels index them without a check, and call the law
    of a point by its address.

    size  three times the number of vertices
    """
    check_indices(archive["triangles"], size // 3, "a triangle refers to the vertex")
    check_indices(points.kinds, len(points.laws), "a sampled point has the law")
    count, modes = len(points.weights), surface_modes.shape[-1]
    shapes = {
        "vertices": (archive["vertices"].shape, (size // 3, 3)),
        "triangles": (archive["triangles"].shape[1:], (3,)),
        "surface modes": (surface_modes.shape, (size, modes)),
        "modes": (points.modes.shape, (9 * count, modes)),
        "weights, kinds": ((points.weights.ndim, points.kinds.shape), (1, (count,))),
        "constants": ((points.constants.ndim, len(points.constants)), (2, count)),
        "springs": (points.springs.shape, (modes, modes)),
    }
    for name, (found, expected) in shapes.items():
        if found != expected:
            raise ValueError(f"{name} of shape {found}, expected {expected}")


class SampledBody(NamedTuple):
    """A sampled body and its state under c contacts; see `sampled.step.step`."""

    model: step.SampledModel
    fine: FineMesh
    shown: Annotated[np.ndarray, "<f8", 2]  # [1] (N,3) `model.weights` times `border.shares_past_border`
    near: float  # [m²] squared distance from the feet within which the residual compliance is added
    fields: Annotated[np.ndarray, "<f8", 3]
    active: Annotated[np.ndarray, "<i8", 1]
    vectors: Annotated[np.ndarray, "<f8", 2]
    matrices: Annotated[np.ndarray, "<f8", 3]
    room: SampledWorkspace
    state: Annotated[np.ndarray, step.STATE_TYPE, 1]  # (1,)
    feet: Annotated[np.ndarray, "<f8", 2]  # [m] (c,3)
    contacts: SampledContacts


def sampled_body(
    basis: SampledBasis, mesh: Mesh, young: float, retardation: float, radius: float, reach: float, contacts: int = 1
) -> SampledBody:
    """A body at rest.

    mesh      the fine surface of loads and displacements, in the frame of the basis
    young [Pa] > 0, retardation [s] >= 0   E, a factor on all moduli of the basis, and tau
    radius    [m] of the patch of the terminal law without load
    reach     [m] distance from the foot point within which all displacements are sent, fewer beyond it
    """
    coarse = Mesh(basis.vertices, basis.triangles)
    edges = coarse.vertices[coarse.triangles]
    margin = float(np.linalg.norm(edges - np.roll(edges, 1, axis=1), axis=2).max())
    corners, weights = lies_on(coarse, mesh)
    shown = weights * shares_past_border(coarse, mesh.vertices, corners, weights)[:, None]
    count, r, state = len(basis.vertices), basis.modes.shape[1], np.zeros(1, step.STATE_TYPE)
    state["budget"]["length"] = 1.0
    model = step.SampledModel(
        basis.residual_compliance, basis.modes, basis.points, basis.bend, basis.vertices, corners, weights,
        young, retardation,
    )  # fmt: skip
    return SampledBody(
        model, fine_mesh(mesh, radius, reach), shown, (2.0 * reach + 1.5 * margin) ** 2, np.zeros((4, count, 3)),
        np.zeros(count, np.int64), np.zeros((9, r)), np.stack([np.eye(r), np.zeros((r, r)), np.zeros((r, r))]),
        scratch(basis.points), state, np.zeros((contacts, 3)),
        SampledContacts(
            np.zeros(contacts), np.zeros((contacts, count, 3)), np.zeros((2, contacts, r)), np.zeros((contacts, 2)),
            np.eye(contacts), np.zeros((2, contacts)),
        ),
    )  # fmt: skip


@ieee_kernel
def bear(body: SampledBody, contact: int, nodes: Indices, forces: Matrix, foot: Vector3, normal: Vector3):
    """Apply the load of a contact, nodal forces [N] (k,3). Call `answer` after all loads."""
    patch, pull, share = patch_of(body.fine, nodes, forces, foot, normal)
    body.feet[contact, 0], body.feet[contact, 1], body.feet[contact, 2] = foot
    load, measures = body.fields[1], body.contacts.measures
    if contact == 0:
        load[:] = 0.0
    measure = body.fields[2] if len(measures) == 1 else measures[contact]
    corners, weights = body.model.corners, body.model.weights
    body.contacts.forces[contact] = step.gather(corners, weights, patch, pull, share, normal, load, measure)


@ieee_kernel
def answer(body: SampledBody, laws: Matrix, coupling: Matrix, dt: float):
    """A step of dt > 0 [s] under the loads of all contacts. Returns the number of evaluations of the energy, and
    whether the step reached equilibrium; else the next step continues from the residual.

    laws      (c,5)      filled: K, n, c, s_free and s_prev of each; s_prev is the current indentation [m], the mean of
                         -n.u over the patch, weighted with the force; n = 1 for several, see `sampled.contacts`
    coupling  [1] (c,c)  filled: O, see `physics.contact.joint`
    """
    state, contacts = body.state[0], body.contacts
    if len(laws) == 1:
        used, settled = step.step(
            body.model, contacts.forces[0], dt, body.fields, body.active, body.vectors, body.matrices, body.room,
            state,
        )  # fmt: skip
        laws[0, 0], laws[0, 1] = state.stiffness, state.exponent
        laws[0, 3], laws[0, 4] = state.free, state.now
        return used, settled
    used, settled = step_all(
        body.model, dt, body.fields, body.active, body.vectors, body.matrices, body.room, state, contacts
    )
    for i in range(len(laws)):
        laws[i, 0], laws[i, 1] = 1.0 / contacts.compliance[i, i], 1.0
        laws[i, 3], laws[i, 4] = contacts.depths[0, i], contacts.depths[1, i]
        for j in range(len(laws)):
            coupling[i, j] = contacts.compliance[i, j] / contacts.compliance[i, i]
    return used, settled


@ieee_kernel
def extrapolation(body: SampledBody):
    """Excess of |q| over the largest one of the full solutions, which is half of that at which the barrier begins: 0
    within, 1 at the barrier."""
    return max(2.0 * np.sqrt(sum_of_squares(body.vectors[1]) / body.model.points.limit) - 1.0, 0.0)


@ieee_kernel
def displace_fine(body: SampledBody):
    """Fill `fine.nodes`, all vertices near the foot points and fewer farther away, and `fine.moved`, their
    displacements [m], for messages: past the border of the basis they fade. Returns their number."""
    model, fine, u = body.model, body.fine, body.fields[3]
    step.field(model, body.feet, body.near, body.fields, body.active, body.vectors[1], body.state[0].gamma)
    return interpolate_fine(model.corners, body.shown, u, fine.reach, body.feet, fine.listed, fine.nodes, fine.moved)
