"""A row of the compliance of a body between the candidates of a contact, at a new place (`between_bodies`).

Where organs slide, the candidates of one of them keep their places on it and move over the other one. Their compliance
C_ij is computed again for one candidate i and all j, with the same equations as for all of them, in a time that does
not grow with the number of candidates that have moved:

    c_i = C Q_i' n_i,   C_ij = (c_i.Q_j' n_j + (1 - nu²)/pi <n_i.n_j> (X_ij - Q_i T Q_j'))/E

Shares and directions of the last computation are those of the load that is sent to the body, and the distances in X are
those on the organ on which the candidates stay: the matrix is that of one set of candidates at any time.
"""

from typing import Annotated, NamedTuple

import numpy as np

from palpate.compiler.dot import dot
from palpate.compiler.kernel import ieee_kernel, kernel
from palpate.physics.arrays import Array, Matrix, Record, Tensor, Vector3
from palpate.physics.contact.organs.between import BLOCK
from palpate.physics.contact.organs.condensed_fields import (
    field_of,
    fields_along,
    gather_hats,
    put_column,
    see_fields,
    seen_by,
    vector3,
)

CONDENSED, SPRINGS, PLATE = 1, 2, 3
Pair3 = tuple[Vector3, Vector3]
NO_NUMBERS, NO_TABLE = np.zeros(0), np.zeros((0, 0), np.float32)


class Law(NamedTuple):
    """Constants of a body, and workspace that is zero between calls where nothing else is said.

    kind        `CONDENSED`, `SPRINGS` or `PLATE`; 0: rows cannot be computed again
    loaded      of a condensed organ: whether it may bear other loads, so that `side.response` and `side.aside` are used
    scale [1/Pa] 1/E;  local [1/Pa] (1 - nu²)/(pi E);  aside [1] (1 - nu/2)/(1 - nu)
    compliance (3V,3V), table (V,V)  C [m/N] for a modulus of 1 Pa, and T [1/m]
    softness q [m/Pa] (W), areas [m²] (W)  of springs at vertices of the surface
    fields (3,3V)  c_i for forces along n, t_1 and t_2, not zero;  near (V)  Q_i T, not zero
    hats (V)      Q_i
    seen (3,3)  Q_j times each of the fields, not zero
    """

    kind: int
    loaded: int
    scale: float
    local: float
    aside: float
    compliance: Annotated[np.ndarray, "<f4", 2]
    table: Annotated[np.ndarray, "<f4", 2]
    softness: Annotated[np.ndarray, "<f8", 1]
    areas: Annotated[np.ndarray, "<f8", 1]
    fields: Annotated[np.ndarray, "<f8", 2]
    near: Annotated[np.ndarray, "<f8", 1]
    hats: Annotated[np.ndarray, "<f8", 1]
    seen: Annotated[np.ndarray, "<f8", 2]


def condensed_law(compliance: np.ndarray, table: np.ndarray, young: float, local: float, aside: float) -> Law:
    """Of a condensed organ; arguments as in `Law`, E [Pa], (1 - nu²)/pi."""
    size = len(compliance) // 3
    return Law(
        CONDENSED, 1, 1.0 / young, local / young, aside, compliance, table, NO_NUMBERS, NO_NUMBERS,
        np.zeros((3, 3 * size)), np.zeros(size), np.zeros(size), np.zeros((3, 3)),
    )  # fmt: skip


def springs_law(softness: np.ndarray, areas: np.ndarray) -> Law:
    """Of independent springs; arguments as in `Law`."""
    return _local_law(SPRINGS)._replace(softness=np.ascontiguousarray(softness), areas=np.ascontiguousarray(areas))


def plate_law() -> Law:
    """Of a rigid plate, whose compliance is the same at all places."""
    return _local_law(PLATE)


def _local_law(kind: int) -> Law:
    nothing = NO_NUMBERS, np.zeros((3, 0)), NO_NUMBERS, NO_NUMBERS, np.zeros((3, 3))
    return Law(kind, 1, 0.0, 0.0, 0.0, NO_TABLE, NO_TABLE, nothing[0], *nothing)


@ieee_kernel
def measure_row(inverse: Matrix, place: Matrix, area: Array, i: int):
    """Fill row and column i of X [1/m] (m,m), see `between_bodies.mean_inverse`; nothing to fill: X is not needed.

    place [m] (m,3), area [m²] (m)  of the candidates on the organ on which they stay
    """
    first = area[i] / np.pi
    for j in range(len(inverse)):
        second, square = area[j] / np.pi, 0.0
        for x in range(3):
            square += (place[i, x] - place[j, x]) ** 2
        away = max(np.sqrt(square), 0.5 * (np.sqrt(first) + np.sqrt(second)))
        fourth = 9.0 / 192.0 * (first * first + second * second) + 9.0 / 64.0 * first * second
        cube = away * away * away
        inverse[i, j] = 1.0 / away + (first + second) / (8.0 * cube) + fourth / (cube * away * away)
        inverse[j, i] = inverse[i, j]
    if len(inverse) > 0:
        inverse[i, i] = 16.0 / (3.0 * np.pi * np.sqrt(first))


@ieee_kernel
def renew_row(
    law: Law, side: Record, i: int, sign: float, inverse: Matrix, area: Array, tangents: Tensor, matrix: Matrix,
    drags: Matrix,
):  # fmt: skip
    """Compute row and column i of `matrix` [m/N] (m,m), `side.response`, `side.aside` and `drags` again.

    side   its shares, and directions `normal` [1] (m,3); `clear_row` before they change
    inverse [1/m] (m,m)  X
    sign   -1: forces on the body act along -n, and its motion along n closes the gap
    area [m²] (m), tangents [1] (2,m,3)  of the candidates
    """
    if law.kind == CONDENSED:
        _renew_condensed(law, side, i, sign, inverse, tangents, matrix, drags)
    elif law.kind == SPRINGS:
        _renew_springs(law, side, i, sign, area, tangents, matrix, drags)


@kernel
def clear_row(law: Law, side: Record, i: int):
    """Before the shares of candidate i change: springs that it leaves no longer move it."""
    if law.kind != SPRINGS:
        return
    size, rubs = len(side.normal), len(side.aside) > 0
    for at in range(side.begins[i], side.ends[i]):
        for x in range(3):
            row = 3 * side.vertices[at] + x
            side.response[i // BLOCK, row, i % BLOCK] = 0.0
            for a in range(2 if rubs else 0):
                j = a * size + i
                side.aside[j // BLOCK, row, j % BLOCK] = 0.0


@kernel
def _renew_springs(
    law: Law, side: Record, i: int, sign: float, area: Array, tangents: Tensor, matrix: Matrix, drags: Matrix
):
    count, soft, rubs = len(matrix), 0.0, tangents.shape[1] > 0
    for at in range(side.begins[i], side.ends[i]):
        v, share = side.vertices[at], side.shares[at]
        side.weights[v, 0] = 1.0
        soft += share * law.softness[v]
        each = share * law.softness[v] / law.areas[v]
        for x in range(3):
            side.response[i // BLOCK, 3 * v + x, i % BLOCK] += sign * each * side.normal[i, x]
            for a in range(2 if rubs else 0):
                j = a * count + i
                side.aside[j // BLOCK, 3 * v + x, j % BLOCK] += each * tangents[a, i, x]
    matrix[i, i] = soft / area[i]
    if rubs:
        for a in range(2):
            drags[(a + 1) * count + i, a * count + i] = matrix[i, i]


@kernel
def _renew_condensed(
    law: Law, side: Record, i: int, sign: float, inverse: Matrix, tangents: Tensor, matrix: Matrix, drags: Matrix
):
    count, size, rubs = len(matrix), len(law.hats), tangents.shape[1] > 0
    normal, n = side.normal, vector3(side.normal, i)
    along, across = tangents[0], tangents[1]  # once: a view of an array costs as much as ten products
    here = (vector3(along, i), vector3(across, i)) if rubs else (n, n)
    gather_hats(law, side, i)
    # displacement of the body by unit forces on the candidate
    field_of(law, side, i, n, law.fields[0])
    if rubs:
        fields_along(law, side, i, here[0], here[1], law.fields[1], law.fields[2])
    local = law.local > 0.0 and len(law.table) > 0
    if local:
        law.near[:] = 0.0
        for k in range(side.few[i]):
            row, hat = law.table[side.coarse[i, k]], side.hats[i, k]
            for v in range(size):
                law.near[v] += hat * row[v]
    # of all candidates
    field, near = law.fields[0], law.near
    for j in range(count):
        m, more = vector3(normal, j), 0.0
        facing = max(n[0] * m[0] + n[1] * m[1] + n[2] * m[2], 0.0)
        moved, apart = seen_by(side, j, field, near, m)
        if local and facing > 0.0:
            more = law.local * (inverse[i, j] - apart)
        matrix[i, j] = matrix[j, i] = law.scale * moved + facing * more
        if rubs:
            see_fields(law, side, j)
            _renew_drags(law, m, i, j, sign, here, (vector3(along, j), vector3(across, j)), more, drags)
    if law.loaded == 0:
        return
    # by forces at the terminals
    put_column(side.response, i, sign * law.scale, law.fields[0])
    for a in range(2 if rubs else 0):
        put_column(side.aside, a * count + i, law.scale, law.fields[a + 1])


@ieee_kernel
def fill_columns(law: Law, side: Record, sign: float, tangents: Tensor):
    """`side.response` and `side.aside` of all candidates of a condensed organ, as of `renew_row`."""
    for i in range(len(side.few)):
        for a in range(1 + (2 if tangents.shape[1] > 0 else 0)):
            field_of(law, side, i, vector3(side.normal if a == 0 else tangents[a - 1], i), law.fields[0])
            if a == 0:
                put_column(side.response, i, sign * law.scale, law.fields[0])
            else:
                put_column(side.aside, (a - 1) * len(side.few) + i, law.scale, law.fields[0])


@kernel
def _renew_drags(
    law: Law, m: Vector3, i: int, j: int, sign: float, here: Pair3, there: Pair3, more: float, drags: Matrix
):
    """Displacement along the tangents at j by forces at i, and at i by forces at j, after `see_fields`; m [1] (3) is
    n_j, here and there [1] (2,3) are the tangents at i and j."""
    count, pressed = drags.shape[1] // 2, vector3(law.seen, 0)
    pulled = vector3(law.seen, 1), vector3(law.seen, 2)
    for a in range(2):
        t = there[a]
        drags[i, a * count + j] = sign * law.scale * dot(pressed, t)
        drags[j, a * count + i] = sign * law.scale * dot(pulled[a], m)
        for b in range(2):
            value = law.scale * dot(pulled[b], t) + law.aside * dot(here[b], t) * more
            drags[(b + 1) * count + i, a * count + j] = drags[(a + 1) * count + j, b * count + i] = value
