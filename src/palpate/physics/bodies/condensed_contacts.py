"""A condensed organ under several contacts: the coupling between them.

The load history h_j of contact j indents the patch of contact i by

    a_ij = (g_i.C h_j + k_ij)/E,    H_ij = (1 - nu²)/pi (X_ij - g_i.T g_j) n_i.n_j,    i != j

with the shares g of the normal force at the coarse vertices, and the compliance C for a modulus of 1 Pa. While contact
j bears a load, the correction k_ij is H_ij y_j, with the normal force y_j on its patch that corresponds to h_j. Without
a load it decays like h_j: a finger that has left the tissue, and whose foot point leaps, would otherwise move the
tissue under the others in that step. What is left of it when j bears a load again continues to decay. As in
`physics.bodies.true_patch`, a half-space corrects for the hat functions: T is its mean 1/r between hat functions, X
that between the true loads, X = Y(d/R)/R at the distance d, R² the mean of both patches' R²,

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
contacts at the same place equal one with both forces.

The tangential energy gradient at contact i is that of `physics.bodies.place_energy` plus f_i times the gradient of a_ij
along the surface, which attracts a finger to another's indentation (exact while contact j bears its load: what is left
of the forces that held a former patch is in a_ij only). With the displacement u by contact j and the forces
that hold its patch, it has two parts,

    -(sum over v of dg_i,v/dp (n_i + t_i).u_v + (dn_i/dp + dt_i/dp).u_i),    u_i = sum over v of g_i,v u_v

On curved ground the normal turns with the foot, and so does the force that holds a patch: without the second part an
organ that another finger pushes aside as a whole would seem tilted. Both derivatives are those of the means over the
patch of n and t round each coarse vertex.
"""

import numpy as np

from palpate.compiler.fields import element_type
from palpate.compiler.kernel import kernel
from palpate.compiler.memory import stack_zeros
from palpate.physics.arrays import Array, Indices, Matrix, Record, Tensor
from palpate.physics.bodies import condensed_step as step
from palpate.physics.bodies.loads.pairs import between, hats, sticking
from palpate.physics.bodies.place_energy import Ground

KEPT = {"bore": bool, "acts": (4,), "left": (4,)}
"""State of the correction k_ij: whether contact j bore a load; k_ij [m Pa] and its gradient [Pa] (3) along the surface
at contact i; what is left of these from a place where contact j bore a load before."""
KEPT_TYPE = element_type(KEPT)


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
    kept: Record,
    ground: Ground,
    vectors: Tensor,
    dt: float,
):
    """Coupling between contacts, and large displacement: updates `contacts`, and fills the compliances between patches
    `cross` [m/N] (c,c), with a zero diagonal, `coupling` [1] (c,c), see `physics.contact.joint`, and `slope` [N] (c,3),
    the tangential energy gradient at each contact due to the others.

    fields (c,F,V,3), marks (c,3,V), contacts (c), counts (c,3): of each contact, see `condensed_step`; the third count
                                                                  is filled
    room   (4,c,V) lists of the loaded and touched vertices of each contact, shares of its patch, two workspaces
    kept   (c,c) `KEPT` of contact i for each j
    ground  normals and holding forces round the coarse vertices
    vectors (2 c,V,3) two workspaces of each contact, see `_pair`
    """
    many = len(counts)
    held = np.zeros((many, 3))
    aside, others, scale = np.zeros((many, 2)), np.zeros(many), np.zeros(many)
    listed, shares, responds, near = room[0], room[1], room[2], room[3]
    slope[:] = 0.0
    for i in range(many):
        cross[i, i] = 0.0
        _list_vertices(fields[i], marks[i], counts[i], listed[i], shares[i])
    # compliances between patches, indentation and gradient due to the others
    lost = sticking(model, profile, marks, contacts, counts, normals, feet, shares, near, held)
    for i in range(many):
        for j in range(i):
            _pair(i, j, model, profile, fields, marks, contacts, counts, normals, feet, listed, shares, responds, near,
                  cross, aside, slope, lost, held, kept, ground, vectors)  # fmt: skip
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
    _take_others_out(contacts, cross, others, scale, take, coupling)
    for i in range(many):
        for x in range(3):
            slope[i, x] *= contacts[i].total


@kernel
def _take_others_out(contacts: Record, cross: Matrix, others: Array, scale: Array, take: float, coupling: Matrix):
    """Laws with the free indentation without the forces of the others, which act through the `coupling`."""
    for i in range(len(contacts)):
        compliance = max(contacts[i].compliance, 1e-300)
        contacts[i].free += contacts[i].compliance * others[i]
        for j in range(len(contacts)):
            joined = take * cross[i, j] * scale[i] * scale[j]
            contacts[i].free -= joined * contacts[j].total
            coupling[i, j] = joined / (compliance + contacts[i].rubs)
        coupling[i, i] = 1.0
        step.with_friction(contacts[i])


@kernel
def _list_vertices(fields: Tensor, marks: Indices, counts: Indices, listed: Array, shares: Array):
    """List the loaded and touched vertices of a contact, and fill in the shares of its patch."""
    for k in range(counts[0]):
        v = marks[0, k]
        listed[k], shares[v] = v, 0.0
    held = counts[0]
    for k in range(counts[1]):
        v = marks[2, k]
        shares[v] = fields[2, v, 0]
        if marks[1, v] == 0:
            listed[held] = v
            held += 1
    counts[2] = held


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
    listed: Matrix,
    shares: Matrix,
    responds: Matrix,
    near: Matrix,
    cross: Matrix,
    aside: Matrix,
    slope: Matrix,
    lost: Matrix,
    held: Matrix,
    kept: Record,
    ground: Ground,
    vectors: Tensor,
):
    """Fill c_ij in `cross`, and add a_ij to `aside` and its gradient to `slope`, for both contacts, see `joint_answer`.

    C is read once for both directions. `lost`, `held`: of `sticking`.
    """
    sticks = 0.0 if contacts[i].organ or contacts[j].organ else 1.0
    true, compliance, young = model.true, model.compliance, model.young
    n, m, f, g = normals[i], normals[j], fields[i, 0], fields[j, 0]
    # -n.C h of each contact at the vertices of the other, in `mine` and `yours`; g_i.C g_j in `both`
    mine, yours = responds[i], responds[j]
    # -u of each contact, with the forces that hold its patch, at the vertices of the other: C times `_pulls`
    my_pull, your_pull, my_way, your_way = vectors[2 * i], vectors[2 * j], vectors[2 * i + 1], vectors[2 * j + 1]
    _pulls(contacts[i], listed[i], counts[i, 2], shares[i], f, held[i], sticks, my_pull)
    _pulls(contacts[j], listed[j], counts[j, 2], shares[j], g, held[j], sticks, your_pull)
    for k in range(counts[j, 2]):
        yours[int(listed[j, k])] = 0.0
        your_way[int(listed[j, k])] = 0.0
    both = 0.0
    for k in range(counts[i, 2]):
        v = int(listed[i, k])
        total = 0.0
        my_way[v] = 0.0
        for q in range(counts[j, 2]):
            b = int(listed[j, q])
            for x in range(3):
                row = compliance[3 * v + x]
                c0, c1, c2 = row[3 * b], row[3 * b + 1], row[3 * b + 2]
                along = c0 * m[0] + c1 * m[1] + c2 * m[2]
                both += shares[i, v] * shares[j, b] * n[x] * along
                yours[b] -= f[v, x] * along
                total -= n[x] * (c0 * g[b, 0] + c1 * g[b, 1] + c2 * g[b, 2])
                my_way[v, x] += c0 * your_pull[b, 0] + c1 * your_pull[b, 1] + c2 * your_pull[b, 2]
                your_way[b, 0] += my_pull[v, x] * c0
                your_way[b, 1] += my_pull[v, x] * c1
                your_way[b, 2] += my_pull[v, x] * c2
        mine[v] = total
    # correction H_ij minus the reduction by sticking; c_ij is limited to sqrt(c_ii c_jj)
    facing = max(n[0] * m[0] + n[1] * m[1] + n[2] * m[2], 0.0) * true.normal
    more = change = 0.0
    if len(true.table) > 0:
        common = hats(i, j, true.table, marks, counts, shares, near)
        hats(j, i, true.table, marks, counts, shares, near)
        more, change = between(i, j, profile, contacts, feet, common)
    more = facing * more - lost[i, j]
    both += more
    most = np.sqrt(max(contacts[i].self_compliance * contacts[j].self_compliance, 0.0)) * young
    share = (most / abs(both) if abs(both) > most else 1.0) / young
    cross[i, j] = cross[j, i] = share * both
    # indentation a_ij and its gradient, without the part along the normal
    for a, b in ((i, j), (j, i)):
        press = contacts[b].press if contacts[b].total > 0.0 else 0.0
        keeps, out = kept[a, b], 0.0
        _keep_correction(a, b, more, facing, change, model, fields, marks, contacts, counts, feet, near, keeps)
        done = more * press + keeps.left[0]
        way = vectors[2 * a + 1]
        side, mean = stack_zeros((3,)), stack_zeros((3,))
        for x in range(3):
            side[x] = normals[a, x] + sticks * held[a, x]
        for k in range(counts[a, 1]):
            v = marks[a, 2, k]
            done += shares[a, v] * responds[a, v]
            for x in range(3):
                mean[x] += shares[a, v] * way[v, x]
        for k in range(counts[a, 1]):
            v, here = marks[a, 2, k], 0.0
            for x in range(3):
                turns = ground.normals[v, x] + sticks * ground.holding[v, x]
                here += side[x] * way[v, x] + turns * mean[x]
            if len(true.table) > 0:
                here -= facing * near[a, v] * press
            for x in range(3):
                slope[a, x] += share * fields[a, step.TILT, v, x] * here
        for x in range(3):
            slope[a, x] += share * facing * change * press * (feet[a, x] - feet[b, x])
            slope[a, x] += share * keeps.left[1 + x]
            out += slope[a, x] * normals[a, x]
        for x in range(3):
            slope[a, x] -= out * normals[a, x]
        _add_indentation(aside[a], share * done, contacts[b])


@kernel
def _pulls(
    contact: Record,
    listed: Array,
    count: int,
    shares: Array,
    history: Matrix,
    held: Array,
    sticks: float,
    pulls: Matrix,
):
    """Fill minus the forces of a contact on its vertices: its history, and what holds its patch under its load."""
    press = sticks * contact.press if contact.total > 0.0 else 0.0
    for k in range(count):
        v = int(listed[k])
        for x in range(3):
            pulls[v, x] = shares[v] * press * held[x] - history[v, x]


@kernel
def _keep_correction(
    a: int,
    b: int,
    more: float,
    facing: float,
    change: float,
    model: Record,
    fields: Tensor,
    marks: Indices,
    contacts: Record,
    counts: Indices,
    feet: Matrix,
    near: Matrix,
    keeps: Record,
):
    """Step k_ab and its gradient: the present correction H_ab [m/N Pa] is `more`, and its half-space's part `facing`
    times Y/R - g.T g, whose derivative over the distance is `change`.

    While contact b bears a load, that acts in proportion to `press`, and so does what is left of a former place; when
    it begins to bear one again, that place's part is what the present correction would lack of k_ab.
    """
    one, acts, left = contacts[b], keeps.acts, keeps.left
    loaded, began = one.total > 0.0, one.total > 0.0 and not keeps.bore
    known = acts[0] != 0.0 and one.course.value > 0.0
    keeps.bore = loaded
    for x in range(4):
        left[x] = one.fading * (acts[x] if began or not loaded else left[x]) if known else 0.0
        acts[x] = left[x]
    if not loaded:
        return
    before = max(one.press - one.added, 0.0) if began and known else 0.0
    for x in range(4):
        now = more if x == 0 else facing * change * (feet[a, x - 1] - feet[b, x - 1])
        if x > 0 and len(model.true.table) > 0:
            for k in range(counts[a, 1]):
                v = marks[a, 2, k]
                now -= facing * near[a, v] * fields[a, step.TILT, v, x - 1]
        left[x] -= now * before
        acts[x] = left[x] + now * one.press


@kernel
def _add_indentation(aside: Array, indentation: float, contact: Record):
    """Add the indentation [m] due to the history of a contact, see `add_others`."""
    aside[0] += indentation
    aside[1] += indentation * contact.course.ahead
