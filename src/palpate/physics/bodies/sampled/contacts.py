"""A sampled body (`physics.bodies.sampled_body`) under the loads of several contacts.

    s_i = m_i.u,      c_ij = T/(T + tau) m_i.D m_j,    D = du/dh = [Phi K^-1 Phi' + gamma R + gamma'/w R h (R h)'/E²]/E

with the shares m_i (V,3) of contact i in its normal force, and K = d²W/dq². D is symmetric, and positive if W is
convex, so c_ij = c_ji and |c_ij| <= sqrt(c_ii c_jj). The law of each contact is the tangent of the next step at the
current forces f of all, at which it is exact:

    s_i = s_free,i + sum_j c_ij f_j,      s_free = s + T/(T + tau) (m.D f - m.D h) - c f

It is not a power law as for one contact, because the effective force can be negative due to a force on the other side
of the body.
"""

from typing import Annotated, NamedTuple

import numpy as np

from palpate.compiler.dot import inner, times
from palpate.compiler.kernel import ieee_kernel
from palpate.physics.arrays import Indices, Matrix, Record, Tensor
from palpate.physics.bodies.sampled import step


class SampledContacts(NamedTuple):
    """Input and results of each contact."""

    forces: Annotated[np.ndarray, "<f8", 1]  # [N] (c) normal force
    measures: Annotated[np.ndarray, "<f8", 3]  # [1] (c,V,3) m
    modal: Annotated[np.ndarray, "<f8", 3]  # [m] (2,c,r) Phi'm, and K^-1 Phi'm
    residual: Annotated[np.ndarray, "<f8", 2]  # [m] (c,2) m.R h/E, and workspace
    compliance: Annotated[np.ndarray, "<f8", 2]  # [m/N] (c,c) c_ij
    depths: Annotated[np.ndarray, "<f8", 2]  # [m] (2,c) s_free and s


@ieee_kernel
def step_all(
    model: Record,
    dt: float,
    fields: Tensor,
    active: Indices,
    vectors: Matrix,
    matrices: Tensor,
    room: Record,
    state: Record,
    contacts: SampledContacts,
):
    """A step under all loads. Fills `contacts` except for forces and measures; other arguments as of `step.step`.
    Returns the number of evaluations of the energy, and whether the step converged."""
    held, load, touched, bent = fields[0], fields[1], fields[2], fields[3]
    p, q, loaded = vectors[0], vectors[1], vectors[7]
    young, bend, take = model.young, model.bend, dt / (dt + model.retardation)
    measures, modal, K_inv_c, compliance = contacts.measures, contacts.modal[0], contacts.modal[1], contacts.compliance
    count = len(contacts.forces)
    touched[:] = 0.0
    for m in measures:
        for v in range(len(m)):
            for a in range(3):
                touched[v, a] += abs(m[v, a])
    acting, used, settled = step.follow(model, dt, fields, active, vectors, matrices, room, state)
    # static correction: compliance R outside the reduced basis, scaled by gamma of its energy h.R h
    step.apply_residual_compliance(model.residual_compliance, held, active, acting, bent)
    strain = max(step.dot(held, bent, active, acting), 0.0) / (young * young)
    gam, dgam = step.gamma(strain, bend[0], bend[1], bend[2])
    state.gamma = gam
    f_R_h = step.dot(load, bent, active, acting) / young
    step.project(model.modes, load, active, acting, loaded)
    for i in range(count):
        m_R_h = step.dot(measures[i], bent, active, acting) / young
        step.project(model.modes, measures[i], active, acting, modal[i])
        times(matrices[0], modal[i], K_inv_c[i])
        contacts.residual[i, 0] = m_R_h
        s = inner(modal[i], q) + gam * m_R_h
        m_D_h = inner(K_inv_c[i], p) + gam * m_R_h + dgam * m_R_h * strain
        contacts.depths[0, i], contacts.depths[1, i] = s - take * m_D_h, s
    # compliances between contacts, and free indentation
    for i in range(count):
        m_R_h = contacts.residual[i, 0]
        step.apply_residual_compliance(model.residual_compliance, measures[i], active, acting, bent)
        m_D_f = inner(K_inv_c[i], loaded) / young + gam * step.dot(load, bent, active, acting) / young
        contacts.depths[0, i] += take * (m_D_f + dgam * m_R_h * f_R_h / young)
        for j in range(i + 1):
            both = inner(K_inv_c[i], modal[j]) + gam * step.dot(measures[j], bent, active, acting)
            both += dgam * m_R_h * contacts.residual[j, 0]
            compliance[i, j] = compliance[j, i] = take * both / young
        compliance[i, i] = max(compliance[i, i], step.LEAST_COMPLIANCE)
    for i in range(count):
        for j in range(count):
            contacts.depths[0, i] -= compliance[i, j] * contacts.forces[j]
    return used, settled
