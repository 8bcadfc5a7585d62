"""A sampled body (`physics.bodies.sampled_body`) under several contacts: one body holds the sum of their loads.

    s_i = m_i.u,      c_ij = T/(T + tau) m_i.D m_j,    D = du/dh = [Phi K^-1 Phi' + gamma R + gamma'/w R h (R h)'/E²]/E

m_i (V,3) the shares of contact i in its normal force, K = d²W/dq². D is symmetric, and positive where W is convex, so
c_ij = c_ji and |c_ij| <= sqrt(c_ii c_jj). The law of each is the tangent of the next step at the present forces f of
all, which it meets exactly:

    s_i = s_free,i + sum_j c_ij f_j,      s_free = s + T/(T + tau) (m.D f - m.D h) - c f

It is no power as with one contact, since a force on the other side of a body may count as less than none here.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from palpate.physics.bodies.sampled.step import (
    GAMMA,
    LEAST_COMPLIANCE,
    apply_residual_compliance,
    dot,
    follow,
    gamma,
    gather,
    project,
)
from palpate.physics.dot import inner, times
from palpate.physics.kernel import kernel

Patch = tuple[np.ndarray, np.ndarray, float]
"""Nodes (k), forces [N] (k,3), and 1 where these are a load, 0 where they only mark the patch."""


class SampledContacts(NamedTuple):
    """What a step reads and answers of each contact."""

    ends: np.ndarray  # (c) of its nodes in the list of all
    shares: np.ndarray  # in the normal force, m
    normals: np.ndarray  # [1] (c,3)
    forces: np.ndarray  # [N] (c) normal force
    measures: np.ndarray  # [1] (c,V,3)
    modal: np.ndarray  # [m] (2,c,r) Phi'm, and K^-1 Phi'm
    residual: np.ndarray  # [m] (c,3) m.R h/E, and room
    compliance: np.ndarray  # [m/N] (c,c) c_ij
    depths: np.ndarray  # [m] (2,c) s_free and s

    @classmethod
    def of(cls, count: int, vertices: int, modes: int) -> SampledContacts:
        """Of so many contacts, of a body of so many vertices and modes."""
        return cls(
            np.zeros(count, np.int64), np.zeros(count), np.zeros((count, 3)), np.zeros(count),
            np.zeros((count, vertices, 3)), np.zeros((2, count, modes)), np.zeros((count, 2)),
            np.eye(count), np.zeros((2, count)),
        )  # fmt: skip

    def take(self, normals: Sequence[tuple], patches: Sequence[Patch]) -> None:
        """What the next step reads."""
        self.normals[:] = normals
        self.shares[:] = [share for _, _, share in patches]
        self.ends[:] = np.cumsum([len(nodes) for nodes, _, _ in patches])


def laws_of(compliance: np.ndarray, depths: np.ndarray) -> list[tuple[float, float, float, float]]:
    """K [N/m], n, s_free and s [m] of each contact, from c_ij [m/N] (c,c) and both depths [m] (2,c)."""
    stiffness = (1.0 / np.diagonal(compliance)).tolist()
    return [(k, 1.0, free, now) for k, free, now in zip(stiffness, *depths.tolist(), strict=True)]


def coupling_of(compliance: np.ndarray) -> np.ndarray:
    """[1] (c,c) O, see `physics.contact.joint`."""
    return compliance / np.diagonal(compliance)[:, None]


def together(patches: Sequence[Patch]) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and forces of all patches in one list."""
    return np.concatenate([nodes for nodes, _, _ in patches]), np.concatenate([pull for _, pull, _ in patches])


@kernel(error_model="numpy")
def step_all(model, patch, pull, dt, fields, active, vectors, matrices, room, numbers, contacts):
    """A step under all loads: evaluations of the energy, and whether it settled. patch, pull: nodes (k) and forces [N]
    (k,3) of all patches, one after the other; contacts: filled; the others as of `step.step`."""
    held, load, touched, bent = fields[0], fields[1], fields[2], fields[3]
    p, q, loaded = vectors[0], vectors[1], vectors[7]
    young, bend, take = model.young, model.bend, dt / (dt + model.retardation)
    measures, modal, K_inv_c, compliance = contacts.measures, contacts.modal[0], contacts.modal[1], contacts.compliance
    count, start = len(contacts.forces), 0
    load[:] = 0.0
    touched[:] = 0.0
    for i in range(count):
        end, m = contacts.ends[i], measures[i]
        contacts.forces[i] = gather(
            model.corners, model.weights, patch[start:end], pull[start:end], contacts.shares[i], contacts.normals[i],
            load, m,
        )  # fmt: skip
        start = end
        for v in range(len(m)):
            for a in range(3):
                touched[v, a] += abs(m[v, a])
    acting, used, settled = follow(model, dt, fields, active, vectors, matrices, room, numbers)
    # static correction: compliance R outside the reduced basis, scaled by gamma of its own energy h.R h
    apply_residual_compliance(model.residual_compliance, held, active, acting, bent)
    strain = max(dot(held, bent, active, acting), 0.0) / (young * young)
    gam, dgam = gamma(strain, bend[0], bend[1], bend[2])
    numbers[GAMMA] = gam
    f_R_h = dot(load, bent, active, acting) / young
    project(model.modes, load, active, acting, loaded)
    for i in range(count):
        m_R_h = dot(measures[i], bent, active, acting) / young
        project(model.modes, measures[i], active, acting, modal[i])
        times(matrices[0], modal[i], K_inv_c[i])
        contacts.residual[i, 0] = m_R_h
        s = inner(modal[i], q) + gam * m_R_h
        m_D_h = inner(K_inv_c[i], p) + gam * m_R_h + dgam * m_R_h * strain
        contacts.depths[0, i], contacts.depths[1, i] = s - take * m_D_h, s
    for i in range(count):
        m_R_h = contacts.residual[i, 0]
        apply_residual_compliance(model.residual_compliance, measures[i], active, acting, bent)
        m_D_f = inner(K_inv_c[i], loaded) / young + gam * dot(load, bent, active, acting) / young
        contacts.depths[0, i] += take * (m_D_f + dgam * m_R_h * f_R_h / young)
        for j in range(i + 1):
            both = inner(K_inv_c[i], modal[j]) + gam * dot(measures[j], bent, active, acting)
            both += dgam * m_R_h * contacts.residual[j, 0]
            compliance[i, j] = compliance[j, i] = take * both / young
        compliance[i, i] = max(compliance[i, i], LEAST_COMPLIANCE)
    for i in range(count):
        for j in range(count):
            contacts.depths[0, i] -= compliance[i, j] * contacts.forces[j]
    return used, settled
