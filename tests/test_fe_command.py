"""The commands `palpate reduce` and `palpate fe`."""

import json

import pytest
from typer.testing import CliRunner

from palpate.launch.__main__ import app
from palpate.nodes.deformation import ReducedFE


def run(*words):
    return CliRunner().invoke(app, list(words))


def test_reduce_builds_a_basis_once_and_the_node_finds_it(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    sets = ["--set", "surface=sphere", "--set", "coarse=60"]
    first = json.loads(run("reduce", *sets, "--json").stdout)
    again = json.loads(run("reduce", *sets, "--json").stdout)
    assert first["built"] and not again["built"] and first["path"] == again["path"]
    node = ReducedFE(surface="sphere", coarse=60, vertices=300, young=5e3, retardation=0.1)
    node.start()
    other = json.loads(run("reduce", *sets, "--set", "bed=20", "--json").stdout)
    assert other["built"] and other["path"] != first["path"]


def test_reduce_says_what_it_cannot_use(tmp_path):
    wrong = run("reduce", "--set", "poisson=0.5")
    assert wrong.exit_code == 2 and "'poisson'" in wrong.output
    wrong = run("reduce", "--set", "bed")
    assert wrong.exit_code == 2 and "name=value" in wrong.output
    wrong = run("reduce", "--set", f"surface={tmp_path / 'no.stl'}")
    assert wrong.exit_code != 0 and "no.stl" in wrong.output
    assert "Traceback" not in wrong.output


def test_fe_fingertip_reports_the_run_beside_the_paper(tmp_path):
    pytest.importorskip("rich")
    words = ["fe", "fingertip", "--cells", "3", "--depth", "0.1", "--material", "20", "--to", str(tmp_path)]
    found = json.loads(run(*words, "--json").stdout)
    assert found["divisor"] == 20.0 and found["indentation"][-1] == pytest.approx(1e-4)
    assert found["paper"][0] == {"force": 0.11, "indentation": 1.24e-3, "found": None}
    assert len(list(tmp_path.rglob("finger.vtu"))) == 1
    wrong = run("fe", "fingertip", "--material", "stone", "--to", str(tmp_path))
    assert wrong.exit_code == 2 and "literal, calibrated or a number" in wrong.output
    wrong = run("fe", "fingertip", "--plate", "rubber", "--to", str(tmp_path))
    assert wrong.exit_code == 2 and "steel, silicone" in wrong.output
