"""A graph gives the same bytes in every kind of run, independent of other libraries and settings of the process."""

import json
import os
import pickle
import subprocess
import sys
from pathlib import Path

import pytest
import warm_fork_server
from same_bytes import digests

from palpate.compiler.arithmetic import LEVEL, pinnable
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.run.tasks.runner import Runner
from palpate.studies.sweeps.point import Point
from palpate.studies.sweeps.task import PointTask

GRAPH = Path(__file__).parents[1] / "golden" / "kidney.yaml"
BODIES = [f"deformation.{name}" for name in ("MassSpring", "ReducedFE", "BeamBundle", "Rigid")]
TURNED = {"rotation": [0.02, 0.0, 0.3]}
VARIANTS = [
    *({"tissue": body} for body in BODIES),
    {"collision": {"use": "collision.Mesh"}},
    {"tissue": {"use": "deformation.ReducedFE", **TURNED}, "collision": TURNED, "spread": TURNED},
    *({"tissue": {"use": body, "area": "fingertip"}, "spread": {"area": "fingertip"}} for body in BODIES[:2]),
]
SETTINGS = [
    {"OMP_NUM_THREADS": "2"},
    {"OPENBLAS_CORETYPE": "Haswell", "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR"},
    {"OPENBLAS_CORETYPE": "Zen", "NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""},
    {"OPENBLAS_CORETYPE": "Prescott", "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR"},
    {"OPENBLAS_CORETYPE": "SkylakeX", "OPENBLAS_NUM_THREADS": "2"},
]
PINS = ("OPENBLAS", "OMP_", "MKL_", "NUMBA_", "NPY_")

pytestmark = pytest.mark.skipif(not pinnable(), reason=f"this machine lacks instructions of {LEVEL}, or PALPATE_NATIVE")


def in_one_process(settings, variants, folder):
    """The output of `same_bytes` in a new process without pinned arithmetic."""
    clean = {name: value for name, value in os.environ.items() if not name.startswith(PINS)}
    folder.mkdir(parents=True, exist_ok=True)
    script = Path(__file__).parents[1] / "support" / "same_bytes.py"
    done = subprocess.run(
        [sys.executable, script, GRAPH, json.dumps(variants), folder],
        env=clean | settings, capture_output=True, text=True, cwd=folder,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """The unchanged graph, by `palpate.run` in a process without settings."""
    return in_one_process({}, [{}], tmp_path_factory.mktemp("plain"))


def test_run_command_line_apart_and_a_study_give_the_same_bytes(plain, tmp_path):
    ((library, _, _, peak),) = plain
    assert peak > 0.05 and len(library) > 7
    for way in ("--fused", "--place=apart"):
        file = tmp_path / f"{way}.mcap"
        given = ["run", str(GRAPH), way, "--duration", "0.12", "--record", str(file), "--no-pictures", "-q"]
        with open(tmp_path / "printed", "w+") as printed:
            process = warm_fork_server.palpate(
                given, cwd=tmp_path, env=dict(os.environ), stdout=printed, stderr=printed
            )
            assert process.wait() == 0, (tmp_path / "printed").read_text()
        assert digests(file) == library, way
    runner = Runner()
    try:
        task, point = PointTask(LaunchFile(graph=GRAPH, duration=0.12), ()), Point(0, "", {}, {}, tmp_path / "p.mcap")
        done = pickle.loads(runner.run(pickle.dumps(task), [pickle.dumps(point)], None)[0])
    finally:
        runner.close()
    assert not done.error and not done.lost
    assert digests(tmp_path / "p.mcap") == library


@pytest.mark.parametrize(
    "settings", [SETTINGS[0], pytest.param(SETTINGS[3], marks=pytest.mark.long)], ids=["threads", "old"]
)
def test_foreign_settings_of_numpy_openblas_and_numba_change_no_byte(settings, plain, tmp_path):
    assert in_one_process(settings, [{}], tmp_path / "there") == plain


@pytest.fixture(scope="module")
def here(tmp_path_factory):
    """Each variant in a process without settings."""
    return in_one_process({}, VARIANTS, tmp_path_factory.mktemp("here"))


@pytest.mark.long
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("settings", SETTINGS, ids=lambda one: " ".join(one.values()))
def test_foreign_settings_change_no_byte_of_any_body(settings, here, tmp_path):
    assert all(peak > 0.05 for *_, peak in here)
    assert in_one_process(settings, VARIANTS, tmp_path / "there") == here
