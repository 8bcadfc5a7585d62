"""The convex solver of stick and slip, compared with its dual, brute force and the Cattaneo-Mindlin closed form."""

import numpy as np
import pytest
from pytest import approx
from scipy.optimize import minimize
from theory.mindlin import presliding, presliding_stiffness, stick_radius

from palpate.physics.fingertip.stick_slip import Blocks, node_slip, solve_band, stick_slip, workspace


def solve(matrix, force, limit, start=None, tolerance=1e-10, most=200):
    """The solver on a dense matrix (2N, 2N)."""
    n = len(limit)
    blocks = np.ascontiguousarray(matrix.reshape(n, 2, n, 2).transpose(0, 2, 1, 3)).reshape(-1, 2, 2)
    rows = np.arange(n + 1) * n
    columns = np.tile(np.arange(n), n)
    slip = np.zeros((n, 2)) if start is None else start.copy()
    plate = np.zeros((n, 2))
    whole = Blocks(rows, columns, np.arange(n) * (n + 1), blocks, n - 1)
    rounds, residual = stick_slip(whole, force, limit, slip, plate, workspace(n, n - 1), tolerance, most)
    return slip, plate, rounds, residual


def problem(seed, n=12, spread=2.0):
    random = np.random.default_rng(seed)
    root = random.normal(size=(2 * n, 2 * n))
    matrix = root @ root.T / n + 0.05 * np.eye(2 * n)
    return matrix, spread * random.normal(size=(n, 2)), random.uniform(0, 2, n) * (random.uniform(size=n) > 0.2)


def dual(matrix, force, limit, turns=20000):
    """min 1/2 q C q - q C r over discs, by accelerated projected gradient."""
    c = np.linalg.inv(matrix)
    gap = c @ force.ravel()
    length = 1 / np.linalg.eigvalsh(c)[-1]
    q = y = np.zeros_like(force)
    t = 1.0
    for _ in range(turns):
        new = y - length * (c @ y.ravel() - gap).reshape(-1, 2)
        size = np.linalg.norm(new, axis=1)
        new *= np.minimum(1, limit / np.where(size > 0, size, 1))[:, None]
        if ((y - new) * (new - q)).sum() > 0:
            t = 1.0
        faster = (1 + np.sqrt(1 + 4 * t * t)) / 2
        y = new + (t - 1) / faster * (new - q)
        q, t = new, faster
    return q


@pytest.mark.parametrize("seed", range(6))
def test_the_forces_solve_the_dual_problem(seed):
    matrix, force, limit = problem(seed)
    _, plate, _, residual = solve(matrix, force, limit)
    assert residual < 1e-9
    assert plate == approx(dual(matrix, force, limit), abs=1e-6)


@pytest.mark.parametrize("seed", range(20))
def test_every_node_satisfies_the_friction_law(seed):
    matrix, force, limit = problem(seed, n=25)
    slip, plate, _, _ = solve(matrix, force, limit)
    assert plate == approx(force - (matrix @ slip.ravel()).reshape(-1, 2), abs=1e-9)
    size = np.linalg.norm(plate, axis=1)
    assert np.all(size <= limit * (1 + 1e-8) + 1e-9)
    moves = np.linalg.norm(slip, axis=1) > 0
    assert size[moves] == approx(limit[moves], abs=1e-8)
    # Checked along the slip, as far as the force is significant: the direction of a tiny force is rounding error.
    assert np.all((plate * slip).sum(axis=1) >= -1e-8 * np.linalg.norm(slip, axis=1))


def test_the_solution_does_not_depend_on_the_start():
    matrix, force, limit = problem(3)
    cold = solve(matrix, force, limit)[0]
    for seed in range(5):
        start = np.random.default_rng(seed).normal(size=cold.shape) * 10
        assert solve(matrix, force, limit, start)[0] == approx(cold, abs=1e-8)


@pytest.mark.parametrize("seed", range(5))
def test_one_node_agrees_with_a_general_minimiser(seed):
    random = np.random.default_rng(seed)
    root = random.normal(size=(2, 2))
    a = root @ root.T + 0.1 * np.eye(2)
    r, limit = random.normal(size=2) * 3, 0.5
    slip = np.array(node_slip(a[0, 0], a[0, 1], a[1, 1], r[0], r[1], limit))

    def energy(w):
        return 0.5 * w @ a @ w - r @ w + limit * np.hypot(*w)

    best = min((minimize(energy, s, method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-14}) for s in (r, slip)),
               key=lambda m: m.fun)  # fmt: skip
    assert slip == approx(best.x, abs=1e-6)


def test_without_friction_the_solution_is_linear_without_force():
    matrix, force, _ = problem(1)
    slip, plate, rounds, _ = solve(matrix, force, np.zeros(len(force)))
    assert slip.ravel() == approx(np.linalg.solve(matrix, force.ravel()), rel=1e-8)
    assert plate == approx(0.0, abs=1e-9) and rounds < 10


def test_nothing_moves_below_the_limit():
    matrix, force, limit = problem(2)
    slip, plate, rounds, residual = solve(matrix, force, limit + 100)
    assert not slip.any() and (plate == force).all() and rounds == 1 and residual <= 0


def test_the_number_of_iterations_is_bounded_for_any_start():
    matrix, force, limit = problem(4, n=40, spread=1e6)
    *_, rounds, residual = solve(matrix, force, limit, np.full((40, 2), 1e9), most=30)
    assert rounds <= 30 and np.isfinite(residual)


def test_the_band_solver_solves_linear_systems():
    random = np.random.default_rng(0)
    n, width = 30, 4
    full = np.diag(random.uniform(10, 20, n))
    for k in range(1, width + 1):
        side = random.normal(size=n - k)
        full += np.diag(side, k) + np.diag(side, -k)
    upper = np.zeros((n, width + 2))
    for k in range(width + 1):
        upper[: n - k, k] = np.diag(full, k)
    right = random.normal(size=n)
    answer = right.copy()
    solve_band(upper, answer, n, width)
    assert answer == approx(np.linalg.solve(full, right))


def test_mindlins_formula_has_its_known_values():
    given = dict(normal_force=0.6, friction=0.7, radius=5e-3, shear_modulus=3.4e4 / 2.96, poisson=0.48)
    assert presliding(0.5 * 0.42, **given) == approx(0.771e-3, abs=5e-7)
    assert presliding(0.42, **given) == approx(2.084e-3, abs=5e-7)
    assert presliding(0.42, **given) / 2e-3 == approx(1.0, abs=0.05)
    slope = 1e-9 / presliding(1e-9, **given)
    assert slope == approx(presliding_stiffness(5e-3, 3.4e4 / 2.96, 0.48), rel=1e-6)
    assert presliding_stiffness(5e-3, 3.4e4 / 2.96, 0.48) == approx(302, abs=1)
    with pytest.raises(ValueError, match=r"0 \.\.\. mu F_n"):
        presliding(0.5, **given)


def half_space(points, pitch, shear_modulus, poisson):
    """Tangential compliance of a half-space on a square grid, after Cerruti (Johnson, eq. 3.75)."""
    away = points[:, None] - points[None]
    distance = np.linalg.norm(away, axis=2)
    np.fill_diagonal(distance, 1.0)
    direct = np.eye(2) * 2 * (1 - poisson) / distance[..., None, None]
    turned = 2 * poisson * away[..., :, None] * away[..., None, :] / distance[..., None, None] ** 3
    c = direct + turned
    mean = 4 * np.log(1 + np.sqrt(2)) / pitch  # mean of 1/r over a cell, from its centre
    c[np.arange(len(points)), np.arange(len(points))] = np.eye(2) * (2 - poisson) * mean
    return c.transpose(0, 2, 1, 3).reshape(2 * len(points), -1) / (4 * np.pi * shear_modulus)


def test_on_a_half_space_the_solver_agrees_with_cattaneo_and_mindlin():
    radius, normal, friction, shear, poisson = 5e-3, 0.6, 0.7, 1.15e4, 0.3
    pitch = radius / 7.5
    grid = np.arange(-7, 8) * pitch
    points = np.stack(np.meshgrid(grid, grid, indexing="ij"), -1).reshape(-1, 2)
    points = points[np.hypot(*points.T) < radius]
    pressure = np.sqrt(1 - (points**2).sum(axis=1) / radius**2)
    limit = friction * normal * pressure / pressure.sum()
    stiffness = np.linalg.inv(half_space(points, pitch, shear, poisson))
    stiffness = (stiffness + stiffness.T) / 2
    for shift in (0.3e-3, 0.8e-3, 1.3e-3):
        force = (stiffness @ np.tile([shift, 0.0], len(points))).reshape(-1, 2)
        slip, plate, _, residual = solve(stiffness, force, limit)
        total = plate[:, 0].sum()
        assert residual < 1e-9
        assert presliding(total, normal, friction, radius, shear, poisson) == approx(shift, rel=0.05)
        sticks = np.hypot(*slip.T) == 0
        assert np.sqrt(sticks.sum() / np.pi) * pitch == approx(
            stick_radius(total, normal, friction, radius), abs=0.6 * pitch
        )
