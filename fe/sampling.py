"""A sampled body from full solutions: modes by proper orthogonal decomposition, elements by non-negative weights.

Modes. The inner product of the decomposition is the mean tangent of loaded states, each over the energy at work there,
so that an error counts as what it changes in the force. The modes that come out are made orthonormal in K0, the
stiffness at rest.

Elements. At snapshot s the modes' generalised forces are sums over all elements, g_s = sum_e g_es,
g_es = Phi_e'f_e(Phi q_s). Weights w >= 0, most of them zero, with sum_e w_e g_es near g_s for all s: the non-negative
least squares of C. L. Lawson, R. J. Hanson, Solving Least Squares Problems (1974), stopped as soon as the residual is
small. Rows are multiplied by the inverse factor of the reduced tangent there, so that the residual is an error of q in
energy; one more row for each snapshot is the error of the indentation under its load, counted `GOAL` times.
C. Farhat et al., Int. J. Numer. Methods Eng. 98 (2014) 625-662.

The weights change the tangent at rest, Phi'K0 Phi = 1, a little, to M. The modes of the elements are therefore taken as
Phi_e M^(-1/2): at rest the sampled body is the full one in these modes, exactly.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.sparse import csr_array

from palpate.fe.elements import gradients
from palpate.fe.materials import Material
from palpate.fe.reducible import Reducible
from palpate.fe.snapshots import Pressed
from palpate.physics.sampled import gamma
from palpate.physics.sampled_energy import LAWS, Elements, forces, scratch, tangent

SAMPLING = 1e-2
"""Residual of the weights, relative to the forces; slabs want 3e-3."""
GOAL = 4.0
"""How much more the indentation counts than the rest."""


def inner(body: Reducible, pressed: list[Pressed]) -> csr_array:
    """Inner product (3N,3N) of the decomposition: the mean tangent of loaded states, each over the energy at work."""
    mean = None
    for own in pressed:
        for u in own.solutions[[len(own.solutions) // 2, -1]]:
            matrix = body.pattern.matrix(body.tangent(u)).tocsr()
            part = matrix / float(u.ravel() @ (matrix @ u.ravel()))
            mean = part if mean is None else mean + part
    return mean


def modes(body: Reducible, pressed: list[Pressed], count: int, product: csr_array | None = None) -> np.ndarray:
    """Modes (N,3,r) of all snapshots, each counted alike, orthonormal in the stiffness at rest; `product` is `inner`
    where it is known."""
    product = inner(body, pressed) if product is None else product
    every = np.concatenate([own.solutions for own in pressed]).reshape(-1, body.fixed.size)
    gram = every @ (product @ every.T)
    size = 1.0 / np.sqrt(np.diag(gram))
    values, vectors = np.linalg.eigh(gram * size[:, None] * size)
    kept = vectors[:, ::-1][:, :count] / np.sqrt(np.maximum(values[::-1][:count], 1e-12 * values[-1]))
    found = (every.T * size) @ kept
    rest = body.pattern.matrix(body.tangent(np.zeros_like(body.mesh.points))).tocsr()
    lower = np.linalg.cholesky(found.T @ (rest @ found))
    return np.ascontiguousarray(solve_triangular(lower, found.T, lower=True).T).reshape(-1, 3, found.shape[1])


def elements_of(body: Reducible, phi: np.ndarray, limit: float) -> Elements:
    """All elements of a body with its modes (N,3,r), each with weight 1."""
    mesh, many, r = body.mesh, len(body.mesh.elements), phi.shape[2]
    slope, det = gradients(mesh.points, mesh.elements)
    kinds, constants = np.zeros(many, dtype=np.int64), np.zeros((many, 6))
    mixed = np.zeros(many, dtype=np.bool_)
    for region, law in body.materials(1.0).items():
        own = mesh.region == region
        kinds[own], mixed[own] = _number(law), law.mixed
        constants[own, : len(law.parameters)] = law.parameters
    springs = np.zeros((r, r))
    for bed in body.springs:
        pull = np.zeros_like(phi)
        for k in range(r):
            bed.add(np.ascontiguousarray(phi[:, :, k]), 0.0, False, pull[:, :, k], np.zeros((0, 3, 3)))
        springs += np.einsum("nia,nib->ab", phi, pull)
    own_modes = np.ascontiguousarray(phi[mesh.elements].reshape(30 * many, r))
    return Elements(own_modes, slope, det / 24.0, kinds, constants, mixed, springs, limit)


def chosen(elements: Elements, which: np.ndarray, weights: np.ndarray) -> Elements:
    """These elements with weights of their own."""
    r = elements.modes.shape[1]
    return elements._replace(
        modes=np.ascontiguousarray(elements.modes.reshape(-1, 30, r)[which].reshape(-1, r)),
        slopes=np.ascontiguousarray(elements.slopes[which]),
        weights=elements.weights[which] * weights[:, None],
        kinds=elements.kinds[which],
        constants=np.ascontiguousarray(elements.constants[which]),
        mixed=elements.mixed[which],
    )


def at_rest(elements: Elements) -> Elements:
    """The same with modes such that the tangent at rest is the identity."""
    r = elements.modes.shape[1]
    hessian = np.zeros((r, r))
    tangent(elements, np.zeros(r), scratch(elements), hessian)
    values, vectors = np.linalg.eigh(hessian)
    root = vectors @ np.diag(values**-0.5) @ vectors.T
    return elements._replace(
        modes=np.ascontiguousarray(elements.modes @ root), springs=np.ascontiguousarray(root @ elements.springs @ root)
    )


def shares(elements: Elements, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Generalised forces (r,E) of each element at q, and the reduced tangent (r,r) there.

    ArithmeticError: an element is inverted there.
    """
    r, many = len(q), len(elements.kinds)
    work, g, hessian = scratch(elements), np.zeros(r), np.zeros((r, r))
    if not (forces(elements, q, work, g) < np.inf and tangent(elements, q, work, hessian)):
        raise ArithmeticError("an element is inverted")
    return np.einsum("eka,ek->ae", elements.modes.reshape(many, 30, r), work.f.reshape(many, 30)), hessian


def sample(
    elements: Elements,
    states: list[np.ndarray],
    tolerance: float = SAMPLING,
    most: int = 400,
    report: Callable[[float], None] | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Elements and their weights > 0 that give the generalised forces at these states to a tolerance.

    states  q (r,) of each; their residual is the mean over the states
    """
    many = len(elements.kinds)
    gram, right, total = np.zeros((many, many)), np.zeros(many), 0.0
    for q in states:
        own, hessian = shares(elements, q)
        values, vectors = np.linalg.eigh(hessian)
        values = np.maximum(values, 1e-3 * float(np.median(values)))
        rows = (vectors.T @ own) / np.sqrt(values)[:, None]
        goal = rows.sum(axis=1)
        size = float(goal @ goal)
        if not size > 0.0:
            continue
        every = (np.concatenate([rows, GOAL * (goal @ rows)[None] / np.sqrt(size)]) / np.sqrt(size)).astype(np.float32)
        goal = every.sum(axis=1, dtype=np.float64)
        gram += every.T @ every
        right += every.T @ goal
        total += float(goal @ goal)
    return nonnegative(gram, right, total, tolerance, most, report)


def nonnegative(
    gram: np.ndarray,
    right: np.ndarray,
    total: float,
    tolerance: float,
    most: int,
    report: Callable[[float], None] | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Columns and coefficients > 0 of a least-squares problem A x = b, x >= 0, from A'A, A'b and b'b, as few as reach
    |A x - b| <= tolerance |b|; at most `most` columns."""
    kept: list[int] = []
    x = np.zeros(0)
    for _ in range(4 * most):
        lean = right - (gram[:, kept] @ x if kept else 0.0)
        missed = max(total - float(right[kept] @ x) - float(lean[kept] @ x), 0.0) if kept else total
        if report is not None:
            report(min(1.0, np.log(total / max(missed, 1e-300)) / np.log(1.0 / tolerance**2)))
        if missed <= tolerance**2 * total or len(kept) >= most:
            break
        lean = lean / np.sqrt(np.maximum(np.diag(gram), 1e-300))
        lean[kept] = -np.inf
        best = int(np.argmax(lean))
        if not lean[best] > 1e-10:
            break
        kept.append(best)
        x = np.append(x, 0.0)
        while True:
            block = gram[np.ix_(kept, kept)]
            block = block + 1e-12 * np.trace(block) / len(kept) * np.eye(len(kept))
            found = cho_solve(cho_factor(block), right[kept])
            if (found > 0.0).all():
                x = found
                break
            down = found <= 0.0
            step = float(np.min(x[down] / np.maximum(x[down] - found[down], 1e-300)))
            x = x + step * (found - x)
            stay = ~(down & (x <= 1e-12 * x.max(initial=1e-300)))
            if stay.all():
                stay[int(np.argmin(x))] = False
            kept, x = [k for k, s in zip(kept, stay, strict=True) if s], x[stay]
    return np.array(kept, dtype=np.int64), x


def bent(w: np.ndarray, pull: np.ndarray, weight: np.ndarray) -> tuple[float, float]:
    """w0 and m of gamma for which gamma w is nearest to these in the mean, the best of a grid.

    w       [1] (S,) sizes of the load on what the modes miss
    pull    [1] (S,) how far it moves there
    weight  [1] (S,) what a miss counts
    """
    best, found = np.inf, (1.0, 1.0)
    low, high = np.log(w.min() / 10.0), np.log(w.max())
    for scale in np.exp(np.linspace(low, high, 60)):
        for power in np.linspace(0.0, 2.0, 81):
            guess = np.array([gamma(x * x, scale, power, np.inf)[0] for x in w]) * w
            miss = float(np.mean(np.abs(guess - pull) * weight))
            if miss < best:
                best, found = miss, (float(scale), float(power))
    return found


def _number(law: Material) -> int:
    name = getattr(law.law, "__name__", "")
    if name not in LAWS or law.small:
        raise ValueError(f"material law {name!r}: a sampled body knows {', '.join(LAWS)}")
    return LAWS.index(name)
