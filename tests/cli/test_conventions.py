"""Conventions of all commands: options, exit codes, and helpful messages."""

import ast
import io
import re
import shlex
import signal
import subprocess
import sys
import threading
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import typer
import yaml
import zmq
from rich.console import Console
from shell_text import unwrapped
from sources import nodes
from typer.core import TyperGroup
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.cli.terminal.group import SYNONYMS
from palpate.cli.terminal.output import table
from palpate.cli.terminal.run_summary import print_end
from palpate.launch.load.launchfile import find as find_graph
from palpate.launch.run.result import Result
from palpate.launch.run.wire import keys
from palpate.launch.run.work.process import join
from palpate.launch.template import node_files
from palpate.messages import Load, Surface
from palpate.physics.errors import ArgumentError, RunError
from palpate.studies.files import refuse
from palpate.views.run import Run

GOLDEN = Path(__file__).parents[1] / "golden" / "kidney.mcap"
ROOT = Path(__file__).parents[2]
TOP = typer.main.get_command(app)


def leaves(command, *names):
    """Name and click command of each command that is not a group."""
    if isinstance(command, TyperGroup):
        for name, sub in command.commands.items():
            yield from leaves(sub, *names, name)
    else:
        yield " ".join(names), command


LEAVES = dict(leaves(TOP))
MEANINGS = {
    "out": {"-o", "--out"}, "quiet": {"-q", "--quiet"}, "as_json": {"--json"}, "force": {"--force"},
    "no_pictures": {"--no-pictures"},
}  # fmt: skip
"""Names of the options that have the same function in all commands, see CONTRIBUTING.md."""
PEOPLE = {"touch", "view", "remote join"}
"""Commands without --json: servers of pages, and a worker."""


def say(*words: object):
    return CliRunner().invoke(app, [str(word) for word in words], env={"COLUMNS": "200"})


@pytest.mark.parametrize(
    "words",
    [
        ("echo", GOLDEN, "nothing"), ("echo", GOLDEN), ("export", GOLDEN, "--to", "nothing"),
        ("export", GOLDEN, "--to", "csv", "--stream", "nix"), ("picture", GOLDEN, "--film", "-o", "x.avi"),
        ("info", "none.mcap"),
        ("picture", "none.mcap", "--film"), ("picture", GOLDEN, "--at", "99"), ("picture", GOLDEN, "foo.bar"),
        ("picture", "none.mcap"), ("replay", GOLDEN, "--only", "foo"), ("compare", GOLDEN, "--set", "foo=1"),
    ],
)  # fmt: skip
def test_wrong_input_has_exit_code_2_in_every_command(words):
    assert say(*words).exit_code == 2


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("new", "graph", "mine", "--takes", "Load"), "--takes, --sends and --compiled are for a node"),
        (("new", "graph", "mine", "--compiled"), "--takes, --sends and --compiled are for a node"),
        (("fit", "record", "x.csv", "--subject", "A", "--session", "1", "--duration", "3 kg"), "expected a time"),
        (("fit", "record", "x.csv", "--subject", "A", "--session", "1", "--duration", "0.1"), "0.5 s to 1 h"),
        (("fit", "tissue", "x.csv", "--rig", "ball", "--radius", "8 kg", "--law", "hertz"), "--radius: found '8 kg'"),
        (("export", GOLDEN, "--to", "xls"), "gltf or mcap"),
        (("check", "mystudy.yaml"), "palpate study mystudy.yaml"),
        (("check", "myexperiment.yaml"), "palpate experiment myexperiment.yaml"),
    ],
)  # fmt: skip
def test_an_error_about_input_names_an_option_or_command_that_works(words, text, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for kind in ("study", "experiment"):
        assert say("new", kind, f"my{kind}").exit_code == 0
    printed = say(*words)
    assert printed.exit_code == 2 and text in unwrapped(printed.output), printed.output


def test_a_misspelt_class_has_one_suggestion():
    printed = say("list", "nodes", "deformation.MassSprng")
    assert printed.exit_code == 2 and printed.stderr.count("Did you mean") == 1


def test_the_word_of_another_program_suggests_the_command_with_this_meaning():
    """By similar spelling alone, `plot` suggested `export`."""
    for word, meant in (("plot", "picture"), *SYNONYMS.items()):
        printed = say(word, "x")
        assert printed.exit_code == 2 and word not in TOP.commands and meant in TOP.commands
        assert f"Did you mean '{meant}'?" in unwrapped(printed.output)
    assert "Did you mean 'replay'?" in say("repaly", "x").output


def test_the_help_fits_on_one_screen():
    """At most 24 commands in at most 7 groups of at most 8, one line each: 50 lines of 80 columns."""
    text = CliRunner().invoke(app, ["--help"], env={"COLUMNS": "80", "TERMINAL_WIDTH": "80"}).stdout
    assert len(text.rstrip().splitlines()) <= 50
    panels = [sub.rich_help_panel for sub in TOP.commands.values()]
    assert len(panels) <= 24 and len(set(panels)) <= 7 and max(panels.count(one) for one in panels) <= 8
    assert None not in panels and "--install-completion" not in text


@pytest.mark.parametrize("name", LEAVES)
def test_options_with_the_same_function_have_the_same_name(name):
    command = LEAVES[name]
    given = {param.name: {*param.opts, *param.secondary_opts} for param in command.params}
    for meaning, names in MEANINGS.items():
        assert given.get(meaning, names) == names
        assert not [own for own, has in given.items() if own != meaning and has & names]
    assert "as_json" in given or name in PEOPLE
    options = set().union(*given.values())
    assert not options & {"--output", "--folder", "--pictures", "--overwrite", "--silent"}
    assert "--to" not in options or name in ("export", "replay", "fit run")  # a format; the end of a replay


@pytest.mark.parametrize("name", LEAVES)
def test_the_help_of_each_command_has_a_valid_example(name):
    command = LEAVES[name]
    assert command.epilog and command.epilog.startswith(f"Example: palpate {name}"), command.epilog
    words = shlex.split(command.epilog.removeprefix(f"Example: palpate {name}"))
    assert command.make_context(name, words) is not None


def named_commands():
    """File and words after `palpate`, for each command in texts for users: pages, graphs, and strings of the code."""
    for path in sorted(ROOT.rglob("*")):
        here = path.relative_to(ROOT)
        if here.parts[0] in (".venv", ".git", "build", "tests", "runs") or here.is_relative_to("docs/decisions"):
            continue
        if path.is_dir() or path.is_symlink() or path.name == "CHANGELOG.md":
            continue
        if path.suffix == ".py":
            texts = [n.value for n in nodes(path) if isinstance(n, ast.Constant) and isinstance(n.value, str)]
        elif path.suffix in (".md", ".yaml", ".ipynb", ".html", ".js", ".sh", ".json"):
            texts = [path.read_text(encoding="utf-8")]
        else:
            continue
        for text in texts:
            for found in re.findall(r"(?:`|: +|\()palpate((?: [\w-]+)+)", text):
                yield str(here), found.split()


def test_every_command_that_is_named_in_a_text_exists():
    """Also in error messages. A word after a group that is not an option is a command of the group."""
    wrong, count = [], 0
    for where, words in named_commands():
        command, rest = TOP, [word for word in words if word != "--debug"]
        while isinstance(command, TyperGroup) and rest and not rest[0].startswith("-") and rest[0].islower():
            count += 1
            if rest[0] not in command.commands:
                wrong.append(f"{where}: palpate {' '.join(words[:3])}")
                break
            command, rest = command.commands[rest[0]], rest[1:]
    assert count > 300 and not wrong, (count, wrong)


def test_a_missing_scene_does_not_hide_other_errors(tmp_path):
    graph = yaml.safe_load(find_graph("kidney").graph.read_text())
    graph["scene"] = "kidny"
    graph["nodes"]["contact"]["foo"] = 1
    graph["nodes"]["tissue"]["use"] = "deformation.MassSprin"
    (tmp_path / "g.yaml").write_text(yaml.safe_dump(graph))
    for words in (["check", tmp_path / "g.yaml"], ["check", tmp_path / "g.yaml", "--scene", "frictionles"]):
        printed = say(*words)
        assert printed.exit_code == 2 and "not found" in printed.stderr
        assert "'MassSpring'" in printed.stderr and "setting 'foo': unknown" in printed.stderr
        assert "the scene has no" not in printed.stderr


def test_a_recording_is_rejected_as_a_graph_with_the_command_that_shows_it():
    printed = say("check", GOLDEN)
    assert printed.exit_code == 2 and "palpate info" in printed.stderr and "UTF-8" not in printed.stderr


@pytest.mark.parametrize(
    ("path", "words"),
    [("tissue.stiffness", "taken in N/m^n"), ("tissue.damping", "'6 s/m'"), ("scene.finger.thickness", "'6 mm'")],
)
def test_an_error_about_a_quantity_names_the_unit_of_the_setting(path, words):
    printed = say("check", "kidney", "--set", f"{path}=abc")
    assert printed.exit_code == 2 and words in printed.stderr
    assert ("6 mm" in printed.stderr) == (words == "'6 mm'")


def test_the_numbers_of_a_tissue_have_units():
    printed = say("list", "tissues", "liver-human").stdout
    assert "stiffness: 90.001 N/m^n" in printed and "young: 6653.79 Pa" in printed and "None" not in printed


@pytest.mark.parametrize("kind", ["graph", "scene", "study", "experiment"])
def test_new_writes_a_valid_file_and_overwrites_no_file(kind, tmp_path):
    printed = say("new", kind, "mine", "-o", tmp_path)
    file = tmp_path / "mine.yaml"
    assert printed.exit_code == 0 and str(file) in printed.stdout
    assert say("new", kind, "mine", "-o", tmp_path).exit_code == 2
    assert say("new", kind, "mine", "-o", tmp_path, "--force").exit_code == 0
    assert say("new", kind, "9 lives", "-o", tmp_path).exit_code == 2
    assert (
        "Did you mean"
        in say(
            "new", kind, "other", "--like", "kidny" if kind in ("graph", "scene") else "kidny-stiffness", "-o", tmp_path
        ).stderr
    )
    if kind == "graph":
        assert say("check", file).exit_code == 0 and find_graph(str(file)).record == Path("mine.mcap")
    elif kind == "scene":
        assert say("check", "kidney", "--scene", file).exit_code == 0
    elif kind == "study":
        from palpate.studies.sweeps.file import load

        assert len(load(file)) > 1
    else:
        from palpate.studies.psychophysics.file import load as load_experiment

        assert load_experiment(file)[0].task


def test_a_new_body_deforms_in_proportion_to_its_force(tmp_path):
    names: dict = {}
    exec(compile(node_files("Liver", Load, Surface)["liver.py"].replace("from __future__ import annotations", ""),
                 "liver.py", "exec"), names)  # fmt: skip
    body = names["Liver"](scale=2.0, stiffness=400.0)
    body.start()
    forces = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, -3.0]])
    load = Load(nodes=np.array([3, 5]), forces=forces, foot=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0))
    surface = body.step(load, dt=1e-3)
    assert surface.previous_indentation == pytest.approx(2.0 * 4.0 / 400.0)
    assert surface.displacement[:, 2] == pytest.approx([-0.02 / 3.0, -0.02])
    assert surface.stiffness * surface.previous_indentation == pytest.approx(4.0)  # the law that the contact solves


def test_quiet_prints_no_table(tmp_path):
    given = ["run", "kidney", "--fused", "--no-record", "--duration", "0.01"]
    loud, quiet = say(*given).stdout, say(*given, "-q").stdout
    assert "p99" in loud and "p99" not in quiet and "skipped" not in quiet and "10 ticks" in " ".join(quiet.split())


def test_headers_of_tables_break_only_between_words():
    heads = ("node that ran", ">messages", ">other than recorded", ">largest difference\n[% of peak]")
    rows = [("a-very-long-name-of-a-node-indeed", "123456", "1", "0.1")]
    for width in (50, 60, 80):
        console = Console(width=width, record=True, file=io.StringIO())
        console.print(table(heads, rows))
        words = set(console.export_text().split())
        assert {"messages", "recorded", "largest", "difference"} <= words, width


@pytest.mark.parametrize(("mark", "what"), [("study.json", "study"), ("dataset_description.json", "experiment")])
def test_a_folder_of_the_wrong_kind_is_rejected(mark, what, tmp_path):
    (tmp_path / mark).write_text("{}")
    with pytest.raises(ArgumentError, match=f"{what}.*--out"):
        refuse(tmp_path, mark, f"data of the {what}")
    words = ["experiment", "kidney-stiffness", "--simulate"] if what == "study" else ["study", "kidney-stiffness"]
    printed = say(*words, "-o", tmp_path)
    assert printed.exit_code == 2 and mark in printed.stderr and [file.name for file in tmp_path.iterdir()] == [mark]


def test_keys_lists_the_given_key(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    keys.make("mine"), keys.make("theirs")
    run = CliRunner().invoke
    assert "theirs" not in run(app, ["remote", "keys", "mine"]).stdout
    for name, expected in (("a/b", "expected a name of at most 100 letters"), ("third", "there is no key 'third'")):
        refused = run(app, ["remote", "keys", name])
        assert refused.exit_code and expected in refused.output + str(refused.exception)


@pytest.mark.parametrize("server", ["another key", "no key"])
def test_join_with_a_wrong_key_fails_at_once(server, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    keys.make("mine"), keys.make("theirs")
    with zmq.Context() as context, context.socket(zmq.PUB) as orders, context.socket(zmq.PULL) as reports:
        if server == "another key":
            for socket in (orders, reports):
                keys.load("theirs").secure(socket, server=True)
        port = 0
        while not port:
            port = orders.bind_to_random_port("tcp://127.0.0.1")
            try:
                reports.bind(f"tcp://127.0.0.1:{port + 1}")
            except zmq.ZMQError:
                orders.unbind(f"tcp://127.0.0.1:{port}")
                port = 0
        caught: list[Exception] = []

        def work() -> None:
            try:
                join(f"tcp://127.0.0.1:{port}", "far", 1000.0, keys.load("mine"))
            except RunError as error:
                caught.append(error)

        thread = threading.Thread(target=work, daemon=True)
        thread.start()
        thread.join(60.0)
        assert caught and "key" in str(caught[0]) and str(port) in str(caught[0])


def test_a_partly_emulated_graph_lists_the_devices_that_are_not_emulated():
    printed = say("check", "indentation", "--set", "device.port=emulator")
    assert printed.exit_code == 0 and "--set sensor.port=emulator" in printed.stderr
    both = say("check", "indentation", "--set", "device.port=emulator", "--set", "sensor.port=emulator")
    assert "sensor.port" not in both.stderr


def test_plot_returns_the_current_figure_of_pyplot():
    pyplot = pytest.importorskip("matplotlib.pyplot")
    figure = Run(GOLDEN).plot("contact.force")
    assert pyplot.gcf() is figure
    pyplot.close(figure)


@pytest.mark.parametrize("stopped", [False, True])
def test_pictures_are_announced_and_skipped_after_ctrl_c(stopped, tmp_path, monkeypatch, capsys):
    drawn = []
    monkeypatch.setattr(
        "palpate.views.pictures.draw_pictures", lambda file, folder, warn, done: done(0.0) or drawn.append(file) or []
    )
    file = tmp_path / "run.mcap"
    file.touch()
    plan = SimpleNamespace(graph=SimpleNamespace(notes=(), rate=1000.0), skipped={})
    result = Result(ticks=5, signal=signal.SIGINT if stopped else 0)
    print_end(SimpleNamespace(result=result, plan=plan, recording=file, verdict=None, lacking="", placed=""), "kidney",
          tmp_path, False, False)  # fmt: skip
    output_text = " ".join("".join(capsys.readouterr()).split())
    assert drawn == ([] if stopped else [file]) and ("drawing the pictures" in output_text) is not stopped
    assert ("no pictures: interrupted; palpate picture" in output_text) is stopped


def test_touch_records_only_sources_unless_all_is_requested(monkeypatch):
    asked = []
    monkeypatch.setattr("palpate.views.page.session.Session", lambda *given: asked.append(given[3]) or SimpleNamespace(
        kept=[], troubles=[]))  # fmt: skip
    monkeypatch.setattr("palpate.cli.commands.running.touch.show", lambda *given: None)
    assert say("touch").exit_code == 0 and say("touch", "--record-only", "all").exit_code == 0
    assert asked == ["sources", "all"]


def test_notes_of_the_live_view_are_not_repeated_at_the_end(capsys):
    graph = SimpleNamespace(notes=(), rate=1000.0)
    result = Result(
        notes=["the hand feels a softer one", "a priority was refused"], live={"the hand feels a softer one"}
    )
    plan = SimpleNamespace(graph=graph, skipped={})
    print_end(SimpleNamespace(result=result, plan=plan, recording=None, verdict=None), "kidney", None, False, False)
    output_text = capsys.readouterr().out
    assert "a priority was refused" in output_text and "softer" not in output_text


def groups(command, *names):
    """Words and click command of each group."""
    yield names, command
    for name, sub in command.commands.items():
        if isinstance(sub, TyperGroup):
            yield from groups(sub, *names, name)


@pytest.mark.parametrize(("names", "command"), list(groups(TOP)))
def test_the_help_of_a_group_prints_the_texts_of_its_commands(names, command, monkeypatch):
    """Its table is made of commands without parameters. Here it is compared with the help of the complete commands."""
    printed = say(*names, "--help").stdout
    monkeypatch.setattr(type(command.commands), "rows", lambda commands: commands)
    assert say(*names, "--help").stdout == printed
    assert all(name in printed for name in command.commands)


def test_the_deferred_classes_of_the_help_are_those_of_rich():
    """Also in a process where the library that formats help is imported first."""
    code = (
        "import sys; from palpate.cli.terminal.formatter import import_formatter; import_formatter()\n"
        "from typer import rich_utils as of; assert not {'rich.markdown', 'rich.traceback'} & set(sys.modules)\n"
        "text = of._make_rich_text(text='*a*', markup_mode='markdown')\n"
        "try: 1 / 0\n"
        "except ZeroDivisionError as error: shown = of.Traceback.from_exception(type(error), error, None)\n"
        "from rich.markdown import Markdown; from rich.traceback import Traceback\n"
        "print(type(text) is Markdown, type(shown) is Traceback)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout.split() == ["True", "True"], done.stderr
