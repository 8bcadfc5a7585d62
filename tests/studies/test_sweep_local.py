"""`palpate study --local`: derivatives of the kept results at the settings of the scene."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

import palpate
from palpate.cli.__main__ import app
from palpate.physics.errors import ArgumentError
from palpate.studies.sweeps.local import local_sensitivity

PATHS = {"tissue.stiffness": [200.0, 300.0], "contact.finger_stiffness": [20.0, 30.0]}


def test_the_derivatives_are_differences_of_the_numbers_of_runs():
    keep = ["peak contact.force", "at 0.6 s controller.force", "curve contact.indentation"]
    found = local_sensitivity(palpate.Study("kidney", PATHS, keep, duration=0.9))
    rows = {(row["of"], row["parameter"]): row for row in found.rows}
    assert len(rows) == 4 and "ideal hand" in found.notes[0]
    sets = [["scene.hand.ideal=true", f"tissue.stiffness={257.0 * (1.0 + sign * 1e-3)!r}"] for sign in (-1, 1)]
    runs = [palpate.run("kidney", duration=0.9, sets=each, record=None) for each in sets]
    peaks = [float(np.max(run.contact.force)) for run in runs]
    assert rows["peak contact.force", "tissue.stiffness"]["derivative"] == pytest.approx(
        np.diff(peaks)[0] / 0.514, rel=1e-4
    )
    lengths = [float(np.linalg.norm(run.controller.force[600])) for run in runs]
    there = rows["at 0.6 s controller.force", "tissue.stiffness"]
    assert there["derivative"] == pytest.approx(np.diff(lengths)[0] / 0.514, rel=1e-3)
    assert there["per_cent"] == pytest.approx(2.57 * there["derivative"])
    time, unit, curves = found.curves["contact.indentation"]
    assert unit == "m" and len(time) == 900 and set(curves) == set(PATHS)
    assert curves["tissue.stiffness"][800] < 0.0 < curves["contact.finger_stiffness"][800]


def test_the_command_prints_rows_and_refuses_choices(tmp_path):
    study = tmp_path / "one.yaml"
    study.write_text(
        "graph: kidney\nduration: 0.6 s\nover: {tissue.stiffness: [200, 300]}\nkeep: [peak contact.force]\n"
    )
    found = json.loads(CliRunner().invoke(app, ["study", str(study), "--local", "--json"]).stdout)
    assert [row["parameter"] for row in found["rows"]] == ["tissue.stiffness"]
    assert found["rows"][0]["reason"] == "" and found["rows"][0]["derivative"] > 0.0
    with pytest.raises(ArgumentError, match="a choice"):
        local_sensitivity(palpate.Study("kidney", {"tissue.use": ["deformation.Rigid"]}, duration=0.1))
