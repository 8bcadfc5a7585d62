"""The commands `palpate build basis` and `palpate build fe`."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import fingertip_flow
import numpy as np
import pytest
from fingertip_claims import statements
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.launch.testing import FakeBus
from palpate.messages import Contact
from palpate.models.build import basis as builder
from palpate.models.fe.study.press_record import PressRun, check_pair
from palpate.nodes.deformation import ReducedFE
from palpate.nodes.tactile.flow import Flow
from palpate.physics.bodies.condensed_basis import Basis
from palpate.physics.bodies.sampled_body import SampledBasis
from palpate.physics.errors import ArgumentError


def run(*words):
    return CliRunner().invoke(app, list(words))


@pytest.mark.parametrize("model", ["linear", pytest.param("nonlinear", marks=pytest.mark.long)])
def test_reduce_builds_a_basis_once_and_the_node_finds_it(tmp_path, monkeypatch, model):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    sets = ["--set", "surface=sphere", "--set", "coarse=60", "--set", f"model={model}"]
    first = json.loads(run("build", "basis", *sets, "--json").stdout)
    again = json.loads(run("build", "basis", *sets, "--json").stdout)
    assert first["built"] and not again["built"] and first["path"] == again["path"]
    node = ReducedFE(surface="sphere", coarse=60, model=model, vertices=300, young=5e3, retardation=0.1)
    node.start()
    other = json.loads(run("build", "basis", *sets, "--set", "bed=20", "--json").stdout)
    assert other["built"] and other["path"] != first["path"]


def test_reduce_reports_invalid_input(tmp_path):
    wrong = run("build", "basis", "--set", "poisson=0.5")
    assert wrong.exit_code == 2 and "'poisson'" in wrong.output
    wrong = run("build", "basis", "--set", "bed")
    assert wrong.exit_code == 2 and "name=value" in wrong.output
    wrong = run("build", "basis", "--set", f"surface={tmp_path / 'no.stl'}")
    assert wrong.exit_code != 0 and "no.stl" in wrong.output
    assert "Traceback" not in wrong.output


def ball(path, corners):
    """A ball of 40 mm, in mm, as an STL file."""
    trimesh = pytest.importorskip("trimesh")
    trimesh.creation.icosphere(corners, 20.0).export(path)
    return ["--set", f"surface={path}", "--set", "file_unit=mm"]


def test_reduce_reports_errors_in_one_line_before_the_build(tmp_path):
    one_line(run("build", "basis", "--set", "poisson=["), 2, "--set poisson=[", "expected a number")
    one_line(run("build", "basis", "--set", "nosuch=1"), 2, "'nosuch'", "unknown")
    fine = json.loads(
        run("build", "basis", "--set", "model=sampled", "--set", "coarse=900", "--out", str(tmp_path), "--json").stdout
    )
    assert "expected at most 18000" in fine["text"] and "`coarse`" in fine["text"]
    (tmp_path / "file").write_text("")
    small = ["--set", "surface=sphere", "--set", "coarse=61"]
    one_line(run("build", "basis", *small, "--out", str(tmp_path / "file" / "bases")), 2, "Not a directory", "-o bases")


def test_a_stopped_reduce_leaves_no_files(tmp_path, monkeypatch):
    def stopped(file, **arrays):
        file.write(b"half")
        raise KeyboardInterrupt

    monkeypatch.setattr(np, "savez_compressed", stopped)
    small = ["--set", "surface=sphere", "--set", "coarse=60", "--set", "model=linear", "--out", str(tmp_path), "--json"]
    one_line(run("build", "basis", *small), 130, "nothing is stored")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("worst", "code"), [(0.4, 1), (0.2, 0)])
def test_reduce_warns_of_a_useless_basis(tmp_path, monkeypatch, worst, code):
    given = Basis(np.zeros((4, 3)), np.zeros((1, 3), dtype=np.int32), np.eye(12))
    missed = {"mean": worst / 4, "worst": worst}
    monkeypatch.setattr(builder, "build_basis", lambda node, stages: (given, missed))
    made = run("build", "basis", "--set", "surface=plane", "--set", "coarse=120", "--out", str(tmp_path))
    assert made.exit_code == code, made.output
    assert f"worst {worst:.1%}" in made.stdout
    assert ("--set coarse=240 (now 120, by default 600)" in made.stderr) == bool(code)


def fingertip(*words):
    return run("build", "fe", "fingertip", "--cells", "3", *words)


@pytest.fixture(scope="module")
def steel(tmp_path_factory):
    """A short run on steel, all of it in its folder."""
    folder = tmp_path_factory.mktemp("runs")
    report = json.loads(fingertip("--depth", "0.1", "--material", "20", "--out", str(folder), "--json").stdout)
    return folder, report


def one_line(result, code, *texts):
    """One line that says what is wrong, and the exit code."""
    assert result.exit_code == code, result.output
    assert "Traceback" not in result.output and len(result.output.strip().splitlines()) == 1, result.output
    for text in texts:
        assert text in result.output


def test_fe_fingertip_reports_the_run_next_to_the_paper(steel):
    _, report = steel
    assert report["divisor"] == 20.0 and report["indentation"][-1] == pytest.approx(1e-4)
    assert report["paper"][0] == {"force": 0.11, "indentation": 1.24e-3, "found": None}


def test_the_file_for_paraview_holds_the_pressure(steel):
    meshio = pytest.importorskip("meshio")
    folder, report = steel
    pressure = meshio.read(next(folder.rglob("finger.vtu"))).point_data["pressure"]
    mean = report["force"][-1] / report["area"][-1]
    assert 0.2 * mean < pressure.max() < 4.0 * mean  # so light a contact is narrower than a face


def test_the_script_of_the_papers_figures_draws_what_the_run_has(steel, tmp_path):
    pytest.importorskip("matplotlib")
    folder, _ = steel
    made = fingertip_flow.draw({"steel": PressRun(folder / "steel-20-3-0.2")}, tmp_path)
    assert [path.name for path in made] == ["force.png", "strain.png"]
    assert min(path.stat().st_size for path in made) > 20_000


def test_the_axes_of_the_area_fit_a_light_run_and_not_the_larger_forces_of_the_paper(steel):
    pytest.importorskip("matplotlib")
    folder, report = steel
    left, right = fingertip_flow.force({"steel": PressRun(folder / "steel-20-3-0.2")}).axes
    assert left.get_ylim()[1] > 0.5
    assert right.get_xlim()[1] == pytest.approx(1.05 * report["force"][-1])


def test_without_meshio_the_run_is_kept_with_a_note_on_what_to_install(steel, monkeypatch):
    folder, _ = steel
    monkeypatch.setitem(sys.modules, "meshio", None)
    again = fingertip("--depth", "0.1", "--material", "20", "--out", str(folder))
    assert again.exit_code == 0 and 'pip install "palpate[mesh]"' in again.output, again.output
    assert "0.11 N: not reached" in again.output


@pytest.mark.long
def test_a_run_beyond_the_papers_forces_has_all_four_pictures(tmp_path):
    pytest.importorskip("matplotlib")
    report = json.loads(fingertip("--material", "cortical", "--depth", "0.9", "--out", str(tmp_path), "--json").stdout)
    made = fingertip_flow.draw({"steel": PressRun(Path(report["folder"]))}, tmp_path)
    assert [path.name for path in made] == ["force.png", "strain.png", "isostrain.png", "flow.png"]
    assert min(path.stat().st_size for path in made) > 20_000
    assert report["paper"][1]["found"] == pytest.approx(0.77e-3, abs=0.03e-3)  # 0.76 mm on finer meshes


def test_the_same_command_again_computes_nothing(steel):
    folder, report = steel
    before = (folder / "steel-20-3-0.2" / "state.npz").stat().st_mtime_ns
    again = json.loads(fingertip("--depth", "0.1", "--material", "20", "--out", str(folder), "--json").stdout)
    assert again == report
    assert (folder / "steel-20-3-0.2" / "state.npz").stat().st_mtime_ns == before


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["--material", "stone"], "printed, calibrated, cortical"),
        (["--material", "0"], "a number above 0"),
        (["--material", "nan"], "a number above 0"),
        (["--plate", "wood"], "steel, silicone"),
        (["--cells", "2"], "--cells 2: expected 3"),
        (["--cells", "2000"], "--cells 2000: expected 3"),
        (["--depth", "30"], "less than 3.84 mm"),
        (["--depth", "-1"], "more than 0"),
        (["--depth", "nan"], "more than 0"),
        (["--friction", "-0.1"], "--friction -0.1"),
    ],
)
def test_fe_fingertip_reports_invalid_input(tmp_path, words, text):
    one_line(fingertip("--out", str(tmp_path / "runs"), *words), 2, text)
    assert not (tmp_path / "runs").exists()
    reported = json.loads(fingertip("--out", str(tmp_path / "runs"), *words, "--json").stdout)
    assert not reported["ok"] and text in reported["text"]


def test_a_folder_without_write_permission_is_reported_before_the_run(tmp_path):
    (tmp_path / "file").write_text("")
    one_line(fingertip("--out", str(tmp_path / "file" / "runs")), 2, "Not a directory")


@pytest.mark.parametrize("name", ["state.npz", "table.npz", "run.json"])
def test_a_damaged_run_is_an_error(steel, tmp_path, name):
    folder, _ = steel
    broken = tmp_path / "steel-20-3-0.2"
    broken.mkdir()
    for path in (folder / "steel-20-3-0.2").iterdir():
        (broken / path.name).write_bytes(path.read_bytes()[:100] if path.name == name else path.read_bytes())
    again = fingertip("--depth", "0.1", "--material", "20", "--out", str(tmp_path))
    one_line(again, 2, name, "damaged")


def test_fe_table_reports_a_file_that_is_not_a_run(steel, tmp_path):
    folder, _ = steel
    mine = str(folder / "steel-20-3-0.2")
    one_line(run("build", "fe", "table", mine, str(tmp_path)), 2, "no run.json", "palpate build fe fingertip")
    one_line(run("build", "fe", "table", mine, str(folder)), 2, "no run.json", f"such as {mine}")
    one_line(run("build", "fe", "table", mine, mine), 2, "a run on steel, expected one on silicone")
    one_line(run("build", "fe", "table", str(tmp_path / "no"), mine), 2, "no run.json")


@pytest.mark.long
def test_ctrl_c_keeps_the_steps_and_the_same_command_continues(tmp_path):
    words = ["build", "fe", "fingertip", "--cells", "3", "--depth", "0.3", "--out", str(tmp_path)]
    begun = subprocess.Popen([sys.executable, "-m", "palpate.cli", *words], stderr=subprocess.PIPE, text=True)
    first = tmp_path / "steel-calibrated-3-0.2" / "step-001.npz"
    until = time.monotonic() + 120
    while not first.exists() and time.monotonic() < until:
        time.sleep(0.05)
    begun.send_signal(signal.SIGINT)
    _, errors = begun.communicate(timeout=60)
    assert begun.returncode == 130 and "the same command continues from there" in errors and "Traceback" not in errors
    report = json.loads(run(*words, "--json").stdout)
    assert report["indentation"][-1] == pytest.approx(3e-4) and (np.diff(report["indentation"]) > 0).all()
    whole = json.loads(run(*words, "--json", "--out", str(tmp_path / "whole")).stdout)
    assert report["force"][-1] == pytest.approx(whole["force"][-1], rel=5e-3)


@pytest.mark.long
def test_the_script_of_the_papers_figures_puts_both_plates_side_by_side(steel, tmp_path, monkeypatch, capsys):
    """Short runs: what they do not reach is left out, not made up."""
    pytest.importorskip("matplotlib")
    folder, _ = steel
    words = ["--plate", "silicone", "--material", "20", "--depth", "0.1", "--out", str(tmp_path), "--json"]
    soft = json.loads(fingertip(*words).stdout)
    runs = [PressRun(folder / "steel-20-3-0.2"), PressRun(Path(soft["folder"]))]
    (row,) = statements(*(run.record() for run in runs))
    assert "strain 0.1" in row["statement"] and row["steel"] is None and row["holds"] is None
    words = ["fingertip_flow.py", *(str(run.folder) for run in runs), "--out", str(tmp_path / "both")]
    monkeypatch.setattr(sys, "argv", words)
    fingertip_flow.main()
    shown = capsys.readouterr().out
    assert "force.png" in shown and "strain.png" in shown and "less on silicone" in shown


@pytest.mark.long
def test_a_users_table_is_a_setting_of_the_node(steel, tmp_path):
    """From two runs by `fe table` to `tactile.Flow`, which reads what the runs hold; a steel run is scaled to the
    material of the other."""
    folder, hard = steel
    soft = json.loads(fingertip("--plate", "silicone", "--depth", "0.05", "--out", str(tmp_path), "--json").stdout)
    written = tmp_path / "tables" / "mine.npz"
    made = run("build", "fe", "table", str(folder / "steel-20-3-0.2"), soft["folder"], "--out", str(written))
    assert made.exit_code == 0, made.output
    runs = {"steel": PressRun(folder / "steel-20-3-0.2"), "silicone": PressRun(Path(soft["folder"]))}
    with pytest.raises(ArgumentError, match=r"divisor is 20\.0 on steel"):
        check_pair(runs)
    force = hard["force"][-1] * 20.0 / soft["divisor"]
    touch = Contact(foot=(0, 0, 0), normal=(0, 0, 1), force=force, compression=0, indentation=0, compression_rate=0,
                    indentation_rate=0)  # fmt: skip
    sent = FakeBus(Flow(table=str(written), plate="steel")).publish(touch)[0]
    assert sent.area == pytest.approx(hard["area"][-1], rel=1e-6)
    assert sent.levels == pytest.approx(hard["levels"]) and sent.volumes == pytest.approx(hard["volumes"][-1])


@pytest.mark.long
def test_an_organ_in_modes_reports_its_error_at_positions_that_were_not_pressed(tmp_path):
    sets = ["--set", "model=sampled", "--set", "modes=8", "--set", "coarse=50"]
    reported = json.loads(run("build", "basis", *sets, "--out", str(tmp_path), "--json").stdout)
    unseen = reported["unseen"]
    assert 0.0 < unseen["mean"] < unseen["worst"] < 0.1 and 0.0 < unseen["linear_mean"] < unseen["linear_worst"]
    assert SampledBasis.load(Path(reported["path"])).modes.shape[1] == 8
    loose = run("build", "basis", *sets, "--set", "bed=0.01", "--out", str(tmp_path), "--json")
    assert loose.exit_code == 2 and "for 0 touches" in json.loads(loose.stdout)["text"]
