"""One implicit viscoelastic step of a condensed organ under a patch, see `condensed_body`."""

from typing import Annotated, NamedTuple

import numpy as np

from palpate.compiler.fields import element_type
from palpate.compiler.kernel import kernel
from palpate.compiler.memory import stack_zeros
from palpate.compiler.records import clear
from palpate.physics.arrays import Array, Indices, Matrix, Record, Tensor, Vector3
from palpate.physics.bodies.half_space_range import FLAT, LIGHT, NEAR_WIDTH, ground_under
from palpate.physics.bodies.large_displacement import NARROWEST, large_depth
from palpate.physics.bodies.loads.acting import acting_patch
from palpate.physics.bodies.loads.scattered import acting_radius
from palpate.physics.bodies.patch import normal_force, patch_radius, share_of
from palpate.physics.bodies.true_patch import HOLDS, LEAST_SHARE, MEAN, TruePatch, patch_compliance
from palpate.physics.contact import end_rate
from palpate.physics.contact.area import WIDTH, AreaLaw, approach, radius_at
from palpate.physics.contact.end_rate import advance

FORGOTTEN = 1e-9  # [N] Load history below which a vertex is removed from the list
LEAST_FORCE = 1e-3  # [N] Smallest force at which the terminal law is fitted


class CondensedModel(NamedTuple):
    """Constants of a condensed body.

    compliance, vertices  as in `Basis`
    corners, weights  [1] (W,3)  coarse triangle of each vertex of the fine mesh, and its barycentric weights
    young [Pa], retardation [s]  E, tau
    """

    compliance: Annotated[np.ndarray, "<f4", 2]
    vertices: Annotated[np.ndarray, "<f8", 2]
    rho: Annotated[np.ndarray, "<f8", 1]  # [1] (3,) see `large_displacement`; empty: the linear organ
    moments: Annotated[np.ndarray, "<f8", 1]  # of the hat functions of the coarse vertices, see `patch.hat_moments`
    corners: Annotated[np.ndarray, "<i8", 2]
    weights: Annotated[np.ndarray, "<f8", 2]
    slopes: Annotated[np.ndarray, "<f8", 3]  # [1/m] (W,3,3) gradients of these weights along the surface
    young: float
    retardation: float
    fine: Annotated[np.ndarray, "<f8", 2]  # [m] (W,3) vertices of the fine mesh
    true: TruePatch  # the correction for the true load
    area: AreaLaw  # of a contact that grows; `rho` is then in its table
    deepest: float  # [1] s/R up to which the law of large displacement is valid
    remembers: bool  # [1] whether a history keeps the correction of the places of its loads, see `_remembered`


EXCESS = {
    "deep": (), "narrow": (),  # deeper than `deepest`; narrower than the fine mesh resolves
    "thin": (), "curved": (),  # on thin or curved ground
    "near": (), "slides": (),  # too narrow near a nodule; too heavy for a surface that is free to slide
    "grown": (),  # beyond the law of a contact that grows
}  # fmt: skip
"""Excess [1] over the limits of the body: 0 within, 1 at twice the limit."""
CONTACT = {
    "compliance": (), "free": (), "now": (), "exponent": (),  # [m/N], s_free and s [m], n of the law
    "self_compliance": (),  # [m/N] of the linear body at rest
    "press": (), "more": (),  # [N] normal force on the patch with the additional load for large displacement; that load
    "radius": (), "wide": (), "narrowed": bool,  # [m] of the patch, also on the coarse surface; near a nodule or a gap
    "scattered": (),  # [1] w of `scattered`
    "total": (),  # [N] normal force of the load
    "corrected": (),  # [m N/N Pa] the history of the correction times the normal force, see `_remembered`
    "recalled": (),  # [m/N] what the compliance of the history is above the present one
    "fading": (), "added": (),  # [1] what is left of the history in this step; [N] the normal force that it takes in
    "organ": bool,  # load of another organ (`physics.contact.organs`): linear, frictionless
    "rubs": (),  # [m/N] indentation of the next step by the friction that grows with the normal force
    "excess": EXCESS, "holds": HOLDS,
    "course": end_rate.COURSE,  # normal force y [N] of the history h; `ahead` is the factor on h in the next step, as h
    # is proportional to y under a patch that does not move
}  # fmt: skip
"""State of a contact; `holds` is that of `true_patch.patch_compliance`."""
CONTACT_TYPE = element_type(CONTACT)
ROOM, TILT, FIELDS = 3, 4, 5  # Indices of the fields of a contact, see `take_load`


@kernel
def _take_history(
    model: CondensedModel,
    patch: Indices,
    pull: Matrix,
    share: float,
    normal: Vector3,
    total: float,
    keep: float,
    take: float,
    fields: Tensor,
    marks: Indices,
    count: int,
):
    """Transfer the load and the patch to the coarse mesh, and update the history h of the load. Returns the contact of
    loaded vertices and of those of the patch."""
    held, load, measure, tilt = fields[0], fields[1], fields[2], fields[TILT]
    active, marked, order = marks[0], marks[1], marks[2]
    # the load, and the patch weights m
    for k in range(count):
        load[active[k]] = 0.0
        measure[active[k], 0] = 0.0
    touched = 0
    for k in range(len(patch)):
        p = patch[k]
        part = share_of(k, pull, normal, total)
        for a in range(3):
            v = model.corners[p, a]
            if marked[v] < 2:  # 1: loaded, 2: touched in this step
                marked[v] += 2
                order[touched] = v
                touched += 1
                load[v] = 0.0
                measure[v, 0] = 0.0
                tilt[v] = 0.0
            w = model.weights[p, a]
            measure[v, 0] += w * part
            for i in range(3):
                load[v, i] += share * w * pull[k, i]
                tilt[v, i] += part * model.slopes[p, a, i]
    # history h of the load: Kelvin-Voigt retardation
    for k in range(count):
        for i in range(3):
            held[active[k], i] *= keep
    for k in range(touched):
        v = order[k]
        marked[v] -= 2
        if share > 0.0:
            for i in range(3):
                held[v, i] += take * load[v, i]
            if marked[v] == 0:
                marked[v] = 1
                active[count] = v
                count += 1
    # remove vertices with a negligible history
    kept = 0
    for k in range(count):
        v = active[k]
        if abs(held[v, 0]) + abs(held[v, 1]) + abs(held[v, 2]) < FORGOTTEN:
            held[v] = 0.0
            marked[v] = 0
        else:
            active[kept] = v
            kept += 1
    return kept, touched


@kernel
def take_load(
    model: CondensedModel,
    patch: Indices,
    pull: Matrix,
    share: float,
    normal: Vector3,
    dt: float,
    fields: Tensor,
    marks: Indices,
    contact: Record,
    count: int,
):
    """Step the linear body under the load `pull` [N] (k,3) on the fine vertices `patch`; `share` is 1, or 0 if
    the forces only define the patch. Returns the contact of loaded vertices and of those of the patch.

    fields  (F,V,3)    h [N]; the load; shares of the normal force, those of the narrowed patch; workspace; derivatives
                       [1/m] of the shares when the patch moves
    marks   [1] (3,V)  the loaded vertices; 1 for each of these; the vertices of the patch
    """
    young, measure, order = model.young, fields[2], marks[2]
    keep, take = model.retardation / (dt + model.retardation), dt / (dt + model.retardation)
    total = normal_force(pull, normal)
    contact.fading, contact.added = keep * contact.course.ahead, take * (share * total)
    count, touched = _take_history(model, patch, pull, share, normal, total, contact.fading, take, fields, marks, count)
    bears = (1.0 - take) * (contact.course.ahead * contact.course.value) + take * (share * total)
    advance(contact.course, bears if count > 0 else 0.0, dt)
    wide = patch_radius(model.vertices, model.moments, order, touched, measure)
    clear(contact.excess)
    radius, narrow, narrowed, contact.scattered, wider = acting_patch(
        model, patch, pull, normal, total, order, touched, measure, not contact.organ
    )
    contact.narrowed = narrowed or contact.scattered > 0.0
    # indentation of the linear body: m.C h of the history, m.C f of the load; its compliance under both loads
    block, sharp = stack_zeros((3, 3)), stack_zeros((3, 3))
    now, pressed, static, hats, near = _gather_all(
        model, fields, marks, count, touched, normal, contact.narrowed, block, sharp
    )
    # correction of the compliance for the true load, by a half-space
    acts = acting_radius(radius, contact.scattered, hats, wider)
    body, more = patch_compliance(model.true, normal, acts, block, sharp, near, contact.holds)
    if contact.organ:
        clear(contact.holds)
    elif len(model.true.table) > 0 and share > 0.0:
        contact.excess.narrow = narrow
        contact.excess.near = max(NEAR_WIDTH * wide / radius - 1.0, 0.0) if narrowed else 0.0
        thin, curved = ground_under(model.true.ground, order, touched, measure)
        _exceed(model, contact.excess, radius, thin, curved, total)
    kept = more
    if model.remembers:
        kept = _remembered(contact, body, more)
    self_compliance, contact.recalled = (body + more) / young, (kept - more) / young
    press = pressed / body if body > 0.0 else 0.0  # the normal force on the patch that corresponds to h
    # indentation due to the tangential load
    tangential = (static - body * total) / young if share > 0.0 and total > 0.0 else 0.0
    now = (now + kept * press) / young
    free = keep * contact.course.ahead * now + take * tangential
    contact.compliance, contact.free, contact.now = take * self_compliance, free, now
    contact.rubs = take * max(tangential, 0.0) / max(total, LEAST_FORCE)
    contact.more, contact.self_compliance, contact.press = 0.0, self_compliance, press
    contact.radius, contact.wide, contact.total = acts, wide, total * share
    return count, touched


@kernel
def _remembered(contact: Record, body: float, more: float):
    """The correction of the compliance g.C g `body` under the history of a load, both [m/N] for a modulus of 1 Pa: the
    mean, by force, of those of the places of its loads, `more` being that of the present one.

    With that of the present place alone, tissue that is already indented would follow each change of the correction at
    once, where it has the time of retardation to follow a change of the load. Next to a gap the correction changes by
    20 % within 3 mm: a slide at 200 mm/s across a cut raised the force by 80 %.
    """
    contact.corrected = contact.fading * contact.corrected + contact.added * more
    if not contact.course.value > 0.0:
        contact.corrected = 0.0
        return more
    return max(contact.corrected / contact.course.value, (LEAST_SHARE - 1.0) * body)


@kernel
def _exceed(model: CondensedModel, excess: Record, radius: float, thin: float, curved: float, total: float):
    """Excess under a force [N] on a patch of this radius [m], on ground of these 1/thickness and curvature [1/m]."""
    excess.thin = max(FLAT * radius * thin - 1.0, 0.0)
    excess.curved = max(FLAT * radius * curved - 1.0, 0.0)
    if not model.true.sticks:
        excess.slides = max(total / (model.young * radius * radius * LIGHT) - 1.0, 0.0)


@kernel
def _gather_all(
    model: CondensedModel,
    fields: Tensor,
    marks: Indices,
    count: int,
    touched: int,
    normal: Vector3,
    narrowed: bool,
    block: Matrix,
    sharp: Matrix,
):
    """Fill `block` and `sharp` [m/N] (3,3) with g.C g of the load and of the narrowed load; both are equal unless it is
    `narrowed`. Returns the other sums of `_gather`: C is read once."""
    active, marked, order, sums = marks[0], marks[1], marks[2], stack_zeros((5,))
    held, load, measure = fields[0], fields[1], fields[2]
    for k in range(count):
        _gather(model, active[k], order, touched, measure, held, load, normal, narrowed, block, sharp, sums)
    for k in range(touched):
        if marked[order[k]] == 0:
            _gather(model, order[k], order, touched, measure, held, load, normal, narrowed, block, sharp, sums)
    if not narrowed:
        sharp[:] = block
        sums[4] = sums[3]
    return sums[0], sums[1], sums[2], sums[3], sums[4]


@kernel
def _gather(
    model: CondensedModel,
    b: int,
    order: Indices,
    touched: int,
    measure: Matrix,
    held: Matrix,
    load: Matrix,
    normal: Vector3,
    narrowed: bool,
    block: Matrix,
    sharp: Matrix,
    sums: Array,
):
    """Add the contributions of the coarse vertex b: to `block` [m/N] (3,3) that to g.C g; to `sums` those to m.C h, to
    its part due to normal forces, to m.C f, and to g.T g. If the load is `narrowed` also those of that load, the second
    column of `measure`: to `sharp`, and to its g.T g."""
    first, second, third = model.compliance[3 * b], model.compliance[3 * b + 1], model.compliance[3 * b + 2]
    c00 = c01 = c02 = c10 = c11 = c12 = c20 = c21 = c22 = hats = 0.0
    corrects = len(model.true.table) > 0
    for k in range(touched):
        v = order[k]
        share, at = measure[v, 0], 3 * v
        c00 += share * first[at]
        c01 += share * first[at + 1]
        c02 += share * first[at + 2]
        c10 += share * second[at]
        c11 += share * second[at + 1]
        c12 += share * second[at + 2]
        c20 += share * third[at]
        c21 += share * third[at + 1]
        c22 += share * third[at + 2]
        if corrects:
            hats += share * model.true.table[b, v]
    n0, n1, n2 = normal
    w0, w1, w2 = c00 * n0 + c01 * n1 + c02 * n2, c10 * n0 + c11 * n1 + c12 * n2, c20 * n0 + c21 * n1 + c22 * n2
    sums[0] -= w0 * held[b, 0] + w1 * held[b, 1] + w2 * held[b, 2]
    sums[1] -= (w0 * n0 + w1 * n1 + w2 * n2) * (held[b, 0] * n0 + held[b, 1] * n1 + held[b, 2] * n2)
    sums[2] -= w0 * load[b, 0] + w1 * load[b, 1] + w2 * load[b, 2]
    share = measure[b, 0]
    if share != 0.0:
        for i, row in enumerate(((c00, c01, c02), (c10, c11, c12), (c20, c21, c22))):
            for j in range(3):
                block[i, j] += share * row[j]
        sums[3] += share * hats
        if narrowed:
            share = measure[b, 1]
            sums[4] += share * _gather_sharp(model, b, order, touched, measure, 0.5 * share, sharp)


@kernel
def _gather_sharp(
    model: CondensedModel, b: int, order: Indices, touched: int, measure: Matrix, half: float, sharp: Matrix
):
    """Add the contribution of the vertex b to `sharp` of `_gather`, whose share is twice `half`; return that to g.T g
    over the share. All pairs together are symmetric, so each adds the symmetric part of its C."""
    first, second, third = model.compliance[3 * b], model.compliance[3 * b + 1], model.compliance[3 * b + 2]
    c00 = c11 = c22 = c01 = c02 = c12 = near = 0.0
    for k in range(touched):
        v = order[k]
        share, at = measure[v, 1], 3 * v
        c00 += share * first[at]
        c11 += share * second[at + 1]
        c22 += share * third[at + 2]
        c01 += share * (first[at + 1] + second[at])
        c02 += share * (first[at + 2] + third[at])
        c12 += share * (second[at + 2] + third[at + 1])
        near += share * model.true.table[b, v]
    for i, row in enumerate(((2.0 * c00, c01, c02), (c01, 2.0 * c11, c12), (c02, c12, 2.0 * c22))):
        for j in range(3):
            sharp[i, j] += half * row[j]
    return near


@kernel
def add_others(model: CondensedModel, dt: float, contact: Record, aside: float, ahead: float, others: float):
    """Update `contact` for other contacts and large displacement.

    aside   [m] indentation of the linear body under the patch due to the history of the other contacts
    ahead   [m] the same at the start of the next step
    others  [N] force on the patch with the same indentation as the current forces of the other contacts
    """
    rho = model.rho
    keep, take = model.retardation / (dt + model.retardation), dt / (dt + model.retardation)
    self_compliance = contact.self_compliance
    contact.free += keep * ahead
    contact.now += aside
    if len(model.area.forces) > 0:
        _grow(model, contact, keep * contact.course.ahead, take)
        return
    if len(rho) == 0 or contact.organ or not self_compliance > 0.0:
        return
    radius, now, free = stretched_radius(model, contact)[0], contact.now, contact.free
    force = max(contact.total + others, LEAST_FORCE)
    contact.now = radius * large_depth(now / radius, rho)[0]
    contact.free = radius * large_depth(free / radius, rho)[0]
    contact.excess.deep = max(contact.now / (min(radius, contact.radius) * model.deepest) - 1.0, 0.0)
    then, slope = large_depth((free + take * self_compliance * force) / radius, rho)
    contact.rubs *= slope
    contact.compliance = (radius * then - contact.free) / force
    # the tangent of a convex s(f), so that the contact approaches its force from above without oscillation; s_free at
    # rest remains 0
    if contact.total + others > LEAST_FORCE and slope * take * self_compliance > contact.compliance:
        contact.compliance = slope * take * self_compliance
        contact.free = radius * then - contact.compliance * force
    contact.more = (contact.now - now) / self_compliance
    contact.press += contact.more


@kernel
def with_friction(contact: Record):
    """Let the law of the next step answer a normal force with the friction that it brings.

    Friction that indents the patch grows with the normal force. A law that keeps it as a constant is too stiff: a
    contact that solves with it overshoots, and above twice the compliance each step makes the next one worse. The law
    keeps its value at the present force; friction that lifts the patch remains constant, on the safe side.
    """
    chord = contact.compliance
    contact.compliance += contact.rubs
    contact.free -= contact.rubs * contact.total
    if contact.exponent > 0.0:
        tangent = chord / contact.exponent + contact.rubs
        contact.exponent = min(max(contact.compliance / tangent, 1.0), 3.0)


@kernel
def excesses(contact: Record):
    """The excess [1] over each limit, in the order of `EXCESS`."""
    over = contact.excess
    return over.deep, over.narrow, over.thin, over.curved, over.near, over.slides, over.grown


@kernel
def half_space(model: CondensedModel, contact: Record):
    """Compliance [m/N] of a half-space under the patch."""
    return (1.0 - model.true.held) * model.true.normal * MEAN / (contact.radius * model.young)


@kernel
def stretched_radius(model: CondensedModel, contact: Record):
    """Radius R (c/c_R)² [m] of the law of large displacement on a finite organ, and d ln R/d ln c [1]. With a nodule or
    capsule c does not measure the extent of the organ, and the radius is R."""
    if len(model.rho) == 0 or len(model.true.table) == 0 or len(model.true.apart) > 0:
        return contact.radius, 0.0
    square = (contact.self_compliance / half_space(model, contact)) ** 2
    return contact.radius * max(square, NARROWEST), 2.0 if square > NARROWEST else 0.0


@kernel
def fixed_part(model: CondensedModel, contact: Record):
    """Part of the fixed patch's compliance [m/N] that the approach of a growing contact replaces: the half-space's,
    limited so that the indentation rises with the force."""
    return min(
        half_space(model, contact), contact.self_compliance + 0.5 * approach(model.area.table, model.area.forces[-1])[1]
    )


@kernel
def _grow(model: CondensedModel, contact: Record, keep: float, take: float):
    """Update `contact` for a contact that grows (`physics.contact.area`): the half-space's part of the indentation is
    the approach d(y) in place of c y. The law F = K (s - s_free)^n has its force, indentation and tangent at the
    present force."""
    area, press = model.area, max(contact.press, 0.0)
    local = fixed_part(model, contact)
    force = max(contact.total, LEAST_FORCE)
    before, after = keep * press, keep * press + take * force
    now, free = approach(area.table, press)[0], approach(area.table, before)[0]
    then, slope, _ = approach(area.table, after)
    contact.now += now - local * press
    contact.free += free - local * before
    linear = take * (contact.self_compliance - local)
    chord, tangent = linear + (then - free) / force, linear + take * slope
    contact.compliance, contact.exponent = chord, min(max(chord / tangent, 1.0), 3.0)
    wide = WIDTH * max(radius_at(area.forces, area.radii, press), 1e-9)
    contact.excess.deep = max(contact.now / (wide * model.deepest) - 1.0, 0.0)
    contact.excess.grown = max(contact.total / area.forces[-1] - 1.0, 0.0)
