"""One implicit viscoelastic step of a condensed organ under the patch that presses it, see `condensed_body`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.physics.bodies.half_space_range import FLAT, LIGHT, NEAR_WIDTH, ground_under
from palpate.physics.bodies.indentation_table import SPACING, patch_radius, rise, risen
from palpate.physics.bodies.patch import normal_force, share_of
from palpate.physics.bodies.true_patch import TruePatch, draw_together, load_radius, patch_compliance
from palpate.physics.kernel import kernel

FORGOTTEN = 1e-9
"""[N] Remaining load below which a vertex is dropped."""
LEAST_FORCE = 1e-3
"""[N] Least force that the terminal law is taken at."""


class CondensedModel(NamedTuple):
    """What a condensed body is made of.

    compliance, vertices, dents  as in `Basis`
    moments           of the hats of the coarse vertices, see `dents.hat_moments`
    corners, weights  [1] (W,3)  vertices of the triangle that a vertex of the fine mesh lies on, and its share of each
    young [Pa], retardation [s]  E, tau
    fine [m] (W,3)    vertices of the fine mesh
    true              what is known of the load's own patch
    """

    compliance: np.ndarray
    vertices: np.ndarray
    dents: np.ndarray
    moments: np.ndarray
    corners: np.ndarray
    weights: np.ndarray
    young: float
    retardation: float
    fine: np.ndarray
    true: TruePatch


COMPLIANCE, FREE, NOW, MORE, OWN, PRESS, RADIUS, WIDE, NARROWED, DEEP, NARROW, THIN, CURVED, NEAR, SLIDES = range(15)
"""Numbers that a body keeps: compliance [m/N], s_free and s [m] of the law that was told, the load [N] on the patch
that large displacement adds, compliance [m/N] of the linear body at rest, the normal force [N] on the patch with what
was added, the patch's radius [m], that on the coarse surface, which the dents were found under, whether it is drawn
together near a nodule; then how far [1] it is outside of what the body can tell, 0 within, 1 at twice the limit: deeper
than the organ was pressed, narrower than the touched mesh, on thin or curved ground, too narrow near a nodule, too
heavy for a surface that is free to slide."""
TOTAL, NUMBERS = 18, 19
"""The normal force of the load [N]; how many numbers."""
SIDE = slice(15, 18)
"""What holds the patch along the surface [1] (3), see `true_patch.patch_compliance`."""


@kernel
def single_step(model, patch, pull, share, normal, dt, fields, marked, curve, numbers, count):
    """`take_load` and `add_others`, of one contact."""
    count, touched = take_load(model, patch, pull, share, normal, dt, fields, marked, numbers, count)
    add_others(model, dt, fields, curve, numbers, touched, 0.0, 0.0)
    return count, touched


@kernel
def take_load(model, patch, pull, share, normal, dt, fields, marked, numbers, count):
    """`share` is 1 where `pull` is a load, 0 where it only marks the patch. Returns how many vertices hold load, and
    how many the patch touches.

    fields  (5,V,3)    h [N]; the load, later the displacement; shares of the normal force; vertices of the patch; room
    marked  [1] (2,V)  the vertices that hold load; 1 for each of these
    """
    compliance, corners, weights, young = model.compliance, model.corners, model.weights, model.young
    held, load, measure, order = fields[0], fields[1], fields[2], fields[3, :, 0]
    active, marks = marked[0], marked[1]
    keep, take = model.retardation / (dt + model.retardation), dt / (dt + model.retardation)
    total = normal_force(pull, normal)
    touched = _onto_coarse(corners, weights, patch, pull, share, normal, total, load, measure, order, marks)
    count = _follow(held, load, order[:touched], share, keep, take, active, marks, count)
    # indentation of the linear body: m.C h of the history, m.C f of the load
    now, static, pressed = 0.0, 0.0, 0.0
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
                out = held[b, 0] * normal[0] + held[b, 1] * normal[1] + held[b, 2] * normal[2]
                along = row[3 * b] * normal[0] + row[3 * b + 1] * normal[1] + row[3 * b + 2] * normal[2]
                pressed += side * out * along
            if share > 0.0:
                for m in range(touched):
                    b = int(order[m])
                    static += side * (
                        row[3 * b] * load[b, 0] + row[3 * b + 1] * load[b, 1] + row[3 * b + 2] * load[b, 2]
                    )
    # the patch as small as the load is: a half-space's correction to the compliance
    radius, narrow = load_radius(model.fine, patch, pull, normal, total, model.true.least)
    wide = patch_radius(model.vertices, model.moments, order, touched, measure)
    numbers[DEEP : SLIDES + 1] = 0.0
    narrowed = draw_together(model, patch, pull, normal, total, order, touched, measure, radius)
    body, more = patch_compliance(
        compliance, model.true, order, touched, measure, narrowed, normal, radius, numbers[SIDE]
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
def _onto_coarse(corners, weights, patch, pull, share, normal, total, load, measure, order, marks):
    """The load [N] and the patch weights m on the vertices of the coarse mesh; adds 2 to the marks of those touched.
    Returns how many these are."""
    touched = 0
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
    return touched


@kernel
def _follow(held, load, order, share, keep, take, active, marks, count):
    """History h of the load: Kelvin-Voigt retardation over a step, h <- keep h + take f; takes the 2 off the marks.
    Returns how many vertices hold load."""
    for k in range(count):
        for i in range(3):
            held[active[k], i] *= keep
    for k in range(len(order)):
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
    return kept


@kernel
def add_others(model, dt, fields, curve, numbers, touched, aside, others):
    """Change `numbers` by what other contacts and large displacement add, see `CondensedBody.answer`.

    curve   (2,D+1)    knots and slopes of the indentation over that of the linear body
    """
    dents, measure, order = model.dents, fields[2], fields[3, :, 0]
    keep, take = model.retardation / (dt + model.retardation), dt / (dt + model.retardation)
    self_compliance = numbers[OWN]
    numbers[FREE] += keep * aside
    numbers[NOW] += aside
    if dents.shape[1] == 0 or not self_compliance > 0.0:
        return
    # large displacement: nonlinear indentation table, s/R over that of the linear body
    radius, now, free = numbers[WIDE], numbers[NOW], numbers[FREE]
    knots, slopes = curve[0], curve[1]
    rise(dents, order, touched, measure, knots, slopes)
    force = max(numbers[TOTAL] + others, LEAST_FORCE)
    numbers[NOW] = radius * risen(now / radius, knots, slopes)[0]
    numbers[FREE] = radius * risen(free / radius, knots, slopes)[0]
    end = SPACING * dents.shape[1]
    numbers[DEEP] = max(numbers[NOW] / (radius * end) - 1.0, 0.0)
    then, slope = risen((free + take * self_compliance * force) / radius, knots, slopes)
    numbers[COMPLIANCE] = (radius * then - numbers[FREE]) / force
    # of a convex s(f): so contact comes to its force from above, and does not swing
    if slope * take * self_compliance > numbers[COMPLIANCE]:
        numbers[COMPLIANCE] = slope * take * self_compliance
        numbers[FREE] = radius * then - numbers[COMPLIANCE] * force
    numbers[MORE] = (numbers[NOW] - now) / self_compliance
    numbers[PRESS] += numbers[MORE]
