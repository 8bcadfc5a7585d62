"""A displacement field in few numbers: every vertex near the contact, fewer and fewer farther off.

An elastic surface moves by about 1/r at the distance r from what presses it. Points h apart then hold it, by linear
interpolation, within h²/(4 r²) of its own displacement there: 3 % of it for h = `GRADE` r, whatever the distance.

Vertices are ranked by farthest-point sampling (T. F. Gonzalez, Theor. Comput. Sci. 38 (1985) 293-306): each is the one
that is farthest from all before it. One that is h away from these is sent up to a distance of h/`GRADE` beyond the
region where all are. The receiver interpolates (`filled`).
"""

import numpy as np
import scipy  # its parts are slow to import, and are when they are used

from palpate.physics.exact import solve
from palpate.physics.kept import kept

GRADE = 0.35  # [1] Distance between the vertices that are sent, over that from the region where all are
RANKED = 600  # Vertices that are ranked; the others are sent only where all are
EVERYWHERE = 150
"""Vertices that are sent wherever the contact is: what the body does as a whole follows its curved surface."""
LANDMARKS = 16  # Vertices farthest from each other by which a receiver knows that all of the surface is listed
SAMPLED = 20_000  # Vertices of a large mesh that ranks are given among
NEIGHBOURS = 12  # Sent vertices that one in between is interpolated from
STIFF = 1e-4  # [1] Regularisation of the linear fit: the neighbours lie nearly in a plane


def ranked(points: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """The first `count` vertices by farthest-point sampling, and the distance [m] of each from all before it."""
    chosen = np.arange(0, len(points), -(-len(points) // SAMPLED))
    some = points[chosen]
    count = min(count, len(some))
    order, apart = np.zeros(count, dtype=np.int64), np.full(count, np.inf)
    away = np.linalg.norm(some - some[0], axis=1)
    for rank in range(1, count):
        order[rank] = away.argmax()
        apart[rank] = away[order[rank]]
        away = np.minimum(away, np.linalg.norm(some - some[order[rank]], axis=1))
    return chosen[order], apart


@kept
def ranges(points: np.ndarray, near: float) -> np.ndarray:
    """Distance [m] (N,) from the contact up to which each vertex is sent.

    points [m] (N,3);  near [m] distance within which all are
    """
    order, apart = ranked(points, RANKED)
    within = np.full(len(points), near)
    within[order] = near + apart / GRADE
    within[order[:EVERYWHERE]] = np.inf
    return within


@kept
def landmarks(points: np.ndarray) -> np.ndarray:
    """Vertices of points [m] (N,3) that are farthest from each other."""
    return ranked(points, LANDMARKS)[0]


def spread_over(points: np.ndarray, nodes: np.ndarray) -> bool:
    """Whether vertices `nodes` are some that lie all over the surface, those sent everywhere among them: then what is
    not listed lies between. Displacements of a contact alone never list the farthest ends of a body together."""
    return len(nodes) < len(points) and bool(np.isin(landmarks(points), nodes).all())


def filled(points: np.ndarray, nodes: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """The field (N,c) of all points [m] (N,3) from that of some of them: `moved` (k,c) of `nodes` (k,).

    Moving least squares of first degree over the nearest nodes, with weights that end at the farthest of them: linear
    fields are kept. P. Lancaster, K. Salkauskas, Math. Comput. 37 (1981) 141-158.
    """
    field = np.zeros((len(points), moved.shape[1]))
    field[nodes] = moved
    between = np.setdiff1d(np.arange(len(points)), nodes)
    if len(nodes) < NEIGHBOURS or not len(between):
        return field
    away, near = scipy.spatial.cKDTree(points[nodes]).query(points[between], k=NEIGHBOURS)
    far = np.maximum(away[:, -1:], 1e-12)
    q = np.minimum(away / far, 1.0) ** 2
    weight = (1.0 - q) ** 2 / (q + 1e-2)
    terms = np.concatenate(
        [np.ones_like(q)[..., None], (points[nodes[near]] - points[between][:, None]) / far[..., None]], 2
    )
    normal = np.einsum("nk,nki,nkj->nij", weight, terms, terms)
    total = weight.sum(axis=1)
    normal[:, [1, 2, 3], [1, 2, 3]] += STIFF * total[:, None]
    first = np.zeros((len(between), 4, 1))
    first[:, 0] = 1.0
    shares = weight * np.einsum("nki,ni->nk", terms, solve(normal, first)[..., 0])
    field[between] = np.einsum("nk,nkc->nc", shares, moved[near])
    return field
