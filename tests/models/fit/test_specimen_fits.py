"""Several specimens in one table or in several files: `fit tissue` gives a result for each, or refuses."""

import json

import numpy as np
import pytest
from pytest import approx
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.models.fit.sessions import SessionError
from palpate.models.fit.specimens import SPECIMENS
from palpate.models.fit.tissue.fit import fit_tissue
from palpate.models.fit.tissue.rigs import Rig
from palpate.models.fit.tissue.several import by_specimen, folders_of
from palpate.studies.presses import PressReader

HEAD = "time [s],depth [mm],force [N]"
YOUNG = {0: 12e3, 1: 24e3}  # [Pa] as in the issue


def rows(young, count=60, seed=0):
    """Cells of a press of a ball of 8 mm by Hertz's law, E/(1 - nu²) with nu = 1/2, with noise of 0.1 mN."""
    depth = np.linspace(-0.3e-3, 0.7e-3, count)
    force = 16.0 / 9.0 * young * np.sqrt(8e-3) * np.maximum(depth, 0.0) ** 1.5
    force = force + 1e-4 * np.random.default_rng(seed).standard_normal(count)
    return [f"{0.01 * k:.3f},{1e3 * d:.5f},{f:.7f}" for k, (d, f) in enumerate(zip(depth, force, strict=True))]


def saved(tmp_path, lines, name="press.csv"):
    path = tmp_path / name
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def fitted(out, *words):
    """Exit code, what was printed, and `out`."""
    given = ["fit", "tissue", *map(str, words), "--rig", "ball", "--radius", "8 mm", "--law", "hertz", "-o", str(out)]
    return CliRunner(env={"COLUMNS": "200"}).invoke(app, given)


def sizes(presses):
    return {label: [float(np.ptp(p.force)) for p in each] for label, each in by_specimen(presses).items()}


def read(path, *columns):
    return PressReader(columns, [], False)(path)


FORMS = ("{}", "{} ID", "{}_no", "{} #", "{}Name")


@pytest.mark.parametrize("name", [form.format(name.title()) for name in SPECIMENS for form in FORMS])
def test_a_column_of_specimens_separates_them_wherever_their_rows_are(tmp_path, name):
    rng = np.random.default_rng(len(name))
    two = [rows(YOUNG[k]) for k in range(2)]
    peak = {k: approx(16.0 / 9.0 * YOUNG[k] * np.sqrt(8e-3) * 0.7e-3**1.5, rel=0.05) for k in range(2)}
    for labels in (("A", "B"), ("1", "2"), ("0.5", "1.5"), ("liver 12 kPa", "liver, 24 kPa"), ("7", "left")):
        stacked = [f'{row},"{label}"' for label, each in zip(labels, two, strict=True) for row in each]
        mixed = [line for pair in zip(stacked[:60], stacked[60:], strict=True) for line in pair]
        turns = [
            stacked[k] for k in np.argsort(np.r_[np.arange(60), np.arange(60)] + 40.0 * rng.uniform(), kind="stable")
        ]
        for lines in (stacked, mixed, turns):
            found = sizes(read(saved(tmp_path, [f"{HEAD},{name}", *lines])))
            assert found == {labels[0]: [peak[0]], labels[1]: [peak[1]]}, labels
    (press,) = read(saved(tmp_path, [f"{HEAD},{name}", *(f"{row},A" for row in two[0])]))  # one specimen
    assert len(press.depth) == 60 and list(by_specimen([press])) == [""]
    texts = [f"{row},s-{k:03}" for k, row in enumerate(two[0])]  # as many as rows
    for lines in (texts, [f"{row},{k}" for k, row in enumerate(two[0])]):
        (press,) = read(saved(tmp_path, [f"{HEAD},{name}", *lines]))
        assert len(press.depth) == 60 and list(by_specimen([press])) == [""]


def test_a_count_of_rows_that_begins_again_is_no_specimen(tmp_path):
    lines = [f"{row},{k + 1},{t}" for t in range(3) for k, row in enumerate(rows(12e3, seed=t))]
    presses = read(saved(tmp_path, [f"{HEAD},Sample,Trial", *lines]))
    assert [len(p.depth) for p in presses] == [60] * 3 and list(by_specimen(presses)) == [""]


def test_a_constant_name_does_not_hide_a_number(tmp_path):
    lines = [f"{row},liver,{k}" for k in (1, 2) for row in rows(YOUNG[k - 1])]
    presses = read(saved(tmp_path, [f"{HEAD},Sample,Sample ID", *lines]))
    assert list(by_specimen(presses)) == ["liver 1", "liver 2"]


def test_trials_of_a_specimen_are_fitted_together_and_blocks_alone(tmp_path):
    lines = [f"{r},{s},{t}" for s in "AB" for t in range(2) for r in rows(YOUNG["AB".index(s)], seed=t)]
    groups = by_specimen(read(saved(tmp_path, [f"{HEAD},specimen,trial", *lines])))
    assert {label: len(each) for label, each in groups.items()} == {"A": 2, "B": 2}
    two = [HEAD, *rows(12e3), HEAD, *rows(24e3)]
    assert list(by_specimen(read(saved(tmp_path, two)))) == ["block 1", "block 2"]
    assert list(by_specimen(read(saved(tmp_path, two), "specimen="))) == [""]
    trials = [f"{HEAD},trial", *(f"{r},1" for r in rows(12e3)), f"{HEAD},trial", *(f"{r},2" for r in rows(24e3))]
    assert list(by_specimen(read(saved(tmp_path, trials)))) == [""]


def test_any_column_can_name_the_specimens(tmp_path):
    path = saved(tmp_path, [f"{HEAD},Batch,trial", *(f"{r},{b},{b}" for b in (3, 4) for r in rows(YOUNG[b - 3]))])
    for column in ("specimen=Batch", "specimen=4", "specimen=trial"):
        assert list(by_specimen(read(path, column))) == ["3", "4"]
    assert list(by_specimen(read(path))) == [""]
    with pytest.raises(SessionError, match=r"row 1: 0 columns 'batch'; expected one of .*'Batch'.* or its number"):
        read(path, "specimen=batch")


def test_files_of_several_specimens(tmp_path):
    one, two, none = (
        saved(tmp_path, [HEAD + head, *(f"{r}{cell}" for r in rows(12e3))], f"{k}.csv")
        for k, (head, cell) in enumerate([(",Specimen", ",A"), (",Specimen", ",B"), ("", "")])
    )
    presses = [p for path in (one, two, none) for p in read(path)]
    assert list(by_specimen([presses[0], presses[2]])) == [""]  # nothing says that they differ
    assert list(by_specimen(presses[:2])) == ["A", "B"]
    with pytest.raises(SessionError, match=r"2\.csv: names no specimen, but the other presses are of A, B; name it"):
        by_specimen(presses)
    with pytest.raises(SessionError, match="presses of the specimens A, B: fit each alone"):
        fit_tissue(presses[:2], Rig("ball", 8e-3), "hertz")


def test_each_specimen_has_its_result_and_one_that_cannot_be_fitted_does_not_stop_the_others(tmp_path):
    labels = ("12 kPa", "24 kPa")
    lines = [f"{row},{s}" for k, s in enumerate(labels) for row in rows(YOUNG[k])]
    sparse = [f"{row},few rows" for row in rows(24e3, count=16)]
    path, out = saved(tmp_path, [f"{HEAD},Sample", *lines, *sparse]), tmp_path / "out"
    words = (path, "--depth-limit", "0.15 mm", "--drift", "linear")
    shown = fitted(out, *words, "--holdout", path)
    assert shown.exit_code != 0 and "specimen few rows: press.csv:few rows: fewer than 10 rows remain" in shown.stderr
    assert "column 'Sample' names 3 specimens: each is fitted alone (--columns specimen= fits all" in shown.output
    found = json.loads((out / "report.json").read_text())["specimens"]
    assert "fewer than 10 rows" in found["few rows"]["refused"]
    for k, label in enumerate(labels):
        young = found[label]["parameters"]["young"]
        assert young["low"] < young["value"] < young["high"] and young["value"] == approx(YOUNG[k], rel=0.2)
        folder = out / found[label]["folder"]
        assert {"scene.yaml", "report.md", "report.json"} <= {file.name for file in folder.iterdir()}
        held = json.loads((folder / "report.json").read_text())["held_out"]
        assert [each["press"] for each in held] == [f"press.csv:{label}"]  # of this specimen only
        assert f"| {label} | 1 |" in (out / "report.md").read_text()
    again = fitted(out, *words)
    assert again.exit_code != 0 and "exists" in again.output


def test_folders_are_plain_and_different():
    labels = ["A/B", "A:B", "../..", "a-b", "Ü 1", "x" * 300]
    folders = folders_of(labels)
    assert len({name.casefold() for name in folders.values()}) == len(labels)
    assert all(name.startswith("specimen-") and "/" not in name and len(name) < 100 for name in folders.values())
