"""Stored bases: their key includes all inputs, unsuitable bases are errors, and shipped bases are up to date."""

import dataclasses
import hashlib
import json
import shlex
from functools import lru_cache

import numpy as np
import pytest
from pytest import approx

from palpate.launch.load.values.overrides import settings_of
from palpate.launch.testing import FakeBus
from palpate.models.build.basis import _organ, silent
from palpate.models.fe.meshing import fingertip, organ, walls
from palpate.models.fe.meshing.organ import Organ
from palpate.models.fe.reduce import reducible, reduction, sampling, snapshots
from palpate.models.fe.reduce.reducible import of_organ
from palpate.nodes.base import SettingError
from palpate.nodes.base.surface import surface_mesh
from palpate.nodes.deformation import ReducedFE, basis_store
from palpate.physics.bodies.condensed_basis import Basis
from palpate.physics.geometry.felt import opposite
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.materials import hyperelastic

SMALL = {"surface": "plane", "coarse": 80, "vertices": 400}


@lru_cache
def small():
    """An empty basis; the tests check only its path."""
    mesh = surface_mesh("plane", 80)
    return Basis(mesh.vertices, mesh.triangles, np.eye(3 * len(mesh.vertices), dtype=np.float32))


@pytest.fixture
def cache(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "palpate/bases"


@lru_cache
def slab():
    """Inputs of the bases, as of another version."""
    return of_organ(Organ(surface_mesh("plane", 80)))


def node_of(command):
    """The node that a command of `palpate build basis` builds a basis for."""
    return ReducedFE(**settings_of([word for word in shlex.split(command)[2:] if word != "--set"]))


def test_numbers_of_a_command_are_read_as_in_graphs():
    assert settings_of(["young=5e3", "tissue.bed=30"]) == {"young": 5e3, "bed": 30}


def test_every_shipped_basis_is_in_the_index_with_its_command():
    printed = basis_store.shipped_bases()
    assert {path.name for path in basis_store.SHIPPED.glob("*.npz")} == set(printed)
    for name, about in printed.items():
        assert basis_store.about(basis_store.SHIPPED / name) == about
        node = node_of(about["command"])
        assert basis_store.differences(about["inputs"], node.inputs()) == []
        assert node.key() == about["key"] == basis_store.key(about["inputs"])
        assert about["version"] and about["commit"]


def test_the_key_follows_the_surface_and_the_version_of_the_builder(monkeypatch):
    usual = ReducedFE(**SMALL).key()
    assert ReducedFE(**SMALL | {"vertices": 900, "young": 1e3, "position": (0.1, 0.0, 0.0)}).key() == usual
    moved = surface_mesh("plane", 80)
    moved = Mesh(moved.vertices + (0.0, 0.0, 1e-6), moved.triangles)
    with monkeypatch.context() as patch:
        patch.setattr(ReducedFE, "coarse_mesh", lambda self: moved)
        assert ReducedFE(**SMALL).key() != usual
    sampled = ReducedFE(**SMALL, model="sampled").key()
    with monkeypatch.context() as patch:
        patch.setitem(basis_store.BUILDERS, "condensed", 0)
        assert ReducedFE(**SMALL).key() != usual
        assert ReducedFE(**SMALL, model="sampled").key() == sampled


def test_the_last_bits_of_a_vertex_do_not_change_the_key():
    mesh = surface_mesh("kidney", 200)
    rng = np.random.default_rng(1)
    shaken = Mesh(mesh.vertices * (1.0 + 2e-16 * rng.integers(-1, 2, mesh.vertices.shape)), mesh.triangles)
    assert basis_store.digest(shaken) == basis_store.digest(mesh)


def test_a_reduced_basis_may_have_as_many_vertices_as_the_file():
    mesh = surface_mesh("kidney", 200)
    other = mesh.vertices[::-1]
    assert basis_store.off(other, mesh) > 0.5 and basis_store.off(other, mesh, reduced=True) < 1e-9
    assert basis_store.off(other + (0.0, 0.0, 0.05), mesh, reduced=True) > 0.1


def test_a_basis_at_another_path_is_an_error_with_the_command_to_rebuild_it(cache):
    node, one = ReducedFE(**SMALL), small()
    one.save(cache / node.filename())
    FakeBus(node)
    Basis(one.vertices + (0.0, 0.0, 7.4e-3), one.triangles, one.compliance).save(cache / node.filename())
    with pytest.raises(
        SettingError, match=r"0\.074 of the surface's extent.*palpate build basis.*--set coarse=80.*--force"
    ):
        FakeBus(ReducedFE(**SMALL))


def test_the_inputs_of_an_unsuitable_shipped_basis_are_reported(cache):
    with pytest.raises(
        SettingError, match=r"of the shipped kidney-condensed\.npz, bed was 50\.0, is 60\.0.*--set bed=60\.0"
    ):
        FakeBus(ReducedFE(bed=60.0))


def test_a_basis_contains_its_inputs(tmp_path):
    small().save(tmp_path / "one.npz", json.dumps({"key": "0" * 16}))
    assert basis_store.about(tmp_path / "one.npz") == {"key": "0" * 16}
    (tmp_path / "none.npz").write_bytes(b"no archive")
    assert basis_store.about(tmp_path / "none.npz") is None


ORGAN = (organ, walls, opposite, hyperelastic)
SAMPLED = (*ORGAN, reduction, sampling, snapshots, fingertip, reducible)
"""Modules whose constants and default fields a basis depends on."""
VERSIONS = {"condensed": (4, "316b9e1812b2041e"), "sampled": (4, "38f5538f1472630c")}
RAISE = "a rebuilt basis has other numbers: raise BUILDERS, rebuild what ships, and enter the new numbers here"


def constants(modules):
    """Upper-case constants and default fields of classes, as text."""
    lines = set()
    for module in modules:
        for name, value in vars(module).items():
            if name.isupper() and isinstance(value, int | float | str | tuple | dict | np.ndarray) and name != "MISUSE":
                lines.add(f"{name} {value!r}")
            elif isinstance(value, type) and dataclasses.is_dataclass(value):
                plain = (f for f in dataclasses.fields(value) if f.default not in (dataclasses.MISSING, None))
                lines |= {f"{name}.{f.name} {f.default!r}" for f in plain if not callable(f.default)}
    return sorted(lines)


@pytest.mark.parametrize(("kind", "modules"), [("condensed", ORGAN), ("sampled", SAMPLED)])
def test_a_changed_constant_of_a_builder_requires_another_version(kind, modules):
    text = "\n".join(constants(modules))
    assert (basis_store.BUILDERS[kind], hashlib.sha256(text.encode()).hexdigest()[:16]) == VERSIONS[kind], RAISE


def test_the_constants_of_a_builder_are_detected(monkeypatch):
    usual = constants(SAMPLED)
    for module, name in ((organ, "SHELLS"), (reduction, "ROUND"), (fingertip, "CORE")):
        with monkeypatch.context() as patch:
            patch.setattr(module, name, 7)
            assert constants(SAMPLED) != usual
    assert "FingertipDimensions.dermis 0.00093" in usual


def test_changed_numbers_of_a_condensed_basis_require_another_version():
    assert basis_store.BUILDERS["condensed"] == 4
    assert np.trace(slab().compliance()) == approx(28157.1478336, rel=1e-6), RAISE


def test_changed_numbers_of_a_sampled_basis_require_another_version():
    body = slab()
    presses = snapshots.press_from_rest(body, reduction.organ_touches(body, 4))
    basis = reduction.build(body, presses[:3], presses[3:], 6, tolerance=3e-2)
    assert basis_store.BUILDERS["sampled"] == 4
    assert np.trace(basis.residual_compliance) == approx(27539.11, rel=1e-4), RAISE
    assert basis.points.weights.sum() == approx(0.016985051, rel=1e-3), RAISE
    assert np.linalg.norm(basis.modes) == approx(24.860345, rel=1e-4), RAISE
    finger = reducible.of_finger(fingertip.FingertipDimensions(cells=reduction.CELLS))
    touches = reduction.finger_touches(finger, 3, reduction.SEED)
    assert finger.mesh.points.sum() == approx(-0.80674444, rel=1e-6), RAISE
    assert finger.surface.areas.sum() == approx(0.001334452632, rel=1e-6), RAISE
    assert np.sum([t.foot for t in touches], axis=0) == approx((0.01014703, 0.00081575, 0.02495533), rel=1e-4), RAISE
    assert [t.levels[-1] for t in touches] == approx((0.0031123663, 0.0055889072, 0.0070970850), rel=1e-4), RAISE


@pytest.mark.long
@pytest.mark.parametrize("name", ["plane-condensed.npz", "plane-nodule-condensed.npz"])
def test_a_shipped_basis_equals_a_new_build(name):
    """The slab, without and with its nodule: its compliance at three vertices."""
    node = node_of(basis_store.shipped_bases()[name]["command"])
    basis, organ = Basis.load(basis_store.SHIPPED / name), of_organ(_organ(node, silent))
    half = 0.51 * float(np.abs(basis.compliance).max()) / 32767  # half of the quantization step of the file
    for v in (0, 100, 300):
        load = np.zeros_like(organ.mesh.points)
        load[:, 2] = organ.hats[:, v]
        u = organ.elastic.rest(organ.fixed).solve(load.ravel()).reshape(-1, 3)
        own = (organ.hats.T @ u).ravel()
        assert basis.compliance[3 * v + 2] == approx(own, abs=half)
