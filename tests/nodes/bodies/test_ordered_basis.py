"""The basis of a file: its vertices are numbered along a curve, in place of the order of the file."""

import numpy as np
import pytest
from pytest import approx

from palpate.launch.testing import FakeBus
from palpate.nodes.base.surface import surface_mesh
from palpate.nodes.deformation import ReducedFE
from palpate.physics.bodies.condensed_basis import Basis, OrderedBasis
from palpate.physics.bodies.condensed_body import answer, bear, condensed_body
from palpate.physics.geometry.mesh import Mesh, write_ply

LINE = 16  # numbers in single precision of a line of the cache


@pytest.fixture(scope="module")
def shuffled():
    """A plane whose vertices are in random order, with a compliance that falls with the distance."""
    mesh, rng = surface_mesh("plane", 600), np.random.default_rng(5)
    order = rng.permutation(len(mesh.vertices))
    number = np.argsort(order)
    vertices, triangles = mesh.vertices[order], number[mesh.triangles].astype(np.int32)
    away = np.linalg.norm(vertices[:, None] - vertices[None], axis=2)
    turned = np.eye(3) + 0.1 * np.array([[0, 1, 2], [1, 0, 3], [2, 3, 0]])
    compliance = np.kron(1.0 / (4e-3 + away), turned)
    return Basis(vertices, triangles, compliance.astype(np.float32))


def lines(vertices):
    """Mean number of lines of the cache with what a row of C has for the 30 vertices nearest to each."""
    found = []
    for vertex in vertices[::7]:
        near = np.argsort(np.linalg.norm(vertices - vertex, axis=1))[:30]
        found.append(len(np.unique((3 * near[:, None] + np.arange(3)) // LINE)))
    return float(np.mean(found))


def test_an_ordered_basis_is_the_same_organ_with_neighbours_close_together(shuffled, tmp_path):
    shuffled.save(tmp_path / "one.npz")
    plain, ordered = Basis.load(tmp_path / "one.npz"), OrderedBasis.load(tmp_path / "one.npz")
    assert np.array_equal(ordered.listed, plain.vertices)
    place = np.array([np.flatnonzero((plain.vertices == vertex).all(axis=1))[0] for vertex in ordered.vertices])
    assert np.array_equal(np.sort(place), np.arange(len(place)))
    assert np.array_equal(plain.vertices[plain.triangles], ordered.vertices[ordered.triangles])
    blocks, kept = (each.compliance.reshape(len(place), 3, -1, 3) for each in (plain, ordered))
    assert np.array_equal(blocks[place][:, :, place], kept)
    assert lines(ordered.vertices) < 0.6 * lines(plain.vertices)
    bodies = [condensed_body(each, surface_mesh("plane", 2500), 19e3, 0.02, 8e-3, 0.02, 0.45)
              for each in (plain, ordered)]  # fmt: skip
    load = np.array([[0.1, 0.0, -0.4], [0.0, 0.1, -0.3], [0.0, 0.0, -0.3]])
    laws = np.zeros((2, 1, 5))
    for body, law in zip(bodies, laws, strict=True):
        for at in (700, 1200):
            bear(body, 0, np.arange(at, at + 3, dtype=np.int32), load, (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 1e-3)
            answer(body, law, 1e-3)
    assert laws[0] == approx(laws[1], rel=1e-12)


def test_a_nodule_in_a_reduced_file_has_its_distance_from_each_vertex_of_the_basis(shuffled, tmp_path, monkeypatch):
    """The distances were those of the vertices of the file, of which there are more."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    mesh = surface_mesh("plane", 2500)
    write_ply(tmp_path / "organ.ply", Mesh(1e3 * mesh.vertices, mesh.triangles))
    node = ReducedFE(surface=str(tmp_path / "organ.ply"), file_unit="mm", refine=0.0, nodule_radius=4e-3)
    assert node.reduced_count() is not None
    shuffled.save(tmp_path / "palpate/bases" / node.filename())
    FakeBus(node)
    model = node._organ[0]
    away = np.abs(np.linalg.norm(model.vertices - node.centre(), axis=1) - 4e-3)
    assert model.true.apart == approx(away, abs=1e-5)
