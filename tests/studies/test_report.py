"""Table, pictures and page."""

import csv
import json
import sys
from pathlib import Path

import pytest
from shell_text import unwrapped
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.studies.accuracy import methods
from palpate.studies.accuracy.cases import TOUCHES
from palpate.studies.accuracy.cells import one
from palpate.studies.accuracy.outcome import Fidelity
from palpate.studies.accuracy.output import page, report
from palpate.studies.accuracy.output.pareto import ParetoPoint, front
from palpate.studies.accuracy.reference import QUANTITIES

STANDARD = {m.name: m for m in methods.standard()}


@pytest.fixture(scope="module")
def cells():
    own = [
        ("ball", "hertz"),
        ("ball", "MassSpring"),
        ("ball", "exponential"),
        ("plate", "exponential"),
        ("plate", "hertz"),
    ]
    settings = [Fidelity(f"{r:g} Hz", r, {"surface": {"vertices": 400}}) for r in (500.0, 1000.0)]
    return [one(TOUCHES[t], STANDARD[m], f) for t, m in own for f in settings]


def test_the_table_contains_the_data_of_the_pictures(cells, tmp_path):
    report.table(cells, {"processor": "some", "commit": "abc"}, tmp_path / "a.csv")
    about, *lines = (tmp_path / "a.csv").read_text(encoding="utf-8").splitlines()
    assert json.loads(about.removeprefix("#")) == {"processor": "some", "commit": "abc"}
    rows = list(csv.DictReader(lines))
    for row, cell in zip(rows, cells, strict=True):
        assert (row["touch"], row["method"], row["status"]) == (cell.touch, cell.method, cell.status)
        assert (float(row["p99"]), row["why"]) == (cell.p99, cell.why)
        printed = {q: {m: float(row[f"{q} {m}"]) for m in ("rms", "worst", "band")} for q in cell.errors}
        assert printed == cell.errors and all(row[f"{q} rms"] == "" for q in set(QUANTITIES) - set(cell.errors))


def test_the_front_contains_the_points_that_no_other_point_dominates():
    points = [(1.0, 5.0), (2.0, 6.0), (3.0, 1.0), (3.0, 0.9), (4.0, 0.9), (0.5, 9.0)]
    assert front(points) == [5, 0, 3]


def test_the_page_ends_with_its_limits(cells, tmp_path):
    page.write(cells, {"processor": "some"}, None, tmp_path / "a.md")
    text = (tmp_path / "a.md").read_text(encoding="utf-8")
    assert text.index("## ball") < text.index("## Not covered")
    assert text.rstrip().endswith(page.NOT_COVERED[-1])
    assert "at the reference" in text
    assert "exponential law: unsupported, it is the law of a fingertip" in text


def test_without_matplotlib_table_and_page_are_written(cells, tmp_path, monkeypatch):
    monkeypatch.delitem(sys.modules, "palpate.studies.accuracy.output.pictures", raising=False)
    for name in [name for name in sys.modules if name.partition(".")[0] == "matplotlib"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert report.write_report(cells, {"processor": "some"}, tmp_path).keys() == {"page", "table"}
    assert {file.name for file in tmp_path.iterdir()} == {"accuracy.csv", "accuracy.md"}


def test_the_command_makes_page_pictures_and_table(tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    given = ["bench", "accuracy", "--touch", "plate", "--method", "exponential", "--quick", "-o", str(tmp_path / "out")]
    ran = CliRunner().invoke(app, [*given, "--json"])
    assert ran.exit_code == 0, ran.output
    reported = json.loads(ran.stdout)
    assert {c["fidelity"] for c in reported["cells"]} == {"1000 Hz"}
    assert {"numpy", "processor", "commit", "seeds"} <= set(reported["about"])
    assert {p.name for p in (tmp_path / "out").iterdir()} >= {"accuracy.md", "accuracy.csv", "overview.png"}


@pytest.mark.parametrize(
    ("given", "text"),
    [
        (["--touch", "rub"], "expected one of ball"),
        (["--method", "magic"], "expected one of hertz"),
        (["--method", "hertz", "--touch", "slip"], "none of these methods supports any of these touches"),
        (["--body", "no_such_lab.Liver"], "not found"),
        (["--body", "contact.Series"], "takes Load and sends Surface"),
    ],
)
def test_unknown_names_are_errors_with_the_valid_names(given, text):
    ran = CliRunner().invoke(app, ["bench", "accuracy", *given])
    assert ran.exit_code in (1, 2)
    assert text in unwrapped(ran.output)


def test_a_median_below_the_range_of_the_picture_is_marked(tmp_path, monkeypatch):
    pictures = pytest.importorskip("palpate.studies.accuracy.output.pictures")
    labels = []
    monkeypatch.setattr(pictures, "_save", lambda figure, path: labels.append(figure.axes[0].get_ylabel()))
    for error in (0.25, 6e-11):
        printed = [ParetoPoint("hertz", "Hertz", "1000 Hz", error, error, "indent", 1e-5, 2e-5, 1, 0)]
        pictures.overview(printed, [], tmp_path / "x.png")
    assert ["smaller errors at 0.01 %" in label for label in labels] == [False, True]


def test_the_readme_counts_the_touches_on_the_slab():
    readme = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")
    assert f"the {sum(touch.body == 'slab' for touch in TOUCHES.values())} touches on a slab" in readme
