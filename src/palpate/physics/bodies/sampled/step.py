"""A step of a sampled body (`physics.bodies.sampled_body`): load history, equilibrium of the modes, residual
compliance, and the terminal law of the next step."""

from typing import Annotated, NamedTuple

import numpy as np

from palpate.compiler.dot import times
from palpate.compiler.fields import element_type
from palpate.compiler.kernel import ieee_kernel
from palpate.physics.arrays import Array, Indices, Matrix, Record, Tensor, Vector3
from palpate.physics.bodies.condensed_step import FORGOTTEN, LEAST_FORCE
from palpate.physics.bodies.patch import normal_force, share_of
from palpate.physics.bodies.sampled.energy import Points
from palpate.physics.bodies.sampled.solve import BUDGET, EACH, at_rest, settle
from palpate.physics.contact.terminal import LEAST_DEPTH, fit_terminal

LEAST_COMPLIANCE = 1e-12  # [m/N] Lower limit for a patch; it keeps the law finite


class SampledModel(NamedTuple):
    """Constants of a sampled body: its basis, the fine mesh on its surface, its material.

    residual_compliance, modes, points, bend, vertices  as in `SampledBasis`
    corners, weights  [1] (W,3)  coarse triangle of each vertex of the fine mesh, and its barycentric weights
    young [Pa], retardation [s]  E, tau
    """

    residual_compliance: Annotated[np.ndarray, "<f4", 2]
    modes: Annotated[np.ndarray, "<f8", 2]
    points: Points
    bend: tuple[float, float, float]
    vertices: Annotated[np.ndarray, "<f8", 2]
    corners: Annotated[np.ndarray, "<i8", 2]
    weights: Annotated[np.ndarray, "<f8", 2]
    young: float
    retardation: float


STATE = {
    "stiffness": (), "exponent": (), "free": (), "now": (),  # K, n, s_free and s of the last law
    "gamma": (), "energy": (), "budget": BUDGET,  # gamma; energy of the modes; budget of `solve.settle`
}  # fmt: skip
"""State of a body, in addition to its arrays."""
STATE_TYPE = element_type(STATE)


@ieee_kernel
def gamma(square: float, scale: float, power: float, most: float):
    """gamma = (1 + (w/scale)²)^((power - 1)/2) [1] at `square` = w² [1], and its derivative by w over w; gamma w is
    constant for w > most."""
    if square > most * most:
        x = 1.0 + (most / scale) ** 2
        value = x ** (0.5 * (power - 1.0)) * most / np.sqrt(square)
        return value, -value / square
    x = 1.0 + square / (scale * scale)
    return x ** (0.5 * (power - 1.0)), (power - 1.0) / (scale * scale) * x ** (0.5 * (power - 3.0))


@ieee_kernel
def gather(
    corners: Indices,
    weights: Matrix,
    patch: Indices,
    pull: Matrix,
    share: float,
    normal: Vector3,
    load: Matrix,
    measure: Matrix,
):
    """Add a load (k,3) to that on the coarse vertices, fill its shares in the normal force. Returns that force [N]."""
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


@ieee_kernel
def residual_displacement(residual_compliance: Matrix, x: Matrix, active: Indices, count: int, v: int):
    """R x at one vertex; x (V,3) is nonzero only at active vertices."""
    row0, row1, row2 = residual_compliance[3 * v], residual_compliance[3 * v + 1], residual_compliance[3 * v + 2]
    out0 = out1 = out2 = 0.0
    for k in range(count):
        b = 3 * active[k]
        x0, x1, x2 = x[active[k], 0], x[active[k], 1], x[active[k], 2]
        out0 += row0[b] * x0 + row0[b + 1] * x1 + row0[b + 2] * x2
        out1 += row1[b] * x0 + row1[b + 1] * x1 + row1[b + 2] * x2
        out2 += row2[b] * x0 + row2[b + 1] * x1 + row2[b + 2] * x2
    return out0, out1, out2


@ieee_kernel
def apply_residual_compliance(residual_compliance: Matrix, x: Matrix, active: Indices, count: int, out: Matrix):
    """Fill R x (V,3) at the active vertices."""
    for k in range(count):
        v = active[k]
        out[v, 0], out[v, 1], out[v, 2] = residual_displacement(residual_compliance, x, active, count, v)


@ieee_kernel
def project(modes: Matrix, x: Matrix, active: Indices, count: int, out: Array):
    """Fill Phi'x (r,)."""
    out[:] = 0.0
    for k in range(count):
        v = active[k]
        for i in range(3):
            if x[v, i] != 0.0:
                for m in range(len(out)):
                    out[m] += modes[3 * v + i, m] * x[v, i]


@ieee_kernel
def dot(x: Matrix, y: Matrix, active: Indices, count: int):
    total = 0.0
    for k in range(count):
        v = active[k]
        total += x[v, 0] * y[v, 0] + x[v, 1] * y[v, 1] + x[v, 2] * y[v, 2]
    return total


@ieee_kernel
def follow(
    model: SampledModel,
    dt: float,
    fields: Tensor,
    active: Indices,
    vectors: Matrix,
    matrices: Tensor,
    room: Record,
    state: Record,
):
    """Update the load history h (Kelvin-Voigt retardation) and the equilibrium of the modes, dW/dq = Phi'h/E. Returns
    the state of active vertices and of energy evaluations, and whether it converged. Arguments as of `step`."""
    held, load, measure = fields[0], fields[1], fields[2]
    p, q, g, inverse = vectors[0], vectors[1], vectors[2], matrices[0]
    keep, take = model.retardation / (dt + model.retardation), dt / (dt + model.retardation)
    count, loaded = 0, False
    for v in range(len(held)):
        size = touched = 0.0
        for i in range(3):
            held[v, i] = keep * held[v, i] + take * load[v, i]
            size += abs(held[v, i])
            touched += abs(measure[v, i]) + abs(load[v, i])
        if size < FORGOTTEN:
            held[v] = 0.0
        else:
            loaded = True
        if size >= FORGOTTEN or touched > 0.0:
            active[count] = v
            count += 1
    budget = state.budget
    budget.evaluations = EACH
    if not loaded:  # at rest the tangent is known
        for k in range(len(q)):
            p[k] = q[k] = g[k] = 0.0
        at_rest(inverse)
        state.energy = 0.0
        return count, 0, True
    project(model.modes, held, active, count, p)
    for k in range(len(q)):
        p[k] /= model.young
    state.energy, used, settled = settle(
        model.points, room, p, q, g, inverse, matrices[1], matrices[2], vectors[3:], state.energy, budget
    )
    return count, used, settled


@ieee_kernel
def step(
    model: SampledModel,
    force: float,
    dt: float,
    fields: Tensor,
    active: Indices,
    vectors: Matrix,
    matrices: Tensor,
    room: Record,
    state: Record,
):
    """A step under one contact, whose load and shares are in `fields`. Returns the number of evaluations of the energy,
    and whether the step converged.

    force    [N]            of the load along the normal
    fields   [N]   (4,V,3)  h, the load, shares in the normal force; R times one of them
    active   [1]   (V,)     workspace, active vertices
    vectors  (9,r)          Phi'h/E, the modal coordinates q, the gradient of W there, and workspace
    matrices (3,r,r)        inverse of the tangent d2W/dq2, and workspace
    room, state             workspace of the energy; `STATE`
    """
    residual, modes, bend, young = model.residual_compliance, model.modes, model.bend, model.young
    held, load, measure, bent = fields[0], fields[1], fields[2], fields[3]
    p, q, inverse = vectors[0], vectors[1], matrices[0]
    keep, take = model.retardation / (dt + model.retardation), dt / (dt + model.retardation)
    r = len(q)
    count, used, settled = follow(model, dt, fields, active, vectors, matrices, room, state)
    # static correction: compliance R outside the reduced basis, scaled by gamma of its energy h.R h
    apply_residual_compliance(residual, held, active, count, bent)
    strain = max(dot(held, bent, active, count), 0.0) / (young * young)
    gam, dgam = gamma(strain, bend[0], bend[1], bend[2])
    m_R_h = dot(measure, bent, active, count) / young  # measure.R h/E
    f_R_h = dot(load, bent, active, count) / young
    c = vectors[7]  # Phi'm, the patch weights m in the modes
    project(modes, measure, active, count, c)
    # indentation s, its compliance on the patch, and s of the linear body
    modal = compliance = modal_linear = 0.0
    K_inv_c = vectors[8]  # K^-1 c, K the tangent
    times(inverse, c, K_inv_c)
    for k in range(r):
        compliance += c[k] * K_inv_c[k]
        modal += c[k] * q[k]
        modal_linear += c[k] * p[k]
    s = modal + gam * m_R_h
    m_D_h = 0.0  # measure.D h, D = d²V*
    for k in range(r):
        m_D_h += K_inv_c[k] * p[k]
    m_D_h += gam * m_R_h + dgam * m_R_h * strain
    state.gamma = gam
    # the same for the unit normal force and for the rest of the load
    apply_residual_compliance(residual, measure, active, count, bent)
    compliance = compliance / young + gam * dot(measure, bent, active, count) / young + dgam * m_R_h * m_R_h / young
    tangential = 0.0
    if force > 0.0:
        m_D_f = gam * dot(load, bent, active, count) / young
        m_D_f += dgam * m_R_h * f_R_h / young
        project(modes, load, active, count, c)
        for k in range(r):
            m_D_f += K_inv_c[k] * c[k] / young
        tangential = m_D_f - compliance * force
    # free indentation on the ray t h from rest, whose slope at rest is that of the body at rest
    f_n = max(force, LEAST_FORCE)
    s_next = s + take * (f_n * compliance + tangential - m_D_h)
    # friction that indents the patch grows with the normal force, see `condensed_step.with_friction`
    rubs = max(tangential, 0.0) / f_n
    free = _ray(keep, s, modal_linear + m_R_h, m_D_h) + take * min(tangential, 0.0)
    slope = 1.0 / max(take * (compliance + rubs), LEAST_COMPLIANCE)
    state.stiffness, state.exponent = fit_terminal(free, max(s_next, free + LEAST_DEPTH), slope, f_n)
    state.free, state.now = free, s
    return used, settled


@ieee_kernel
def _ray(t: float, end: float, start_slope: float, end_slope: float):
    """The cubic from 0 to `end` with these slopes, limited to be monotonic, at t in [0, 1]."""
    if not abs(end) > 0.0:
        return 0.0
    a, b = min(max(start_slope / end, 0.0), 3.0), min(max(end_slope / end, 0.0), 3.0)
    u = 1.0 - t
    return end * (t * t * (3.0 - 2.0 * t) + a * t * u * u - b * t * t * u)


@ieee_kernel
def field(model: SampledModel, feet: Matrix, far: float, fields: Tensor, active: Indices, q: Array, more: float):
    """Fill fields[3], u [m] (V,3): the displacement of the modes, plus that of the residual compliance near the feet
    [m] (c,3), within the squared distance `far` [m²]."""
    points, held, u = model.vertices, fields[0], fields[3]
    scale = more / model.young
    count = 0
    for v in range(len(held)):
        if held[v, 0] != 0.0 or held[v, 1] != 0.0 or held[v, 2] != 0.0:
            active[count] = v
            count += 1
    times(model.modes, q, u.reshape(-1))
    for v in range(len(points)):
        near = False
        for foot in feet:
            d0, d1, d2 = points[v, 0] - foot[0], points[v, 1] - foot[1], points[v, 2] - foot[2]
            near = near or not d0 * d0 + d1 * d1 + d2 * d2 > far
        if near:
            out0, out1, out2 = residual_displacement(model.residual_compliance, held, active, count, v)
            u[v, 0] += scale * out0
            u[v, 1] += scale * out1
            u[v, 2] += scale * out2
