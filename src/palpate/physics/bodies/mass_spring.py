"""The mass-spring body, nodal law: each loaded node of the surface is an independent spring with a damper.

Node j of area A_j carries the pressure p_j = f_j/A_j. Its normal law is the law of the contact for a fraction of the
total normal force f [N],

    K <u + tau (u - u_j)/T>^n <1 + c (u - u_j)/T> = f p_j/p_max,

so that the node with the largest pressure moves by the indentation s of the contact, and at rest
u(d) = s (k(d)/k(0))^{1/n} for a force spread by a kernel k. Without load, u <- max(u tau/(T + tau), u - T/c). Along
the surface each node has a linear spring k_t and damper d_t, by backward Euler:
u_t <- (f_t T p_j/p_max + d_t u_t)/(k_t T + d_t), f_t the total. A compact list contains the nodes that are loaded or
have not recovered.
"""

import math
from typing import Annotated, NamedTuple

import numpy as np

from palpate.compiler.dot import dot
from palpate.compiler.exact import row_times
from palpate.compiler.fields import element_type
from palpate.compiler.kernel import ieee_kernel
from palpate.compiler.memory import stack_zeros
from palpate.physics.arrays import Array, Indices, Matrix, Record, Vector3
from palpate.physics.bodies import patch
from palpate.physics.bodies.stretch import Neighbours, StretchWorkspace, limit_stretch, neighbours
from palpate.physics.contact.terminal import free_recovery, indentation, power_of
from palpate.physics.geometry.mesh import Mesh

AT_REST = 1e-9  # [m] Displacement below which an unloaded node counts as recovered
SPRING = {"indentation": (), "normal": (3,), "load": (3,)}
"""A node in the list: u [m], normal [1] of its last load, and load [N]."""
SPRINGS = element_type(SPRING)
GROUND = element_type({"position": (3,), "factor": (), "operator": (9,), "leans": (3,)})
"""A vertex of an organ: x [m], factor on K, shape operator [1/m] row by row, d of `side_force` [1]."""
MOST_STRAIN = 0.8  # [1] Largest difference of displacement between neighbours, over the length of their edge


@ieee_kernel
def normal_force(forces: Matrix, normal: Vector3):
    """Total of nodal forces [N] (k,3) against the outward unit normal [1] (3), at least 0."""
    return max(patch.normal_force(forces, normal), 0.0)


@ieee_kernel
def shared_load(foot: Array, other_foot: Array, normal: Array, other_normal: Array, radius: float):
    """Share O [1] of the force of one contact that acts on another, of patches of this radius R [m]:

        O = (1 - q)^4 (4q + 1) n.n',    q = |x - x'|/2R

    1 for equal feet, 0 if the patches do not overlap or face away; positive definite (H. Wendland, Adv. Comput. Math. 4
    (1995) 389-396), so that the coupled contacts are passive. feet [m] (3), normals [1] (3)
    """
    away = facing = 0.0
    for i in range(3):
        away += (foot[i] - other_foot[i]) * (foot[i] - other_foot[i])
        facing += normal[i] * other_normal[i]
    q = min(math.sqrt(away) / (2.0 * radius), 1.0)
    square = (1.0 - q) * (1.0 - q)
    return square * square * (4.0 * q + 1.0) * max(facing, 0.0)


@ieee_kernel
def add_shared(forces: Matrix, normal: Vector3, share: float):
    """Nodal forces [N] (k,3) plus the fraction `share` [1] of their normal parts."""
    out = np.empty_like(forces)
    for i in range(len(forces)):
        along = share * row_times(forces[i], normal)
        for k in range(3):
            out[i, k] = forces[i, k] + along * normal[k]
    return out


@ieee_kernel
def deeper(body: "NodalBody"):
    """Merge the displacements of several contacts, the larger one at each node, in ascending order of nodes. Returns
    the number of nodes."""
    nodes, chosen, count = body.nodes, body.chosen, 0
    for c in range(len(body.counts)):
        for slot in range(body.counts[c]):
            node = body.active[c, slot]
            if chosen[node, 0] < 0:
                nodes[count] = node
                count += 1
            elif not _size(body.moved[c, slot]) > _size(body.moved[chosen[node, 0], chosen[node, 1]]):
                continue
            chosen[node, 0], chosen[node, 1] = c, slot
    nodes[:count].sort()
    for k in range(count):
        c, slot = chosen[nodes[k], 0], chosen[nodes[k], 1]
        chosen[nodes[k], 0] = -1
        for i in range(3):
            body.deepest[k, i] = body.moved[c, slot, i]
    return count


@ieee_kernel
def _size(x: Array):
    return x[0] * x[0] + x[1] * x[1] + x[2] * x[2]


@ieee_kernel
def retard_law(stiffness: float, exponent: float, retardation: float, dt: float):
    """The law K <s + tau s'>^n of a Kelvin-Voigt body in a step of dt > 0 [s] as a terminal law, K_T <s - s_free>^n:

        K_T = K/m^n,    s_free = (1 - m) s_prev,    m = T/(T + tau)

    Returns K_T [N/m^n] and 1 - m [1]. retardation tau >= 0 [s]; with 0 the law does not depend on the step. To first
    order in tau this is the law of viscoelastic spheres (N. V. Brilliantov et al., Phys. Rev. E 53 (1996) 5382-5392):
    K (s^n + n tau s^(n-1) s').
    """
    rest = retardation / (dt + retardation)
    return stiffness / power_of(1.0 - rest, exponent), rest


@ieee_kernel
def mean_hardness(nodes: Indices, forces: Matrix, normal: Vector3, hardness: Array):
    """Mean factor on K [1] under a load [N] (k,3) on nodes (k), weighted by the normal forces; 1 without load."""
    total = weighted = 0.0
    for i in range(nodes.size):
        if 0 <= nodes[i] < hardness.size:
            push = max(-dot(forces[i], normal), 0.0)
            total += push
            weighted += push * hardness[nodes[i]]
    return weighted / total if total > 0.0 else 1.0


@ieee_kernel
def factor_at(nodes: Indices, foot: Vector3, normal: Vector3, ground: Record, radius: float, out: Array):
    """Factor on K [1] at a foot point p [m] (3): mean over the loaded vertices with weights (1 - |x - p|²/R²)², R the
    radius [m] of the patch, so that it depends on the place alone. 0 without a vertex within R.

    Fill `out` (12): derivative of its logarithm [1/m] (3) along the surface, and shape operator [1/m] (9) row by row.
    normal [1] (3);  ground (V)  `GROUND`
    """
    total = factor = 0.0
    out[:] = 0.0
    for i in range(nodes.size):
        near = _nearness(nodes[i], foot, ground, radius)
        if near > 0.0:
            row, weight = ground[nodes[i]], near * near
            total += weight
            factor += weight * row.factor
            for k in range(9):
                out[3 + k] += weight * row.operator[k]
    if not total > 0.0:
        return 0.0
    for k in range(9):
        out[3 + k] /= total
    mean = factor / total
    for i in range(nodes.size):
        near = _nearness(nodes[i], foot, ground, radius)
        if near > 0.0:
            row = ground[nodes[i]]
            share = 4.0 * near * (row.factor - mean) / (radius * radius * factor)
            for k in range(3):
                out[k] += share * (row.position[k] - foot[k])
    outward = dot(out, normal)
    for k in range(3):
        out[k] -= outward * normal[k]
    return mean


@ieee_kernel
def side_force(nodes: Indices, forces: Matrix, foot: Vector3, normal: Vector3, ground: Record, radius: float):
    """Normal force [N] that would indent the organ as the part of the load [N] (k,3) along the surface does: d.f_t,
    with d [1] (3) the mean over the loaded vertices, weighted as in `factor_at`.

    d = -C_tn/c follows from the compliance of the organ, C u_n under a force along the surface over that under an equal
    normal force. It is 0 on a half-space."""
    total, d, along = 0.0, stack_zeros((3,)), stack_zeros((3,))
    for i in range(nodes.size):
        near = _nearness(nodes[i], foot, ground, radius)
        if near > 0.0:
            total += near * near
            for k in range(3):
                d[k] += near * near * ground[nodes[i]].leans[k]
        for k in range(3):
            along[k] += forces[i, k]
    if not total > 0.0:
        return 0.0
    return (dot(d, along) - dot(along, normal) * dot(d, normal)) / total


@ieee_kernel
def _nearness(node: int, foot: Vector3, ground: Record, radius: float):
    """1 - |x - p|²/R² [1] of a vertex; 0 of one that the mesh does not have."""
    if not 0 <= node < len(ground):
        return 0.0
    square = 0.0
    for k in range(3):
        square += (ground[node].position[k] - foot[k]) ** 2
    return 1.0 - square / (radius * radius)


@ieee_kernel
def admit(node: int, where: Indices, active: Indices, state: Record, along: Matrix, count: int):
    """Slot of a node in the compact list, appended at rest if it is new; returns the slot and the count."""
    slot = where[node]
    if slot < 0:
        slot = count
        where[node] = slot
        active[slot] = node
        state[slot].indentation = 0.0
        for k in range(3):
            along[slot, k] = state[slot].normal[k] = state[slot].load[k] = 0.0
        count += 1
    return slot, count


@ieee_kernel
def take_load(
    nodes: Indices,
    forces: Matrix,
    normal: Vector3,
    per_area: Array,
    where: Indices,
    active: Indices,
    state: Record,
    along: Matrix,
    count: int,
):
    """Sum the nodal forces [N] into the loads of `state`; returns total normal force, largest pressure, count. Forces
    on nodes that the mesh does not have are ignored."""
    for slot in range(count):
        for k in range(3):
            state[slot].load[k] = 0.0
    total = 0.0
    for i in range(nodes.size):
        node = nodes[i]
        if node < 0 or node >= where.size:
            continue
        slot, count = admit(node, where, active, state, along, count)
        for k in range(3):
            state[slot].load[k] += forces[i, k]
        total -= dot(forces[i], normal)
    peak = 0.0
    for i in range(nodes.size):
        node = nodes[i]
        if 0 <= node < where.size:
            push = -dot(state[where[node]].load, normal)
            if push > 0.0:
                peak = max(peak, push * per_area[node])
    return max(total, 0.0), peak, count


@ieee_kernel
def nodal_step(
    nodes: Indices,
    forces: Matrix,
    normal: Vector3,
    dt: float,
    ahead: float,
    law: "NodalLaw",
    nodal: Matrix,
    edges: Neighbours,
    where: Indices,
    active: Indices,
    state: Record,
    along: Matrix,
    out: Matrix,
    room: StretchWorkspace,
    count: int,
):
    """One step of the nodal law; returns the number of displaced nodes.

    ahead    [1]     factor on u at the start of the step (`physics.contact.end_rate`)
    nodes (k), forces [N] (k,3)   the load; normal [1] (3): outward at the contact
    nodal    (2,V)   factor on K of each node, and inverse nodal areas [1/m²]
    where, active (V)  slot of each node in the list, -1 outside, and node of each slot
    state (V), along [m] (V,3)  by slot: `SPRING` and u_t
    out      (V,3)   displacement [m] by slot
    room             workspace of `stretch.limit_stretch`
    count            length of the list before the step
    """
    exponent, damping, k_t, d_t = law.exponent, law.damping, law.tangential_stiffness, law.tangential_damping
    stiffness, rest = retard_law(law.stiffness, exponent, law.retardation, dt)
    rest *= ahead
    hardness, per_area = nodal[0], nodal[1]
    total, peak, count = take_load(nodes, forces, normal, per_area, where, active, state, along, count)
    # backward Euler along the surface, u_t <- keep u_t + gain f_t; `share` makes pressures fractions of the total
    gain = 1.0 / (k_t + d_t / dt)
    keep = gain * d_t / dt
    share = total / peak if peak > 0.0 else 0.0
    widest, rested = 0.0, False
    for slot in range(count):
        node = state[slot]
        push, u = -dot(node.load, normal), node.indentation
        for k in range(3):
            along[slot, k] *= keep
        if push > 0.0:
            scale = share * per_area[active[slot]]
            local = stiffness * hardness[active[slot]]
            node.indentation = indentation(push * scale, dt, local, exponent, damping, rest * u, u)
            scale *= gain
            for k in range(3):
                node.normal[k] = normal[k]
                along[slot, k] += scale * (node.load[k] + push * normal[k])
        else:
            node.indentation = free_recovery(u, rest * u, damping, dt)
            rested |= _is_rested(node, along, slot)
        widest = max(widest, along[slot, 0] ** 2 + along[slot, 1] ** 2 + along[slot, 2] ** 2)
    # limit differences between neighbours, remove recovered nodes, add both parts of the displacement
    if 2.0 * math.sqrt(widest) > MOST_STRAIN * law.shortest:
        rested |= limit_stretch(along, count, MOST_STRAIN, law.shortest, edges, where, active, room) > 0
    if rested:
        count = drop_rested(where, active, state, along, count)
    for slot in range(count):
        for k in range(3):
            out[slot, k] = along[slot, k] - state[slot].indentation * state[slot].normal[k]
    return count


@ieee_kernel
def _is_rested(spring: Record, along: Matrix, slot: int):
    """Whether a node has no load and no displacement."""
    square = spring.indentation**2 + along[slot, 0] ** 2 + along[slot, 1] ** 2 + along[slot, 2] ** 2
    idle = spring.load[0] == 0.0 and spring.load[1] == 0.0 and spring.load[2] == 0.0
    return idle and square < AT_REST * AT_REST


@ieee_kernel
def drop_rested(where: Indices, active: Indices, state: Record, along: Matrix, count: int):
    """Remove nodes without load and displacement from the list, in order; returns the count."""
    kept = 0
    for slot in range(count):
        node, spring = active[slot], state[slot]
        if _is_rested(spring, along, slot):
            where[node] = -1
            continue
        if kept != slot:
            where[node] = kept
            active[kept] = node
            state[kept].indentation = spring.indentation
            for k in range(3):
                along[kept, k] = along[slot, k]
                state[kept].normal[k], state[kept].load[k] = spring.normal[k], spring.load[k]
        kept += 1
    return kept


class NodalLaw(NamedTuple):
    """Constants of a node's springs and dampers."""

    stiffness: float  # [N/m^n] K
    exponent: float  # [1] n
    damping: float  # [s/m] c
    tangential_stiffness: float  # [N/m] k_t
    tangential_damping: float  # [N s/m] d_t
    shortest: float  # [m] edge of the mesh
    retardation: float  # [s] tau


class NodalBody(NamedTuple):
    """The nodal law on a mesh, under each of c contacts; see `nodal_step`."""

    law: NodalLaw
    nodal: Annotated[np.ndarray, "<f8", 2]
    edges: Neighbours
    where: Annotated[np.ndarray, "<i4", 2]  # (c,V)
    active: Annotated[np.ndarray, "<i4", 2]  # (c,V)
    state: Annotated[np.ndarray, SPRINGS, 2]  # (c,V)
    along: Annotated[np.ndarray, "<f8", 3]  # [m] (c,V,3)
    moved: Annotated[np.ndarray, "<f8", 3]  # [m] (c,V,3) displacement by slot
    counts: Annotated[np.ndarray, "<i4", 1]  # (c) displaced nodes
    room: StretchWorkspace
    nodes: Annotated[np.ndarray, "<i4", 1]  # of all contacts: displaced nodes, their displacement [m] (V,3)
    deepest: Annotated[np.ndarray, "<f8", 2]
    chosen: Annotated[np.ndarray, "<i4", 2]  # (V,2) contact and slot of each of these nodes, -1 outside


def nodal_body(
    mesh: Mesh,
    stiffness: float,
    exponent: float,
    damping: float,
    tangential_stiffness: float,
    tangential_damping: float,
    hardness: np.ndarray | None = None,
    contacts: int = 1,
    retardation: float = 0.0,
) -> NodalBody:
    """A body at rest.

    stiffness K [N/m^n], exponent n >= 1, damping c [s/m], tangential_stiffness k_t [N/m] > 0,
    tangential_damping d_t [N s/m] >= 0, hardness (V) factor on K of each node, retardation tau >= 0 [s]. Nodal areas
    are at least 1e-6 of the mean.
    """
    size, several = len(mesh.vertices), len(mesh.vertices) if contacts > 1 else 0
    mean = float(mesh.areas.mean())
    per_area = 1.0 / np.maximum(mesh.areas, 1e-6 * mean if mean > 0 else 1.0)
    nodal = np.stack([np.ones(size) if hardness is None else np.asarray(hardness, float), per_area])
    edges = neighbours(mesh)
    shortest = float(edges.spans.min(initial=math.inf))
    constants = stiffness, exponent, damping, tangential_stiffness, tangential_damping, shortest, retardation
    return NodalBody(
        NodalLaw(*map(float, constants)),
        nodal, edges,
        np.full((contacts, size), -1, np.int32), np.zeros((contacts, size), np.int32),
        np.zeros((contacts, size), SPRINGS), np.zeros((contacts, size, 3)), np.zeros((contacts, size, 3)),
        np.zeros(contacts, np.int32),
        StretchWorkspace.of(size), np.zeros(several, np.int32), np.zeros((several, 3)),
        np.full((several, 2), -1, np.int32),
    )  # fmt: skip


@ieee_kernel
def move(body: NodalBody, contact: int, nodes: Indices, forces: Matrix, normal: Vector3, dt: float, ahead: float = 1.0):
    """Step dt > 0 [s] of a contact's indentation under nodal forces [N] (k,3), see `nodal_step`. Returns the number of
    displaced nodes, which are the first of `active` and `moved`."""
    body.counts[contact] = nodal_step(
        nodes, forces, normal, dt, ahead, body.law, body.nodal, body.edges, body.where[contact], body.active[contact],
        body.state[contact], body.along[contact], body.moved[contact], body.room, body.counts[contact],
    )  # fmt: skip
    return body.counts[contact]
