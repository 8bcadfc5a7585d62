"""Displacements of a condensed organ's surface due to its loads, see `condensed_body`."""

import numpy as np

from palpate.compiler.kernel import ieee_kernel, kernel
from palpate.physics.arrays import Array, Indices, Matrix, Record, Tensor
from palpate.physics.bodies.condensed_step import ROOM
from palpate.physics.bodies.true_patch import depth_at
from palpate.physics.contact.area import hertz_depth, radius_at


@kernel
def add_field(
    model: Record, u: Matrix, fields: Tensor, marks: Indices, count: int, touched: int, normal: Array, contact: Record
):
    """Add displacements u [m] (V,3), in single precision, of the coarse vertices due to the load history, the
    additional load of large displacement and the tangential force that holds the patch, minus those of the half-space
    under the hat functions, unless the load is scattered: the true one has no profile then."""
    held, share, room, active, order = fields[0], fields[2], fields[ROOM], marks[0], marks[2]
    true, press, side = model.true, contact.press, contact.holds.side
    narrowed = contact.narrowed
    for k in range(touched):
        v = order[k]
        for i in range(3):
            room[v, i] = share[v, 0] * (press * side[i] - contact.more * normal[i])
            if narrowed:  # twice, as displacements are also averaged with the hat functions
                room[v, i] += 2.0 * (share[v, 1] - share[v, 0]) * press * (side[i] - normal[i])
    for k in range(count):
        for i in range(3):
            room[active[k], i] += held[active[k], i]
    _add_rows(u.reshape(-1), model.compliance, active[:count], order[:touched], room, model.young)
    if len(true.table) > 0:
        n0, n1, n2 = np.float32(normal[0]), np.float32(normal[1]), np.float32(normal[2])
        hats = np.zeros(len(u), dtype=np.float32)
        for k in range(touched):
            v = order[k]
            part = 2.0 * share[v, 1] - share[v, 0] if narrowed else share[v, 0]
            amount = np.float32(true.normal * press * part * (1.0 - contact.scattered) / model.young)
            row = true.table[v]
            for b in range(len(hats)):
                hats[b] += amount * row[b]
        for b in range(len(hats)):
            u[b, 0] += hats[b] * n0
            u[b, 1] += hats[b] * n1
            u[b, 2] += hats[b] * n2


@ieee_kernel
def _add_rows(field: Array, rows: Matrix, active: Indices, order: Indices, forces: Matrix, young: float):
    """For each vertex v of two lists add rows 3v, 3v + 1, 3v + 2 times its force over `young` to a field, one vertex
    after the other; sets the force to 0. Two vertices share a pass over the field, which takes 80 % of the time."""
    waits, f0, f1, f2 = -1, np.float32(0.0), np.float32(0.0), np.float32(0.0)
    for k in range(len(active) + len(order)):
        v = active[k] if k < len(active) else order[k - len(active)]
        force = forces[v]
        g0, g1, g2 = np.float32(force[0] / young), np.float32(force[1] / young), np.float32(force[2] / young)
        force[:] = 0.0
        if g0 == 0.0 and g1 == 0.0 and g2 == 0.0:
            continue
        if waits < 0:
            waits, f0, f1, f2 = v, g0, g1, g2
            continue
        a, b, c = rows[3 * waits], rows[3 * waits + 1], rows[3 * waits + 2]
        d, e, f = rows[3 * v], rows[3 * v + 1], rows[3 * v + 2]
        for j in range(len(field)):
            field[j] = field[j] + (f0 * a[j] + f1 * b[j] + f2 * c[j]) + (g0 * d[j] + g1 * e[j] + g2 * f[j])
        waits = -1
    if waits >= 0:
        a, b, c = rows[3 * waits], rows[3 * waits + 1], rows[3 * waits + 2]
        for j in range(len(field)):
            field[j] += f0 * a[j] + f1 * b[j] + f2 * c[j]


@ieee_kernel
def add_half_space(model: Record, foot: Array, normal: Array, contact: Record, nodes: Indices, moved: Matrix):
    """Add the displacement of the half-space under the true load to that of the fine vertices `nodes`."""
    true, press, radius = model.true, contact.press, contact.radius
    if len(true.table) == 0:
        return
    grows = len(model.area.forces) > 0
    if grows:
        radius = max(radius_at(model.area.forces, model.area.radii, press), 1e-6)
    deep = (0.75 * np.pi if grows else 1.0) * (1.0 - true.held) * true.normal * press / (model.young * radius)
    deep *= 1.0 - contact.scattered
    n0, n1, n2, flat = deep * normal[0], deep * normal[1], deep * normal[2], 1.0 / (radius * radius)
    for k in range(len(nodes)):
        p = nodes[k]
        d0, d1, d2 = model.fine[p, 0] - foot[0], model.fine[p, 1] - foot[1], model.fine[p, 2] - foot[2]
        square = (d0 * d0 + d1 * d1 + d2 * d2) * flat
        depth = hertz_depth(square) if grows else depth_at(true.profile, square)
        moved[k, 0] -= depth * n0
        moved[k, 1] -= depth * n1
        moved[k, 2] -= depth * n2
