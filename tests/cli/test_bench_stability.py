"""`palpate bench stability`: table, picture, and invalid devices."""

import csv
import json

import pytest
from pytest import approx
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.physics.device.wall_loop import WallDevice
from palpate.studies.stability import walls

SHORT = ["bench", "stability", "--rate", "1000", "--delay", "1", "--damping", "0", "--json"]


def call(*options):
    return CliRunner().invoke(app, [*SHORT, *options])


def test_the_table_compares_theory_with_the_simulated_loop_of_a_device(tmp_path):
    printed = json.loads(call("-o", str(tmp_path), "--drag", "0.4", "--coulomb", "0.003").stdout)
    (row,) = printed["rows"]
    assert row["passive"] == approx(2 * 0.4 / 1e-3 / 3, rel=1e-5)
    assert row["quantised"] == approx(100.0)
    assert 0.85 * row["stable"] < row["bare"] < 1.05 * row["stable"] < row["controlled"] < row["commanded"]
    assert row["given_out"] < 5e-3
    with open(printed["table"], encoding="utf-8") as file:
        (line,) = csv.DictReader(file)
    assert float(line["stable [N/m]"]) == approx(row["stable"], rel=1e-5)


def test_a_wall_with_a_slow_oscillation_does_not_count_as_stable():
    row = walls.row(WallDevice(), 4000.0, 0, 0.0, 1, 0.0, 0.0, 0)
    assert 0.8 * row["stable"] < row["bare"] <= row["stable"]


def test_the_controller_renders_the_stiffness_of_the_wall_up_to_its_limit(monkeypatch):
    monkeypatch.setattr(walls, "HIGH", 300.0)
    soft = walls.row(WallDevice(), 4000.0, 0, 0.0, 1, 0.0, 0.0, 0)
    assert soft["controlled"] == approx(soft["commanded"], rel=0.02) and 200.0 < soft["commanded"] <= 300.0
    monkeypatch.undo()
    late = walls.row(WallDevice(), 1000.0, 5, 0.0, 1, 0.0, 0.0, 0)
    assert late["commanded"] >= 1e7 and 0.5 * late["stable"] < late["controlled"] < 5.0 * late["stable"]


def test_the_output_begins_with_the_result_and_omits_empty_columns(tmp_path):
    printed = CliRunner().invoke(app, [*SHORT[:-1], "-o", str(tmp_path)], env={"COLUMNS": "200"}).output
    first = next(line for line in printed.splitlines() if line.startswith("At "))
    assert "1000 Hz and 1 samples of delay" in first and "without the controller (theory: 133)" in first
    table = printed[printed.index(first) :]
    assert "injected" in table and "[mJ]" in table and "stability.csv" in table
    assert "quantised" not in table[: table.index("without dry friction")]


def test_legends_do_not_cover_curves(tmp_path, monkeypatch):
    pictures, drawn = pytest.importorskip("palpate.studies.stability.pictures"), []
    blank = pictures.figure
    monkeypatch.setattr(pictures, "figure", lambda *size: drawn.append(blank(*size)) or drawn[-1])
    same = {"rate": 1000.0, "delay": 0, "stable": 400.0, "bare": 380.0, "controlled": 4000.0}
    pictures.draw_walls([{**same, "damping": 0.1 * k, "passive": 300.0} for k in range(3)], tmp_path / "walls.png")
    for figure in drawn:
        (legend,) = figure.legends
        box = legend.get_window_extent()
        assert not any(box.overlaps(axes.get_window_extent()) or axes.get_legend() for axes in figure.axes)
        assert box.x0 >= 0.0 and box.x1 <= figure.bbox.x1


@pytest.mark.parametrize("wrong", [("--drag", "0"), ("--mass", "nan"), ("--lost", "2"), ("--filter", "0")])
def test_an_invalid_device_is_rejected_with_the_name_of_the_option(tmp_path, wrong):
    result = call("-o", str(tmp_path), *wrong)
    assert result.exit_code == 2 and wrong[0] in result.stdout and "expected" in result.stdout
    assert not (tmp_path / "stability.csv").exists()


@pytest.mark.parametrize(
    ("options", "output_text"),
    [
        (["--mass", "-1"], "--mass: found -1"),
        (["--rate", "nan"], "--rate: found nan"),
        (["-o", "{file}/x"], "file/x: Not a directory"),
    ],
)
def test_invalid_options_are_rejected_before_the_estimated_time_is_printed(tmp_path, monkeypatch, options, output_text):
    monkeypatch.setattr(walls, "row", lambda *given: pytest.fail("it computes first"))
    (tmp_path / "file").write_text("")
    given = [text.format(file=tmp_path / "file") for text in options]
    result = CliRunner().invoke(app, ["bench", "stability", "-o", str(tmp_path / "out"), *given])
    text = result.output + str(result.exception)
    assert result.exit_code == 2 and output_text in " ".join(text.split()) and "roughly" not in text
    assert not (tmp_path / "out").exists()
