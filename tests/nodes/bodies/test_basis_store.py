"""Stored bases: found by all that they depend on, refused where they do not fit, and as the code would build them."""

import json
import shlex
from functools import lru_cache

import numpy as np
import pytest
from pytest import approx

import palpate.models.fe.reduce.dents as dents
from palpate.launch.testing import FakeBus
from palpate.models.fe.meshing.organ import Organ
from palpate.models.fe.reduce.indentation import Press
from palpate.models.fe.reduce.reducible import of_organ
from palpate.nodes.base import SettingError
from palpate.nodes.base.surface import surface_mesh
from palpate.nodes.deformation import ReducedFE, basis_store, reduced_fe
from palpate.physics.bodies.condensed_body import Basis
from palpate.physics.bodies.dents import SPACING, hat_moments, patch_radius
from palpate.physics.geometry.mesh import Mesh

SMALL = {"surface": "plane", "coarse": 80, "vertices": 400}


@lru_cache
def small():
    """A basis without numbers of its own: where it lies is what is looked at."""
    mesh = surface_mesh("plane", 80)
    return Basis(
        mesh.vertices,
        mesh.triangles,
        np.eye(3 * len(mesh.vertices), dtype=np.float32),
        dents=np.zeros((len(mesh.vertices), 2)),
    )


@pytest.fixture
def cache(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "palpate/bases"


def node_of(command):
    """The node that a command of `palpate reduce` builds a basis for."""
    words = shlex.split(command)[2:]
    given = dict(word.split("=", 1) for word in words if word != "--set")
    return ReducedFE(**given)


def test_every_shipped_basis_is_in_the_index_and_is_the_one_for_its_command():
    told = basis_store.shipped()
    assert {path.name for path in basis_store.SHIPPED.glob("*.npz")} == set(told)
    for name, about in told.items():
        assert basis_store.about(basis_store.SHIPPED / name) == about
        node = node_of(about["command"])
        assert basis_store.differences(about["inputs"], node.inputs()) == []
        assert node.key() == about["key"] == basis_store.key(about["inputs"])
        assert about["version"] and about["commit"]


def test_the_key_follows_the_surface_the_constants_and_the_method(monkeypatch, tmp_path):
    usual = ReducedFE(**SMALL).key()
    assert ReducedFE(**SMALL | {"vertices": 900, "young": 1e3, "position": (0.1, 0.0, 0.0)}).key() == usual
    moved = surface_mesh("plane", 80)
    moved = Mesh(moved.vertices + (0.0, 0.0, 1e-6), moved.triangles)
    with monkeypatch.context() as patch:
        patch.setattr(ReducedFE, "coarse_mesh", lambda self: moved)
        assert ReducedFE(**SMALL).key() != usual
    for name in ("fe/reduce/dents.py:PLACES", "fe/reduce/dents.py:RADIUS", "fe/meshing/organ.py:SHELLS"):
        with monkeypatch.context() as patch:
            other = reduced_fe.constants(basis_store.ORGAN)
            assert name in other
            patch.setattr(reduced_fe, "constants", lambda files, other=other, name=name: other | {name: "7"})
            assert ReducedFE(**SMALL).key() != usual
    with monkeypatch.context() as patch:
        patch.setattr(reduced_fe, "METHOD", basis_store.METHOD + 1)
        assert ReducedFE(**SMALL).key() != usual


def test_layers_and_touches_of_the_fingertip_are_in_its_key():
    constants = basis_store.constants(basis_store.FINGER + basis_store.SAMPLED)
    assert {f"fe/reduce/reduction.py:{name}" for name in ("CELLS", "TOUCHES,SEED")} <= set(constants)
    assert constants["fe/meshing/fingertip.py:Fingertip.dermis"] == "0.00093"
    assert constants["fe/reduce/reduction.py:ROUND,BEHIND"] == "(float(np.deg2rad(65.0)), 0.007)"


def test_the_last_bits_of_a_vertex_do_not_change_the_key():
    mesh = surface_mesh("kidney", 200)
    rng = np.random.default_rng(1)
    shaken = Mesh(mesh.vertices * (1.0 + 2e-16 * rng.integers(-1, 2, mesh.vertices.shape)), mesh.triangles)
    assert basis_store.digest(shaken) == basis_store.digest(mesh)


def test_a_basis_of_another_place_is_refused_with_the_command_that_rebuilds_it(cache):
    node, one = ReducedFE(**SMALL), small()
    one.save(cache / node.filename())
    FakeBus(node)
    Basis(one.vertices + (0.0, 0.0, 7.4e-3), one.triangles, one.compliance, one.dents).save(cache / node.filename())
    with pytest.raises(SettingError, match=r"0\.074 of the surface's extent.*palpate reduce.*--set coarse=80.*--force"):
        FakeBus(ReducedFE(**SMALL))


def test_what_the_shipped_basis_was_made_from_is_told_where_it_does_not_serve(cache):
    with pytest.raises(
        SettingError, match=r"of the shipped kidney-dents\.npz, bed was 50\.0, is 60\.0.*--set bed=60\.0"
    ):
        FakeBus(ReducedFE(bed=60.0))


def test_a_basis_says_what_it_was_made_from(tmp_path):
    small().save(tmp_path / "one.npz", json.dumps({"key": "0" * 16}))
    assert basis_store.about(tmp_path / "one.npz") == {"key": "0" * 16}
    (tmp_path / "none.npz").write_bytes(b"no archive")
    assert basis_store.about(tmp_path / "none.npz") is None


def test_the_method_has_its_number():
    """Whoever changes what these come to raises `METHOD`, enters the new numbers here and rebuilds what ships."""
    organ = of_organ(Organ(surface_mesh("plane", 80)))
    table = dents.dent_table(organ, places=2, levels=3)
    assert basis_store.METHOD == 3
    assert np.trace(organ.compliance()) == approx(TRACE, rel=1e-6)
    assert table.mean(axis=0) == approx(MEAN_DENTS, rel=1e-3)


TRACE = 28157.1478336
MEAN_DENTS = (-0.00668844, -0.01596131, -0.02876823)


@pytest.mark.long
def test_a_shipped_basis_is_the_one_that_would_be_built_now():
    """The slab: its compliance at three vertices, and its dents where it is pressed at three of its places, through
    which the table goes exactly."""
    name, radius = "plane-dents.npz", dents.RADIUS
    node = node_of(basis_store.shipped()[name]["command"])
    basis, organ = Basis.load(basis_store.SHIPPED / name), of_organ(Organ(node.coarse_mesh(), node.poisson, node.bed))
    half = 0.51 * float(np.abs(basis.compliance).max()) / 32767  # of the steps that it is stored in
    for v in (0, 100, 300):
        load = np.zeros_like(organ.mesh.points)
        load[:, 2] = organ.hats[:, v]
        u = organ.rest().solve(load.ravel()).reshape(-1, 3)
        own = (organ.hats.T @ u).ravel()
        assert basis.compliance[3 * v + 2] == approx(own, abs=half)
    feet, normals = dents.pressed_places(organ.surface, dents.PLACES, radius)
    moments, every = hat_moments(organ.surface), np.arange(len(organ.surface.vertices))
    model = Press(organ)
    for k in (0, len(feet) // 2, len(feet) - 1):
        one = dents.patch(organ.surface, feet[k], normals[k], radius)
        share = -one @ normals[k]
        across = patch_radius(organ.surface.vertices, moments, every, len(every), share[:, None])
        deep = SPACING * np.arange(1, dents.LEVELS + 1)
        work = model.curve(organ.hats @ one, across * deep, dents.sticking(organ.hats, one))
        (curve,) = model.run([work])
        built = curve.force / (curve.stiffness * across) / deep - 1.0
        assert share @ basis.dents == approx(built, abs=1e-3)
