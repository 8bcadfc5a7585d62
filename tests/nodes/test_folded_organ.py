"""contact.Folds: an organ in two pieces that touch is two organs that touch, and what it notes."""

import json

import numpy as np
import pytest
from pytest import approx

from palpate.messages import Load
from palpate.nodes.base import SettingError
from palpate.nodes.contact import Between
from palpate.nodes.contact.folds import Folds
from palpate.nodes.contact.organs.given_bodies import given_bodies
from palpate.physics.geometry.mesh import Mesh, write_ply
from palpate.studies.organs.gaps import MM, cut_block

GAP = 1 * MM
LINEAR = {"exponent": 1.0, "damping": 0.0, "retardation": 0.02, "stiffness": 257.0}


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The pieces of a cut block, the second finer, and both in one file."""
    folder, pieces = tmp_path_factory.mktemp("cut"), []
    for name, sign, count in (("one", -1.0, 1500), ("two", 1.0, 2500)):
        cut = cut_block(GAP, count)
        some = (sign * cut.vertices[cut.triangles][:, :, 1] > 0.0).all(axis=1)
        used, corners = np.unique(cut.triangles[some], return_inverse=True)
        pieces.append(Mesh(cut.vertices[used], corners.reshape(-1, 3).astype(np.int32)))
        write_ply(folder / f"{name}.ply", pieces[-1])
    triangles = np.concatenate([pieces[0].triangles, pieces[1].triangles + len(pieces[0].vertices)])
    write_ply(folder / "both.ply", Mesh(np.concatenate([each.vertices for each in pieces]), triangles))
    return folder


def side(folder, name):
    surface = {"surface": str(folder / f"{name}.ply"), "refine": 0.0, "position": (0.0, 0.0, 0.0)}
    return {"use": "MassSpring", "settings": LINEAR | surface, "surface": surface}


def started(cls, *sides, **settings):
    node = cls(bodies=json.dumps(sides), reach=3 * MM, cells=400, **settings)
    node.start()
    node.resize([1, 0])
    return node


def near(mesh, y, push):
    """A load of `push` [N] along y in the middle of the wall at y."""
    at = mesh.vertices
    nodes = np.flatnonzero((np.abs(at - (0.0, y, 0.0)) < (6 * MM, 1e-6, 5 * MM)).all(axis=1)).astype(np.int32)
    forces = np.tile((0.0, push / len(nodes), 0.0), (len(nodes), 1))
    return Load(nodes=nodes, forces=forces, foot=(0.0, y, 0.0), normal=(0.0, 1.0, 0.0))


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_two_pieces_of_one_organ_press_on_each_other_as_two_organs(files, friction):
    """A load pulls the first wall across the gap; springs, of which only those under it move."""
    two = started(Between, side(files, "one"), side(files, "two"), friction=friction)
    folded = started(Folds, side(files, "both"), friction=friction)
    mesh = given_bodies(folded.bodies)[0].mesh
    seen = []
    for k in range(60):
        push = 2.5 * np.sin(np.pi * k / 59)
        apart = two.step([near(given_bodies(two.bodies)[0].mesh, -0.5 * GAP, push)], [], [], [], dt=1e-3)
        own = folded.step([near(mesh, -0.5 * GAP, push)], [], [], [], dt=1e-3)
        assert own.force == approx(apart.force, rel=1e-9, abs=1e-12) and own.gap == approx(apart.gap, abs=1e-12)
        assert own.dissipated == approx(apart.dissipated, rel=1e-9, abs=1e-15)
        assert own.first_yields == approx(apart.first_yields, rel=1e-6, abs=1e-12)
        # the finer piece is the second organ, and its wall the first here
        assert np.array(own.resultant) == approx(-np.array(apart.resultant), rel=1e-9, abs=1e-12)
        assert own.first_forces.sum(axis=0) == approx(apart.second_forces.sum(axis=0), rel=1e-9, abs=1e-12)
        assert own.generated == 0.0 and own.left == 0
        seen.append(own.force)
    assert max(seen) > 0.1 and seen[-1] == 0.0


def test_notes_name_walls_out_of_reach_and_a_body_whose_walls_do_not_move_each_other(files):
    node = Folds(bodies=json.dumps([side(files, "both")]), reach=0.5 * MM)
    node.start()
    notes = node.notes()
    assert any("no walls of the surface face each other with a gap of 0 to 0.5 mm" in note for note in notes)
    assert any("MassSpring: a finger moves only the surface under its patch" in note for note in notes)


def test_two_bodies_are_refused(files):
    with pytest.raises(SettingError, match="found 2 bodies, expected 1"):
        started(Folds, side(files, "one"), side(files, "two"))
