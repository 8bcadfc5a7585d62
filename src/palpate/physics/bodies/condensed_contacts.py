"""A condensed organ under several contacts: the coupling between them.

The load history h_j of contact j indents the patch of contact i by

    a_ij = (g_i.C h_j + H_ij y_j)/E,    H_ij = (1 - nu²)/pi (X_ij - g_i.T g_j) n_i.n_j,    i != j

with the shares g of the normal force at the coarse vertices, the compliance C for a modulus of 1 Pa, and the normal
force y_j that corresponds to h_j on its patch. As in `physics.bodies.true_patch`, a half-space corrects for the hat
functions: T is its mean 1/r between hat functions, X that between the true loads, X = Y(d/R)/R at the distance d, R²
the mean of both patches' R²,

    Y(rho) = integral of (48 J3(x)/x³)² J0(x rho) from 0 to inf,    Y(0) = I,    Y -> 1/rho + 1/(8 rho³)

The compliance between two patches is c_ij = (g_i.C g_j + H_ij)/E = c_ji (E. Betti 1872), |c_ij| <= sqrt(c_ii c_jj).
If patches stick, each normal force acts with the tangential forces t = -C_tt^-1 C_tz that hold its patch, z being the
normal and t the tangential directions. Between two patches c_zz then becomes

    C_zz + C_zt t_j + t_i C_tz + t_i C_tt t_j

with H in C_tt, times `TruePatch.tangential`; C_zt is not corrected. A patch does not hold the organ against the forces
of the others: that takes friction, which the normal force limits, and depends on the place where it began. If it
did, a finger that hovers would stiffen the organ under the others, by up to 25 % for a ball on its foundation, and one
that touches later would return more energy than was put in. On a slab the indentation differs from that of a full
model by at most 2.1 % either way. Sticking of each point of a patch affects only c_ii.

Large displacement is applied to the total indentation of a patch. The ratio tau_i of its chord compliance to the linear
one scales the coupling: c_ij sqrt(tau_i tau_j) is symmetric and positive, so that the joint step is passive. Two
contacts at the same place equal one with both forces. The tangential energy gradient at contact i is that of
`physics.bodies.place_energy` plus f_i times the gradient of a_ij, which attracts a finger to another's indentation.
"""

import numpy as np

from palpate.compiler.exact import cos, product
from palpate.compiler.kernel import kernel
from palpate.physics.arrays import Array, Indices, Matrix, Record, Tensor
from palpate.physics.bodies import condensed_step as step
from palpate.physics.bodies.true_patch import sideways
from palpate.physics.kept import keep_results
from palpate.physics.special import gauss_legendre, patch_depth

STEP, FARTHEST = 1.0 / 32.0, 6.0  # [1] Step and end of the table of Y over d/R


@keep_results
def joint_profile() -> np.ndarray:
    """Y at rho = 0, STEP ... FARTHEST: the mean of W (`true_patch.depth_profile`) over a patch at the distance rho, by
    the Gauss-Legendre rule over its radius and the trapezoidal rule over the angle."""
    rho = np.arange(0.0, FARTHEST + 0.5 * STEP, STEP)
    node, weight = gauss_legendre(32)
    r = 0.5 * (node + 1.0)
    weight = 0.5 * weight * 6.0 * r * (1.0 - r * r) ** 2
    turn = (np.arange(64) + 0.5) * np.pi / 64
    away = np.sqrt(rho[:, None, None] ** 2 + r[:, None] ** 2 + 2.0 * rho[:, None, None] * r[:, None] * cos(turn))
    return product(patch_depth(away).mean(axis=2), weight)


@kernel
def joint_answer(
    model: Record,
    profile: Array,
    fields: Tensor,
    marks: Indices,
    contacts: Record,
    counts: Indices,
    normals: Matrix,
    feet: Matrix,
    room: Tensor,
    cross: Matrix,
    coupling: Matrix,
    slope: Matrix,
    dt: float,
):
    """Coupling between contacts, and large displacement: updates `contacts`, and fills the compliances between patches
    `cross` [m/N] (c,c), with a zero diagonal, `coupling` [1] (c,c), see `physics.contact.joint`, and `slope` [N] (c,3),
    the tangential energy gradient at each contact due to the others.

    fields (c,F,V,3), marks (c,3,V), contacts (c), counts (c,3): of each contact, see `condensed_step`; the third count
                                                                  is filled
    room   (c,4,V) of each contact: list of its loaded and touched vertices, shares of the patch, two workspaces
    """
    # lists of vertices and shares of each contact
    many = len(counts)
    aside, others, scale = np.zeros((many, 2)), np.zeros(many), np.zeros(many)
    slope[:] = 0.0
    for i in range(many):
        cross[i, i] = 0.0
        for k in range(counts[i, 0]):
            v = marks[i, 0, k]
            room[i, 0, k], room[i, 1, v] = v, 0.0
        held = counts[i, 0]
        for k in range(counts[i, 1]):
            v = marks[i, 2, k]
            room[i, 1, v] = fields[i, 2, v, 0]
            if marks[i, 1, v] == 0:
                room[i, 0, held] = v
                held += 1
        counts[i, 2] = held
    # compliances between patches, indentation and gradient due to the others
    lost = _sticking(model, profile, marks, contacts, counts, normals, feet, room)
    for i in range(many):
        for j in range(i):
            _pair(i, j, model, profile, fields, marks, contacts, counts, normals, feet, room, cross, aside, slope, lost)
    # large displacement at the effective forces; tau is the square of `scale`
    take = dt / (dt + model.retardation)
    for i in range(many):
        self_compliance = max(contacts[i].self_compliance, 1e-300)
        for j in range(many):
            others[i] += cross[i, j] * contacts[j].total / self_compliance
    for i in range(many):
        step.add_others(model, dt, contacts[i], aside[i, 0], aside[i, 1], others[i])
        tau = max(contacts[i].compliance, 1e-300) / (take * max(contacts[i].self_compliance, 1e-300))
        scale[i] = np.sqrt(tau)
        if len(model.area.forces) > 0:  # growth of the contact is local: the others indent it as a linear organ
            others[i], scale[i] = others[i] / tau, min(scale[i], 1.0)
    # laws: free indentation without the forces of the others, which act through the coupling
    for i in range(many):
        compliance = max(contacts[i].compliance, 1e-300)
        contacts[i].free += contacts[i].compliance * others[i]
        for j in range(many):
            joined = take * cross[i, j] * scale[i] * scale[j]
            contacts[i].free -= joined * contacts[j].total
            coupling[i, j] = joined / (compliance + contacts[i].rubs)
        coupling[i, i] = 1.0
        step.with_friction(contacts[i])
        for x in range(3):
            slope[i, x] *= contacts[i].total


@kernel
def _between(i: int, j: int, profile: Array, contacts: Record, feet: Matrix, hats: float):
    """Mean 1/r [1/m] between two true patches minus that of the hat functions; derivative over the distance [1/m³]."""
    radius = np.sqrt(0.5 * (contacts[i].radius ** 2 + contacts[j].radius ** 2))
    away = 0.0
    for x in range(3):
        away += (feet[i, x] - feet[j, x]) ** 2
    away = np.sqrt(away)
    mean, change = _mean_inverse(profile, away / radius)
    return mean / radius - hats, change / (radius * radius * max(away, 1e-12))


@kernel
def _sticking(
    model: Record,
    profile: Array,
    marks: Indices,
    contacts: Record,
    counts: Indices,
    normals: Matrix,
    feet: Matrix,
    room: Tensor,
):
    """Reduction [m/N] (c,c) of the compliances between patches because they stick, for a modulus of 1 Pa; its diagonal
    is zero, as c_ii includes it. 0 if patches slide."""
    many, compliance, true = len(counts), model.compliance, model.true
    lost, block, held = np.zeros((many, many)), np.zeros((3, 3)), np.zeros((many, 3))
    if not true.sticks:
        return lost
    for i in range(many):
        _holding(contacts[i].holds, normals[i], held[i])
        for j in range(i):
            if contacts[i].organ or contacts[j].organ:  # its patch is another when it parts, but not its history
                continue
            # g_i.C g_j, in C_tt with the correction
            block[:] = 0.0
            for k in range(counts[i, 1]):
                v = marks[i, 2, k]
                for q in range(counts[j, 1]):
                    b = marks[j, 2, q]
                    both = room[i, 1, v] * room[j, 1, b]
                    for x in range(3):
                        for y in range(3):
                            block[x, y] += both * compliance[3 * v + x, 3 * b + y]
            hats = _hats(i, j, true.table, marks, counts, room)
            more = true.tangential * true.normal * _between(i, j, profile, contacts, feet, hats)[0]
            total = 0.0
            for x in range(3):
                total += held[i, x] * more * held[j, x]
                for y in range(3):
                    along = normals[i, x] * held[j, y] + held[i, x] * normals[j, y] + held[i, x] * held[j, y]
                    total += block[x, y] * along
            lost[i, j] = lost[j, i] = -total
    return lost


@kernel
def _holding(holds: Record, normal: Array, held: Array):
    """Fill the tangential force [1] (3) that holds a patch under a unit normal force."""
    a, b, d = holds.own[0, 0], holds.own[0, 1], holds.own[1, 1]
    y, z = holds.cross[0], holds.cross[1]
    det = a * d - b * b
    held[:] = 0.0
    if det > 0.0:
        axes = np.zeros((2, 3))
        sideways(normal, axes)
        for x in range(3):
            held[x] = -((d * y - b * z) * axes[0, x] + (a * z - b * y) * axes[1, x]) / det


@kernel
def _pair(
    i: int,
    j: int,
    model: Record,
    profile: Array,
    fields: Tensor,
    marks: Indices,
    contacts: Record,
    counts: Indices,
    normals: Matrix,
    feet: Matrix,
    room: Tensor,
    cross: Matrix,
    aside: Matrix,
    slope: Matrix,
    lost: Matrix,
):
    """Fill c_ij in `cross`, and add a_ij to `aside` and its gradient to `slope`, for both contacts, see `joint_answer`.

    C is read once for both directions. `lost`: of `_sticking`.
    """
    true, compliance, young = model.true, model.compliance, model.young
    n, m, f, g = normals[i], normals[j], fields[i, 0], fields[j, 0]
    # -n.C h of each contact at the vertices of the other, in `mine` and `yours`; g_i.C g_j in `both`
    mine, yours = room[i, 2], room[j, 2]
    for k in range(counts[j, 2]):
        yours[int(room[j, 0, k])] = 0.0
    both = 0.0
    for k in range(counts[i, 2]):
        v = int(room[i, 0, k])
        total = 0.0
        for q in range(counts[j, 2]):
            b = int(room[j, 0, q])
            for x in range(3):
                row = compliance[3 * v + x]
                c0, c1, c2 = row[3 * b], row[3 * b + 1], row[3 * b + 2]
                along = c0 * m[0] + c1 * m[1] + c2 * m[2]
                both += room[i, 1, v] * room[j, 1, b] * n[x] * along
                yours[b] -= f[v, x] * along
                total -= n[x] * (c0 * g[b, 0] + c1 * g[b, 1] + c2 * g[b, 2])
        mine[v] = total
    # correction H_ij minus the reduction by sticking; c_ij is limited to sqrt(c_ii c_jj)
    facing = max(n[0] * m[0] + n[1] * m[1] + n[2] * m[2], 0.0) * true.normal
    more = change = 0.0
    if len(true.table) > 0:
        hats = _hats(i, j, true.table, marks, counts, room)
        _hats(j, i, true.table, marks, counts, room)
        more, change = _between(i, j, profile, contacts, feet, hats)
    more = facing * more - lost[i, j]
    both += more
    most = np.sqrt(max(contacts[i].self_compliance * contacts[j].self_compliance, 0.0)) * young
    share = (most / abs(both) if abs(both) > most else 1.0) / young
    cross[i, j] = cross[j, i] = share * both
    # indentation a_ij and its gradient, without the part along the normal
    for a, b in ((i, j), (j, i)):
        press = contacts[b].press
        done = more * press
        out = 0.0
        for k in range(counts[a, 1]):
            v = marks[a, 2, k]
            here = room[a, 2, v]
            done += room[a, 1, v] * here
            if len(true.table) > 0:
                here -= facing * room[a, 3, v] * press
            for x in range(3):
                slope[a, x] += share * fields[a, step.TILT, v, x] * here
        for x in range(3):
            slope[a, x] += share * facing * change * press * (feet[a, x] - feet[b, x])
            out += slope[a, x] * normals[a, x]
        for x in range(3):
            slope[a, x] -= out * normals[a, x]
        _add_indentation(aside[a], share * done, contacts[b])


@kernel
def _add_indentation(aside: Array, indentation: float, contact: Record):
    """Add the indentation [m] due to the history of a contact, see `add_others`."""
    aside[0] += indentation
    aside[1] += indentation * contact.course.ahead


@kernel
def _hats(i: int, j: int, table: Matrix, marks: Indices, counts: Indices, room: Tensor):
    """Mean 1/r [1/m] between the hat functions of two patches; fills that of each vertex of the first into its room."""
    total = 0.0
    for k in range(counts[i, 1]):
        v = marks[i, 2, k]
        near = 0.0
        for q in range(counts[j, 1]):
            b = marks[j, 2, q]
            near += table[v, b] * room[j, 1, b]
        room[i, 3, v] = near
        total += room[i, 1, v] * near
    return total


@kernel
def _mean_inverse(profile: Array, rho: float):
    """Y and its derivative at rho [1], by linear interpolation of the table, and the asymptote beyond its end."""
    at = rho / STEP
    k = int(at)
    if k + 1 >= len(profile):
        return (1.0 + 0.125 / (rho * rho)) / rho, -(1.0 + 0.375 / (rho * rho)) / (rho * rho)
    rise = profile[k + 1] - profile[k]
    return profile[k] + (at - k) * rise, rise / STEP
