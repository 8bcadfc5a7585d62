"""Kernels compiled before a run: the check finds missing ones, and after the compilation none is missing."""

import os
import subprocess
import sys

import pytest

from palpate.cli.machine.kernels import BODIES, MISSING, OTHER_SCENES, TOUCHES, USUAL, shipped_launches
from palpate.launch.load.launchfile import SCENES, names


def call(tmp_path, *words):
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache"), "TMPDIR": str(tmp_path / "temporary")}
    (tmp_path / "temporary").mkdir(exist_ok=True)
    command = [sys.executable, "-m", "palpate.cli.machine.kernels", *words]
    return subprocess.run(command, env=environment, capture_output=True, text=True)


def test_the_check_finds_a_missing_kernel_and_leaves_nothing(tmp_path):
    done = call(tmp_path, "check")
    assert (done.returncode, done.stdout, done.stderr) == (MISSING, "", "")
    assert not list((tmp_path / "temporary").iterdir())
    assert not list((tmp_path / "cache").rglob("*.nb[ci]")), "it ends at the first missing kernel"


@pytest.mark.long
def test_compiled_kernels_suffice_for_the_usual_graphs_in_one_and_several_processes(tmp_path):
    done = call(tmp_path)
    assert (done.returncode, done.stdout, len(done.stderr.splitlines())) == (0, "", 1)
    assert call(tmp_path, "check").returncode == 0
    made = {file.name for file in (tmp_path / "cache").rglob("*.nbc")}
    command = [sys.executable, "-m", "palpate.cli", "run", "kidney", "--no-pictures", "-q", "--no-record"]
    for body in USUAL:
        words = [*command, "--duration", "0.02", "--set", f"tissue.use=deformation.{body}"]
        run = subprocess.run(words, env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}, cwd=tmp_path)
        assert run.returncode == 0
    assert {file.name for file in (tmp_path / "cache").rglob("*.nbc")} == made


@pytest.mark.long
def test_the_wheel_contains_every_graph_scene_and_body():
    assert {file.stem for file in SCENES.glob("*.yaml")} - set(names()) == set(OTHER_SCENES)
    listed = [name for name, _ in shipped_launches()]
    assert set(listed) >= set(names()) | {f"{graph} with {body}" for graph in TOUCHES for body in BODIES}
