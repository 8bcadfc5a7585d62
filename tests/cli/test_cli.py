"""The command line: output, exit codes, and errors without traceback."""

import json
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest
import typer
from rich.text import Text
from typer.testing import CliRunner

from palpate.cli import commands
from palpate.cli.__main__ import app
from palpate.cli.machine import diagnostics
from palpate.drivers import discover
from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.records.reader import Recording

runner = CliRunner()


def run(*args):
    return runner.invoke(app, [str(a) for a in args], env={"COLUMNS": "200", "NO_COLOR": "1"})


def json_output(*args):
    """Exit code and JSON output of a command."""
    result = run(*args, "--json")
    return result.exit_code, json.loads(result.stdout)


def test_the_version_is_that_of_the_package():
    assert run("--version").stdout.strip() == f"palpate {version('palpate')}"


def test_the_help_lists_the_commands():
    text = run("--help").stdout
    for verb in ("check", "plan", "list", "doctor", "new"):
        assert verb in text
    assert run().exit_code == 2


def test_each_file_below_commands_is_one_short_command():
    folder = Path(commands.__file__).parent

    def verbs(command):
        for name, sub in getattr(command, "commands", {}).items():
            yield from verbs(sub) if hasattr(sub, "commands") else [name.replace("-", "_")]

    files = [file for file in folder.rglob("*.py") if file.stem != "__init__"]
    assert sorted(verbs(typer.main.get_command(app))) == sorted(file.stem for file in files)
    assert {file: n for file in files if (n := len(file.read_text(encoding="utf-8").splitlines())) > 120} == {}


def test_brackets_in_printed_text_are_not_markup(monkeypatch):
    hint = "TypeError: needs list[int], pip install 'lab[usb]'"
    monkeypatch.setattr("palpate.launch.load.classes.catalogue", lambda: ((), {"lab": hint}))
    assert run("list", "nodes").stdout.strip() == f"lab cannot be loaded. {hint}"


@pytest.mark.parametrize(
    ("printed", "args"),
    [
        ("--thin: found 'contact=²'", ("run", "kidney", "--fused", "--no-pictures", "--thin", "contact=²")),
        ("address: found 'tcp://host:²'", ("remote", "join", "tcp://host:²", "loop")),
    ],
)
def test_a_unicode_digit_is_rejected_with_the_name_of_the_option(tmp_path, monkeypatch, printed, args):
    monkeypatch.chdir(tmp_path)
    refused = run(*args)
    assert refused.exit_code == 2 and printed in refused.stderr


def test_the_help_shows_its_texts_completely():
    """rich would interpret units in brackets, such as [s] at the start of a text, as styles and drop them."""

    def texts(command):
        yield command.help or ""
        yield command.epilog or ""
        yield from (option.help or "" for option in command.params if hasattr(option, "help"))
        for sub in getattr(command, "commands", {}).values():
            yield from texts(sub)

    every = [text for text in texts(typer.main.get_command(app)) if text]
    assert len(every) > 100
    assert [text for text in every if Text.from_markup(text).plain != text] == []


def test_check_accepts_a_valid_graph(whole):
    result = run("check", whole)
    assert result.exit_code == 0
    assert "ok" in result.stdout and "nodes 9" in result.stdout and "(2 held)" in result.stdout
    code, data = json_output("check", whole, "--fused")
    assert code == 0 and data["ok"] and data["processes"] == 1


def test_check_lists_all_errors_of_a_graph_without_traceback(whole):
    result = run("check", whole, "--set", "tissue.stifness=3", "--set", "rat=1")
    assert result.exit_code == 2 and result.stdout == ""
    assert "Did you mean 'stiffness'" in result.stderr and "2 faults" in result.stderr
    assert "Traceback" not in result.stderr
    code, data = json_output("check", whole, "--set", "tissue.stifness=3", "--set", "rat=1")
    assert code == 2 and not data["ok"] and len(data["faults"]) == 2
    assert {f["setting"] for f in data["faults"]} == {"", "stifness"}


def test_check_includes_the_placement(whole, write):
    place = write("place.yaml", "a: {nodes: [nera]}\n")
    result = run("check", whole, "--place", place)
    assert result.exit_code == 2 and "Did you mean 'near'" in result.stderr


def test_debug_prints_the_traceback(whole):
    result = run("--debug", "check", whole, "--set", "rat=1")
    assert type(result.exception).__name__ == "GraphError"


@pytest.mark.parametrize("args", [["check", "nowhere"], ["plan", "kidny"], ["plan", "x", "--scene", "nowhere"]])
def test_missing_files_and_graphs_are_reported(args):
    result = run(*args)
    assert result.exit_code == 2 and "not found" in result.stderr and "Shipped" in result.stderr


def test_wrong_usage_ends_with_exit_code_2(whole):
    assert run("plan").exit_code == 2
    assert run("plan", whole, "--drow").exit_code == 2
    assert run("plam", whole).exit_code == 2
    assert run("plan", whole, "-o", "x.mmd").exit_code == 2


def test_plan_lists_running_nodes_and_the_reason_for_the_others(whole):
    result = run("plan", whole, "--set", "scene.tissue.friction=off")
    assert result.exit_code == 0
    lines = [line.split() for line in result.stdout.splitlines() if line.strip()]
    assert [line[1] for line in lines if line[0] == "run"][:3] == ["device", "finger", "near"]
    skipped = next(line for line in lines if line[0] == "skip")
    assert skipped[1] == "friction" and "tissue.friction is false" in " ".join(skipped)
    assert "~tissue" in result.stdout and "every" not in result.stdout
    assert "graph_nodes.Spring, every 10" in run("plan", whole, "--set", "tissue.every=10").stdout


def test_plan_as_json(whole, write):
    place = write("place.yaml", "a: {nodes: [near, contact], core: 1}\n")
    code, data = json_output("plan", whole, "--place", place)
    assert code == 0 and data["order"][0] == "device"
    group = {"name": "a", "nodes": ["near", "contact"], "core": [1], "priority": None, "host": None, "why": ""}
    assert data["groups"][0] == group


def test_list_shows_the_ports_and_units_of_a_node_class():
    result = run("list", "nodes", "graph_nodes.Near")
    for word in ("The nearest point", "pose", "Pose", "drives", "Proximity", "offset", "count", ">= 1"):
        assert word in result.stdout
    code, data = json_output("list", "nodes", "graph_nodes.Needy")
    assert code == 0
    assert data["settings"] == [
        {"name": "mass", "unit": "kg", "type": "float", "limits": "", "default": None, "required": True}
    ]
    result = run("list", "nodes", "graph_nodes.Neer")
    assert result.exit_code == 2 and "Did you mean 'Near'" in result.stderr


def test_the_catalogue_lists_every_shipped_class():
    code, data = json_output("list", "nodes")
    assert code == 0
    for entry in data["nodes"]:
        assert entry["about"], f"{entry['use']} has no docstring"
        for setting in entry["settings"]:
            assert setting["unit"] and "typing" not in setting["type"]


def test_list_shows_the_effects_of_a_node_class():
    text = run("list", "nodes", "deformation.BeamBundle").stdout
    rows = [line.split() for line in text[text.index("switched by") :].splitlines()[1:] if line]
    assert ["nodule", "nodule_radius,", "off", "at", "0"] in rows
    assert any(row[:3] == ["pressure", "part", "pressure"] for row in rows)
    assert any(row[:7] == ["shape", "part", "(also", "for", "pressure)", "nodes,", "displacement"] for row in rows)
    code, data = json_output("list", "nodes", "deformation.BeamBundle")
    assert code == 0
    found = {(e["effect"], e["how"], e["setting"], e["off"], *e["fields"]) for e in data["effects"]}
    assert found == {
        ("deformation", "node", None, None),
        ("pressure", "part", None, None, "pressure"),
        ("shape", "part", None, None, "nodes", "displacement"),
        ("nodule", "setting", "nodule_radius", 0.0),
        ("relaxation", "setting", "relaxations", 0.0),
    }
    assert "switched by" not in run("list", "nodes", "kinematics.FalconStatics").stdout


def test_the_catalogues_of_nodes_and_of_effects_agree():
    nodes, effects = json_output("list", "nodes")[1]["nodes"], json_output("list", "effects")[1]["effects"]
    computed, shown = {}, {}
    for node in nodes:
        names = {setting["name"] for setting in node["settings"]}
        for effect in node["effects"]:
            assert (effect["setting"] in names) == (effect["how"] == "setting") == (effect["off"] is not None)
            use = node["use"] + f", {effect['setting']}" * (effect["how"] == "setting")
            computed.setdefault(effect["effect"], set()).add(use)
            shown.setdefault(effect["effect"], set()).update(effect["fields"])
    assert computed == {row["effect"]: set(row["computed_by"]) for row in effects}
    assert shown == {row["effect"]: set(row["shown_by"]) for row in effects}


def test_a_setting_with_choices_lists_them():
    code, data = json_output("list", "nodes", "tactile.Flow")
    assert code == 0 and data["settings"][0]["type"] == "steel or silicone"


def test_messages_have_units_and_shapes():
    result = run("list", "messages", "Contact")
    assert "compression_rate" in result.stdout and "[m/s]" in result.stdout and "(3)" in result.stdout
    code, data = json_output("list", "messages")
    assert code == 0 and {"Message", "Surface"} <= {m["name"] for m in data["messages"]}
    result = run("list", "messages", "Contakt")
    assert result.exit_code == 2 and "Did you mean 'Contact'" in result.stderr


def test_new_writes_a_node_with_a_test_that_passes(tmp_path):
    ports = {
        "my drag": [],
        "my body": ["--takes", "Load", "--sends", "Surface"],
        "my hand": ["--takes", "DeviceState", "--sends", "Load"],
        "my force": ["--compiled"],
        "my load": ["--compiled", "--takes", "Force", "--sends", "Load"],
        "my tissue": ["--compiled", "--takes", "Load", "--sends", "Surface"],
    }
    for name, args in ports.items():
        result = run("new", "node", name, "-o", tmp_path, *args)
        word = name.removeprefix("my ")
        assert result.exit_code == 0 and f"my_{word}.My{word.title()}" in result.stdout
    files = sorted(path.name for path in tmp_path.glob("test_*.py"))
    assert files == [f"test_my_{name}.py" for name in ("body", "drag", "force", "hand", "load", "tissue")]
    command = [sys.executable, "-m", "pytest", "-q", *files]
    test = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert test.returncode == 0, test.stdout
    again = run("new", "node", "MyDrag", "-o", tmp_path)
    assert again.exit_code == 2 and "exists" in again.stderr


@pytest.mark.parametrize("installed", [True, False])
def test_new_prints_the_command_for_the_test_of_a_node(installed, tmp_path, monkeypatch):
    monkeypatch.setattr("palpate.cli.commands.graphs.new.find_spec", lambda name: object() if installed else None)
    command = f"python -m pytest {tmp_path / 'test_my_drag.py'};"
    expected = command if installed else f"python -m pip install pytest && {command}"
    assert f"Next:  {expected}" in run("new", "node", "MyDrag", "-o", tmp_path).stdout


def test_a_new_node_passes_the_check_of_a_graph(tmp_path, whole, monkeypatch):
    run("new", "node", "Mine", "-o", tmp_path, "--takes", "Load", "--sends", "Surface")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    assert run("check", whole, "--set", "tissue.use=mine.Mine", "--set", "tissue.with=null").exit_code == 0


@pytest.mark.parametrize(
    ("node", "takes", "sends", "sets"),
    [
        ("tissue", "Load", "Surface", []),
        ("spread", "Contact", "Load", ["spread.in.friction=null"]),
        ("friction", "Contact", "Friction", ["friction.in.proximity=null"]),
        ("contact", "Proximity", "Contact", ["contact.in.body=null", "wanted=[controller]"]),
        ("collision", "Pose", "Proximity", []),
        (
            "controller",
            "Contact",
            "Force",
            [f"controller.in.{port}=null" for port in ("friction", "pose", "ledger", "device")],
        ),
        ("statics", "Force", "Torque", ["statics.in.pose=null"]),
    ],
)
@pytest.mark.parametrize("form", [[], pytest.param(["--compiled"], marks=pytest.mark.long)], ids=["python", "compiled"])
def test_a_new_node_can_replace_each_node_of_the_kidney(tmp_path, monkeypatch, node, takes, sends, sets, form):
    run("new", "node", "Mine", "-o", tmp_path, "--takes", takes, "--sends", sends, *form)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.delitem(sys.modules, "mine", raising=False)
    swap = [f"{node}.use=mine.Mine", "scene.surface.vertices=600", *sets]
    outcome = execute(find("kidney").but(place="fused", duration=0.02, overrides=swap))
    assert outcome.ok and outcome.result.ticks == 20


QUICK = ["--fused", "-q", "--set", "scene.surface.vertices=600", "--set", "scene.hand.begin=[0, 0, 0.107]"]


def test_a_custom_graph_is_recorded_and_its_pictures_are_next_to_the_recording(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.yaml").write_text("extends: kidney\nnodes: {tissue: {stiffness: 2e3}}\n")
    few = ["--set", "log.in=[contact, collision]"]  # whose pictures are soon drawn
    assert run("run", "mine.yaml", "--duration", "0.05", *QUICK, *few).exit_code == 0
    (folder,) = (tmp_path / "runs").iterdir()
    assert {"mine.mcap", "compression.png"} <= {file.name for file in folder.iterdir()}
    assert run("run", "kidney", "--duration", "0.05", *QUICK, *few, "--record", "here/x.mcap").exit_code == 0
    assert {"x.mcap", "compression.png"} <= {file.name for file in (tmp_path / "here").iterdir()}
    assert len(list((tmp_path / "runs").iterdir())) == 1


def test_a_failed_start_leaves_no_folder_and_deletes_no_other_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    failing = ["--fused", "-q", "--set", "bad.how=start raise"]
    (tmp_path / "g.yaml").write_text(
        "nodes:\n  src: {use: nodes_that_misbehave.Source}\n  bad: {use: nodes_that_misbehave.Bad, in: {pose: src}}\n"
        "  log: {use: logger.Mcap, in: all}\n"
    )
    ended = run("run", "g.yaml", "--duration", "0.1", "--out", "a/b", *failing)
    assert ended.exit_code == 1 and not (tmp_path / "a").exists()
    (tmp_path / "kept.mcap").touch()
    assert run("run", "g.yaml", "--duration", "0.1", "--record", "kept.mcap", *failing).exit_code == 1
    assert (tmp_path / "kept.mcap").exists()


def test_a_recording_of_few_streams_starts_and_a_failed_start_prints_one_line(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    few = ["--set", "log.in=[contact, controller]", "--out", "out"]
    assert run("run", "kidney", "--duration", "0.05", *QUICK, *few).exit_code == 0
    assert set(Recording(tmp_path / "out" / "kidney.mcap").streams) == {"contact", "controller"}
    (tmp_path / "half.py").write_text(
        "from palpate.nodes.logger import Mcap\n\n\nclass Half(Mcap):\n"
        "    def start(self):\n        raise ValueError('half way')\n\n"
        "    def stop(self):\n        self.never_made.close()\n"
    )
    ended = run("run", "kidney", "--duration", "0.05", *QUICK, "--set", "log.use=half.Half", "--out", "out2")
    assert ended.exit_code == 1 and "ValueError: half way" in ended.stderr and "never_made" not in ended.stderr


def test_required_fields_of_a_message_are_marked():
    lines = run("list", "messages", "Friction").stdout.splitlines()
    assert any(line.startswith("* force") for line in lines) and any(line.startswith("  stored") for line in lines)
    _, data = json_output("list", "messages", "Friction")
    assert [f["name"] for f in data["messages"][0]["fields"] if f["required"]] == ["force", "bristle", "stick"]


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["1st"], ["'1st' cannot name a class"]),
        (["--", "-"], ["cannot name a class"]),
        (["Mine", "--takes", "Lod"], ["'Lod'", "Did you mean 'Load'"]),
        (["Mine", "--compiled", "--takes", "Health"], ["Health.state: a compiled node cannot hold str", "in Python"]),
    ],
)
def test_an_invalid_name_or_kind_of_a_new_node_is_rejected(tmp_path, args, words):
    result = run("new", "node", "-o", tmp_path, *args)
    assert result.exit_code == 2
    for word in words:
        assert word in result.stderr
    assert not list(tmp_path.iterdir())


def test_doctor_measures_the_machine():
    code, data = json_output("doctor", "--no-pictures", "--seconds", "0.2")
    findings = {f["what"]: f for f in data["diagnostics"]}
    assert code == 0 and data["ok"]
    assert {"python", "pyzmq", "extra view", "kernels", "cores", "SCHED_RR", "locked memory", "wake-ups"} <= set(
        findings
    )
    assert "p99.9" in findings["wake-ups"]["found"]
    assert "ZeroMQ" in findings["pyzmq"]["found"]
    for finding in findings.values():
        assert finding["state"] == "ok" or finding["cure"]


def test_doctor_finds_a_device(tmp_path, monkeypatch):
    monkeypatch.setattr(discover, "USB", tmp_path)
    assert [f.found for f in diagnostics._usb()] == ["none on USB"]
    folder = tmp_path / "1-1"
    folder.mkdir()
    for name, text in {"idVendor": "0403", "idProduct": "cb48", "busnum": "999", "devnum": "7"}.items():
        (folder / name).write_text(f"{text}\n")
    (finding,) = diagnostics._usb()
    assert finding.what == "Novint Falcon"
    if "devices" not in finding.cure or "pip" not in finding.cure:
        assert "/dev/bus/usb/999/007" in finding.found and "--install-udev" in finding.cure


def test_doctor_fails_if_a_required_package_is_missing(monkeypatch):
    monkeypatch.setattr(diagnostics, "package_version", lambda name: None if name == "msgspec" else "1.0")
    result = run("doctor", "--no-pictures", "--seconds", "0")
    assert result.exit_code == 1 and "pip install msgspec" in result.stdout


def test_doctor_runs_without_the_packages_that_it_checks():
    words = "sys.argv[1:] = ['doctor', '--no-pictures', '--seconds', '0']"
    gone = "sys.modules |= dict.fromkeys(['msgspec', 'numpy'])"
    code = f"import sys; {gone}; {words}; from palpate.cli.__main__ import main; main()"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert "msgspec" in done.stdout and done.stderr == "" and done.returncode == 0


def test_an_unexpected_exception_is_printed_in_one_line(monkeypatch, whole):
    def burst(self):
        raise RuntimeError("the pipe burst")

    monkeypatch.setattr("palpate.launch.load.launchfile.LaunchFile.plan", burst)
    result = run("check", whole)
    assert result.exit_code == 1
    assert "RuntimeError: the pipe burst" in result.stderr and "--debug" in result.stderr
    assert "Traceback" not in result.stderr
