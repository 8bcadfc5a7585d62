"""The mass-spring body, nodal law: each surface node of the zone of influence is a spring and damper of its own.

Node j of area A_j carries the pressure p_j = f_j/A_j. Its normal law is the contact's law on its share of the force,

    K u^n <1 + c (u - u_j)/T> = f p_j/p_max,

f [N] the total normal force. So the most loaded node goes in by the contact's own indentation s, and at rest
u(d) = s (k(d)/k(0))^{1/n} for a force spread by a kernel k. Without load, u <- <u - T/c>. Along the surface a linear
spring k_t and damper d_t by backward Euler: u_t <- (f_t T p_j/p_max + d_t u_t)/(k_t T + d_t), f_t the total. Only nodes
under load or not yet recovered are touched; they are kept in a compact list.
"""

import math

import numpy as np

from palpate.physics.bodies.stretch import StretchWorkspace, hold_together, neighbours
from palpate.physics.contact.terminal import indentation
from palpate.physics.entry_point import NO_NODES, NO_VECTORS, entry_point
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.kernel import kernel

AT_REST = 1e-9  # [m] Displacement below which an unloaded node counts as recovered
MOST_STRAIN = 0.8  # Largest difference of displacement between neighbours, over the length of their edge


@kernel(error_model="numpy")
def normal_force(forces, normal):
    """Total of nodal forces [N] (k,3) against the outward unit normal [1] (3): positive pressing, else zero."""
    total = 0.0
    for i in range(forces.shape[0]):
        total -= forces[i, 0] * normal[0] + forces[i, 1] * normal[1] + forces[i, 2] * normal[2]
    return max(total, 0.0)


def shared(feet, normals, radius):
    """Share O [1] (c,c) of the force of one contact that acts on another, of patches of this radius R [m]:

        O_ij = (1 - q)^4 (4q + 1) n_i.n_j,    q = |x_i - x_j|/2R

    1 at one place, 0 where the patches do not overlap or face away; positive definite over all places (H. Wendland,
    Adv. Comput. Math. 4 (1995) 389-396), so contacts under it are passive. feet [m] (c,3), normals [1] (c,3)
    """
    x, n = np.array(feet), np.array(normals)
    away, facing = x[:, None] - x, (n[:, None] * n).sum(axis=2)
    q = np.minimum(np.sqrt((away * away).sum(axis=2)) / (2.0 * radius), 1.0)
    return np.square(np.square(1.0 - q)) * (4.0 * q + 1.0) * np.maximum(facing, 0.0)


def deeper(dents):
    """One surface of several dents, each of nodes (k) and their displacements [m] (k,3): of each node the larger."""
    nodes = np.concatenate([nodes for nodes, _ in dents])
    moved = np.concatenate([moved for _, moved in dents])
    chosen = _deepest(nodes, moved, np.argsort(nodes, kind="stable"))
    return nodes[chosen], moved[chosen]


@kernel(error_model="numpy")
def _deepest(nodes, moved, order):
    """Of the rows of each node, in the order of the nodes, the one with the largest displacement."""
    chosen, count, most = np.empty(order.size, np.int64), 0, 0.0
    for k in order:
        size = moved[k, 0] * moved[k, 0] + moved[k, 1] * moved[k, 1] + moved[k, 2] * moved[k, 2]
        if count == 0 or nodes[k] != nodes[chosen[count - 1]]:
            chosen[count], most = k, size
            count += 1
        elif size > most:
            chosen[count - 1], most = k, size
    return chosen[:count]


@kernel(error_model="numpy")
def mean_hardness(nodes, forces, normal, hardness):
    """Mean of the factor on K over a load, weighted by the normal forces; 1 without load."""
    total = weighted = 0.0
    for i in range(nodes.size):
        if 0 <= nodes[i] < hardness.size:
            push = max(-(forces[i, 0] * normal[0] + forces[i, 1] * normal[1] + forces[i, 2] * normal[2]), 0.0)
            total += push
            weighted += push * hardness[nodes[i]]
    return weighted / total if total > 0.0 else 1.0


@kernel(error_model="numpy")
def admit(node, where, active, state, count):
    """Slot of a node in the compact list, appended at rest where it is new; returns the slot and the count."""
    slot = where[node]
    if slot < 0:
        slot = count
        where[node] = slot
        active[slot] = node
        for k in range(10):
            state[slot, k] = 0.0
        count += 1
    return slot, count


@kernel(error_model="numpy")
def take_load(nodes, forces, normal, per_area, where, active, state, count):
    """Sum the nodal forces [N] into columns 7-9 of `state`; returns total normal force, greatest pressure, count.

    Forces on nodes that the mesh does not have are left out.
    """
    for slot in range(count):
        state[slot, 7] = state[slot, 8] = state[slot, 9] = 0.0
    total = 0.0
    for i in range(nodes.size):
        node = nodes[i]
        if node < 0 or node >= where.size:
            continue
        slot, count = admit(node, where, active, state, count)
        for k in range(3):
            state[slot, 7 + k] += forces[i, k]
        total -= forces[i, 0] * normal[0] + forces[i, 1] * normal[1] + forces[i, 2] * normal[2]
    peak = 0.0
    for slot in range(count):
        push = -(state[slot, 7] * normal[0] + state[slot, 8] * normal[1] + state[slot, 9] * normal[2])
        if push > 0.0:
            peak = max(peak, push * per_area[active[slot]])
    return max(total, 0.0), peak, count


@kernel(error_model="numpy")
def nodal_step(nodes, forces, normal, dt, law, nodal, edges, slots, state, out, room, count):
    """One step of the nodal law; returns how many nodes are displaced.

    nodes (k), forces [N] (k,3)   the load; normal [1] (3): outward at the contact
    law      (6)     K [N/m^n], n, c [s/m], k_t [N/m], d_t [N s/m], shortest edge [m]
    nodal    (2,V)   factor on K of each node, and inverse nodal areas [1/m²]
    slots    (2,V)   slot of each node in the list, -1 outside, and node of each slot
    state    (V,10)  by slot: u [m], u_t [m] (3), the normal [1] (3) against which it was last pressed, load [N] (3)
    out      (V,3)   displacement [m] by slot
    room             work space of `stretch.hold_together`
    count            length of the list before the step
    """
    stiffness, exponent, damping, k_t, d_t, shortest = law[0], law[1], law[2], law[3], law[4], law[5]
    hardness, per_area, where, active = nodal[0], nodal[1], slots[0], slots[1]
    nx, ny, nz = normal[0], normal[1], normal[2]
    total, peak, count = take_load(nodes, forces, normal, per_area, where, active, state, count)
    gain = 1.0 / (k_t + d_t / dt)
    keep = gain * d_t / dt
    share = total / peak if peak > 0.0 else 0.0
    widest = 0.0
    for slot in range(count):
        push = -(state[slot, 7] * nx + state[slot, 8] * ny + state[slot, 9] * nz)
        u = state[slot, 0]
        state[slot, 1] *= keep
        state[slot, 2] *= keep
        state[slot, 3] *= keep
        if push > 0.0:
            scale = share * per_area[active[slot]]
            local = stiffness * hardness[active[slot]]
            state[slot, 0] = indentation(push * scale, dt, local, exponent, damping, 0.0, u)
            state[slot, 4], state[slot, 5], state[slot, 6] = nx, ny, nz
            scale *= gain
            state[slot, 1] += scale * (state[slot, 7] + push * nx)
            state[slot, 2] += scale * (state[slot, 8] + push * ny)
            state[slot, 3] += scale * (state[slot, 9] + push * nz)
        else:
            state[slot, 0] = max(0.0, u - dt / damping) if damping > 0.0 else 0.0
        widest = max(widest, state[slot, 1] ** 2 + state[slot, 2] ** 2 + state[slot, 3] ** 2)
    if 2.0 * math.sqrt(widest) > MOST_STRAIN * shortest:
        hold_together(state[:, 1:4], count, MOST_STRAIN, edges, where, active, room)
    count = drop_rested(where, active, state, count)
    for slot in range(count):
        for k in range(3):
            out[slot, k] = state[slot, 1 + k] - state[slot, 0] * state[slot, 4 + k]
    return count


@kernel(error_model="numpy")
def drop_rested(where, active, state, count):
    """Take nodes without load (columns 7-9) and displacement (0-3) out of the list, in order; returns the count."""
    kept = 0
    for slot in range(count):
        node = active[slot]
        square = state[slot, 0] ** 2 + state[slot, 1] ** 2 + state[slot, 2] ** 2 + state[slot, 3] ** 2
        idle = state[slot, 7] == 0.0 and state[slot, 8] == 0.0 and state[slot, 9] == 0.0
        if idle and square < AT_REST * AT_REST:
            where[node] = -1
            continue
        if kept != slot:
            where[node] = kept
            active[kept] = node
            for k in range(10):
                state[kept, k] = state[slot, k]
        kept += 1
    return kept


class NodalBody:
    """The nodal law on a mesh.

    stiffness K [N/m^n], exponent n >= 1, damping c [s/m], tangential_stiffness k_t [N/m] > 0,
    tangential_damping d_t [N s/m] >= 0, hardness (V) factor on K of each node

    A node without area counts as a millionth of the mean.
    """

    def __init__(
        self,
        mesh: Mesh,
        stiffness: float,
        exponent: float,
        damping: float,
        tangential_stiffness: float,
        tangential_damping: float,
        hardness: np.ndarray | None = None,
    ) -> None:
        size = len(mesh.vertices)
        mean = float(mesh.areas.mean())
        per_area = 1.0 / np.maximum(mesh.areas, 1e-6 * mean if mean > 0 else 1.0)
        nodal = np.stack([np.ones(size) if hardness is None else np.asarray(hardness, float), per_area])
        edges = neighbours(mesh)
        shortest = float(edges.spans.min(initial=math.inf))
        law = np.array([stiffness, exponent, damping, tangential_stiffness, tangential_damping, shortest])
        self.slots = np.stack([np.full(size, -1, np.int32), np.zeros(size, np.int32)])
        self.displacement = np.zeros((size, 3))
        self.count = 0
        self._fixed = (
            law,
            nodal,
            edges,
            self.slots,
            np.zeros((size, 10)),
            self.displacement,
            StretchWorkspace.of(size),
        )
        self._step = entry_point(nodal_step, NO_NODES, NO_VECTORS, (0.0, 0.0, 0.0), 0.0, *self._fixed, 0)

    def step(
        self, nodes: np.ndarray, forces: np.ndarray, normal: tuple[float, float, float], dt: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Displaced nodes (k) and their displacement [m] (k,3) after a step dt > 0 [s] under nodal forces [N]."""
        self.count = self._step(nodes, forces, normal, dt, *self._fixed, self.count)
        return self.slots[1, : self.count], self.displacement[: self.count]
