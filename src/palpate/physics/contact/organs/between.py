"""Contact of two deformable bodies on a set of candidates: unilateral, implicit in time, without friction.

Candidate i is a small patch of the first surface, opposite a patch of the second. With the force p_i on it along its
normal n_i, outwards from the second body, gap and forces at the end of a step of T > 0 [s] satisfy

    w = g0 + u_1 + u_2,    p >= 0,    w >= 0,    p_i w_i = 0

g0 is the gap of the undeformed bodies, u_b the opening by body b: a linear Kelvin-Voigt solid with the compliance C_b
between the candidates and the retardation tau_b, under the forces of the contact and the opening o_b that all other
loads would cause at rest. By backward Euler, as in `physics.bodies.condensed_body`,

    u_b = m_b (C_b p + o_b) + (1 - m_b) u_b',    m_b = T/(T + tau_b),    u_b' at the start of the step

so that p solves a linear complementarity problem with W = m_1 C_1 + m_2 C_2 (`pivoting`). The force is that of the
end of the step: contact and bodies have no delay, and no stiffness of a penalty limits the step.

Energy: the step does the work p.(w - w') on the bodies' surfaces, w' the gap before. With p.w = 0 this is -p.w' <= 0:
the contact dissipates what closing the gap within a step takes, and generates nothing. Only where the last call ended
with an overlap (`complement`) may it be positive; it is then counted as generated.

Fingers j on body b that press with the normal forces f_j open the candidates by r_j f_j (r < 0 closes), n_j f_j of it
by the normal part of their load; friction grows with the normal force. While the active set S stays, the forces respond
by dp_S = -W_SS^-1 m_b r_j,S df_j, and lift the patch of finger i by

    sum_j y_ij df_j,    y_ij = m_b² n_i,S.W_SS^-1 r_j,S

(E. Betti's reciprocity): the Schur complement, by which the laws of the fingers' contacts are stiffer than their body
alone. y is symmetric without friction.

Signorini's contact: A. Signorini 1933; P. Wriggers, Computational Contact Mechanics, 2006, ch. 5. Range: displacements
small against the radii of curvature, for candidates, normals and compliances are those of the undeformed bodies.
"""

from typing import Annotated, NamedTuple

import numpy as np

from palpate.compiler.dot import inner
from palpate.compiler.fields import element_type
from palpate.compiler.kernel import ieee_kernel, kernel
from palpate.physics.arrays import Array, Indices, Matrix, Tensor, Vector3
from palpate.physics.contact.organs.pivoting import (
    ActiveSet,
    active_set,
    add_rows,
    complement,
    refactor,
    solve_lower,
)

MOST = 32
"""Most candidates that touch or part in a step; the others follow in the next. At 1 kHz 500 candidates per 16 ms."""
BLOCK = 4  # columns of a block, see `blocks_of`
LEAST_FORCE = 1e-6  # [N] of a finger for which the response is computed


PAST = {"step": (), "dissipated": (), "generated": ()}
"""Step of the last matrix [s]; energies since the start [J]."""
PAST_TYPE = element_type(PAST)


class Pair(NamedTuple):
    """Two bodies and their contact on m candidates.

    gap     [m]   (m)      g0
    first, second [m/N] (m,m)  C_b
    retardation [s] (2)    tau_b
    matrix  [m/N] (m,m)    W
    moved   [m]   (2,m)    u_b
    opening [m]   (m)      w
    free    [m]   (m)      w without the forces of this step
    past    (1)            `PAST`
    """

    gap: Annotated[np.ndarray, "<f8", 1]
    first: Annotated[np.ndarray, "<f8", 2]
    second: Annotated[np.ndarray, "<f8", 2]
    retardation: Annotated[np.ndarray, "<f8", 1]
    matrix: Annotated[np.ndarray, "<f8", 2]
    moved: Annotated[np.ndarray, "<f8", 2]
    opening: Annotated[np.ndarray, "<f8", 1]
    free: Annotated[np.ndarray, "<f8", 1]
    past: Annotated[np.ndarray, PAST_TYPE, 1]
    active: ActiveSet


def pair(gap: np.ndarray, first: np.ndarray, second: np.ndarray, retardation: tuple[float, float]) -> Pair:
    """Two bodies at rest; arguments as in `Pair`."""
    size = len(gap)
    return Pair(
        np.array(gap, float), np.array(first, float, order="C"), np.array(second, float, order="C"),
        np.array(retardation, float), np.zeros((size, size)), np.zeros((2, size)), np.array(gap, float),
        np.zeros(size), np.zeros(1, PAST_TYPE), active_set(size),
    )  # fmt: skip


@kernel
def take(pair: Pair, body: int, dt: float):
    """m_b [1]."""
    return dt / (dt + pair.retardation[body])


@ieee_kernel
def begin_step(pair: Pair, others: Matrix, dt: float):
    """Move both bodies by all but the forces of this step, which fills `pair.free`; returns whether W has changed.

    others  [m] (2,m)  o_b, the opening that the other loads on each body would cause at rest
    dt      [s]        T > 0
    """
    first, second, free, moved = take(pair, 0, dt), take(pair, 1, dt), pair.free, pair.moved
    size, past = len(free), pair.past[0]
    changed = past.step != dt
    if changed:
        past.step = dt
        for i in range(size):
            for j in range(size):
                pair.matrix[i, j] = first * pair.first[i, j] + second * pair.second[i, j]
    for i in range(size):
        moved[0, i] = first * others[0, i] + (1.0 - first) * moved[0, i]
        moved[1, i] = second * others[1, i] + (1.0 - second) * moved[1, i]
        free[i] = pair.gap[i] + (moved[0, i] + moved[1, i])
    return changed


@ieee_kernel
def end_step(pair: Pair, dt: float):
    """Move both bodies by the forces `pair.active.force`; fills the gaps `pair.opening`, and counts the energy."""
    first, second, moved, force = take(pair, 0, dt), take(pair, 1, dt), pair.moved, pair.active.force
    past = pair.past[0]
    add_rows(pair.first, pair.active, first, moved[0])
    add_rows(pair.second, pair.active, second, moved[1])
    work = 0.0
    for i in range(len(pair.free)):
        opening = pair.gap[i] + (moved[0, i] + moved[1, i])
        work += force[i] * (opening - pair.opening[i])
        pair.opening[i] = opening
    if work > 0.0:
        past.generated += work
    else:
        past.dissipated -= work


@ieee_kernel
def step_pair(pair: Pair, others: Matrix, dt: float, most: int):
    """A step: fills the forces `pair.active.force` [N] (m) and the gaps `pair.opening`. Returns the number of
    candidates that pull or overlap and are left for the next step.

    others, dt  of `begin_step`
    most        most changes of candidates in this step
    """
    if begin_step(pair, others, dt):
        refactor(pair.matrix, pair.active)
    left = complement(pair.matrix, pair.free, pair.active, most)
    end_step(pair, dt)
    return left


@ieee_kernel
def responses(
    pair: Pair, active: ActiveSet, begin: int, body: int, opened: Matrix, pressed: Matrix, forces: Array, dt: float,
    along: Tensor, out: Matrix,
):  # fmt: skip
    """Fill `out` [m/N] (f,f), y_ij: by how much the contact lifts the patch of finger i on a body per newton of j.

    active, begin  the candidates of a problem, of which those of the pair begin there (`coupled`)
    opened, pressed [m] (f,m)  opening of the candidates by the load of each finger alone, and by its normal part
    forces [N] (f)  normal forces; a finger of less than `LEAST_FORCE` has no response
    along  (2,f,.)  workspace, as long as the problem
    """
    count, size = active.tally[0].active, len(pair.free)
    for a in range(len(out)):
        scale = take(pair, body, dt) / forces[a] if forces[a] > LEAST_FORCE else 0.0
        for k in range(count):
            i = active.order[k] - begin
            inside = 0 <= i < size
            along[0, a, k] = scale * pressed[a, i] if inside else 0.0
            along[1, a, k] = scale * opened[a, i] if inside else 0.0
        solve_lower(active, along[0, a], count)
        solve_lower(active, along[1, a], count)
    for a in range(len(out)):
        for b in range(len(out)):
            out[a, b] = inner(along[0, a][:count], along[1, b][:count])


@kernel
def open_by(
    nodes: Indices,
    forces: Matrix,
    normal: Vector3,
    corners: Indices,
    weights: Matrix,
    compliance: Tensor,
    gathered: Matrix,
    touched: Indices,
    out: Array,
    pressed: Array,
):
    """Fill `out` [m] (m): opening of the candidates by a load at rest, and `pressed` [m] (m): by its part along n; that
    is left out if it is empty.

    nodes (k), forces [N] (k,3), normal [1] (3)  the load on vertices of the body's surface
    corners (V,3), weights [1] (V,3)    terminals that carry the load of each vertex
    compliance [m/N] (b,3t,4)           opening by a unit force along each axis at each of t terminals, see `blocks_of`
    gathered [N] (t,3), touched (2,t)   workspace: forces on terminals, list of the loaded ones and a mark of each;
                                        forces and marks are zero before and after
    """
    count, listed, marks = 0, touched[0], touched[1]
    for k in range(len(nodes)):
        v = nodes[k]
        for a in range(3):
            weight, terminal = weights[v, a], corners[v, a]
            if weight != 0.0:
                if marks[terminal] == 0:
                    marks[terminal], listed[count] = 1, terminal
                    count += 1
                for x in range(3):
                    gathered[terminal, x] += weight * forces[k, x]
    _add_openings(compliance, gathered, listed, count, out)
    for k in range(count):
        terminal = listed[k]
        given, marks[terminal] = gathered[terminal], 0
        value = given[0] * normal[0] + given[1] * normal[1] + given[2] * normal[2]
        for x in range(3):
            given[x] = value * normal[x]
    if len(pressed) > 0:
        _add_openings(compliance, gathered, listed, count, pressed)
    for k in range(count):
        for x in range(3):
            gathered[listed[k], x] = 0.0


@kernel
def _add_openings(compliance: Tensor, gathered: Matrix, listed: Indices, count: int, out: Array):
    """Fill `out` [m] (m) with the opening by the forces `gathered` on the first `count` terminals of a list."""
    for b in range(len(compliance)):
        rows, a = compliance[b], BLOCK * b
        x = y = z = w = 0.0
        for k in range(count):
            for axis in range(3):
                row, force = 3 * listed[k] + axis, gathered[listed[k], axis]
                x, y = x + force * rows[row, 0], y + force * rows[row, 1]
                z, w = z + force * rows[row, 2], w + force * rows[row, 3]
        out[a] = x
        if a + 1 < len(out):
            out[a + 1] = y
        if a + 2 < len(out):
            out[a + 2] = z
        if a + 3 < len(out):
            out[a + 3] = w


def blocks_of(columns: np.ndarray) -> np.ndarray:
    """A table (n,m) as blocks (b,n,4) of its columns, zero behind the last one.

    A candidate that follows gets a new column in each step. Here it is in a contiguous part of the memory; written to
    rows of 1 kB it took 20 % of the step of two condensed organs. `open_by` sums four columns at a time.
    """
    size, count = columns.shape
    blocks = np.zeros((-(-count // BLOCK), size, BLOCK))
    for j in range(count):
        blocks[j // BLOCK, :, j % BLOCK] = columns[:, j]
    return blocks
