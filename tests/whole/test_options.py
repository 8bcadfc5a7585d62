"""Every option of every shipped node gives the same messages, notes and refusals from the shell and from Python."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from options import digests
from shell_text import unwrapped
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.compiler.arithmetic import LEVEL, pinnable
from palpate.launch.load.classes import catalogue
from palpate.launch.load.files import SCENES
from palpate.launch.load.launchfile import find
from palpate.messages.wording import words_of
from palpate.nodes.base import settings

RUNS = {
    ("kidney", None): 0.5,
    ("kidney", "breathing"): 0.5,
    ("fingertip", None): 0.55,
    ("nodule", None): 0.4,
    ("nodule", "afferents"): 0.35,
    ("palpate-two", None): 0.4,
    ("pinch", None): 0.45,
    ("pinch", "lift"): 0.6,
    ("pinch-liver", None): 0.6,
    ("organs", None): 0.3,
    ("neighbours", None): 0.75,
    ("texture", None): 0.35,
    ("texture", "grating"): 0.35,
    ("remote", None): 0.5,
    ("fingertip-slide", None): 0.05,
    ("softness", None): 0.1,
    ("digit", None): 0.7,
    ("sensors", None): 0.5,
}
"""Graphs and scenes, and durations [s] in which the finger touches."""
IN_PLACE = {
    "deformation.BeamBundle": ("kidney", "tissue"),
    "deformation.ReducedFE": ("kidney", "tissue"),
    "deformation.Rigid": ("kidney", "tissue"),
    "device.Steered": ("kidney", "device"),
    "friction.Coulomb": ("kidney", "friction"),
    "friction.ElastoPlastic": ("kidney", "friction"),
    "texture.Autoregressive": ("texture", "texture"),
}
"""Nodes that run in place of another one."""
NOT_RUN = {
    "actuator.SoundCard": "an observer that needs a sound card",
    "contact.Folds": "in no shipped graph; tests/whole/test_folds.py",
    "contact.Wall": "in no shipped graph; tests/whole/test_folds.py",
    "device.Mouse": "needs a program that sends the mouse; tests/views",
    "device.RecordedPose": "needs a recording; tests/nodes/test_recorded_pose.py",
    "device.Replayed": "needs a recording; tests/records",
    "friction.Components": "in no shipped graph; tests/physics/friction/test_components.py",
    "kinematics.Cartesian": "follows a device; tests/drivers",
    "support.World": "in no shipped graph; tests/whole/test_lift_neighbours.py",
    "tactile.Flow": "in no shipped graph; tests/nodes/test_fingertip_effects.py",
}
WITH = {"area=table": ["area_forces=[0.1, 2]", "area_radii=[2 mm, 5 mm]"]}
"""What an option needs."""
FILES = {"path", "surface", "pattern", "session", "folder", "file"}  # settings that name a file
OLD = {"OPENBLAS_CORETYPE": "Prescott", "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR"}
PINS = ("OPENBLAS", "OMP_", "MKL_", "NUMBA_", "NPY_")

pytestmark = pytest.mark.skipif(not pinnable(), reason=f"this machine lacks instructions of {LEVEL}, or PALPATE_NATIVE")


def places():
    """For each node the run and the place in it, and what else must be set."""
    found = {}
    for graph, scene in RUNS:
        launch = find(graph).but(scene=None if scene is None else SCENES / f"{scene}.yaml")
        for name, spec in launch.load().nodes.items():
            if spec.off is None:
                found.setdefault(spec.use.partition("[")[0], ((graph, scene), name, []))
    for use, (graph, name) in IN_PLACE.items():
        found[use] = (graph, None), name, [f"{name}.use={use}"]
    return found


PLACES = places()
NODES = {entry.use: entry.cls for entry in catalogue()[0] if not entry.cls.hardware}


def others(use, setting):
    """Other values of a setting: all of its words, the other flag, a number nearby."""
    if words := words_of(setting.type):
        return [word for word in words if word != setting.default]
    value = setting.default
    if isinstance(value, bool):
        return [not value]
    if isinstance(value, int):
        return [value + 1]
    if isinstance(value, float):
        return [1.1 * value if value else 0.01]
    if isinstance(value, tuple) and value and all(isinstance(part, float) for part in value):
        return [[1.01 * part + 0.001 for part in value]]
    return []


def runs(numbers):
    """Runs with one option each; `numbers`: with numbers, otherwise with words and flags."""
    made = {}
    for use, cls in NODES.items():
        if use not in PLACES:
            continue
        run, name, sets = PLACES[use]
        for setting in settings(cls).values():
            if setting.name in FILES:
                continue
            chosen = words_of(setting.type) or isinstance(setting.default, bool)
            for value in others(use, setting) if bool(chosen) != numbers else ():
                changed = [f"{setting.name}={json.dumps(value)}", *WITH.get(f"{setting.name}={value}", ())]
                agree = ("spread", "tissue") if setting.name == "area" else (name,)  # the scene sets it for both
                changed = [f"{node}.{text}" for node in agree for text in changed]
                made[f"{use} {setting.name}={value}"] = [*run, RUNS[run], [*sets, *changed]]
    return made


def shell(graph, scene, duration, sets, file):
    """The outcome of `palpate run`, and what it prints."""
    words = [word for text in sets for word in ("--set", text)] + (["--scene", scene] if scene else [])
    words += ["--fused", "--no-pictures", "--duration", str(duration), "--record", str(file)]
    done = CliRunner().invoke(app, ["run", graph, *words], env={"COLUMNS": "10000"})
    printed = unwrapped(done.output)
    return (digests(file) if done.exit_code == 0 else None), printed


def test_every_node_is_run_or_has_a_reason():
    assert set(NODES) == {*PLACES, *NOT_RUN} & set(NODES) and not set(NOT_RUN) & set(PLACES)
    assert len(runs(False)) > 40 and len(runs(True)) > 200


def compared(made, folder):
    """Run all of them both ways; the differences, and the number of runs that were not refused."""
    (folder / "runs.json").write_text(json.dumps(list(made.values())))
    clean = {name: value for name, value in os.environ.items() if not name.startswith(PINS)}
    command = [sys.executable, Path(__file__).parents[1] / "support" / "options.py", folder / "runs.json", folder]
    there = subprocess.Popen(command, env=clean | OLD, stdout=subprocess.PIPE, text=True, cwd=folder)
    assert there.stdout is not None
    wrong, ran = [], 0
    for option, given in made.items():
        file = folder / "shell.mcap"
        streams, printed = shell(*given, file)
        file.unlink(missing_ok=True)
        python = json.loads(there.stdout.readline())
        if "refused" in python:
            why = python["refused"].replace(f"{Path.cwd()}/", "").partition(" What was recorded before")[0]
            if streams is not None or why not in printed:
                wrong.append(f"{option}: Python refuses it, {python['refused']}; the shell printed {printed}")
            continue
        ran += 1
        if streams is None:
            wrong.append(f"{option}: the shell refuses it, {printed}")
        elif streams != python["streams"]:
            wrong.append(f"{option}: {[s for s in streams if streams[s] != python['streams'].get(s)]} differ")
        wrong += [
            f"{option}: the shell did not print {n}" for n in python["notes"] if " ".join(n.split()) not in printed
        ]
    assert there.wait() == 0
    return wrong, ran


@pytest.mark.long
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("numbers", [False, True], ids=["words", "numbers"])
def test_every_option_gives_the_same_from_the_shell_and_from_python(tmp_path, numbers):
    made = runs(numbers)
    wrong, ran = compared(made, tmp_path)
    assert not wrong, "\n".join(wrong)
    assert ran > 0.8 * len(made)


def test_the_laws_of_the_contact_area_give_the_same_from_the_shell_and_from_python(tmp_path):
    made = {option: given for option, given in runs(False).items() if " area=" in option or " finger_law=" in option}
    made = {option: given for option, given in made.items() if "MassSpring" in option or "Series" in option}
    wrong, ran = compared(made, tmp_path)
    assert not wrong, "\n".join(wrong)
    assert len(made) >= 8 and ran >= 7
