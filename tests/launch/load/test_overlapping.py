"""Organs that lie in each other: one finger would feel the tissue twice. Reported at load, from shell and Python."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

import palpate
from palpate.cli.__main__ import app
from palpate.engine.faults import GraphError
from palpate.launch.load.graph import load
from palpate.nodes.base.surface import rotation_matrix, surface_mesh
from palpate.physics.errors import PalpateWarning
from palpate.physics.geometry.mesh import Mesh, plane
from palpate.physics.geometry.overlap import Shape, Solid, coincide, overlap

LEVEL = np.eye(3)
RADIUS = 21e-3  # [m] of the built-in sphere
BALL = Shape(surface_mesh("sphere", 3000))
INSIDE = "scene.liver-surface.position=[0, 0, 0.084]"
NEEDLE = "scene.finger.width=0"  # which needs no surface that is felt of both organs
NURBS = ("collision-kidney.use=collision.Nurbs", "collision-liver.use=collision.Nurbs")


def test_the_thickness_of_the_overlap_of_two_balls_is_that_of_their_lens():
    """2 R - d at the distance d of the centres, in 12 random directions and turns."""
    random = np.random.default_rng(3)
    for _ in range(12):
        direction = random.normal(size=3)
        direction /= np.linalg.norm(direction)
        distance = random.uniform(5e-3, 2.0 * RADIUS + 5e-3)
        place, turn = random.normal(size=3), rotation_matrix(tuple(random.normal(size=3)))
        one, other = Solid(BALL, LEVEL, place), Solid(BALL, turn, place + distance * direction)
        depth, at = overlap(one, other)
        lens = max(2.0 * RADIUS - distance, 0.0)
        assert depth <= lens + 1e-6 and depth >= lens - max(5e-5, 0.2 * lens), (distance, depth)
        assert depth == pytest.approx(overlap(other, one)[0], abs=1e-9)
        if depth > 0.0:
            ends = np.linalg.norm(at - place), np.linalg.norm(at - place - distance * direction)
            assert max(ends) < RADIUS + 1e-5
        assert not coincide(one, other)


def test_coarse_bodies_cross_where_no_vertex_is_inside():
    """Two bars as a plus sign, 10 x 10 x 60 mm; and one bar within a larger one."""
    box = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float) - 0.5
    corners = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = np.array([t for a, b, c, d in corners for t in ((a, b, c), (a, c, d))], np.int32)
    bar = Shape(Mesh(box * [0.01, 0.01, 0.06], triangles))
    across = Solid(bar, rotation_matrix((0.5 * np.pi, 0.0, 0.0)), np.zeros(3))
    assert overlap(Solid(bar, LEVEL, np.zeros(3)), across)[0] == pytest.approx(0.01, rel=0.1)
    block = Solid(Shape(Mesh(box * 0.08, triangles)), LEVEL, np.zeros(3))
    assert overlap(block, Solid(bar, LEVEL, np.zeros(3)))[0] == pytest.approx(0.035, rel=0.01)
    assert overlap(block, Solid(bar, LEVEL, np.array([0.0, 0.0451, 0.0])))[0] == 0.0


def test_an_open_sheet_is_a_body_below_it():
    sheet = Solid(Shape(plane(0.1, 500)), LEVEL, np.zeros(3))
    for height, depth in ((0.0212, 0.0), (0.018, 0.003), (-0.03, 0.051)):
        assert overlap(sheet, Solid(BALL, LEVEL, np.array([0.0, 0.0, height])))[0] == pytest.approx(depth, abs=5e-5)
    assert overlap(sheet, Solid(BALL, LEVEL, np.array([0.2, 0.0, 0.0])))[0] == 0.0


@pytest.mark.parametrize("sets", [NURBS, ()], ids=["Nurbs", "Mesh"])
@pytest.mark.parametrize(("place", "words"), [
    ("[0, 0, 0.084]", "kidney and liver overlap by 36 mm"), ("[0, 0.040, 0.084]", "kidney and liver overlap by 11 mm"),
    ("[0, 0.0508, 0.084]", "overlap by 0.1"), ("[0, 0.051, 0.084]", ""), ("[0, 0.06, 0.084]", ""),
])  # fmt: skip
def test_the_note_has_the_names_of_both_organs_and_the_depth(sets, place, words):
    notes = load("organs", overrides=[NEEDLE, *sets, f"scene.liver-surface.position={place}"]).notes
    notes = [note for note in notes if "in place of collision.Nurbs" not in note]
    assert len(notes) == bool(words)
    for note in notes:
        assert words in note and "Move one of them" in note and "collision-liver" in note


def test_organs_of_files_are_compared_too(tmp_path):
    (tmp_path / "ball.obj").write_text(
        "".join(f"v {x} {y} {z}\n" for x, y, z in BALL.mesh.vertices)
        + "".join(f"f {a} {b} {c}\n" for a, b, c in BALL.mesh.triangles + 1)
    )
    file = f"scene.liver-surface.surface={tmp_path / 'ball.obj'}"
    (note,) = load("organs", overrides=["collision-liver.use=collision.Mesh", file, INSIDE]).notes
    assert "kidney and liver overlap by 36 mm" in note
    assert not load("organs", overrides=["collision-liver.use=collision.Mesh", file]).notes


def test_two_organs_at_one_place_are_refused():
    """As two pieces of one file are."""
    twin = "scene.liver-surface={surface: kidney, position: [0, 0, 0.084], rotation: [0, 0, 0]}"
    with pytest.raises(GraphError, match="kidney and liver lie at the same place") as error:
        load("organs", overrides=[twin])
    assert error.value.faults[0].node == "collision-liver" and "position" in error.value.faults[0].cure
    (note,) = load("organs", overrides=[twin.replace("[0, 0, 0.084]", "[0.0002, 0, 0.084]")]).notes
    assert "overlap by 3" in note  # the whole organ, not the shift


def test_shell_and_python_report_the_same_note():
    (note,) = load("organs", overrides=[INSIDE, NEEDLE]).notes
    for command in ("check", "plan"):
        printed = CliRunner().invoke(app, [command, "organs", "--set", INSIDE, "--set", NEEDLE, "--json"])
        assert json.loads(printed.stdout)["notes"] == [note]
    with pytest.warns(PalpateWarning, match="kidney and liver overlap by 36 mm"):
        for _ in palpate.steps("organs", sets=[INSIDE, NEEDLE], duration=0.002):
            pass
    places = [[0.0, 0.0515, 0.084], [0.0, 0.0, 0.084], [0.0, 0.04, 0.084]]
    moved = {"scene.liver-surface.position": places}
    lanes = palpate.Ensemble("organs", 3, moved, ["both.Contact.force"], sets=[NEEDLE], duration=0.002)
    with pytest.warns(PalpateWarning, match="overlap by"):
        found = lanes.run(quiet=True)
    of_graph = [each for each in lanes.notes if not each.node]  # those of nodes are about the gap
    assert [each.lane for each in of_graph] == [1, 2] and of_graph[0] == note
    assert ["graph: kidney and liver overlap by" in text for text in found["notes"].values] == [False, True, True]
