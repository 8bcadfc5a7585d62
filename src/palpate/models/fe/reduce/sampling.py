"""Hyper-reduction of a body: modes by proper orthogonal decomposition (POD), points by empirical cubature.

Modes. The inner product is the mean tangent of loaded states, each normalized by its energy, so that errors are
weighted by their effect on the force. The modes are orthonormal in K0, the stiffness at rest.

Points. The generalised forces of snapshot s are sums over all integration points, g_s = sum_p g_ps with
g_ps = w_p G_p'P(1 + G_p q_s). Sparse weights x_p >= 0 approximate sum_p x_p g_ps = g_s for all s by non-negative least
squares (C. L. Lawson, R. J. Hanson, Solving Least Squares Problems (1974)), stopped at a tolerance of the residual.
Rows are multiplied by the inverse factor of the reduced tangent, so that the residual is the error of q in the energy
norm; one more row per snapshot is the error of the indentation under its load, with the weight `GOAL`. J. A.
Hernandez, M. A. Caicedo, A. Ferrer, Comput. Methods Appl. Mech. Eng. 313 (2017) 687-722.

A sparse sign embedding reduces the rows to `ROWS` and changes the norm of a residual by a few per cent (P.-G.
Martinsson, J. A. Tropp, Acta Numerica 29 (2020) 403-572).

The weights change the tangent at rest from Phi'K0 Phi = 1 to M. The points therefore use the modes G_p M^(-1/2), with
which the sampled body at rest equals the full model in these modes.
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

SAMPLING = 4e-3  # Relative residual of the forces with the weights; slabs need 3e-3
GOAL = 4.0  # Weight of the indentation relative to the other rows
METRIC = 60  # Approximate number of touches in the mean tangent
STATES = 1500  # Number of random snapshots for the selection of points
FEW = 7  # Stride of the points whose tangent weights the forces of a snapshot
ROWS, SIGNS, SEED = 4096, 8, 1  # Sparse sign embedding: number of rows, nonzeros per column, seed


def modes(body: Reducible, pressed: list[PressSolution], count: int) -> tuple[np.ndarray, np.ndarray]:
    """Modes (N,3,r) of all snapshots, each with equal weight, orthonormal in the stiffness at rest; and the coordinates
    q (S,r) of the snapshots, projected in the mean tangent."""
    # mean tangent M, normalized by energy
    mean = None
    for press in pressed[:: 1 + len(pressed) // METRIC]:
        for u in press.solutions[[len(press.solutions) // 2, -1]]:
            matrix = body.elastic.pattern.matrix(body.elastic.tangent(u)).tocsr()
            part = matrix / float(u.ravel() @ (matrix @ u.ravel()))
            mean = part if mean is None else mean + part
    # POD by the method of snapshots: eigenvectors of the correlation matrix
    every = np.concatenate([press.solutions for press in pressed]).reshape(-1, body.fixed.size)
    weighted = mean @ every.T
    gram = every @ weighted
    size = np.diag(gram) ** -0.5
    values, vectors = np.linalg.eigh(gram * size[:, None] * size)
    kept = vectors[:, ::-1][:, :count] / np.sqrt(np.maximum(values[::-1][:count], 1e-12 * values[-1]))
    basis = (every.T * size) @ kept
    # orthonormalize in K0 by Cholesky; project the snapshots
    rest = body.elastic.pattern.matrix(body.elastic.tangent(np.zeros_like(body.mesh.points))).tocsr()
    lower = np.linalg.cholesky(basis.T @ (rest @ basis))
    phi = np.ascontiguousarray(solve_triangular(lower, basis.T, lower=True).T)
    states = np.linalg.solve(phi.T @ (mean @ phi), phi.T @ weighted).T
    return phi.reshape(-1, 3, phi.shape[1]), states


def points_of(body: Reducible, phi: np.ndarray, limit: float) -> Points:
    """All integration points of a body with its modes (N,3,r) and their quadrature weights. ValueError: see
    `_place`."""
    mesh, many, r = body.mesh, len(body.mesh.elements), phi.shape[2]
    slope, det = gradients(mesh.points, mesh.elements)
    laws = {region: law for region, law in body.materials(1.0).items() if (mesh.region == region).any()}
    places = {_place(law): None for law in laws.values()}
    kinds = np.zeros(many, dtype=np.int64)
    constants = np.zeros((many, max(len(law.parameters) for law in laws.values())))
    for region, law in laws.items():
        inside = mesh.region == region
        kinds[inside] = list(places).index(_place(law))
        constants[inside, : len(law.parameters)] = law.parameters
    springs = np.zeros((r, r))
    for support in body.elastic.supports:
        pull = np.zeros_like(phi)
        for k in range(r):
            support.add(np.ascontiguousarray(phi[:, :, k]), 0.0, False, pull[:, :, k], np.zeros((0, 3, 3)))
        springs += np.einsum("nia,nib->ab", phi, pull)
    gradients_of_modes = np.einsum("enia,epnj->epija", phi[mesh.elements], slope, optimize=True)
    each = slope.shape[1]
    return Points(
        np.ascontiguousarray(gradients_of_modes.reshape(-1, r)), (det / 24.0).ravel(), np.repeat(kinds, each),
        np.repeat(constants, each, axis=0), springs, limit, np.array(list(places)),
    )  # fmt: skip


def select_points(points: Points, which: np.ndarray, weights: np.ndarray) -> Points:
    r = points.modes.shape[1]
    return points._replace(
        modes=np.ascontiguousarray(points.modes.reshape(-1, 9, r)[which].reshape(-1, r)),
        weights=points.weights[which] * weights,
        kinds=points.kinds[which],
        constants=np.ascontiguousarray(points.constants[which]),
    )


def at_rest(points: Points) -> Points:
    """The points with modes M^(-1/2), for which the tangent at rest is the identity."""
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
    """Points and their weights > 0 that give the generalised forces at states q (S,r) to a tolerance.

    States in which the modes invert a point are excluded.
    """
    r, many, rng = points.modes.shape[1], len(points.kinds), np.random.default_rng(SEED)
    work, g, hessian = scratch(points), np.zeros(r), np.zeros((r, r))
    few = select_points(points, np.arange(0, many, FEW), np.full(-(-many // FEW), float(FEW)))
    few_work = scratch(few)
    mode_gradients, stresses = points.modes.reshape(many, 9, r), work.f.reshape(many, 9)
    mixed = np.zeros((ROWS, many), dtype=np.float32)
    for q in rng.permutation(states)[:STATES]:
        # whiten the forces with the factor of the reduced tangent
        if not (forces(points, q, work, g) < np.inf and tangent(few, q, few_work, hessian)):
            continue
        values, vectors = np.linalg.eigh(hessian)
        values = np.maximum(values, 1e-3 * float(np.median(values)))
        rows = (vectors / np.sqrt(values)).T @ np.einsum("pka,pk->ap", mode_gradients, stresses)
        goal = rows.sum(axis=1)
        size = float(goal @ goal)
        if not size > 0.0:
            continue
        # sparse sign embedding of the rows
        for row in np.concatenate([rows, GOAL * (goal @ rows)[None] / np.sqrt(size)]) / np.sqrt(SIGNS * size):
            for k in rng.integers(ROWS, size=SIGNS):
                mixed[k] += row if rng.random() < 0.5 else -row
    return nonnegative(np.ascontiguousarray(mixed.T), mixed.sum(axis=1, dtype=np.float64), tolerance, most, report)


def nonnegative(
    columns: np.ndarray, goal: np.ndarray, tolerance: float, most: int, report: Report = unheard
) -> tuple[np.ndarray, np.ndarray]:
    """Indices of columns and coefficients x > 0 with |sum_k x_k column_k - goal| <= `tolerance` |goal|.

    Active-set non-negative least squares (Lawson, Hanson 1974), with the Gram matrix of the active columns.

    columns  (P,n), one in each row
    goal     (n,)
    most     largest number of columns
    """
    size = np.sqrt(np.maximum(np.einsum("pn,pn->p", columns, columns, dtype=np.float64), 1e-300))
    whole, x = float(np.linalg.norm(goal)), np.zeros(0)
    kept: list[int] = []
    active, gram, right = np.zeros((0, len(goal))), np.zeros((0, 0)), np.zeros(0)
    for _ in range(4 * most):
        residual = goal - x @ active
        error = float(np.linalg.norm(residual))
        report(min(1.0, float(np.log(max(error / whole, 1e-300)) / np.log(tolerance))))
        if error <= tolerance * whole or len(kept) >= most:
            break
        # add the column with the largest correlation with the residual
        correlation = columns @ (residual / error).astype(columns.dtype) / size
        correlation[kept] = -np.inf
        best = int(np.argmax(correlation))
        if not correlation[best] > 1e-6:
            break
        column = columns[best].astype(np.float64)
        across = active @ column
        gram = np.block([[gram, across[:, None]], [across[None], column @ column]])
        active, right = np.vstack([active, column]), np.append(right, column @ goal)
        kept, x = [*kept, best], np.append(x, 0.0)
        # least squares of the active columns; remove those whose coefficient reaches 0 on the line to the solution
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
            kept, x, active = [k for k, s in zip(kept, stay, strict=True) if s], x[stay], active[stay]
            gram, right = gram[np.ix_(stay, stay)], right[stay]
    return np.array(kept, dtype=np.int64), x


def fit_gamma(w: np.ndarray, pull: np.ndarray, weight: np.ndarray) -> tuple[float, float]:
    """w0 and m of gamma with the lowest mean of |gamma w - pull| weight, by grid search.

    w       [1] (S,) size of the load on the residual compliance
    pull    [1] (S,) its displacement in the full solutions
    weight  [1] (S,)
    """
    best, parameters = np.inf, (1.0, 1.0)
    low, high = np.log(w.min() / 10.0), np.log(w.max())
    for scale in np.exp(np.linspace(low, high, 60)):
        for power in np.linspace(0.0, 2.0, 81):
            guess = np.array([gamma(x * x, scale, power, np.inf)[0] for x in w]) * w
            error = float(np.mean(np.abs(guess - pull) * weight))
            if error < best:
                best, parameters = error, (float(scale), float(power))
    return parameters


def _place(law: Material) -> int:
    """Place of a law, see `hyperelastic.place_of`. ValueError: a law for small strains, or a mixed element, whose
    energy is not a sum over its points."""
    name = law.name
    if law.small:
        raise ValueError(f"material law {name!r}: it is for small strains, but a sampled body has large rotations")
    if law.mixed:
        raise ValueError(
            f"material law {name!r} with the mixed element: expected the plain element, as the energy of a sampled "
            "body is a sum over points. The plain element is valid up to a Poisson's ratio of about 0.45"
        )
    return place_of(law.law, name)
