"""The mathematics of the quadratic tetrahedron, its laws and the sparse factor."""

import numba
import numpy as np
import pytest
from pytest import approx
from scipy.linalg import expm, logm

from palpate.models.fe import (
    Settings,
    Solver,
    TetMesh,
    box,
    hencky,
    linear,
    mooney_rivlin,
    neo_hooke,
    quadratic,
)
from palpate.models.fe.element.elements import POINTS, gradients, integrate, shape
from palpate.models.fe.element.mesh import bricks, grid
from palpate.models.fe.sparse.cholesky import Cholesky, NotPositive
from palpate.models.fe.sparse.tangent import pattern
from palpate.physics.materials.compiled import compile_law, law_signature
from palpate.physics.materials.hencky import log_stretch
from palpate.physics.materials.hyperelastic import Material, moduli
from palpate.physics.materials.invariants import shape_invariants, shape_stress

DERMIS = (2430.0, 5420.0, 239000.0, 262000.0, 74700.0, 13.3e-6)
FINITE = {
    "neo-Hooke": neo_hooke(1e4, 0.3),
    "neo-Hooke, mixed": neo_hooke(1e4, 0.49),
    "Hencky": hencky(1e4, 0.3),
    "Hencky, mixed": hencky(1e4, 0.49),
    "Mooney-Rivlin": mooney_rivlin(*DERMIS),
}
LAWS = FINITE | {"linear": linear(1e4, 0.3), "linear, mixed": linear(1e4, 0.49)}


def skewed(cells=2):
    """A box whose inner nodes are moved about."""
    x = np.linspace(0.0, 1.0, cells + 1)
    points, hexahedra = grid(x, x, x)
    inner = ((points > 1e-9) & (points < 1 - 1e-9)).all(axis=1)
    points[inner] += 0.1 / cells * np.random.default_rng(1).standard_normal((inner.sum(), 3))
    return quadratic(points, bricks(points, hexahedra))


def evaluate(mesh, material, u, tangent=True):
    sparsity = pattern(len(mesh.points), mesh.elements)
    slope, det = gradients(mesh.points, mesh.elements)
    force, data = np.zeros_like(u), np.zeros((len(sparsity.indices), 3, 3))
    law = compile_law(material.law, law_signature())
    energy, bad = integrate(
        law, slope, det / 24.0, mesh.elements, u, np.array(material.parameters), material.mixed, material.small,
        tangent, sparsity.where(mesh.elements), force, data,
    )  # fmt: skip
    return energy, force, sparsity.matrix(data), bad


@pytest.mark.parametrize("name", LAWS)
def test_the_force_is_the_derivative_of_the_energy_and_the_tangent_that_of_the_force(name):
    mesh, rng = skewed(), np.random.default_rng(2)
    u = 0.02 * rng.standard_normal(mesh.points.shape)
    v = rng.standard_normal(u.shape)
    _, force, tangent, bad = evaluate(mesh, LAWS[name], u)
    h = 1e-6
    above, below = (evaluate(mesh, LAWS[name], u + s * h * v, False) for s in (1, -1))
    assert bad == -1
    assert (above[0] - below[0]) / (2 * h) == approx(float(np.sum(force * v)), rel=1e-6)
    change = (above[1] - below[1]) / (2 * h)
    assert tangent @ v.ravel() == approx(change.ravel(), abs=1e-6 * np.abs(change).max())
    assert abs(tangent - tangent.T).max() < 1e-12 * abs(tangent).max()


@pytest.mark.parametrize("name", FINITE)
def test_a_rotation_makes_no_stress(name):
    mesh = skewed()
    angle = 1.1
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    u = mesh.points @ turn.T - mesh.points + (0.3, -0.2, 0.1)
    energy, force, _, _ = evaluate(mesh, FINITE[name], u)
    _, scale, _, _ = evaluate(mesh, FINITE[name], 0.01 * mesh.points * (1, 0, 0))
    assert np.abs(force).max() < 1e-9 * np.abs(scale).max()
    assert abs(energy) < 1e-9


@pytest.mark.parametrize("name", LAWS)
def test_patch_a_linear_displacement_of_the_boundary_is_carried_inside_exactly(name):
    mesh = skewed()
    surface = np.zeros(len(mesh.points), dtype=bool)
    surface[mesh.faces] = True
    size = 1e-3 if LAWS[name].small else 0.1
    strain = size * np.array([[0.5, 0.3, 0.0], [-0.2, -0.4, 0.1], [0.0, 0.2, 0.3]])
    exact = mesh.points @ strain.T
    body = Solver(mesh, {0: LAWS[name]}, np.repeat(surface[:, None], 3, axis=1), lambda load: load * exact,
                  settings=Settings(tolerance=1e-11, step=1.0))  # fmt: skip
    body.advance(1.0)
    assert body.displacement == approx(exact, abs=1e-9 * size)


@pytest.mark.parametrize(
    ("stretch", "stress", "volume"),
    [(0.95, -4772, None), (0.9, -21410, 0.955), (0.8, -91040, 0.798), (1.1, 14910, None)],
)
def test_uniaxial_stress_of_the_dermis(stretch, stress, volume):
    mesh = box((1.0, 1.0, 1.0), (1, 1, 1))
    x, y, z = mesh.points.T
    fixed = np.stack([x < 1e-9, y < 1e-9, (z < 1e-9) | (z > 1 - 1e-9)], axis=1)
    top = z > 1 - 1e-9
    body = Solver(mesh, {0: mooney_rivlin(*DERMIS)}, fixed, lambda load: load * np.outer(top, (0, 0, stretch - 1.0)))
    body.advance(1.0)
    assert body.reaction[top, 2].sum() == approx(stress, rel=1e-3)
    if volume:
        width = 1.0 + body.displacement[x > 1 - 1e-9, 0].mean()
        assert stretch * width**2 == approx(volume, abs=1e-3)


def test_a_custom_law_is_one_function():
    @numba.njit
    def gent(F, J, p, P, A):
        shear, limit, bulk = p
        _, i, _ = shape_invariants(F)
        left = 1.0 - i / limit
        shape_stress(F, 0.5 * shear / left, 0.0, 0.5 * shear / (limit * left**2), 0.0, 0.0, P, A)
        return -0.5 * shear * limit * np.log(left), 0.5 * bulk * (J - 1) ** 2, bulk * (J - 1), bulk

    mesh, rng = skewed(1), np.random.default_rng(5)
    u, v, h = 0.02 * rng.standard_normal(mesh.points.shape), rng.standard_normal(mesh.points.shape), 1e-6
    own = Material(gent, (4e3, 2.0, 1e4))
    _, force, tangent, _ = evaluate(mesh, own, u)
    above, below = (evaluate(mesh, own, u + s * h * v, False) for s in (1, -1))
    assert (above[0] - below[0]) / (2 * h) == approx(float(np.sum(force * v)), rel=1e-6)
    change = ((above[1] - below[1]) / (2 * h)).ravel()
    assert tangent @ v.ravel() == approx(change, abs=1e-6 * np.abs(change).max())
    far = evaluate(mesh, Material(gent, (4e3, 1e9, 1e4)), u)[1]
    near = evaluate(mesh, Material(neo_hooke(1.0, 0.3).law, (4e3, 1e4)), u)[1]
    assert far == approx(near, abs=1e-6 * np.abs(near).max())


def octant(cells):
    """An eighth of a hollow sphere, radii 1 and 2, with curved edges."""
    t = np.linspace(0.0, 1.0, cells + 1)
    points, hexahedra = grid(t, t, np.linspace(1.0, 2.0, cells + 1))
    flat = quadratic(points, bricks(points, hexahedra))
    a, b, r = flat.points.T
    # a point (a, b) of the unit square goes to the octant's plane triangle with one corner opened, then to the sphere
    s, q = a * (1 - b / 2), b * (1 - a / 2)
    corner = np.stack([s + 0 * a, q, np.maximum(1 - s - q, 0.0)], axis=1)
    place = r[:, None] * corner / np.linalg.norm(corner, axis=1)[:, None]
    return TetMesh(place, flat.elements), r


def lame(poisson, cells, material):
    """Displacement of the inner wall of a hollow sphere of 10 kPa under 1 Pa inside, times 1e4: found and exact."""
    from palpate.models.fe.element import faces as rule

    mesh, r = octant(cells)
    fixed = np.abs(mesh.points) < 1e-9
    inner = mesh.faces[(r[mesh.faces] < 1 + 1e-9).all(axis=1)]
    area = rule.areas(mesh.points, inner)
    value, _ = rule.shape(rule.POINTS)
    out = np.einsum("qa,fai->fqi", value, mesh.points[inner])
    out /= np.linalg.norm(out, axis=-1, keepdims=True)
    push = np.zeros_like(mesh.points)
    np.add.at(push, inner, np.einsum("qa,fq,fqi->fai", value, area, out))
    body = Solver(mesh, {0: material}, fixed, loads=lambda load: load * push, settings=Settings(step=1.0))
    body.advance(1.0)
    wall = r < 1 + 1e-9
    displacement = np.linalg.norm(body.displacement[wall], axis=1).mean() / 1e-4
    a3, b3 = 1.0, 8.0
    return displacement, a3 / (b3 - a3) * ((1 - 2 * poisson) + (1 + poisson) * b3 / 2.0)


@pytest.mark.parametrize("poisson", [0.3, 0.499, 0.49999])
def test_a_hollow_sphere_does_not_lock(poisson):
    errors = []
    for cells in (2, 4):
        computed, exact = lame(poisson, cells, linear(1e4, poisson))
        errors.append(abs(computed / exact - 1.0))
    assert errors[1] < 0.01
    assert errors[1] < errors[0] / 3.0  # second order at least: a fourth, less what the coarse mesh's luck takes


def test_the_factor_solves_as_a_dense_solver_does():
    mesh, rng = skewed(2), np.random.default_rng(3)
    u = np.zeros_like(mesh.points)
    _, _, tangent, _ = evaluate(mesh, neo_hooke(1.0, 0.3), u)
    sparsity = pattern(len(mesh.points), mesh.elements)
    data = tangent.data.copy()
    diagonal = sparsity.where(np.arange(len(mesh.points))[:, None])[:, 0, 0]
    data[diagonal] += 0.1 * np.eye(3)
    rhs = rng.standard_normal((3 * len(mesh.points), 4))
    dense = np.linalg.solve(sparsity.matrix(data).toarray(), rhs)
    for single, tolerance in ((False, 1e-11), (True, 1e-3)):
        factor = Cholesky(mesh.points, sparsity.indptr, sparsity.indices, single)
        factor.factor(data)
        assert factor.solve(rhs) == approx(dense, abs=tolerance * np.abs(dense).max())
        assert factor.solve(rhs[:, 0]) == approx(dense[:, 0], abs=tolerance * np.abs(dense).max())
    data[diagonal[7]] -= 100.0 * np.eye(3)
    with pytest.raises(NotPositive):
        factor.factor(data)


def test_the_logarithmic_strain_of_series_and_of_eigenvectors_is_one():
    """Random stretches and turns on both sides of where the series ends; the matrix logarithm is scipy's."""
    rng, C, N, E = np.random.default_rng(8), np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3))
    for size in np.geomspace(1e-4, 0.6, 60):
        turn, _ = np.linalg.qr(rng.standard_normal((3, 3)))
        F = np.sign(np.linalg.det(turn)) * turn @ expm(size * (lambda x: x + x.T)(rng.uniform(-0.5, 0.5, (3, 3))))
        log_stretch(F, C, N, E)
        assert approx(0.5 * logm(F.T @ F), abs=1e-9 * size) == E


def test_hencky_stress_alone_equals_that_computed_with_the_tangent():
    rng, law = np.random.default_rng(9), hencky(1e4, 0.3)
    for size in (1e-3, 0.05, 0.15, 0.4):
        F = np.eye(3) + size * rng.uniform(-1.0, 1.0, (3, 3))
        answers = []
        for wanted in (np.nan, 0.0):
            P, A = np.zeros((3, 3)), np.zeros((9, 9))
            A[0, 0] = wanted
            answers.append((law.law(F, float(np.linalg.det(F)), np.array(law.parameters), P, A), P))
        assert answers[0][0] == approx(answers[1][0], rel=1e-8)
        assert answers[0][1] == approx(answers[1][1], abs=1e-8 * np.abs(answers[1][1]).max())


def swelling(x, poisson):
    """A smooth field whose volume changes, and the body force that it needs."""
    mu, kappa = moduli(1e4, poisson)
    s, c = np.sin(2.0 * x), np.cos(2.0 * x)
    u = 1e-3 * np.stack([s[:, i] * c[:, (i + 1) % 3] for i in range(3)], axis=1)
    rise = -4e-3 * np.stack([s[:, i] * (c[:, (i + 1) % 3] + c[:, (i + 2) % 3]) for i in range(3)], axis=1)
    return u, 8.0 * mu * u - (kappa + mu / 3.0) * rise


def keeping(x, poisson):
    """One that keeps its volume."""
    mu, _ = moduli(1e4, poisson)
    u = 1e-3 * np.stack([np.sin(2.0 * x[:, (i + 1) % 3]) * np.cos(2.0 * x[:, (i + 2) % 3]) for i in range(3)], axis=1)
    return u, 8.0 * mu * u


@pytest.mark.parametrize(
    ("poisson", "field"), [(0.3, swelling), (0.4496, swelling), (0.469, swelling), (0.47, keeping), (0.4999, keeping)]
)
def test_the_element_that_a_law_takes_is_of_third_order_in_smooth_fields(poisson, field):
    """With mixed elements the dermis, 0.4496, has the order 1.4 only."""
    errors = []
    for cells in (2, 4):
        mesh = box((1.0, 1.0, 1.0), (cells,) * 3)
        value, natural = shape(POINTS)
        place = np.einsum("na,eai->eni", value, mesh.points[mesh.elements])
        weight = np.linalg.det(np.einsum("eai,nak->enik", mesh.points[mesh.elements], natural)) / 24.0
        goal, load = field(mesh.points, poisson)[0], np.zeros_like(mesh.points)
        force = field(place.reshape(-1, 3), poisson)[1].reshape(place.shape)
        np.add.at(load, mesh.elements, np.einsum("en,na,eni->eai", weight, value, force))
        fixed = np.zeros(mesh.points.shape, dtype=bool)
        fixed[np.unique(mesh.faces)] = True
        body = Solver(
            mesh, {0: linear(1e4, poisson)}, fixed, lambda t, goal=goal: t * goal, lambda t, load=load: t * load,
            settings=Settings(tolerance=1e-9, step=1.0, largest=1.0),
        )  # fmt: skip
        body.advance(1.0)
        displacement = np.einsum("na,eai->eni", value, body.displacement[mesh.elements])
        exact = field(place.reshape(-1, 3), poisson)[0].reshape(place.shape)
        errors.append(np.sqrt((weight[..., None] * (displacement - exact) ** 2).sum()))
    assert np.log2(errors[0] / errors[1]) > 2.7


def test_one_rule_chooses_the_element_of_a_law():
    for law in (neo_hooke, hencky, linear):
        assert [law(1e4, ratio).mixed for ratio in (0.3, 0.45, 0.4699, 0.47, 0.4999)] == [
            False,
            False,
            False,
            True,
            True,
        ]
    assert not mooney_rivlin(*DERMIS).mixed  # 0.4496
    assert mooney_rivlin(*DERMIS[:5], 1.3e-6).mixed
