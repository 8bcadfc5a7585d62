"""Every material law: stress, tangent, objectivity, moduli; and a law in a single file."""

import numpy as np
import pytest
from added_laws import GENT
from pytest import approx
from scipy.linalg import expm

from palpate.models import fe
from palpate.models.fe import MaterialError, RigidIndenter, Settings, Solver, box, plane
from palpate.models.fe.reduce.reducible import Reducible
from palpate.models.fe.reduce.sampling import points_of
from palpate.physics import materials
from palpate.physics.bodies.sampled.energy import forces, scratch
from palpate.physics.bodies.sampled_body import SampledBasis
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.materials.compiled import compile_law, law_signature
from palpate.physics.materials.hyperelastic import example, law, laws, rest_moduli


@pytest.fixture
def gent(tmp_path, monkeypatch):
    """A folder with an additional law."""
    (tmp_path / "gent.py").write_text(GENT)
    monkeypatch.setattr(materials, "__path__", [*materials.__path__, str(tmp_path)])


def deformed(seed, size=0.3):
    return expm(size * np.random.default_rng(seed).standard_normal((3, 3)))


def evaluated(material, F):
    """W + U, its derivative by F and its second derivative, from the parts of a law."""
    P, A = np.zeros((3, 3)), np.zeros((9, 9))
    J = np.trace(F) - 2.0 if material.small else np.linalg.det(F)
    cofactor = np.eye(3) if material.small else J * np.linalg.inv(F).T
    W, U, dU, ddU = compile_law(material.law, law_signature())(F, J, np.array(material.parameters), P, A)
    return W, U, P + dU * cofactor, P, A, dU, ddU


def consistent(material):
    F, H, h = deformed(1), np.random.default_rng(2).standard_normal((3, 3)), 1e-5
    if material.small:
        F = np.eye(3) + 1e-3 * F
    _, _, stress, P, A, dU, _ = evaluated(material, F)
    above, below = (evaluated(material, F + s * h * H) for s in (1, -1))
    scale = np.abs(A).max()
    assert (above[0] + above[1] - below[0] - below[1]) / (2 * h) == approx(np.sum(stress * H), abs=1e-7 * scale)
    assert (above[3] - below[3]) / (2 * h) == approx((A @ H.ravel()).reshape(3, 3), abs=1e-7 * scale)
    assert approx(A.T, abs=1e-12 * scale) == A
    J = np.linalg.det(F)
    law, p = compile_law(material.law, law_signature()), np.array(material.parameters)
    memory = np.zeros((3, 3)), np.zeros((9, 9))
    up, down = (law(F, J + s * h, p, *memory) for s in (1, -1))
    assert (up[1] - down[1]) / (2 * h) == approx(dU if not material.small else law(F, J, p, *memory)[2], rel=1e-6)
    assert (up[2] - down[2]) / (2 * h) == approx(law(F, J, p, *memory)[3], rel=1e-6)
    untold = np.full((9, 9), np.nan)
    alone = np.zeros((3, 3))
    law(F, J, p, alone, untold)
    assert alone == approx(P, abs=1e-9 * scale)  # the same stress without the tangent


def turned_without_stress(material):
    F = deformed(3)
    turn = expm(np.array([[0, 0.7, -0.2], [-0.7, 0, 0.5], [0.2, -0.5, 0]]))
    here, there = evaluated(material, F), evaluated(material, turn @ F)
    scale = np.abs(here[4]).max()
    assert there[0] + there[1] == approx(here[0] + here[1], abs=1e-10 * scale)
    assert there[2] == approx(turn @ here[2], abs=1e-10 * scale)
    assert evaluated(material, turn)[2] == approx(np.zeros((3, 3)), abs=1e-10 * scale)
    for factor in (0.7, 1.3):
        assert evaluated(material, factor * F)[0] == approx(here[0], abs=1e-10 * scale)  # depends on the shape only


def small_strain(material):
    """Assert that the stress of a small strain is that of the moduli at rest."""
    shear, bulk = rest_moduli(material)
    e = 1e-6 * np.array([[1.0, 0.4, -0.2], [0.4, -0.5, 0.3], [-0.2, 0.3, 0.8]])
    expected = 2 * shear * (e - np.trace(e) / 3 * np.eye(3)) + bulk * np.trace(e) * np.eye(3)
    assert evaluated(material, np.eye(3) + e)[2] == approx(expected, rel=1e-3, abs=1e-9 * shear)


@pytest.mark.parametrize("name", laws())
def test_a_law_is_consistent(name):
    material = example(name)
    consistent(material)
    small_strain(material)
    if not material.small:
        turned_without_stress(material)
    assert material.name == name
    assert law(name) is material.law
    assert "W =" in laws()[name].__doc__
    assert "U =" in laws()[name].__doc__


def test_a_law_in_one_file_is_found_everywhere(gent, tmp_path, capsys):
    assert "gent" in laws()
    made = fe.gent(2e4, 0.4, 3.0)
    assert made.name == "gent"
    consistent(made)
    turned_without_stress(made)
    small_strain(made)
    assert "gent" in dir(fe)
    from palpate.cli.commands.graphs.list.laws import laws as listed

    listed(as_json=True)
    assert "chains of limited length" in capsys.readouterr().out


def block(material):
    mesh = box((1e-2, 1e-2, 1e-2), (2, 2, 2))
    fixed = np.repeat(mesh.points[:, 2:] < 1e-9, 3, axis=1)
    return mesh, fixed, {0: material}


def test_a_block_with_a_law_in_one_file_can_be_pressed(gent):
    """Limited chains are stiffer than free ones, and the same at small strain."""
    reactions = []
    for material in (fe.gent(2e4, 0.4, 1.0), fe.neo_hooke(2e4, 0.4)):
        mesh, fixed, given = block(material)
        top = mesh.faces[(mesh.points[mesh.faces][:, :, 2] > 1e-2 - 1e-9).all(axis=1)]
        touch = RigidIndenter(top, plane, (0.0, 0.0, -1.0), lambda load: np.array([0.0, 0.0, 1e-2 - load]))
        body = Solver(mesh, given, fixed, contacts=[touch], settings=Settings(step=1e-3, largest=1e-3))
        own = []
        for depth in (1e-5, 2e-3):
            body.advance(depth)
            own.append(abs(touch.force[2]))
        reactions.append(own)
    ratios = np.divide(*reactions)
    assert ratios[0] == approx(1.0, abs=1e-3)
    assert ratios[1] > 1.02


def test_a_sampled_basis_names_its_law_in_one_file(gent, tmp_path):
    mesh, fixed, _ = block(fe.neo_hooke(2e4, 0.4))
    rng = np.random.default_rng(4)
    phi = np.where(fixed[:, :, None], 0.0, rng.standard_normal((*fixed.shape, 3)) * 1e-4)
    surface = Mesh(mesh.points[:4], np.array([[0, 1, 2]], dtype=np.int32))
    body = Reducible(mesh, lambda young: {0: fe.gent(2e4 * young, 0.4, 3.0)}, fixed, surface, np.zeros((len(fixed), 4)))
    points = points_of(body, phi, 1e3)
    q, g = np.array([0.5, -0.3, 0.2]), np.zeros(3)
    forces(points, q, scratch(points), g)
    assert g == approx(np.einsum("nir,ni->r", phi, body.elastic.forces(phi @ q)), rel=1e-9)
    path = tmp_path / "basis.npz"
    SampledBasis(
        mesh.points[:4], surface.triangles, np.zeros((12, 12), np.float32), phi[:4].reshape(12, 3), points,
        (1.0, 1.0, 1.0),
    ).save(path)  # fmt: skip
    again = SampledBasis.load(path).points
    h = np.zeros(3)
    forces(again, q, scratch(again), h)
    assert h == approx(g, rel=1e-2)  # modes are stored in half precision


def test_a_law_named_in_a_file_is_not_imported(tmp_path, monkeypatch):
    (tmp_path / "innocent.py").write_text(f"open({str(tmp_path / 'was imported')!r}, 'w').close()\n{GENT}")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(MaterialError, match=r"'innocent\.strain_energy' lies outside palpate"):
        law("innocent.strain_energy")
    assert not (tmp_path / "was imported").exists()
    import innocent

    assert law("innocent.strain_energy") is innocent.strain_energy


def test_an_unknown_law_is_an_error_with_the_known_laws():
    with pytest.raises(MaterialError, match=r"no material law 'putty': expected .*hencky.*neo_hooke"):
        law("putty")
    with pytest.raises(AttributeError, match=r"no material law 'putty'; laws: .*hencky"):
        _ = fe.putty
