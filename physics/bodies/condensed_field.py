"""Displacements of a condensed organ's surface under what it holds, see `condensed_body`."""

from __future__ import annotations

import numpy as np

from palpate.physics.bodies.condensed_step import MORE, NARROWED, PRESS, RADIUS, SIDE
from palpate.physics.bodies.patch import carried
from palpate.physics.bodies.true_patch import dent_at
from palpate.physics.kernel import kernel


@kernel
def add_field(model, u, fields, active, count, touched, normal, numbers):
    """Add displacements of the coarse vertices: of the body under what it holds, what large displacement adds and what
    holds the patch along the surface, less the half-space's own under the hats."""
    compliance, held, share, order = model.compliance, fields[0], fields[2], fields[3, :, 0]
    true, press = model.true, numbers[PRESS]
    narrowed = numbers[NARROWED] > 0.0
    field, side, patch = u.reshape(-1), numbers[SIDE], fields[4]
    for k in range(touched):
        v = int(order[k])
        for i in range(3):
            patch[v, i] = share[v, 0] * (press * side[i] - numbers[MORE] * normal[i])
            if narrowed:  # twice: what is shown passes through the hats once more
                patch[v, i] += 2.0 * (share[v, 1] - share[v, 0]) * press * (side[i] - normal[i])
    for k in range(count):
        b = active[k]
        for i in range(3):
            patch[b, i] += held[b, i]
        _add_three(field, compliance, b, patch[b], model.young)
    for k in range(touched):
        v = int(order[k])
        _add_three(field, compliance, v, patch[v], model.young)
    if len(true.table) > 0:
        hats = patch.reshape(-1)[: len(u)]
        for k in range(touched):
            v = int(order[k])
            part = 2.0 * share[v, 1] - share[v, 0] if narrowed else share[v, 0]
            _add(hats, true.table[v], true.normal * press * part / model.young)
        for v in range(len(u)):
            for i in range(3):
                u[v, i] += hats[v] * normal[i]
        hats[:] = 0.0


@kernel
def surface_displacements(model, foot, reach, room, fields, active, count, touched, normal, numbers, nodes, moved):
    """Displacements of the fine mesh near the foot; returns of how many vertices."""
    u = fields[1]
    u[:] = 0.0
    add_field(model, u, fields, active, count, touched, normal, numbers)
    told = carried(model.corners, model.weights, u, reach, foot, room, nodes, moved)
    add_dent(model, foot, normal, numbers, nodes[:told], moved)
    return told


@kernel
def _add_three(field, rows, v, force, young):
    """Add rows 3v, 3v + 1, 3v + 2 times a force (3) over `young` to a field; sets the force to 0."""
    f0, f1, f2 = force[0] / young, force[1] / young, force[2] / young
    first, second, third = rows[3 * v], rows[3 * v + 1], rows[3 * v + 2]
    if f0 != 0.0 and f1 != 0.0 and f2 != 0.0:  # the field is read and written once
        for k in range(len(field)):
            field[k] = field[k] + f0 * first[k] + f1 * second[k] + f2 * third[k]
    else:
        _add(field, first, f0)
        _add(field, second, f1)
        _add(field, third, f2)
    force[:] = 0.0


@kernel
def add_dent(model, foot, normal, numbers, nodes, moved):
    """Add the half-space's own displacement under the true load to that of the fine vertices `nodes`."""
    true, press, radius = model.true, numbers[PRESS], numbers[RADIUS]
    if len(true.table) == 0:
        return
    deep = (1.0 - true.held) * true.normal * press / (model.young * radius)
    for k in range(len(nodes)):
        p = nodes[k]
        d0, d1, d2 = model.fine[p, 0] - foot[0], model.fine[p, 1] - foot[1], model.fine[p, 2] - foot[2]
        dent = deep * dent_at(true.profile, np.sqrt(d0 * d0 + d1 * d1 + d2 * d2) / radius)
        for i in range(3):
            moved[k, i] -= dent * normal[i]


@kernel
def _add(field, row, amount):
    """Add `amount` of a row to a field."""
    if amount != 0.0:
        for k in range(len(field)):
            field[k] += amount * row[k]
