"""Colours of a surface: displacement, pressure, slip, strain, with a bar in units."""

import numpy as np
import pytest
from drawing import needs_drawing
from shell_text import unwrapped
from short_touch import short_touch
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.messages import Surface
from palpate.physics.errors import ArgumentError
from palpate.physics.geometry.mesh import plane
from palpate.records.reader import Recording
from palpate.views.surface import film as films
from palpate.views.surface.colour import COLOURS, able, check, paint_vertices, top

SHEET = plane(0.1, 100)


def surface(**more):
    """The surface of a sheet stretched by 20 % along x."""
    nodes = np.arange(len(SHEET.vertices), dtype=np.int32)
    moved = SHEET.vertices * (0.2, 0.0, 0.0)
    law = {"stiffness": 1.0, "exponent": 1.0, "damping": 0.0, "rest_indentation": 0.0, "previous_indentation": 0.0}
    return Surface(nodes=nodes, displacement=moved, **law, **more)


def test_the_values_come_from_the_message():
    count = len(SHEET.vertices)
    printed = surface(pressure=np.linspace(0.0, 5e3, count), slipped=np.arange(count) % 2)
    assert able(printed) == list(COLOURS)
    assert paint_vertices(COLOURS["displacement"], SHEET, printed) == pytest.approx(0.2 * np.abs(SHEET.vertices[:, 0]))
    assert paint_vertices(COLOURS["pressure"], SHEET, printed) == pytest.approx(printed.pressure)
    assert paint_vertices(COLOURS["slip"], SHEET, printed).tolist() == [float(i % 2) for i in range(count)]
    assert paint_vertices(COLOURS["strain"], SHEET, printed) == pytest.approx(0.2, abs=1e-12)


def test_a_vertex_missing_in_the_message_has_the_value_zero():
    one = Surface(
        nodes=np.array([7], np.int32), displacement=np.array([[0.0, 0.0, -1e-3]]), pressure=np.array([2e3]),
        slipped=np.array([1]), stiffness=1.0, exponent=1.0, damping=0.0, rest_indentation=0.0, previous_indentation=0.0,
    )  # fmt: skip
    for name in ("displacement", "pressure", "slip"):
        assert np.flatnonzero(paint_vertices(COLOURS[name], SHEET, one)).tolist() == [7]
    strained = np.flatnonzero(paint_vertices(COLOURS["strain"], SHEET, one) > 1e-9)
    around = SHEET.triangles[(SHEET.triangles == 7).any(axis=1)]
    assert set(strained.tolist()) == set(around.ravel().tolist())


def test_an_unavailable_colour_lists_the_available_ones():
    with pytest.raises(ArgumentError, match=r"r.mcap: its body sends no slip. Available colours: displacement, strain"):
        check(COLOURS["slip"], [surface()], "r.mcap")
    with pytest.raises(ArgumentError, match=r"sends no pressure; --set effects.pressure=on"):
        check(COLOURS["pressure"], [surface()], "r.mcap")
    check(COLOURS["strain"], [surface()], "r.mcap")


@pytest.mark.parametrize(
    ("name", "most", "end"),
    [
        ("displacement", 4.2e-3, 5e-3),
        ("pressure", 3.1e3, 5e3),
        ("pressure", 0.0, 1e3),
        ("strain", 0.034, 0.05),
        ("strain", -0.1, 0.01),
        ("slip", 0.0, 1.0),
    ],
)
def test_the_bar_ends_at_a_round_number_of_its_units(name, most, end):
    assert top(COLOURS[name], most) == pytest.approx(end)


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    return short_touch(
        tmp_path_factory.mktemp("colours"), "beams", "tissue.use=deformation.BeamBundle", "effects.pressure=on"
    ).path


@pytest.mark.parametrize("name", ["pressure", "strain"])
def test_a_picture_has_the_colour_and_its_bar(file, tmp_path, name, monkeypatch):
    needs_drawing()
    labels = []
    first = films._figure
    monkeypatch.setattr(
        films, "_figure", lambda of, most, *more: labels.append((of.label, most)) or first(of, most, *more)
    )
    target = tmp_path / "a.png"
    result = CliRunner().invoke(app, ["picture", str(file), "--at", "0.3", "-o", str(target), "--colour", name])
    assert result.exit_code == 0, result.output
    assert target.read_bytes()[:4] == b"\x89PNG"
    ((label, most),) = labels
    touch = films.TouchStreams(Recording(file))
    shown = films.bodies_of(touch)
    (instant,) = films.instants_at(touch, shown, [300])
    most_of_it = paint_vertices(COLOURS[name], shown.mesh, instant.surface).max()
    assert label == COLOURS[name].label and 0.0 < most_of_it <= most <= 10 * most_of_it


def test_an_unknown_colour_is_an_error_of_one_line(file, tmp_path):
    for name, words in (("slip", "sends no slip. Available colours: displacement, pressure, strain"),
                        ("heat", "expected one of displacement, pressure, slip, strain")):  # fmt: skip
        for verb in (["picture", "--at", "0.3"], ["picture", "--film"]):
            result = CliRunner().invoke(app, [verb[0], str(file), *verb[1:], "--colour", name])
            assert result.exit_code == 2 and words in unwrapped(result.stderr), result.output
    assert [one.name for one in file.parent.iterdir()] == [file.name]
