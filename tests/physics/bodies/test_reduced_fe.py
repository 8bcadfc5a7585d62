"""The condensed organ compared with its full model, and as a body in contact."""

from functools import lru_cache

import numpy as np
import pytest
from pressing import CondensedBody
from pytest import approx
from scipy.sparse.linalg import spsolve

from palpate.launch.testing import FakeBus
from palpate.messages import Load
from palpate.models.fe.element.mesh import MeshError
from palpate.models.fe.meshing.organ import Capsule, Nodule, Organ, fill
from palpate.models.fe.reduce.reducible import of_organ
from palpate.nodes.base import SettingError
from palpate.nodes.base.surface import surface_mesh
from palpate.nodes.deformation import ReducedFE
from palpate.physics.archive import ArchiveError
from palpate.physics.bodies.condensed_basis import Basis
from palpate.physics.geometry.mesh import Mesh

UP = (0.0, 0.0, 1.0)
YOUNG = 2e4


@lru_cache
def organ():
    return of_organ(Organ(surface_mesh("sphere", 60)))


@lru_cache
def compliance():
    return organ().compliance()


@lru_cache
def basis():
    mesh = organ().surface
    return Basis(mesh.vertices, mesh.triangles, compliance().astype(np.float32))


def body(retardation=0.02, vertices=400):
    return CondensedBody(basis(), surface_mesh("sphere", vertices), YOUNG, retardation, 8e-3, 30e-3)


def patch(mesh, radius=8e-3):
    """Vertices around the top, with a smooth distribution of the force."""
    top = mesh.vertices[np.argmax(mesh.vertices[:, 2])]
    q = np.linalg.norm(mesh.vertices - top, axis=1) / radius
    nodes = np.flatnonzero(q < 1).astype(np.int32)
    share = (1 - q[nodes] ** 2) ** 2
    return nodes, share / share.sum(), tuple(top)


def test_the_volume_of_the_organ_equals_that_of_its_surface():
    mesh = surface_mesh("kidney", 300)
    corner = mesh.vertices[mesh.triangles]
    inside = np.einsum("ij,ij->", np.cross(corner[:, 0], corner[:, 1]), corner[:, 2]) / 6
    assert fill(mesh).corner_volumes.sum() == approx(inside)
    assert len(fill(mesh).faces) == len(mesh.triangles)


def test_condensation_is_exact_for_any_load():
    rng = np.random.default_rng(0)
    full, hats = organ(), organ().hats
    force = rng.standard_normal((hats.shape[1], 3))
    u = spsolve(
        full.elastic.pattern.matrix(full.elastic.tangent(np.zeros_like(full.mesh.points))).tocsc(),
        (hats @ force).ravel(),
    ).reshape(-1, 3)
    displacement = (basis().compliance @ force.ravel()).reshape(-1, 3)
    assert displacement == approx(hats.T @ u, abs=1e-5 * np.abs(u).max())


def test_a_light_touch_agrees_with_the_nonlinear_model():
    hats = organ().hats
    top = int(np.argmax(organ().surface.vertices[:, 2]))
    push = np.zeros((hats.shape[1], 3))
    push[top, 2] = -1e-3
    full = organ().solver(YOUNG, lambda load: load * (hats @ push))
    full.advance(1.0)
    depth = -(hats[:, top] @ full.displacement)[2]
    assert -(basis().compliance @ push.ravel())[3 * top + 2] / YOUNG == approx(depth, rel=2e-3)


def test_compliance_is_symmetric_and_positive():
    c = basis().compliance.astype(float)
    assert c == approx(c.T)
    assert np.linalg.eigvalsh(c).min() > 0


def test_a_nodule_stiffens_the_surface_above_it():
    soft = np.trace(compliance())
    hard = np.trace(of_organ(Organ(organ().surface, nodule=Nodule((0, 0, 8e-3), 8e-3, 20.0))).compliance())
    assert hard < 0.99 * soft


@pytest.mark.parametrize("surface", ["sphere", "plane"])
def test_a_capsule_is_a_layer_of_uniform_thickness(surface):
    mesh, thin = surface_mesh(surface, 200), 1e-3
    full = fill(mesh, capsule=Capsule(thin))
    area = 0.5 * np.linalg.norm(mesh.face_vectors, axis=1).sum()
    curved = 1 - thin / 0.021 if surface == "sphere" else 1.0
    assert full.corner_volumes[full.region == 2].sum() == approx(area * thin * curved, rel=0.02)
    assert full.corner_volumes.sum() == approx(fill(mesh).corner_volumes.sum())


def test_a_capsule_stiffens_the_organ_unless_it_has_the_same_modulus():
    mesh = organ().surface
    soft = np.trace(compliance())
    traces = [np.trace(of_organ(Organ(mesh, capsule=Capsule(1e-3, r))).compliance()) for r in (1.0, 10.0, 30.0)]
    assert traces[0] == approx(soft, rel=0.02)  # the layers of the mesh differ
    assert traces[2] < 0.9 * traces[1] < 0.8 * traces[0]


def test_a_nodule_outside_the_organ_is_an_error():
    with pytest.raises(MeshError, match="nodule: no element has its centre"):
        Organ(organ().surface, nodule=Nodule((0, 0, 0.1), 5e-3))


def test_a_capsule_that_does_not_fit_is_an_error():
    with pytest.raises(MeshError, match="does not fit under the surface at"):
        Organ(organ().surface, capsule=Capsule(0.03))
    with pytest.raises(MeshError, match="less than the slab"):
        Organ(surface_mesh("plane", 100), capsule=Capsule(0.05))


def test_the_inputs_of_a_basis_are_in_its_key_and_in_its_build_command(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    plain, given = ReducedFE(), {"nodule_depth": 0.01, "nodule_radius": 6e-3, "capsule_thickness": 5e-4}
    keys = {plain.key(), *(ReducedFE(**{k: v}).key() for k, v in given.items() if k != "nodule_depth")}
    assert len(keys) == 3
    assert ReducedFE(young=1e4, retardation=0.1).key() == plain.key()
    assert ReducedFE(capsule_ratio=3.0).key() == plain.key()  # without a capsule
    with pytest.raises(SettingError) as error:
        FakeBus(ReducedFE(**given))
    for text in (
        "--set nodule_depth=0.01",
        "--set nodule_radius=0.006",
        "--set capsule_thickness=0.0005",
    ):
        assert text in str(error.value)


def test_a_stored_basis_keeps_its_numbers_and_a_damaged_one_is_an_error(tmp_path):
    path = tmp_path / "basis.npz"
    basis().save(path)
    back = Basis.load(path)
    assert back.compliance == approx(basis().compliance, abs=2e-5 * float(np.abs(basis().compliance).max()))
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(ArchiveError, match="palpate build basis"):
        Basis.load(path)


def test_the_body_creeps_to_the_static_indentation_with_any_step():
    nodes, share, foot = patch(surface_mesh("sphere", 400))
    forces = -0.5 * np.outer(share, UP)
    indentations = []
    for dt, steps in ((1e-3, 400), (0.1, 20), (100.0, 1)):
        it = body()
        for _ in range(steps):
            law = it.step(nodes, forces, foot, UP, dt)
        indentations.append(law[2])
    assert indentations == approx([indentations[0]] * 3, rel=1e-3)
    assert indentations[0] > 0
    assert body(0.0).step(nodes, forces, foot, UP, 1e-3)[2] == approx(indentations[0], rel=1e-3)


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_the_terminal_law_predicts_the_next_step(sense):
    """Tangential forces either indent the patch and grow with the normal force, or lift it and are constant."""
    nodes, share, foot = patch(surface_mesh("sphere", 400))
    it, rng = body(), np.random.default_rng(1)
    aside = sense * np.array([0.3, -0.2, 0.0])
    law = None
    for force in rng.random(50):
        pull = np.outer(share, 0.4 * aside * (force if sense > 0.0 else 1.0) - force * np.array(UP))
        if law is not None:
            foretold = law[1] + law[0] * force
        law, before = it.step(nodes, pull, foot, UP, 1e-3), law
        if before is not None:
            assert law[2] == approx(foretold, rel=1e-6)


def test_random_loads_never_gain_work():
    it, rng = body(), np.random.default_rng(2)
    mesh = surface_mesh("sphere", 400)
    stored = work = 0.0
    c = basis().compliance.astype(float)
    u = np.zeros((len(mesh.vertices), 3))
    for _ in range(100):
        nodes = rng.choice(len(mesh.vertices), 12, replace=False).astype(np.int32)
        forces = rng.standard_normal((12, 3))
        dt = 10.0 ** rng.uniform(-4, 1)
        it.step(nodes, forces, tuple(mesh.vertices[nodes[0]]), UP, dt)
        moved = (c @ it.held.ravel()).reshape(-1, 3) / YOUNG
        new = np.einsum("pa,pai->pi", it.own.model.weights, moved[it.own.model.corners])
        work += float(np.sum(forces * (new[nodes] - u[nodes])))
        u = new
        stored = 0.5 * float(it.held.ravel() @ (c @ it.held.ravel())) / YOUNG
        assert work >= stored - 1e-9


def test_the_compliance_does_not_jump_while_the_foot_moves():
    it = body()
    angle = np.linspace(-0.5, 0.5, 401)
    compliances = []
    for a in angle:
        n = (float(np.sin(a)), 0.0, float(np.cos(a)))
        foot = tuple(0.021 * np.array(n))
        compliances.append(it.step(np.zeros(0, np.int32), np.zeros((0, 3)), foot, n, 1e-3)[0])
    compliances = np.array(compliances)
    assert np.abs(np.diff(compliances)).max() < 0.02 * compliances.mean()


def test_after_release_the_body_recovers_completely_without_overshoot():
    nodes, share, foot = patch(surface_mesh("sphere", 400))
    it = body()
    for _ in range(50):
        it.step(nodes, -np.outer(share, UP), foot, UP, 1e-3)
    depth = [it.step(nodes[:0], np.zeros((0, 3)), foot, UP, 1e-3)[2] for _ in range(1200)]
    assert (np.diff(depth) <= 0).all() and min(depth) >= 0.0
    assert depth[-1] == 0.0 and it.still
    _, moved = it.displaced(foot)
    assert (moved == 0.0).all()


def test_surfaces_without_a_volume_are_errors_with_a_position():
    mesh = organ().surface
    with pytest.raises(MeshError, match="not closed"):
        fill(Mesh(mesh.vertices, mesh.triangles[1:]))
    with pytest.raises(MeshError, match="normals point inwards"):
        fill(Mesh(mesh.vertices, mesh.triangles[:, ::-1]))
    with pytest.raises(MeshError, match="is its unit right"):
        Organ(Mesh(1e3 * mesh.vertices, mesh.triangles))
    with pytest.raises(MeshError, match="expected a positive"):
        Organ(mesh, bed=0.0)


def press(mesh, force):
    nodes, share, foot = patch(mesh)
    return Load(nodes=nodes, forces=-force * np.outer(share, UP), foot=foot, normal=UP)


def test_the_node_receives_loads_and_sends_a_law():
    node = ReducedFE(vertices=1000, model="linear")
    bus = FakeBus(node)
    mesh = node.mesh()
    first, *_, last = bus.publish(*[press(mesh, 1.0)] * 300)
    assert last.previous_indentation > first.previous_indentation > 0
    assert 1e-3 < last.previous_indentation < 10e-3
    assert last.exponent == 1.0 and last.stiffness > 0
    top = mesh.vertices[last.nodes[np.argmin(last.displacement[:, 2])]]
    assert np.linalg.norm(top - patch(mesh)[2]) < 4e-3
    bus.twice()
    same = bus.publish(press(mesh, 1.0))
    assert same[0].previous_indentation == same[1].previous_indentation
    soft = FakeBus(ReducedFE(vertices=1000, young=9.5e3, model="linear"))
    assert soft.publish(*[press(mesh, 1.0)] * 300)[-1].previous_indentation == approx(
        2 * last.previous_indentation, rel=1e-6
    )


def test_rotating_the_organ_rotates_its_response():
    level = ReducedFE(vertices=600, position=(0, 0, 0))
    turned = ReducedFE(vertices=600, position=(0.01, 0.02, 0.03), rotation=(0.3, -0.2, 0.5))
    a, b = FakeBus(level), FakeBus(turned)
    mesh, other = level.mesh(), turned.mesh()
    nodes, share, foot = patch(mesh)
    k = int(np.argmin(np.linalg.norm(mesh.vertices - foot, axis=1)))
    n = other.normals[k]
    one = a.publish(Load(nodes=nodes, forces=-np.outer(share, mesh.normals[k]), foot=foot, normal=mesh.normals[k]))[0]
    two = b.publish(Load(nodes=nodes, forces=-np.outer(share, n), foot=other.vertices[k], normal=n))[0]
    assert two.previous_indentation == approx(one.previous_indentation, rel=1e-5)
    assert np.linalg.norm(two.displacement, axis=1).max() == approx(
        np.linalg.norm(one.displacement, axis=1).max(), rel=1e-5
    )


def test_a_missing_basis_is_an_error_with_the_command_to_build_it(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    with pytest.raises(SettingError, match=r"palpate build basis --set poisson=0\.31$"):
        FakeBus(ReducedFE(poisson=0.31))
