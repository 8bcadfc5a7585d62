"""Compliance of a body between the candidates of its contact with another (`physics.contact.organs.between`).

C_ij [m/N] is the displacement of candidate i along its normal by a unit force on candidate j along its normal; P are
the weights of the candidates on the surface (`physics.contact.organs.candidates`).

*A condensed organ* (`condensed_body`), of the compliance C between coarse vertices for a modulus of 1 Pa. With the
weights Q (m,V) of the candidates on the coarse vertices,

    C_ij = (n_i.(Q C Q')_ij n_j + (1 - nu²)/pi <n_i.n_j> (X - Q T Q')_ij)/E,    <x> = max(0, x)

As in `true_patch`, a half-space corrects for the hat functions of the coarse surface: T is its mean 1/r between them, X
that between discs of the candidates' areas A = pi a²: for one disc 16/(3 pi a), the mean displacement under a uniform
pressure (K. L. Johnson, Contact Mechanics, 1985, eq. 3.29), and for two at the distance d, to fourth order in a/d (the
mean of f over a disc is f + a²/8 D f + a⁴/192 D D f, with D 1/r = 1/r³, D 1/r³ = 9/r⁵ in the plane),

    X_ij = 1/d + (a_i² + a_j²)/(8 d³) + (9/192 (a_i⁴ + a_j⁴) + 9/64 a_i² a_j²)/d⁵

The surfaces slide freely, so nothing is reduced by sticking. Large displacement of the organ is neglected.

*A foundation* of independent springs of the compliance q [m/Pa] per area: each candidate is a spring of its area,

    C_ij = d_ij/A_i sum_v P_iv q_v

and a load f_v of vertices of the areas A_v moves it by sum_v P_iv q_v n_i.f_v/A_v. (With C = P diag(q/A_v) P' the
forces of candidates that share vertices of a coarser surface would not be determined.)

*One organ on both sides* (`folded_between`): candidate i has a place p_i, and q_i on the opposite wall of the same
organ. With the displacements and unit forces along n_i at p_i, and along -n_i at q_i, a body of 2m candidates,

    C_ij = C_pi,pj + C_pi,qj + C_qi,pj + C_qi,qj

is the opening of i by a pair of forces at j that pushes both walls apart; the second and third term are those by which
the walls of one piece move each other, zero between separate pieces and for independent springs. As q pushes along -n,
it is C_pp + C_qq - C_pq - C_qp in terms of displacements and forces along n.

*A rigid plate* that is indented by force over stiffness: C_ij = (1 + d_ij)/K; d_ij = 1 for i = j is the compliance of
the place itself, without which the forces of several candidates would not be determined.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from palpate.compiler.exact import product
from palpate.physics.bodies.condensed_step import CondensedModel
from palpate.physics.bodies.true_patch import sideways
from palpate.physics.contact.organs.between_rows import Law, condensed_law, plate_law, springs_law
from palpate.physics.contact.organs.candidates import Shares

NO_TANGENTS, NO_FIELD = np.zeros((2, 0, 3)), np.zeros((0, 0))


class BetweenBody(NamedTuple):
    """A body as its contact with another needs it.

    matrix      [m/N] (m,m)    C
    response    [m/N] (3t,m)   displacement of each candidate along its normal by a unit force along each axis at each
                               of t terminals
    corners     (V,3)          terminals of each vertex of the surface, and their weights [1] (V,3)
    retardation [s]
    aside       [m/N] (3t,2m)  displacement of each candidate along its tangents, those along t_1 before those along
                               t_2, by a unit force along each axis at each terminal
    drags       [m/N] (3m,2m)  the same by a unit force on each candidate along n, t_1 and t_2
    law                        for candidates that follow (`between_rows`)
    """

    matrix: np.ndarray
    response: np.ndarray
    corners: np.ndarray
    weights: np.ndarray
    retardation: float
    law: Law
    aside: np.ndarray = NO_FIELD
    drags: np.ndarray = NO_FIELD


def condensed_between(
    model: CondensedModel, shares: Shares, normal: np.ndarray, area: np.ndarray, tangents: np.ndarray = NO_TANGENTS
) -> BetweenBody:
    """A condensed organ; normal [1] (m,3) and area [m²] (m) of the candidates, tangents [1] (2,m,3) if they rub."""
    size, count = len(model.vertices), len(normal)
    hats = np.zeros((count, size))  # Q
    for a in range(3):
        np.add.at(hats, (shares.cells, model.corners[shares.vertices, a]),
                  shares.weights * model.weights[shares.vertices, a])  # fmt: skip
    along = _moved(model, hats, normal)  # n.Q C (m,3V), then its product with Q' n
    matrix = np.zeros((count, count))
    for cell, v in zip(*np.nonzero(hats), strict=True):
        for x in range(3):
            matrix[:, cell] += hats[cell, v] * normal[cell, x] * along[:, 3 * v + x]
    local = np.zeros((count, count))
    if len(model.true.table):
        near = product(product(hats, model.true.table), hats.T)
        facing = np.maximum(product(normal, normal.T), 0.0)
        # opposite walls are not the surface of one half-space
        local = np.where(facing > 0.0, model.true.normal * (mean_inverse(shares.place, area) - near), 0.0)
        matrix += facing * local
    matrix = 0.5 * (matrix + matrix.T) / model.young
    response = np.ascontiguousarray(along.T) / model.young
    true = model.true
    law = condensed_law(
        model.compliance, true.table, model.young, true.normal if len(true.table) else 0.0, true.tangential
    )
    body = BetweenBody(matrix, response, model.corners, model.weights, model.retardation, law)
    if not tangents.size:
        return body
    # displacement along the tangents by forces along n, t_1 and t_2
    aside = np.concatenate([_moved(model, hats, t) for t in tangents])
    pushes = [(hats[:, :, None] * e[:, None, :]).reshape(count, 3 * size) for e in (normal, *tangents)]
    drags = product(aside, np.concatenate(pushes).T)
    for a, t in enumerate(tangents):
        for b, e in enumerate(tangents):
            drags[a * count : (a + 1) * count, (b + 1) * count : (b + 2) * count] += (
                model.true.tangential * product(t, e.T) * local
            )
    return body._replace(aside=np.ascontiguousarray(aside.T) / model.young, drags=drags.T / model.young)


def _moved(model: CondensedModel, hats: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """e.Q C (m,3V): displacement of each candidate along a direction [1] (m,3) by a unit force at a coarse vertex."""
    along = np.zeros((len(hats), 3 * hats.shape[1]))
    for cell, v in zip(*np.nonzero(hats), strict=True):
        for x in range(3):
            along[cell] += hats[cell, v] * direction[cell, x] * model.compliance[3 * v + x]
    return along


def folded_between(
    body: Callable[[Shares, np.ndarray, np.ndarray, np.ndarray], BetweenBody],
    first: Shares,
    second: Shares,
    normal: np.ndarray,
    area: np.ndarray,
    tangents: np.ndarray = NO_TANGENTS,
) -> BetweenBody:
    """A body of which both walls of each candidate are part: `matrix`, `response`, `aside` and `drags` are those of the
    opening, and of the displacement of the first wall against the second, by a pair of opposite forces on both.

    body  as `condensed_between` for a body: its compliance for candidates with these shares, normals, areas, tangents
    """
    count = len(normal)
    both = Shares(
        np.concatenate([first.cells, second.cells + count]), *(
            np.concatenate([getattr(first, name), getattr(second, name)]) for name in ("vertices", "weights", "place")
        )
    )  # fmt: skip
    found = body(both, np.concatenate([normal, -normal]), np.concatenate([area, area]),
                 np.concatenate([tangents, -tangents], axis=1))  # fmt: skip
    matrix = _together(_together(found.matrix, count, 0), count, 1)
    folded = found._replace(matrix=matrix, response=_together(found.response, count, 1))
    if not tangents.size:
        return folded
    drags = _together(_together(found.drags, count, 0), count, 1)
    return folded._replace(aside=_together(found.aside, count, 1), drags=drags)


def _together(field: np.ndarray, count: int, axis: int) -> np.ndarray:
    """The sum over both walls, along an axis that has those of `count` candidates for each direction."""
    shape = list(field.shape)
    shape[axis : axis + 1] = [shape[axis] // (2 * count) if count else 0, 2, count]
    first, second = np.moveaxis(field.reshape(shape), axis + 1, 0)
    shape[axis : axis + 3] = [field.shape[axis] // 2]
    return np.ascontiguousarray((first + second).reshape(shape))


def mean_inverse(place: np.ndarray, area: np.ndarray) -> np.ndarray:
    """X [1/m] (m,m): mean of 1/r between discs of these areas [m²] (m) at these places [m] (m,3)."""
    square = area / np.pi
    away = np.sqrt(np.sum(np.square(place[:, None] - place[None]), axis=2))
    radius = np.sqrt(square)
    away = np.maximum(away, 0.5 * (radius[:, None] + radius[None]))  # discs that overlap, as on a rim
    first, second = square[:, None], square[None]
    fourth = 9.0 / 192.0 * (first * first + second * second) + 9.0 / 64.0 * first * second
    cube = away * away * away
    found = 1.0 / away + (first + second) / (8.0 * cube) + fourth / (cube * away * away)
    np.fill_diagonal(found, 16.0 / (3.0 * np.pi * radius))
    return np.asarray(found)


def measure_along(
    law: Law, matrix: np.ndarray, drags: np.ndarray, places: tuple[np.ndarray, np.ndarray], normal: np.ndarray,
    tangents: np.ndarray, area: np.ndarray,
) -> None:  # fmt: skip
    """Change the distances in X of `matrix` [m/N] (m,m) and `drags` (3m,2m) to those on the organ on which the
    candidates stay, as in `between_rows`, from the start on. places [m] (m,3)  on that organ and on the other one"""
    fine, other = places
    if not len(law.table):
        return
    facing, count = np.maximum(product(normal, normal.T), 0.0), len(area)
    local = np.where(facing > 0.0, law.local * (mean_inverse(fine, area) - mean_inverse(other, area)), 0.0)
    matrix += facing * local
    if not tangents.size:
        return
    for a, t in enumerate(tangents):
        for b, e in enumerate(tangents):
            drags[(b + 1) * count : (b + 2) * count, a * count : (a + 1) * count] += law.aside * product(e, t.T) * local


def foundation_between(
    softness: np.ndarray,
    areas: np.ndarray,
    shares: Shares,
    normal: np.ndarray,
    area: np.ndarray,
    retardation: float,
    tangents: np.ndarray = NO_TANGENTS,
) -> BetweenBody:
    """Independent springs, as soft along the surface as across it; softness q [m/Pa] (V), areas [m²] (V) of the
    vertices, area [m²] (m) of the candidates."""
    used, terminal = np.unique(shares.vertices, return_inverse=True)
    weights = np.zeros((len(normal), len(used)))  # P
    weights[shares.cells, terminal.ravel()] = shares.weights
    matrix = np.diag(product(weights, softness[used]) / area)
    response = (weights * (softness[used] / areas[used]))[:, :, None] * normal[:, None, :]
    corners, on = np.zeros((len(areas), 3), np.int64), np.zeros((len(areas), 3))
    corners[used, 0], on[used, 0] = np.arange(len(used)), 1.0
    body = BetweenBody(
        matrix, np.ascontiguousarray(response.reshape(len(normal), 3 * len(used)).T), corners, on, retardation,
        springs_law(softness, areas),
    )  # fmt: skip
    if not tangents.size:
        return body
    moved = [(weights * (softness[used] / areas[used]))[:, :, None] * t[:, None, :] for t in tangents]
    aside = np.concatenate([each.reshape(len(normal), 3 * len(used)) for each in moved])
    return body._replace(aside=np.ascontiguousarray(aside.T), drags=_own_drags(matrix))


def _own_drags(tangential: np.ndarray) -> np.ndarray:
    """Displacement [m/N] (3m,2m) of candidates that move along the surface only by forces along it, as across it."""
    count = len(tangential)
    drags = np.zeros((3 * count, 2 * count))
    for a in range(2):
        drags[(a + 1) * count : (a + 2) * count, a * count : (a + 1) * count] = tangential
    return drags


def rigid_between(stiffness: float, size: int, normal: np.ndarray, tangents: np.ndarray = NO_TANGENTS) -> BetweenBody:
    """A plate of this stiffness [N/m], whose surface has `size` vertices. Other loads do not move it."""
    matrix = (np.ones((len(normal), len(normal))) + np.eye(len(normal))) / stiffness
    nothing = np.zeros((3, len(normal)))
    body = BetweenBody(matrix, nothing, np.zeros((size, 3), np.int64), np.zeros((size, 3)), 0.0, plate_law())
    if not tangents.size:
        return body
    return body._replace(aside=np.zeros((3, 2 * len(normal))), drags=_own_drags(matrix))


def tangents_of(normal: np.ndarray) -> np.ndarray:
    """Two orthogonal tangents [1] (2,m,3) of candidates with the normals [1] (m,3)."""
    found, along = np.zeros((2, len(normal), 3)), np.zeros((2, 3))
    for i, n in enumerate(normal):
        sideways((float(n[0]), float(n[1]), float(n[2])), along)
        found[:, i] = along
    return found
