"""`palpate study` from the shell."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from typer.testing import CliRunner

import palpate
from palpate.cli.__main__ import app
from palpate.studies.sweeps.file import STUDIES, find, load
from palpate.studies.sweeps.store import Store

STUDY = """
graph: ball.yaml
over:
  ball.young: [1e4, 2e4]
  ball.what: ["", fail]
keep: [peak ball.force, curve ball.force]
"""
BALL = """
nodes:
  ball: {use: nodes_for_studies.Ball}
wanted: [ball]
run: {duration: 5 ms}
"""


def call(*words):
    return CliRunner().invoke(app, ["study", *map(str, words)], env={"COLUMNS": "200"})


@pytest.fixture
def mine(write):
    write("ball.yaml", BALL)
    return lambda text=STUDY: write("mine.yaml", text)


def test_a_study_file_yields_a_table_and_pictures_and_a_second_run_is_stored(mine, tmp_path):
    first = call(mine(), "-o", tmp_path / "out", "--workers", 1)
    assert first.exit_code == 1, first.output
    assert "4 points, 0 stored, 4 to compute" in first.stderr
    assert "peak ball.force [N]" in first.stdout and "the mesh is inside out" in first.stdout
    assert "2 of 4 points failed; --retry computes them again" in first.stdout
    for name in ("peak-ball.force.png", "curve-ball.force.png"):
        assert (tmp_path / "out" / name).read_bytes()[:4] == b"\x89PNG"
    again = call(mine(), "-o", tmp_path / "out", "--json")
    printed = json.loads(again.stdout)
    assert not printed["ok"] and printed["failed"] == 2 and again.exit_code == 1
    assert [point["ball.young"] for point in printed["points"]] == [1e4, 1e4, 2e4, 2e4]
    assert printed["points"][2]["peak ball.force"] == 2 * printed["points"][0]["peak ball.force"]


@pytest.mark.parametrize(
    ("text", "output_text"),
    [
        ("- 1", "expected a mapping with graph, over and keep"),
        ("graph: ball.yaml", "over: missing"),
        (STUDY + "samplse: 4", "mine.yaml:7: unknown key 'samplse'"),
        (
            STUDY.replace("keep:", "keep: peak ball.force #"),
            "mine.yaml:6: keep: found 'peak ball.force', expected a list",
        ),
        (STUDY + "limit: 5 mm", "a length; expected a time"),
        (STUDY.replace("ball.young", "ball.yuong"), "over ball.yuong: node 'ball', setting 'yuong': unknown"),
        (STUDY + "set: {ball.radios: 1}", "set ball.radios: node 'ball', setting 'radios': unknown"),
    ],
)
def test_an_invalid_file_is_reported_in_one_line(mine, text, output_text, tmp_path):
    outcome = call(mine(text), "-o", tmp_path / "new" / "out")
    assert outcome.exit_code == 2 and output_text in outcome.stderr, outcome.stderr
    assert not (tmp_path / "new").exists()


def test_a_large_study_asks_for_confirmation(mine):
    text = STUDY.replace("[1e4, 2e4]", "{linspace: [1e4, 2e4, 5000]}").replace('["", fail]', "a")
    text = text.replace("ball.what: a", "ball.radius: {linspace: [1e-3, 2e-3, 2000]}")
    outcome = call(mine(text))
    assert outcome.exit_code == 2 and "10,000,000 points" in outcome.stderr and "--yes" in outcome.stderr


@pytest.mark.parametrize("package", ["pyarrow", "SALib", "xarray"])
def test_a_missing_package_is_named_with_its_extra(mine, monkeypatch, package, tmp_path):
    for name in [name for name in sys.modules if name.startswith("palpate.studies.sweeps")]:
        monkeypatch.delitem(sys.modules, name)
    for name in [name for name in sys.modules if name.partition(".")[0] == package]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, package, None)
    over = {"ball.young": {"uniform": [1, 2]}, "ball.depth": {"uniform": [1, 2]}}
    with pytest.raises(
        palpate.PalpateError, match=rf'package {package} is not installed; pip install "palpate\[study\]"'
    ):
        mine()
        study = palpate.Study(tmp_path / "ball.yaml", over, ["peak ball.force"], samples=2, sensitivity="morris")
        study.folder = tmp_path
        study.xarray()
        study.run(tmp_path)


@pytest.mark.parametrize("name", sorted(file.stem for file in STUDIES.glob("*.yaml")))
def test_the_shipped_studies_load(name):
    assert 2 <= len(load(find(name))) <= 100


@pytest.mark.long
def test_ctrl_c_ends_a_study_with_its_exit_code_and_keeps_finished_points(mine, tmp_path):
    file = mine(STUDY.replace('ball.what: ["", fail]', "ball.pause: {linspace: [0.2, 0.3, 20]}"))
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    env = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1] / "support"), "TMPDIR": str(temporary)}
    command = [
        sys.executable,
        "-m",
        "palpate.cli",
        "study",
        str(file),
        "-o",
        str(tmp_path / "out"),
        "--workers",
        "1",
    ]
    log, stored = tmp_path / "out" / "log.jsonl", 0
    for again in range(2):  # the line counted only the points of the last command
        process = subprocess.Popen(command, env=env, stderr=subprocess.PIPE, text=True, start_new_session=True)
        while not (log.exists() and log.read_text().count("\n") > stored + 3):
            time.sleep(0.05)
            assert process.poll() is None
        os.killpg(process.pid, signal.SIGINT)
        _, output_text = process.communicate(timeout=120)
        before, stored = stored, len(Store(tmp_path / "out", write=False).rows)
        assert process.returncode == 130 and f"stopped; {stored} of 40 points are stored" in output_text, again
        assert stored >= before + 4
    assert not list(temporary.glob("palpate-*"))
