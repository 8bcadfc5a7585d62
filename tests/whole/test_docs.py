"""The examples of README and docs work: every YAML block loads, every command exists, and the fast ones run.

Commands that do not run are listed below with the reason.
"""

import importlib
import json
import os
import re
import shlex
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import phantom_finger
import pytest
import typer
import yaml
from strokes_of_a_surface import strokes
from trimesh import Trimesh
from typer.core import TyperGroup
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.cli.terminal.options import choose_launch
from palpate.launch.load.launchfile import find
from palpate.launch.load.placement import load_place
from palpate.launch.load.values.source import read
from palpate.launch.template import node_files
from palpate.launch.testing import FakeBus
from palpate.messages import Load, Pose, Surface, pack
from palpate.nodes.base.surface import surface_mesh
from palpate.studies.psychophysics.file import load as load_experiment
from palpate.studies.psychophysics.observer import load as load_observer
from palpate.studies.psychophysics.stimuli import Stimuli
from palpate.studies.sweeps.file import load

ROOT = Path(__file__).parents[2]
DOCS = [page for page in sorted((ROOT / "docs").rglob("*.md")) if page.parts[-2] not in ("reference", "_build")]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *DOCS]
OTHERS = {
    "./setup.sh": "builds an environment",
    "./check.sh": "runs the tests",
    "git": "fetches a copy",
    ". .venv/bin/activate": "changes the reader's shell",
    "pip install": "installs packages",
    ".venv/bin/python": "tests and benchmarks",
    "python": "tests and scripts: tests/whole/test_scripts.py loads each",
    "cc": "compiles an example: tests/launch/run/test_listen.py",
    "python3 -m venv": "tests/whole/test_install.py runs docs/install.md",
    "uv": "the same",
    "pipx": "the same",
    "palpate-": "",
}
"""Commands of other programs, by their first words."""
NOT_RUN = {
    "palpate bench": "minutes; tests/studies runs its parts",
    "palpate tune": "minutes; tests/studies/test_tune.py",
    "palpate rates": "minutes; tests/studies/test_rates.py",
    "palpate build fe": "minutes; tests/models/fe/study",
    "palpate top": "runs until Ctrl-C",
    "palpate remote join": "waits for another machine; tests/launch/run",
    "palpate run two-machines": "waits for another machine",
    "palpate run falcon --set device.firmware=nvent_firmware.bin": "a device",
    "palpate run kidney --set device.use=device.Falcon --clock real": "a device",
    "palpate run falcons --set device-thumb.port=SERIAL": "two devices",
    "palpate run cartesian --set device.use=force_dimension": "a device; tests/drivers/test_vendor_library.py",
    "palpate fit record press.csv --subject gel --session 1 --set sensor.port=192": "two devices",
    "palpate run kidney --set scene.finger.band=true --set band.model": "a file of fit force; tests/models/fit",
    "palpate export runs/texture.mcap": "a whole slide; tests/nodes/test_texture.py",
    "palpate study kidney-stiffness --scheduler": "a cluster; tests/studies/test_cluster.py",
    "palpate experiment kidney-stiffness": "a page; tests/views, tests/cli/commands/test_experiment.py",
    "palpate experiment --analyse": "data of the reader; tests/cli/commands/test_experiment.py",
    "palpate fit tissue press.csv --columns": "presses of the reader; tests/models/fit",
    "palpate fit tissue A1.csv": "the same",
    "palpate fit tissue probes.csv": "probes of the reader; tests/models/fit/test_probes.py",
    "palpate fit map probes.csv": "the same",
    "palpate run nodule --scene map/scene.yaml": "a map of fit map; tests/models/fit/test_probes.py",
    "palpate fit finger presses.csv": "presses of the reader; tests/models/fit/test_fit_finger.py",
}
PAGE_VERBS = ("palpate touch", "palpate view", "palpate run kidney --view")
"""These commands serve a page until Ctrl-C, which is sent when they have printed the address."""
COMMAND = typer.main.get_command(app)
SHORT = ["--duration", "0.05", "--out", "runs/short"]


def blocks():
    """Page and line, language and text of each block."""
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for match in re.finditer(r"^```(\w*)\n(.*?)^```", text, re.MULTILINE | re.DOTALL):
            line = text[: match.start()].count("\n") + 1
            yield f"{page.relative_to(ROOT)}:{line}", match[1], match[2]


def commands():
    """Page and line, and words of each command; in a block without a language only palpate's lines are commands."""
    for where, language, text in blocks():
        for line in text.splitlines() if language in ("", "sh") else ():
            if language == "" and not line.startswith("palpate "):
                continue
            for part in re.split(r" && |; ", re.sub(r"\s#.*|^#.*", "", line)):
                if part.strip():
                    yield where, shlex.split(part)


def inline():
    """Commands within sentences, except in decisions, which may name former commands."""
    for page in (page for page in PAGES if page.parent.name != "decisions"):
        for text in re.findall(r"`(palpate [^`]+)`", page.read_text(encoding="utf-8")):
            yield str(page.relative_to(ROOT)), shlex.split(" ".join(text.split()))


PALPATE = [(where, ["palpate", *words[1:]]) for where, words in commands() if words[0].endswith("palpate")]
YAML = [(where, text) for where, language, text in blocks() if language == "yaml"]


def ids(given):
    return [f"{where} {' '.join(words)[:70]}" for where, words in given]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with the files that the pages mention."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    far = next(text for _, text in YAML if "10.0.0.2" in text)
    (tmp_path / "far.yaml").write_text(far)
    (tmp_path / "mine.yaml").write_text("extends: kidney\n")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "scene.yaml").write_text("extends: kidney\n")
    (tmp_path / "map").mkdir()
    (tmp_path / "map" / "scene.yaml").write_text("extends: nodule\n")
    press = [f"own,1,{0.1 * k:.1f},{5.0},{3e3 * (1e-4 * k) ** 1.5:.6g}" for k in range(40)]
    (tmp_path / "press.csv").write_text("\n".join(["subject,session,depth [mm],rate [mm/s],force [N]", *press]))
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs" / "kidney-rates.yaml").write_text("graph: kidney\nset: {friction.every: 10}\n")
    example = ROOT / "docs" / "examples" / "force_dimension.py"
    (tmp_path / example.name).write_text(example.read_text())
    for name, text in node_files("Liver", Load, Surface).items():
        (tmp_path / name).write_text(text)
    liver = surface_mesh("sphere", 600)  # [m]; the page's file is in mm
    Trimesh(1e3 * liver.vertices, liver.triangles).export(tmp_path / "liver.stl")
    return tmp_path


def parsed(words):
    """The options of a command. KeyError: unknown command; typer.BadParameter and similar: unknown option."""
    command, name, rest = COMMAND, "", [w for w in words[1:] if w not in ("--debug", "--help")]
    while isinstance(command, TyperGroup):
        if not rest:
            return {}
        name, *rest = rest
        command = command.commands[name]
    return command.make_context(name, rest).params


FITTED = "palpate run kidney --set scene.finger.band=true --set band.model"
"""This command reads, while it loads the graph, a file that the command before it on the page writes."""
LOADED = [(where, words) for where, words in PALPATE if not " ".join(words).startswith(FITTED)]


@pytest.mark.parametrize(("where", "words"), LOADED, ids=ids(LOADED))
def test_a_printed_command_exists_and_its_graph_loads(folder, where, words):
    given = parsed(words)
    if isinstance(given.get("graph"), str) and "sets" in given:
        place = given.get("place")
        scenes = given.get("scene")
        for scene in scenes or [None] if isinstance(scenes, list | tuple) else [scenes]:  # a page may have several
            run = choose_launch(given["graph"], given["sets"], scene, place)
            run.placement(run.plan())


def test_a_command_within_a_sentence_has_options_that_exist(folder):
    wrong = []
    for where, words in inline():
        try:
            parsed(words)
        except Exception as error:
            if type(error).__name__ != "MissingParameter":  # the sentence names only the command
                wrong.append(f"{where}: {' '.join(words)}: {error!r}")
    assert not wrong


@pytest.mark.parametrize("page", [page for page in PAGES if "palpate new" in page.read_text(encoding="utf-8")],
                         ids=lambda page: page.name)  # fmt: skip
def test_the_files_that_a_page_has_written_do_not_collide(page, tmp_path, monkeypatch):
    """`palpate new` twice with one name is an error of the second command."""
    monkeypatch.chdir(tmp_path)
    where = str(page.relative_to(ROOT))
    given = [words for at, words in [*PALPATE, *inline()] if at.partition(":")[0] == where and words[1:2] == ["new"]]
    for words in dict.fromkeys(tuple(words) for words in given if len(words) > 3):
        done = CliRunner().invoke(app, words[1:])
        assert done.exit_code == 0, f"{' '.join(words)}: {done.exception}"


@pytest.mark.parametrize(("where", "text"), YAML, ids=[where for where, _ in YAML])
def test_a_printed_yaml_block_loads(folder, where, text):
    """A graph, a scene, a launch file, a study, an experiment or a placement, recognised by its keys."""
    data = yaml.safe_load(text)
    (folder / "page.yaml").write_text(text)
    if "over" in data:
        load(folder / "page.yaml")
    elif "blocks" in data:
        Stimuli(*load_experiment(folder / "page.yaml"), folder / "page.yaml")
    elif list(data) == ["observer"]:
        load_observer(read(folder / "page.yaml").sub("observer"))
    elif "graph" in data:
        run = find("page.yaml")
        run.placement(run.plan())
    elif "nodes" in data or list(data) == ["effects"]:
        (folder / "page.yaml").write_text(text if "nodes" in data else f"extends: kidney\n{text}")
        find("page.yaml").plan()
    elif "extends" in data:
        find("kidney").but(scene=folder / "page.yaml").plan()
    elif all("use" in line for line in data.values()):
        (folder / "page.yaml").write_text(yaml.safe_dump({"extends": "kidney", "nodes": data}))
        find("page.yaml").plan()
    elif list(data) == ["folds"]:
        (folder / "page.yaml").write_text(f"extends: kidney\n{text}")
        assert "folds-tissue" in find("kidney").but(scene=folder / "page.yaml").plan().order
    elif list(data) == ["foundations"]:
        (folder / "page.yaml").write_text(f"extends: pinch\n{text}")
        find("pinch").but(scene=folder / "page.yaml").plan()
    elif list(data) == ["motions"]:
        names = {"liver": "upper", "spleen": "middle"}  # of the bodies of the graph stack
        own = re.sub("|".join(names), lambda name: names[name[0]], text)
        (folder / "page.yaml").write_text(f"extends: stack\n{own}")
        find("stack").but(scene=folder / "page.yaml").plan()
    else:
        load_place(folder / "page.yaml", find("kidney").plan())


def test_every_command_of_another_program_is_listed():
    other = [(where, words) for where, words in commands() if not words[0].endswith("palpate")]
    unknown = [f"{where}: {' '.join(w)}" for where, w in other if not any(" ".join(w).startswith(k) for k in OTHERS)]
    assert not unknown


def test_every_reason_is_still_needed():
    printed = [" ".join(words) for _, words in PALPATE]
    assert not [begin for begin in NOT_RUN if not any(text.startswith(begin) for text in printed)]


def skipped(words):
    return any(" ".join(words).startswith(begin) for begin in NOT_RUN)


RUN = {where.partition(":")[0] for where, words in PALPATE if not skipped(words)}


def serves_a_page(command):
    """Start it, wait for the address of its page, and press Ctrl-C."""
    quiet = {**os.environ, "BROWSER": "true"}  # `true` replaces the browser that it opens
    serving = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=quiet)
    output = ""
    for line in serving.stdout:
        output += line
        if "http://127.0.0.1" in line:
            serving.send_signal(signal.SIGINT)
    assert serving.wait(timeout=60) in (0, 130) and "http://127.0.0.1" in output and "Traceback" not in output, output


@pytest.mark.long
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("page", sorted(RUN))
def test_the_commands_of_a_page_run_in_order(folder, page):
    """Runs are shortened; FILE and the named recordings are those of a short touch."""
    python = [sys.executable, "-m", "palpate.cli"]
    touch = [
        "run",
        "kidney",
        "--fused",
        "-q",
        "--no-pictures",
        "--duration",
        "0.4",
        "--set",
        "scene.hand.begin=[0, 0, 0.107]",
    ]
    names = ("short.mcap", "FILE", "run.mcap", "touch.mcap", "kidney.mcap", "soft.mcap", "hard.mcap")
    subprocess.run([*python, *touch, "--record", names[0]], check=True, capture_output=True)
    for name in names[1:]:
        (folder / name).write_bytes((folder / names[0]).read_bytes())
    if page == "docs/fingertip.md":
        phantom_finger.write_dicom(phantom_finger.scan(), folder / "SCAN")
    if page == "docs/texture.md":
        strokes(folder / "stroke.csv", 14_000)
    # The commands after a measurement with devices read its recording.
    unmeasured = {where for where, words in PALPATE if words[1:3] == ["fit", "record"] and skipped(words)}
    for where, words in PALPATE:
        if where.partition(":")[0] != page or skipped(words) or where in unmeasured:
            continue
        if " ".join(words).startswith(PAGE_VERBS):
            serves_a_page([*python, *words[1:]])
            continue
        if words[1:3] == ["fit", "tissue"]:  # it overwrites no earlier fit
            (folder / "out" / "scene.yaml").unlink()
        if words[1] == "new":  # the other pages already have its files
            for name in node_files("Liver", Load, Surface):
                (folder / name).unlink()
        cut = ["-q", *(SHORT if "--record" not in words else SHORT[:2])] if words[1] == "run" else []
        words = [word.replace("900 ms", "300 ms") for word in words[1:]]
        ended = subprocess.run([*python, *words, *cut], capture_output=True, text=True)
        assert ended.returncode == 0, f"{where}: {' '.join(words)}\n{ended.stdout}{ended.stderr}"


def test_the_node_in_python_and_the_compiled_node_send_the_same_bytes(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    programs = [text for where, _, text in blocks() if where.startswith("docs/add_a_node.md") and "SlowDrag(" in text]
    sent = []
    for number, text in enumerate(programs):
        (tmp_path / f"slow_drag_{number}.py").write_text(text)
        bus = FakeBus(importlib.import_module(f"slow_drag_{number}").SlowDrag())
        speeds = np.random.default_rng(5).normal(size=(50, 3)).tolist()
        given = [Pose(position=(0.0, 0.0, 0.0), velocity=tuple(speed), dt=1e-3) for speed in speeds]
        sent.append([pack(message) for message in bus.publish(*given)])
        del sys.modules[f"slow_drag_{number}"]
    assert sent[0] == sent[1] and len(set(sent[0])) == 50
    assert len(programs[1].splitlines()) <= len(programs[0].splitlines()) <= 20


def errors_in(text):
    """RMS and largest force error [% of peak] in a text; (0, 0) if the force is the same."""
    found = re.search(r"force differs by ([\d.]+)%.*?([\d.]+)% at most", text, re.DOTALL)
    assert found or "same force" in text, text
    return tuple(map(float, found.groups())) if found else (0.0, 0.0)


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_the_page_on_effects_matches_the_output_of_the_command(folder):
    python = [sys.executable, "-m", "palpate.cli"]
    touch = [*python, "run", "kidney", "--fused", "-q", "--no-pictures", "--record", "kidney.mcap"]
    subprocess.run(touch, check=True, capture_output=True)
    asked = [*python, "plan", "kidney", "--ablate", "kidney.mcap", "--json"]
    reported = json.loads(subprocess.run(asked, check=True, capture_output=True).stdout)["costs"]
    proofs = {item["effect"]: item["proof"] for item in reported}
    (block,) = (text for where, _, text in blocks() if where.startswith("docs/effects.md") and "without it:" in text)
    printed = dict(re.findall(r"^(?:on|off) +(\w+)(.*?)(?=^o|\Z)", block, re.MULTILINE | re.DOTALL))
    assert set(printed) == {"friction", "relaxation", "shape", "energy"}
    for effect, text in printed.items():
        assert errors_in(text) == pytest.approx(errors_in(proofs[effect]), rel=0.05), effect
