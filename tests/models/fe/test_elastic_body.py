"""The elastic body: energy, forces, tangent and compliance belong to one another."""

import numpy as np
import pytest
from pytest import approx
from scipy.sparse.linalg import spsolve

from palpate.models.fe import MeshError, Solver, box, hencky, neo_hooke
from palpate.models.fe.contact.protocol import ElasticFoundation
from palpate.models.fe.solve.body import ElasticBody, hats

SIZE = (0.03, 0.02, 0.01)


def made(mixed=False):
    """Two materials side by side on springs, and a displacement of a few per cent."""
    mesh = box(SIZE, (2, 2, 1))
    mesh.region[mesh.points[mesh.elements].mean(axis=1)[:, 0] > 0.015] = 7
    laws = {0: neo_hooke(1e4, 0.48 if mixed else 0.3), 7: hencky(3e4, 0.3)}
    under = mesh.faces[(mesh.points[mesh.faces][:, :, 2] < 1e-9).all(axis=1)]
    u = 2e-4 * np.random.default_rng(3).standard_normal(mesh.points.shape)
    return mesh, laws, ElasticFoundation(under, 4e5), u


@pytest.mark.parametrize("mixed", [False, True])
def test_forces_are_the_derivative_of_the_energy_and_the_tangent_that_of_the_forces(mixed):
    mesh, laws, bed, u = made(mixed)
    body, way = ElasticBody(mesh, laws, [bed]), np.random.default_rng(4).standard_normal(mesh.points.shape)
    h = 1e-8
    (up, above), (down, below) = (body.balance(u + s * h * way) for s in (1.0, -1.0))
    assert (up - down) / (2 * h) == approx(np.sum(body.forces(u) * way), rel=1e-6)
    pulled = (body.pattern.matrix(body.tangent(u)) @ way.ravel()).reshape(-1, 3)
    assert (above - below) / (2 * h) == approx(pulled, abs=1e-6 * np.abs(pulled).max())


def test_the_load_steps_and_the_reduction_see_the_same_body():
    """In the solver's equilibrium the forces of the body balance the load."""
    mesh, laws, bed, _ = made()
    fixed = np.zeros(mesh.points.shape, dtype=bool)
    push = np.zeros_like(fixed, dtype=float)
    push[np.argmax(mesh.points.sum(axis=1))] = (0.01, -0.02, -0.05)
    solver = Solver(mesh, laws, fixed, loads=lambda load: load * push, contacts=[bed])
    solver.advance(1.0)
    rest = ElasticBody(mesh, laws, [ElasticFoundation(bed.faces, 4e5)]).forces(solver.displacement)
    assert rest == approx(push, abs=1e-6 * np.abs(push).max())


def test_compliance_is_that_of_the_tangent_at_rest():
    mesh, laws, bed, _ = made()
    body = ElasticBody(mesh, laws, [bed])
    top = mesh.faces[(mesh.points[mesh.faces][:, :, 2] > SIZE[2] - 1e-9).all(axis=1)]
    corners = np.unique(top[:, :3])
    own, free = hats(mesh, top, corners), np.zeros(mesh.points.shape, dtype=bool)
    assert own.sum(axis=0) == approx(1.0)
    compliance = body.compliance(free, own)
    load = np.random.default_rng(1).standard_normal((len(corners), 3))
    matrix = body.pattern.matrix(body.tangent(np.zeros_like(mesh.points))).tocsc()
    u = spsolve(matrix, (own @ load).ravel()).reshape(-1, 3)
    assert (compliance @ load.ravel()).reshape(-1, 3) == approx(own.T @ u, rel=1e-9, abs=1e-12 * np.abs(u).max())


def test_an_inverted_displacement_has_no_forces_and_an_inverted_mesh_is_refused():
    mesh, laws, bed, _ = made()
    assert ElasticBody(mesh, laws, [bed]).forces(-3.0 * mesh.points) is None
    mesh.points[mesh.elements[0, 4:]] = mesh.points[mesh.elements[0, 0]]
    with pytest.raises(MeshError, match="its Jacobian is negative"):
        ElasticBody(mesh, laws)


def test_the_digest_depends_on_every_part():
    mesh, laws, bed, _ = made()
    usual = ElasticBody(mesh, laws, [bed]).digest()
    assert ElasticBody(mesh, laws, [ElasticFoundation(bed.faces, 4e5)]).digest() == usual
    assert ElasticBody(mesh, laws, [ElasticFoundation(bed.faces, 4.1e5)]).digest() != usual
    assert ElasticBody(mesh, laws | {7: hencky(3.1e4, 0.3)}, [bed]).digest() != usual
    other = box((0.03, 0.02, 0.0101), (2, 2, 1))
    other.region[:] = mesh.region
    assert ElasticBody(other, laws, [bed]).digest() != usual
