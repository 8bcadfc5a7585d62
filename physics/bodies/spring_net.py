"""The mass-spring body, full net: the nodal law of `mass_spring` with springs and dampers between neighbours.

Backward Euler over one step, x the displacement at its end:

    r(x) = foundation(x) + edges(x) + D (x - x_before)/T - f = 0,    (D/T + K) dx = -r

the form of Baraff & Witkin (Large steps in cloth simulation, SIGGRAPH 1998) without inertia, which for a millimetre of
tissue at the speed of a hand is far below the other forces. Newton's method to convergence, each system by conjugate
gradients. K is held positive semidefinite: a compressed edge keeps its axial stiffness and loses the negative lateral
one. Nodes outside the patch (the loaded nodes with some rings round them, and nodes
not yet recovered) are held.

Everything is divided by the greatest nodal pressure over the total force, so that a node at the centre carries the
contact's own law and a coupling of zero gives the nodal law.
"""

import math
from typing import NamedTuple

import numpy as np

from palpate.physics.bodies.mass_spring import Net, admit, drop_rested, limit_differences, take_load
from palpate.physics.bodies.stretch import Neighbours
from palpate.physics.contact.terminal import indentation, terminal_force
from palpate.physics.entry_point import NO_NODES, NO_VECTORS, entry_point
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.kernel import kernel


class NodeLaw(NamedTuple):
    """Of a node at the centre of the contact: K [N/m^n], n, c [s/m], k_t [N/m], d_t [N s/m]; of a spring between
    neighbours [N/m] and of the damper beside it [N s/m]."""

    stiffness: float
    exponent: float
    damping: float
    tangential_stiffness: float
    tangential_damping: float
    coupling: float
    coupling_damping: float


class Tables(NamedTuple):
    """What a step needs of a mesh: vertices [m] and normals [1] (V,3), factor on K and inverse area [1/m²] of each node
    (2,V), edges."""

    vertices: np.ndarray
    normals: np.ndarray
    nodal: np.ndarray
    edges: Neighbours


class NetWorkspace(NamedTuple):
    """Memory of a step.

    edges   (E,5)   direction of each edge [1] (3), its stiffness [N/m] along it, less that across, and across
    work    (V,17)  by slot: see `_linearise` and `_solve`
    share   (V)     of the total force that a node of its area bears
    memory  (1)     greatest pressure over total force [1/m²] so far
    """

    edges: np.ndarray
    work: np.ndarray
    share: np.ndarray
    memory: np.ndarray


@kernel(error_model="numpy")
def grow(rings, tables, listed, count):
    """Add rings of neighbours round the loaded nodes; returns the count."""
    first, neighbours, _ = tables.edges
    where, active, state = listed
    start, end = 0, count
    for ring in range(rings):
        for slot in range(start, end):
            idle = state[slot, 7] == 0.0 and state[slot, 8] == 0.0 and state[slot, 9] == 0.0
            if ring == 0 and idle:
                continue
            node = active[slot]
            for at in range(first[node], first[node + 1]):
                _, count = admit(neighbours[at], where, active, state, count)
        start, end = end, count
    return count


@kernel(error_model="numpy")
def _linearise(law, dt, tables, listed, room, count):
    """Residual [N] in columns 0-2 of `work`, foundation slopes in 12-13, and the edges' data; see `net_step`."""
    damping, k_t, d_t = law.damping, law.tangential_stiffness, law.tangential_damping
    coupling, edge_damping = law.coupling, law.coupling_damping
    vertices, normals, hardness = tables.vertices, tables.normals, tables.nodal[0]
    first, neighbours, spans = tables.edges
    where, active, state = listed
    edges, work, share = room.edges, room.work, room.share
    largest = 0.0
    for slot in range(count):
        node = active[slot]
        w = share[node]
        mx, my, mz = normals[node, 0], normals[node, 1], normals[node, 2]
        x, y, z = state[slot, 0], state[slot, 1], state[slot, 2]
        bx, by, bz = state[slot, 4], state[slot, 5], state[slot, 6]
        # u, before: indentation along the inner normal now and a step ago; rest: how far the free node has recovered
        u = -(x * mx + y * my + z * mz)
        before = -(bx * mx + by * my + bz * mz)
        rest = max(0.0, before - dt / damping) if damping > 0.0 else 0.0
        if u > rest:
            local = law.stiffness * hardness[node]
            value, slope = terminal_force(u, dt, local, law.exponent, damping, 0.0, before)
        else:
            # Outwards of its free recovery the node is drawn back to it.
            value, slope = k_t * (u - rest), k_t
        # r: foundation, a Kelvin-Voigt spring along the surface, and load; the edges' tension is added below
        tangent = k_t + d_t / dt
        tx, ty, tz = x + u * mx, y + u * my, z + u * mz
        ox, oy, oz = bx + before * mx, by + before * my, bz + before * mz
        rx = w * (-value * mx + k_t * tx + d_t / dt * (tx - ox)) - state[slot, 7]
        ry = w * (-value * my + k_t * ty + d_t / dt * (ty - oy)) - state[slot, 8]
        rz = w * (-value * mz + k_t * tz + d_t / dt * (tz - oz)) - state[slot, 9]
        work[slot, 12], work[slot, 13] = w * slope, w * tangent
        dx, dy, dz = w * tangent, w * tangent, w * tangent
        dx += w * (slope - tangent) * mx * mx
        dy += w * (slope - tangent) * my * my
        dz += w * (slope - tangent) * mz * mz
        # edges: p, q the difference of both ends' displacements now and a step ago, e the direction
        for at in range(first[node], first[node + 1]):
            neighbour = neighbours[at]
            other = where[neighbour]
            px, py, pz = x, y, z
            qx, qy, qz = bx, by, bz
            if other >= 0:
                px, py, pz = px - state[other, 0], py - state[other, 1], pz - state[other, 2]
                qx, qy, qz = qx - state[other, 4], qy - state[other, 5], qz - state[other, 6]
            ex = vertices[node, 0] - vertices[neighbour, 0] + px
            ey = vertices[node, 1] - vertices[neighbour, 1] + py
            ez = vertices[node, 2] - vertices[neighbour, 2] + pz
            length = math.sqrt(ex * ex + ey * ey + ez * ez)
            inverse = 1.0 / length if length > 1e-12 else 0.0
            ex, ey, ez = ex * inverse, ey * inverse, ez * inverse
            rate = ((px - qx) * ex + (py - qy) * ey + (pz - qz) * ez) / dt
            tension = coupling * (length - spans[at]) + edge_damping * rate
            rx, ry, rz = rx + tension * ex, ry + tension * ey, rz + tension * ez
            # stiffness of an edge: along e that of spring and damper, across it tension over length, never negative
            lateral = max(0.0, tension * inverse)
            axial = coupling + edge_damping / dt
            edges[at, 0], edges[at, 1], edges[at, 2], edges[at, 3], edges[at, 4] = ex, ey, ez, axial - lateral, lateral
            dx += lateral + (axial - lateral) * ex * ex
            dy += lateral + (axial - lateral) * ey * ey
            dz += lateral + (axial - lateral) * ez * ez
        # columns 14-16: the inverse diagonal, which preconditions `_solve`
        work[slot, 0], work[slot, 1], work[slot, 2] = -rx, -ry, -rz
        work[slot, 14], work[slot, 15], work[slot, 16] = 1.0 / max(dx, 1e-9), 1.0 / max(dy, 1e-9), 1.0 / max(dz, 1e-9)
        largest = max(largest, rx * rx + ry * ry + rz * rz)
    return math.sqrt(largest)


@kernel(error_model="numpy")
def _apply(tables, listed, room, count):
    """Columns 9-11 of `work` become the matrix times columns 6-8; returns the product of the two."""
    normals, edges, work = tables.normals, room.edges, room.work
    first, neighbours, _ = tables.edges
    where, active, _ = listed
    total = 0.0
    for slot in range(count):
        node = active[slot]
        x, y, z = work[slot, 6], work[slot, 7], work[slot, 8]
        mx, my, mz = normals[node, 0], normals[node, 1], normals[node, 2]
        inward = (work[slot, 12] - work[slot, 13]) * (x * mx + y * my + z * mz)
        rx = work[slot, 13] * x + inward * mx
        ry = work[slot, 13] * y + inward * my
        rz = work[slot, 13] * z + inward * mz
        for at in range(first[node], first[node + 1]):
            other = where[neighbours[at]]
            px, py, pz = x, y, z
            if other >= 0:
                px, py, pz = px - work[other, 6], py - work[other, 7], pz - work[other, 8]
            along = edges[at, 3] * (edges[at, 0] * px + edges[at, 1] * py + edges[at, 2] * pz)
            rx += along * edges[at, 0] + edges[at, 4] * px
            ry += along * edges[at, 1] + edges[at, 4] * py
            rz += along * edges[at, 2] + edges[at, 4] * pz
        work[slot, 9], work[slot, 10], work[slot, 11] = rx, ry, rz
        total += x * rx + y * ry + z * rz
    return total


@kernel(error_model="numpy")
def _solve(tables, listed, room, count):
    """Conjugate gradients with the diagonal as preconditioner: columns 3-5 of `work` solve for columns 0-2."""
    work = room.work
    rho = 0.0
    for slot in range(count):
        for k in range(3):
            work[slot, 3 + k] = 0.0
            work[slot, 6 + k] = work[slot, 14 + k] * work[slot, k]
            rho += work[slot, k] * work[slot, 6 + k]
    goal = 1e-8 * rho
    for _ in range(200):
        if not rho > goal:
            return
        curvature = _apply(tables, listed, room, count)
        if not curvature > 0.0:
            return
        step = rho / curvature
        fresh = 0.0
        for slot in range(count):
            for k in range(3):
                work[slot, 3 + k] += step * work[slot, 6 + k]
                work[slot, k] -= step * work[slot, 9 + k]
                fresh += work[slot, 14 + k] * work[slot, k] * work[slot, k]
        turn = fresh / rho
        rho = fresh
        for slot in range(count):
            for k in range(3):
                work[slot, 6 + k] = work[slot, 14 + k] * work[slot, k] + turn * work[slot, 6 + k]


@kernel(error_model="numpy")
def net_step(nodes, forces, normal, dt, law, rings, tables, listed, room, out, count):
    """One step of the net; returns how many nodes are in its list.

    rings   of neighbours that are added round loaded and moving nodes
    listed  the compact list: slot of each node, node of each slot, state; as in `mass_spring.nodal_step`

    State of a slot: x [m] (3), unused, x before the step (3), load [N] (3). Other arguments as in
    `mass_spring.nodal_step`.
    """
    normals, hardness, per_area = tables.normals, tables.nodal[0], tables.nodal[1]
    where, active, state = listed
    work, share, memory = room.work, room.share, room.memory
    # 1. who takes part: loaded and moving nodes and the rings around them
    total, peak, count = take_load(nodes, forces, normal, per_area, where, active, state, count)
    if total > 0.0:
        memory[0] = peak / total
    count = grow(rings, tables, listed, count)
    # 2. the first guess, and the state before the step
    size = 0.0
    for slot in range(count):
        node = active[slot]
        share[node] = memory[0] / per_area[node]
        push = before = 0.0
        for k in range(3):
            state[slot, 4 + k] = state[slot, k]
            push -= state[slot, 7 + k] * normals[node, k]
            before -= state[slot, k] * normals[node, k]
            size = max(size, abs(state[slot, 7 + k]))
        state[slot, 3] = 0.0
        if push > 0.0 and not before > 0.0:
            # A node at rest has no stiffness to start from: it starts at the answer of the nodal law.
            local = law.stiffness * hardness[node]
            u = indentation(push / share[node], dt, local, law.exponent, law.damping, 0.0, 0.0)
            for k in range(3):
                state[slot, k] -= (u - before) * normals[node, k]
    # 3. implicit Euler by Newton's method; a step that makes the residual larger is halved
    goal = 1e-6 * size + 1e-12
    residual = _linearise(law, dt, tables, listed, room, count)
    for _ in range(20):
        if residual <= goal:
            break
        _solve(tables, listed, room, count)
        for slot in range(count):
            for k in range(3):
                state[slot, k] += work[slot, 3 + k]
                out[slot, k] = work[slot, 3 + k]
        following = _linearise(law, dt, tables, listed, room, count)
        for _ in range(4):
            if following <= residual:
                break
            for slot in range(count):
                for k in range(3):
                    out[slot, k] *= 0.5
                    state[slot, k] -= out[slot, k]
            following = _linearise(law, dt, tables, listed, room, count)
        residual = following
    # 4. no edge is strained beyond what the law holds for; nodes that have come to rest leave the list
    limit_differences(state, 0, count, tables.edges, where, active)
    count = drop_rested(where, active, state, count)
    for slot in range(count):
        for k in range(3):
            out[slot, k] = state[slot, k]
    return count


class NetBody:
    """The net on a mesh.

    stiffness K [N/m^n], exponent n >= 1, damping c [s/m], tangential_stiffness k_t [N/m] > 0,
    tangential_damping d_t [N s/m] >= 0: of a node at the centre of the contact, as in `NodalBody`
    coupling [N/m] > 0, coupling_damping [N s/m] >= 0: of a spring between neighbours
    rings: of neighbours round the loaded nodes that move along
    hardness (V): factor on K of each node, None: 1; the springs between neighbours are as everywhere
    """

    def __init__(
        self,
        mesh: Mesh,
        stiffness: float,
        exponent: float,
        damping: float,
        tangential_stiffness: float,
        tangential_damping: float,
        coupling: float,
        coupling_damping: float,
        rings: int = 3,
        hardness: np.ndarray | None = None,
    ) -> None:
        self.net = net = Net(mesh, hardness)
        normal_law = (stiffness, exponent, damping, tangential_stiffness, tangential_damping)
        law = NodeLaw(*map(float, (*normal_law, coupling, coupling_damping)))
        size, count = len(mesh.vertices), len(net.edges.spans)
        tables = Tables(net.vertices, net.normals, net.nodal, net.edges)
        room = NetWorkspace(np.zeros((count, 5)), np.zeros((size, 17)), np.zeros(size), np.zeros(1))
        self._fixed = law, rings, tables, (*net.slots, net.state), room, net.displacement
        self._step = entry_point(net_step, NO_NODES, NO_VECTORS, (0.0, 0.0, 0.0), 0.0, *self._fixed, 0)

    def step(self, nodes: np.ndarray, forces: np.ndarray, normal: tuple[float, float, float], dt: float):
        """Displaced nodes (k) and their displacement [m] (k,3) after a step dt > 0 [s] under nodal forces [N]."""
        net = self.net
        net.count = self._step(nodes, forces, normal, dt, *self._fixed, net.count)
        return net.displaced
