"""A sampled body from full solutions: modes by proper orthogonal decomposition, points by non-negative weights.

Modes. The inner product is the mean tangent of loaded states, each over the energy at work there, so that an error
counts as what it changes in the force. The modes are made orthonormal in K0, the stiffness at rest.

Points. At snapshot s the modes' generalised forces are sums over all integration points, g_s = sum_p g_ps,
g_ps = w_p G_p'P(1 + G_p q_s). Weights >= 0, most of them zero, with sum_p x_p g_ps near g_s for all s: the
non-negative least squares of C. L. Lawson, R. J. Hanson, Solving Least Squares Problems (1974), stopped as soon as
the residual is small. Rows are multiplied by the inverse factor of the reduced tangent, so that the residual is an
error of q in energy; one more row for each snapshot is the error of the indentation under its load, counted `GOAL`
times. J. A. Hernandez, M. A. Caicedo, A. Ferrer, Comput. Methods Appl. Mech. Eng. 313 (2017) 687-722.

The rows are mixed down to `ROWS` by a random matrix of few signs, which keeps the length of every residual to some per
cent. P.-G. Martinsson, J. A. Tropp, Acta Numerica 29 (2020) 403-572 (sparse sign embeddings).

The weights change the tangent at rest, Phi'K0 Phi = 1, a little, to M. The modes of the points are therefore taken as
G_p M^(-1/2): at rest the sampled body is the full one in these modes, exactly.
"""

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from palpate.models.fe.element.elements import gradients
from palpate.models.fe.progress import Report, unheard
from palpate.models.fe.reduce.reducible import Reducible
from palpate.models.fe.reduce.snapshots import PressSolution
from palpate.physics.bodies.sampled.energy import Points, forces, scratch, tangent
from palpate.physics.bodies.sampled.step import gamma
from palpate.physics.materials.hyperelastic import Material, place_of

SAMPLING = 4e-3  # Residual of the weights, relative to the forces; slabs want 3e-3
GOAL = 4.0  # How much more the indentation counts than the rest
METRIC = 60  # About how many touches the mean tangent is taken over
STATES = 1500  # Snapshots, at random, that the points are sampled at
FEW = 7  # One in how many points gives the tangent that the forces of a snapshot are weighed with
ROWS, SIGNS, SEED = 4096, 8, 1
"""Rows that the forces of all snapshots are mixed down to, how many of them each one goes to, and which."""


def modes(body: Reducible, pressed: list[PressSolution], count: int) -> tuple[np.ndarray, np.ndarray]:
    """Modes (N,3,r) of all snapshots, each counted alike, orthonormal in the stiffness at rest; and the snapshots in
    them, q (S,r), nearest in the mean tangent."""
    mean = None
    for own in pressed[:: 1 + len(pressed) // METRIC]:
        for u in own.solutions[[len(own.solutions) // 2, -1]]:
            matrix = body.elastic.pattern.matrix(body.elastic.tangent(u)).tocsr()
            part = matrix / float(u.ravel() @ (matrix @ u.ravel()))
            mean = part if mean is None else mean + part
    every = np.concatenate([own.solutions for own in pressed]).reshape(-1, body.fixed.size)
    turned = mean @ every.T
    gram = every @ turned
    size = np.diag(gram) ** -0.5
    values, vectors = np.linalg.eigh(gram * size[:, None] * size)
    kept = vectors[:, ::-1][:, :count] / np.sqrt(np.maximum(values[::-1][:count], 1e-12 * values[-1]))
    basis = (every.T * size) @ kept
    rest = body.elastic.pattern.matrix(body.elastic.tangent(np.zeros_like(body.mesh.points))).tocsr()
    lower = np.linalg.cholesky(basis.T @ (rest @ basis))
    phi = np.ascontiguousarray(solve_triangular(lower, basis.T, lower=True).T)
    states = np.linalg.solve(phi.T @ (mean @ phi), phi.T @ turned).T
    return phi.reshape(-1, 3, phi.shape[1]), states


def points_of(body: Reducible, phi: np.ndarray, limit: float) -> Points:
    """All integration points of a body with its modes (N,3,r), each with its own weight. ValueError: see `_place`."""
    mesh, many, r = body.mesh, len(body.mesh.elements), phi.shape[2]
    slope, det = gradients(mesh.points, mesh.elements)
    laws = {region: law for region, law in body.materials(1.0).items() if (mesh.region == region).any()}
    places = {_place(law): None for law in laws.values()}
    kinds = np.zeros(many, dtype=np.int64)
    constants = np.zeros((many, max(len(law.parameters) for law in laws.values())))
    for region, law in laws.items():
        own = mesh.region == region
        kinds[own] = list(places).index(_place(law))
        constants[own, : len(law.parameters)] = law.parameters
    springs = np.zeros((r, r))
    for bed in body.elastic.beds:
        pull = np.zeros_like(phi)
        for k in range(r):
            bed.add(np.ascontiguousarray(phi[:, :, k]), 0.0, False, pull[:, :, k], np.zeros((0, 3, 3)))
        springs += np.einsum("nia,nib->ab", phi, pull)
    own_modes = np.einsum("enia,epnj->epija", phi[mesh.elements], slope, optimize=True)
    each = slope.shape[1]
    return Points(
        np.ascontiguousarray(own_modes.reshape(-1, r)), (det / 24.0).ravel(), np.repeat(kinds, each),
        np.repeat(constants, each, axis=0), springs, limit, np.array(list(places)),
    )  # fmt: skip


def chosen(points: Points, which: np.ndarray, weights: np.ndarray) -> Points:
    r = points.modes.shape[1]
    return points._replace(
        modes=np.ascontiguousarray(points.modes.reshape(-1, 9, r)[which].reshape(-1, r)),
        weights=points.weights[which] * weights,
        kinds=points.kinds[which],
        constants=np.ascontiguousarray(points.constants[which]),
    )


def at_rest(points: Points) -> Points:
    """The same with modes such that the tangent at rest is the identity."""
    r = points.modes.shape[1]
    hessian = np.zeros((r, r))
    tangent(points, np.zeros(r), scratch(points), hessian)
    values, vectors = np.linalg.eigh(hessian)
    root = vectors @ np.diag(values**-0.5) @ vectors.T
    return points._replace(
        modes=np.ascontiguousarray(points.modes @ root), springs=np.ascontiguousarray(root @ points.springs @ root)
    )


def sample(
    points: Points, states: np.ndarray, tolerance: float = SAMPLING, most: int = 1000, report: Report = unheard
) -> tuple[np.ndarray, np.ndarray]:
    """Points and their weights > 0 that give the generalised forces at states q (S,r) to a tolerance; a state that so
    few modes cannot take without inverting a point is left out."""
    r, many, rng = points.modes.shape[1], len(points.kinds), np.random.default_rng(SEED)
    work, g, hessian = scratch(points), np.zeros(r), np.zeros((r, r))
    few = chosen(points, np.arange(0, many, FEW), np.full(-(-many // FEW), float(FEW)))
    own_few = scratch(few)
    own_modes, own_forces = points.modes.reshape(many, 9, r), work.f.reshape(many, 9)
    mixed = np.zeros((ROWS, many), dtype=np.float32)
    for q in rng.permutation(states)[:STATES]:
        if not (forces(points, q, work, g) < np.inf and tangent(few, q, own_few, hessian)):
            continue
        values, vectors = np.linalg.eigh(hessian)
        values = np.maximum(values, 1e-3 * float(np.median(values)))
        rows = (vectors / np.sqrt(values)).T @ np.einsum("pka,pk->ap", own_modes, own_forces)
        goal = rows.sum(axis=1)
        size = float(goal @ goal)
        if not size > 0.0:
            continue
        for row in np.concatenate([rows, GOAL * (goal @ rows)[None] / np.sqrt(size)]) / np.sqrt(SIGNS * size):
            for k in rng.integers(ROWS, size=SIGNS):
                mixed[k] += row if rng.random() < 0.5 else -row
    return nonnegative(np.ascontiguousarray(mixed.T), mixed.sum(axis=1, dtype=np.float64), tolerance, most, report)


def nonnegative(
    columns: np.ndarray, goal: np.ndarray, tolerance: float, most: int, report: Report = unheard
) -> tuple[np.ndarray, np.ndarray]:
    """Columns and coefficients x > 0, as few as bring |sum_k x_k column_k - goal| to `tolerance` |goal|.

    columns  (P,n), one in each row
    goal     (n,)
    most     columns that may be taken
    """
    size = np.sqrt(np.maximum(np.einsum("pn,pn->p", columns, columns, dtype=np.float64), 1e-300))
    whole, x = float(np.linalg.norm(goal)), np.zeros(0)
    kept: list[int] = []
    own, gram, right = np.zeros((0, len(goal))), np.zeros((0, 0)), np.zeros(0)
    # Active-set non-negative least squares (Lawson, Hanson 1974), with the Gram matrix of the columns kept
    for _ in range(4 * most):
        left = goal - x @ own
        missed = float(np.linalg.norm(left))
        report(min(1.0, float(np.log(max(missed / whole, 1e-300)) / np.log(tolerance))))
        if missed <= tolerance * whole or len(kept) >= most:
            break
        # take the column that is most like the residual
        lean = columns @ (left / missed).astype(columns.dtype) / size
        lean[kept] = -np.inf
        best = int(np.argmax(lean))
        if not lean[best] > 1e-6:
            break
        column = columns[best].astype(np.float64)
        across = own @ column
        gram = np.block([[gram, across[:, None]], [across[None], column @ column]])
        own, right = np.vstack([own, column]), np.append(right, column @ goal)
        kept, x = [*kept, best], np.append(x, 0.0)
        # the kept columns' least squares; on the way to it the first coefficient that would pass 0 leaves
        while True:
            solution = cho_solve(cho_factor(gram + 1e-12 * np.trace(gram) / len(kept) * np.eye(len(kept))), right)
            if (solution > 0.0).all():
                x = solution
                break
            down = solution <= 0.0
            step = float(np.min(x[down] / np.maximum(x[down] - solution[down], 1e-300)))
            x = x + step * (solution - x)
            stay = ~(down & (x <= 1e-12 * x.max(initial=1e-300)))
            if stay.all():
                stay[int(np.argmin(x))] = False
            kept, x, own = [k for k, s in zip(kept, stay, strict=True) if s], x[stay], own[stay]
            gram, right = gram[np.ix_(stay, stay)], right[stay]
    return np.array(kept, dtype=np.int64), x


def bent(w: np.ndarray, pull: np.ndarray, weight: np.ndarray) -> tuple[float, float]:
    """w0 and m of gamma for which gamma w is nearest to these in the mean, the best of a grid.

    w       [1] (S,) sizes of the load on what the modes miss
    pull    [1] (S,) how far it moves there
    weight  [1] (S,) what a miss counts
    """
    best, parameters = np.inf, (1.0, 1.0)
    low, high = np.log(w.min() / 10.0), np.log(w.max())
    for scale in np.exp(np.linspace(low, high, 60)):
        for power in np.linspace(0.0, 2.0, 81):
            guess = np.array([gamma(x * x, scale, power, np.inf)[0] for x in w]) * w
            miss = float(np.mean(np.abs(guess - pull) * weight))
            if miss < best:
                best, parameters = miss, (float(scale), float(power))
    return parameters


def _place(law: Material) -> int:
    """Where a law is, see `hyperelastic.place_of`. ValueError: a law of small strain; an element with one mean volume
    ratio, whose energy is no sum over its points."""
    name = law.name
    if law.small:
        raise ValueError(f"material law {name!r}: it is for small strains, but a sampled body has large rotations")
    if law.mixed:
        raise ValueError(
            f"material law {name!r} with the mixed element: expected the plain one, as the energy of a sampled body is "
            "a sum over points. The plain one serves up to a Poisson's ratio of about 0.45"
        )
    return place_of(law.law, name)
