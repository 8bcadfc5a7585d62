"""One of the two bodies of a contact of organs: its candidates, the loads on it, and the load of the contact on it."""

from typing import Annotated, NamedTuple

import numpy as np

from palpate.compiler.records import floats, integers, nth, unpacking, vector
from palpate.nodes.base.kernels import ieee_kernel
from palpate.physics.bodies.between_bodies import BetweenBody
from palpate.physics.bodies.mass_spring import normal_force
from palpate.physics.contact.organs import between as contact
from palpate.physics.contact.organs.candidates import Shares
from palpate.physics.contact.organs.rubbing import Rubbing


class BodySide(NamedTuple):
    """One of the two bodies: its terminals, see `between_bodies.BetweenBody`, and the shares of the candidates.

    response (b,3t,4), aside (c,3t,4)  in blocks of columns, see `physics.contact.organs.between.blocks_of`
    begins (m+1), ends (m)  first share of each candidate, and the one after its last
    vertices, shares (k)  see `candidates.Shares`
    place (m,3)   centre of each candidate [m];  centre (m,3)  that for which the compliances were computed
    normal (m,3)  direction for which they were computed
    few (m), coarse (m,h), hats [1] (m,h)  of a condensed organ whose candidates follow: the number of coarse vertices
                  on which a candidate has weights, these vertices, and the weights, as for the compliances
    gathered (t,3), touched (2,t)  workspace of `physics.contact.organs.between.open_by`
    slot (V)      place of a vertex in `nodes`, -1: none; -1 between steps
    nodes (k), forces [N] (k,3)  the load on the body
    """

    corners: Annotated[np.ndarray, "<i8", 2]
    weights: Annotated[np.ndarray, "<f8", 2]
    response: Annotated[np.ndarray, "<f8", 3]
    aside: Annotated[np.ndarray, "<f8", 3]
    begins: Annotated[np.ndarray, "<i8", 1]
    ends: Annotated[np.ndarray, "<i8", 1]
    vertices: Annotated[np.ndarray, "<i8", 1]
    shares: Annotated[np.ndarray, "<f8", 1]
    place: Annotated[np.ndarray, "<f8", 2]
    centre: Annotated[np.ndarray, "<f8", 2]
    normal: Annotated[np.ndarray, "<f8", 2]
    few: Annotated[np.ndarray, "<i8", 1]
    coarse: Annotated[np.ndarray, "<i8", 2]
    hats: Annotated[np.ndarray, "<f8", 2]
    gathered: Annotated[np.ndarray, "<f8", 2]
    touched: Annotated[np.ndarray, "<i8", 2]
    slot: Annotated[np.ndarray, "<i8", 1]
    nodes: Annotated[np.ndarray, "<i4", 1]
    forces: Annotated[np.ndarray, "<f8", 2]


def body_side(body: BetweenBody, shares: Shares, normal: np.ndarray) -> BodySide:
    """The side of a body whose candidates have these shares, along `normal` [1] (m,3)."""
    size, terminals = len(body.corners), len(body.response) // 3
    used, begins = len(np.unique(shares.vertices)), np.searchsorted(shares.cells, np.arange(len(normal) + 1))
    place, count = np.ascontiguousarray(shares.place), len(normal)
    return BodySide(
        np.ascontiguousarray(body.corners, np.int64), np.ascontiguousarray(body.weights, float),
        contact.blocks_of(body.response), contact.blocks_of(body.aside), begins.astype(np.int64),
        begins[1:].astype(np.int64), shares.vertices, shares.weights, place, place.copy(), normal.copy(),
        np.zeros(count, np.int64), np.zeros((count, 0), np.int64), np.zeros((count, 0)), np.zeros((terminals, 3)),
        np.zeros((2, terminals), np.int64), np.full(size, -1), np.zeros(used, np.int32), np.zeros((used, 3)),
    )  # fmt: skip


side_of, pair_of, rub_of = unpacking(BodySide), unpacking(contact.Pair), unpacking(Rubbing)


@ieee_kernel
def take_loads(load, fingers, side, others, opened, pressing, aside, moved):
    """Fill `others` [m] (m), the opening of the candidates by all loads on a body at rest, `opened` [m] (2,f + 1,m),
    that by each of the first f = `fingers` loads and by its normal part, and their normal forces `pressing` [N]; if the
    bodies rub, `aside` [m] (2m), the displacement of the candidates along the surface by all loads. Returns whether a
    load is on an unknown vertex.

    moved (2m)  workspace
    """
    others[:] = 0.0
    aside[:] = 0.0
    pressing.count = fingers
    for i in range(load.count):
        each, row, part = nth(load, i), opened[0, min(i, fingers)], opened[1, min(i, fingers)]
        if i >= fingers:
            part = part[:0]
        else:
            pressing.values[i] = 0.0
        if not each.there or each.nodes.shape[0] == 0:
            continue
        nodes, forces = integers(each.nodes), floats(each.forces)
        for v in nodes:
            if not 0 <= v < len(side.corners):
                return True
        n = vector(each.normal)
        contact.open_by(
            nodes, forces, n, side.corners, side.weights, side.response, side.gathered, side.touched, row, part
        )
        for k in range(len(others)):
            others[k] += row[k]
        if len(aside) > 0:
            contact.open_by(
                nodes, forces, n, side.corners, side.weights, side.aside, side.gathered, side.touched, moved, part[:0]
            )
            for k in range(len(aside)):
                aside[k] += moved[k]
        if i < fingers:
            pressing.values[i] = normal_force(forces, n)
    return False


@ieee_kernel
def spread_forces(pair, side, rubs, sign):
    """Fill nodes and forces of a side's load with the forces of the candidates, `sign` p n and the friction `rubs` [N]
    (m,3); returns the number of nodes."""
    count, active, normal = 0, pair.active, side.normal
    for k in range(active.tally[0].active):
        i = active.order[k]
        force = sign * active.force[i]
        if force == 0.0:
            continue
        for at in range(side.begins[i], side.ends[i]):
            v = side.vertices[at]
            if side.slot[v] < 0:
                side.slot[v], side.nodes[count] = count, v
                side.forces[count, 0] = side.forces[count, 1] = side.forces[count, 2] = 0.0
                count += 1
            for x in range(3):
                given = force * normal[i, x]
                if len(rubs) > 0:
                    given += rubs[i, x]
                side.forces[side.slot[v], x] += side.shares[at] * given
    for k in range(count):
        side.slot[side.nodes[k]] = -1
    return count
