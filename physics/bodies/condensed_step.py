"""One implicit viscoelastic step of a condensed organ under the patch that presses it, see `condensed_body`."""

from typing import Annotated, NamedTuple

import numpy as np

from palpate.physics.bodies.half_space_range import FLAT, LIGHT, NEAR_WIDTH, ground_under
from palpate.physics.bodies.large_displacement import DEEPEST, large_depth
from palpate.physics.bodies.patch import load_radius, normal_force, patch_radius, share_of
from palpate.physics.bodies.true_patch import TruePatch, draw_together, patch_compliance
from palpate.physics.kernel import kernel

FORGOTTEN = 1e-9  # [N] Remaining load below which a vertex is dropped
LEAST_FORCE = 1e-3  # [N] Least force that the terminal law is taken at


class CondensedModel(NamedTuple):
    """What a condensed body is made of.

    compliance, vertices  as in `Basis`
    corners, weights  [1] (W,3)  vertices of the triangle that a vertex of the fine mesh lies on, and its share of each
    young [Pa], retardation [s]  E, tau
    """

    compliance: Annotated[np.ndarray, "<f4", 2]
    vertices: Annotated[np.ndarray, "<f8", 2]
    rho: Annotated[
        np.ndarray, "<f8", 1
    ]  # [1] (3,) of large displacement, see `large_displacement`; empty: the linear organ
    moments: Annotated[np.ndarray, "<f8", 1]  # of the hats of the coarse vertices, see `patch.hat_moments`
    corners: Annotated[np.ndarray, "<i8", 2]
    weights: Annotated[np.ndarray, "<f8", 2]
    slopes: Annotated[np.ndarray, "<f8", 3]  # [1/m] (W,3,3) gradients of these shares along the surface
    young: float
    retardation: float
    fine: Annotated[np.ndarray, "<f8", 2]  # [m] (W,3) vertices of the fine mesh
    true: TruePatch  # what is known of the load's own patch


COMPLIANCE, FREE, NOW, MORE, OWN, PRESS, RADIUS, WIDE, NARROWED, DEEP, NARROW, THIN, CURVED, NEAR, SLIDES = range(15)
"""Numbers that a body keeps: compliance [m/N], s_free and s [m] of the law that was told, the load [N] on the patch
that large displacement adds, compliance [m/N] of the linear body at rest, the normal force [N] on the patch with what
was added, the patch's radius [m], that on the coarse surface, whether it is drawn together near a
nodule; then how far [1] it is outside of what the body can tell, 0 within, 1 at twice the limit: deeper
than `DEEPEST`, narrower than the touched mesh, on thin or curved ground, too narrow near a nodule, too
heavy for a surface that is free to slide."""
TOTAL, NUMBERS = 24, 25  # The normal force of the load [N]; how many numbers
ROOM, TILT, FIELDS = 3, 4, 5  # Of the fields of a contact, see `take_load`
SIDE, HOLD = slice(15, 24), 18
"""What holds the patch along the surface, see `true_patch.patch_compliance`; where its compliances begin."""


@kernel
def _take_history(model, patch, pull, share, normal, total, dt, fields, marks, count):
    """The load and the patch on the vertices of the coarse mesh, and the history h of the load. Returns how
    many vertices hold load, and how many the patch touches."""
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
            if marked[v] < 2:  # 1: holds load, 2: touched now
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
    # history h of the load: Kelvin-Voigt retardation over dt
    keep, take = model.retardation / (dt + model.retardation), dt / (dt + model.retardation)
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
    # drop what has faded
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
def take_load(model, patch, pull, share, normal, dt, fields, marks, numbers, count):
    """`share` is 1 where `pull` is a load, 0 where it only marks the patch. Returns how many vertices hold load, and
    how many the patch touches.

    fields  (F,V,3)    h [N]; the load; shares of the normal force, of the true patch and drawn together; room; what the
                       shares change by as the patch moves [1/m]
    marks   [1] (3,V)  the vertices that hold load; 1 for each of these; the vertices of the patch
    """
    young = model.young
    held, load, measure = fields[0], fields[1], fields[2]
    active, marked, order = marks[0], marks[1], marks[2]
    keep, take = model.retardation / (dt + model.retardation), dt / (dt + model.retardation)
    total = normal_force(pull, normal)
    count, touched = _take_history(model, patch, pull, share, normal, total, dt, fields, marks, count)
    # the patch as small as the load is: a half-space's correction to the compliance
    radius, narrow = load_radius(model.fine, patch, pull, normal, total, model.true.least)
    wide = patch_radius(model.vertices, model.moments, order, touched, measure)
    numbers[DEEP : SLIDES + 1] = 0.0
    narrowed = draw_together(model, patch, pull, normal, total, order, touched, measure, radius)
    block = np.zeros((3, 3))
    # indentation of the linear body: m.C h of the history, m.C f of the load
    sums = np.zeros(4)
    for k in range(count):
        _gather(model, active[k], order, touched, measure, held, load, normal, block, sums)
    for k in range(touched):
        if marked[order[k]] == 0:
            _gather(model, order[k], order, touched, measure, held, load, normal, block, sums)
    now, pressed, static, hats = sums
    body, more = patch_compliance(
        model.compliance, model.true, order, touched, measure, narrowed, normal, radius, block, hats, numbers[SIDE]
    )
    numbers[NARROWED] = narrowed
    if len(model.true.table) > 0 and share > 0.0:
        numbers[NARROW] = narrow
        thin, curved = ground_under(model.true.ground, order, touched, measure)
        numbers[THIN] = max(FLAT * radius * thin - 1.0, 0.0)
        numbers[CURVED] = max(FLAT * radius * curved - 1.0, 0.0)
        if not model.true.sticks:
            numbers[SLIDES] = max(total / (young * radius * radius * LIGHT) - 1.0, 0.0)
        numbers[NEAR] = max(NEAR_WIDTH * wide / radius - 1.0, 0.0) if narrowed else 0.0
    self_compliance = (body + more) / young
    press = pressed / body if body > 0.0 else 0.0  # the normal force on the patch that h stands for
    # what the tangential load adds
    tangential = (static - body * total) / young if share > 0.0 and total > 0.0 else 0.0
    now = (now + more * press) / young
    free = keep * now + take * tangential
    numbers[COMPLIANCE], numbers[FREE], numbers[NOW] = take * self_compliance, free, now
    numbers[MORE], numbers[OWN], numbers[PRESS] = 0.0, self_compliance, press
    numbers[RADIUS], numbers[WIDE], numbers[TOTAL] = radius, wide, total * share
    return count, touched


@kernel
def _gather(model, b, order, touched, measure, held, load, normal, block, sums):
    """Add what the coarse vertex b is to the patch: to `block` [m/N] (3,3) its part of g.C g, and to `sums` those of
    m.C h, of the part of it that the normal forces of h make, of m.C f, and of g.T g."""
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


@kernel
def add_others(model, dt, numbers, aside, others):
    """Change `numbers` by what other contacts and large displacement add.

    aside   [m] indentation of the linear body under the patch by what the other contacts have done
    others  [N] force on the patch that would indent it as what presses there now does
    """
    rho = model.rho
    keep, take = model.retardation / (dt + model.retardation), dt / (dt + model.retardation)
    self_compliance = numbers[OWN]
    numbers[FREE] += keep * aside
    numbers[NOW] += aside
    if len(rho) == 0 or not self_compliance > 0.0:
        return
    radius, now, free = numbers[RADIUS], numbers[NOW], numbers[FREE]
    force = max(numbers[TOTAL] + others, LEAST_FORCE)
    numbers[NOW] = radius * large_depth(now / radius, rho)[0]
    numbers[FREE] = radius * large_depth(free / radius, rho)[0]
    numbers[DEEP] = max(numbers[NOW] / (radius * DEEPEST) - 1.0, 0.0)
    then, slope = large_depth((free + take * self_compliance * force) / radius, rho)
    numbers[COMPLIANCE] = (radius * then - numbers[FREE]) / force
    # The tangent of a convex s(f): contact comes to its force from above, and does not swing. At rest s_free stays 0.
    if numbers[TOTAL] + others > LEAST_FORCE and slope * take * self_compliance > numbers[COMPLIANCE]:
        numbers[COMPLIANCE] = slope * take * self_compliance
        numbers[FREE] = radius * then - numbers[COMPLIANCE] * force
    numbers[MORE] = (numbers[NOW] - now) / self_compliance
    numbers[PRESS] += numbers[MORE]
