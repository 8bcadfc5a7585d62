"""The patch of two bodies that rub: means over its candidates, and the friction of each (`rubbing`, with its terms)."""

import numpy as np

from palpate.compiler.dot import dot
from palpate.compiler.kernel import kernel
from palpate.physics.arrays import Array, Matrix, Record
from palpate.physics.bodies.floating.turning import cross, times, times_back
from palpate.physics.contact.organs.between import Pair, take
from palpate.physics.contact.organs.condensed_fields import vector3
from palpate.physics.contact.organs.rubbing_axes import add_turned


@kernel
def drag(pair: Pair, rub: Record, body: int, drags: Matrix, dt: float):
    """Place a body's candidates along the surface by all loads but the friction of this step: by the memory of the last
    step, the other loads and the normal forces."""
    share, size, active = take(pair, body, dt), len(rub.touched), pair.active
    moved, others = rub.moved[body], rub.others[body]
    for i in range(2 * size):
        moved[i] = share * others[i] + (1.0 - share) * rub.before[body, i]
    for k in range(active.tally[0].active):
        j = active.order[k]
        row, push = drags[j], share * active.force[j]
        for i in range(2 * size):
            moved[i] += push * row[i]


@kernel
def gather(pair: Pair, rub: Record, total: float, free: Array):
    """Fill `rub.normal`, `rub.plane` with P, and `free` [m] (3) with e."""
    size, active, block = len(rub.touched), pair.active, rub.block
    n = (0.0, 0.0, 0.0)
    rub.plane[:], free[:] = 0.0, 0.0
    for body in range(2):
        sign, tangents, moved, before = 1.0 - 2.0 * body, rub.tangents[body], rub.moved[body], rub.before[body]
        block[:] = 0.0
        e, f = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        for k in range(active.tally[0].active):
            i = active.order[k]
            weight, t, s = active.force[i] / total, vector3(tangents[0], i), vector3(tangents[1], i)
            u, v, out = moved[i] - before[i], moved[size + i] - before[size + i], cross(t, s)
            e = (
                e[0] + weight * (u * t[0] + v * s[0]),
                e[1] + weight * (u * t[1] + v * s[1]),
                e[2] + weight * (u * t[2] + v * s[2]),
            )
            f = f[0] + weight * out[0], f[1] + weight * out[1], f[2] + weight * out[2]
            for x in range(3):
                for y in range(3):
                    block[x, y] += weight * (t[x] * t[y] + s[x] * s[y])
        add_turned(rub.axes[body], block, 0.5, rub.plane)
        e, f = times(rub.axes[body], e), times(rub.axes[body], f)
        n = n[0] + f[0], n[1] + f[1], n[2] + f[2]
        for x in range(3):
            free[x] += sign * e[x]
    away = np.sqrt(dot(n, n))
    by = times(rub.plane, rub.carried)
    for x in range(3):
        rub.normal[x] = n[x] / away if away > 0.0 else rub.normal[x]
        free[x] += by[x]


@kernel
def yields(pair: Pair, rub: Record, total: float, dt: float, out: Matrix):
    """Fill `out` with C [m/N] (3,3), from each two candidates once: D is symmetric (E. Betti)."""
    size, active, block = len(rub.touched), pair.active, rub.block
    out[:] = 0.0
    for body in range(2):
        drags, along, across = rub.first if body == 0 else rub.second, rub.tangents[body, 0], rub.tangents[body, 1]
        block[:] = 0.0
        for k in range(active.tally[0].active):
            j = active.order[k]
            one, two = drags[size + j], drags[2 * size + j]
            # motions of the patch by unit forces along t_1 and t_2 at j: of candidates before j, and of j by half
            u = v = w = a = b = c = 0.0
            for q in range(k + 1):
                i = active.order[q]
                t, s, force = vector3(along, i), vector3(across, i), active.force[i]
                weight = force if q < k else 0.5 * force
                x, y = weight * one[i], weight * one[size + i]
                u, v, w = u + (x * t[0] + y * s[0]), v + (x * t[1] + y * s[1]), w + (x * t[2] + y * s[2])
                x, y = weight * two[i], weight * two[size + i]
                a, b, c = a + (x * t[0] + y * s[0]), b + (x * t[1] + y * s[1]), c + (x * t[2] + y * s[2])
            t, s, force = vector3(along, j), vector3(across, j), active.force[j]
            for x in range(3):
                block[0, x] += force * (u * t[x] + a * s[x])
                block[1, x] += force * (v * t[x] + b * s[x])
                block[2, x] += force * (w * t[x] + c * s[x])
        for x in range(3):
            block[x, x] *= 2.0
            for y in range(x):
                block[x, y] = block[y, x] = block[x, y] + block[y, x]
        add_turned(rub.axes[body], block, take(pair, body, dt) / (total * total), out)


@kernel
def spread(pair: Pair, rub: Record, total: float, dt: float):
    """Spread the friction over the candidates, and move both bodies by it."""
    size, active = len(rub.touched), pair.active
    rub.touched[:] = 0
    for body in range(2):
        drags, tangents, moved = rub.first if body == 0 else rub.second, rub.tangents[body], rub.moved[body]
        share, force = take(pair, body, dt), rub.force[body]
        whole = times_back(rub.axes[body], rub.total)
        for k in range(active.tally[0].active):
            j = active.order[k]
            rub.touched[j] = 1
            weight = active.force[j] / total if body == 1 else -active.force[j] / total
            u, v = weight * dot(whole, vector3(tangents[0], j)), weight * dot(whole, vector3(tangents[1], j))
            for x in range(3):
                force[j, x] += u * tangents[0, j, x]
                force[j, x] += v * tangents[1, j, x]
            one, two, u, v = drags[size + j], drags[2 * size + j], share * u, share * v
            for i in range(2 * size):
                moved[i] = (moved[i] + u * one[i]) + v * two[i]


@kernel
def open_by_friction(rub: Record, others: Matrix):
    """Add to `others` [m] (2,m) the opening of the candidates by the friction of the last step (E. Betti)."""
    size, listed, along, count = len(rub.touched), rub.listed, rub.along, 0
    for j in range(size):
        if rub.touched[j] != 0:
            listed[count] = j
            count += 1
    for body in range(2):
        drags, out = rub.first if body == 0 else rub.second, others[body]
        for k in range(count):
            for a in range(2):
                along[2 * k + a] = dot(rub.force[body, listed[k]], rub.tangents[body, a, listed[k]])
        # along the rows, four at a time: a column is not contiguous, and a sum has to wait for each addition
        whole = size - size % 4
        for i in range(0, whole, 4):
            one, two, three, four = drags[i], drags[i + 1], drags[i + 2], drags[i + 3]
            x, y, z, w = out[i], out[i + 1], out[i + 2], out[i + 3]
            for k in range(count):
                j, u, v = listed[k], along[2 * k], along[2 * k + 1]
                x, y = (x + u * one[j]) + v * one[size + j], (y + u * two[j]) + v * two[size + j]
                z, w = (z + u * three[j]) + v * three[size + j], (w + u * four[j]) + v * four[size + j]
            out[i], out[i + 1], out[i + 2], out[i + 3] = x, y, z, w
        for i in range(whole, size):
            for k in range(count):
                j = listed[k]
                out[i] = (out[i] + along[2 * k] * drags[i, j]) + along[2 * k + 1] * drags[i, size + j]
