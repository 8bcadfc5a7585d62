"""A recording is data: opening it imports only modules of palpate and those that the user trusts."""

import os
import sys
from pathlib import Path

import pytest
import warm_fork_server
from short_touch import QUICK
from typer.testing import CliRunner

import palpate
from palpate.cli.__main__ import app
from palpate.engine import imports
from palpate.messages import Contact, Message
from palpate.nodes.base import Node
from palpate.records.reader import Recording
from palpate.records.stored import RecordingError

MODULE = """
from typing import Annotated
from palpate.messages import Contact, Message
from palpate.nodes.base import Node
from palpate.nodes.deformation import Rigid

class Grip(Message):
    \"\"\"How hard it is held.

    force  [N]  ()
    \"\"\"
    force: Annotated[float, "N"]

class Organ(Rigid):
    \"\"\"A custom body.\"\"\"

class Holder(Node):
    \"\"\"A custom node.\"\"\"
    def step(self, contact: Contact) -> Grip:
        return Grip(force=contact.force)
"""
GRAPH = """
extends: kidney
nodes:
  tissue: {use: innocent.Organ}
  grip: {use: innocent.Holder, in: {contact: contact}}
"""
MARK = "open({!r}, 'w').close()\n"


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A recording with classes of a module `innocent` in its folder, which was imported in another process."""
    folder = tmp_path_factory.mktemp("trust")
    (folder / "innocent.py").write_text(MODULE)
    (folder / "mine.yaml").write_text(GRAPH)
    sets = [part for item in QUICK for part in ("--set", item)]
    run = ["run", "mine.yaml", "--fused", "--duration", "0.05", *sets, "--record", "run.mcap"]
    with open(folder / "printed", "w") as printed:
        assert (
            warm_fork_server.palpate(run, cwd=folder, env=dict(os.environ), stdout=printed, stderr=printed).wait() == 0
        )
    (folder / "innocent.py").write_text(MARK.format(str(folder / "was imported")) + MODULE)
    return folder


@pytest.fixture
def here(recorded, monkeypatch):
    monkeypatch.chdir(recorded)
    monkeypatch.setattr(sys, "path", [entry for entry in sys.path if entry])
    monkeypatch.delitem(sys.modules, "innocent", raising=False)
    (recorded / "was imported").unlink(missing_ok=True)
    yield recorded
    sys.modules.pop("innocent", None)
    imports.trust_only(())


def say(*arguments):
    result = CliRunner().invoke(app, [str(a) for a in arguments], env={"COLUMNS": "300", "NO_COLOR": "1"})
    assert "Traceback" not in result.output
    return result.exit_code, result.stdout, result.stderr


COMMANDS = [
    ["replay", "run.mcap", "--check"],
    ["replay", "run.mcap"],
    ["replay", "run.mcap", "--set", "contact.every=1"],
    ["compare", "run.mcap", "--set", "scene.tissue.stiffness=300", "--no-pictures"],
    ["echo", "run.mcap", "grip"],
    ["export", "run.mcap", "--to", "csv", "--out", "tables"],
    ["picture", "run.mcap", "grip.force"],
    ["view", "run.mcap", "--no-open"],
]


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: " ".join(command[:1] + command[2:4]))
def test_no_command_imports_what_a_recording_names(here, command):
    code, _, printed = say(*command)
    assert code != 0
    assert "'innocent': not part of palpate" in printed and "--trust innocent" in printed
    assert not (here / "was imported").exists()
    assert str(here) not in sys.path


def test_a_picture_of_a_custom_body_shows_the_organ_of_the_collision_node_without_importing_the_body(here):
    code, _, _ = say("picture", "run.mcap", "--at", "0.03")
    assert code == 0 and not (here / "was imported").exists()


def test_commands_that_need_no_foreign_class_do_not_import_it(here):
    assert say("info", "run.mcap")[0] == 0
    assert say("echo", "run.mcap", "contact", "-n", "1")[0] == 0
    assert say("export", "run.mcap", "--to", "csv", "--stream", "contact", "--out", "contacts")[0] == 0
    assert say("export", "run.mcap", "--to", "mcap", "--out", "again.mcap")[0] == 0
    assert len(palpate.open("run.mcap").contact.force) == 50
    assert not (here / "was imported").exists()


def test_a_package_that_the_user_trusts_is_imported(here):
    code, out, printed = say("replay", "run.mcap", "--check", "--trust", "innocent")
    assert code == 0, printed
    assert "bit-equal" in out and (here / "was imported").exists()
    sys.modules.pop("innocent")
    code, _, printed = say("replay", "run.mcap", "--check")  # it was trusted in that call only
    assert code == 2 and "--trust innocent" in printed


def test_a_given_graph_names_the_trusted_packages(here):
    code, _, printed = say("replay", "run.mcap", "--graph", "mine.yaml", "--set", "tissue.use=innocent.Organ")
    assert code == 0, printed


def test_in_python_a_package_is_imported_first_or_trusted(here):
    with pytest.raises(palpate.PalpateError, match="--trust innocent"):
        palpate.open("run.mcap").grip.force  # noqa: B018
    assert len(palpate.open("run.mcap", trust=["innocent"]).grip.force) == 50


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("palpate.records.fill.recover", Node),
        ("palpate.engine.provenance.platform", Node),
        ("palpate.messages.Contact", Node),
        ("palpate.nodes.contact.Series", Message),
        ("os.system", Node),
    ],
)
def test_a_class_that_is_neither_node_nor_message_is_an_error(name, kind):
    with pytest.raises(ImportError, match=r"is not a (Node|Message)"):
        imports.recorded_class(name, kind)


def test_a_class_below_palpate_is_found():
    assert imports.recorded_class("palpate.messages.contact.Contact", Message) is Contact


def test_a_stream_names_its_missing_class(here):
    with pytest.raises(RecordingError, match=r"stream 'grip' contains innocent\.Grip: 'innocent'.*other streams"):
        list(Recording(Path("run.mcap")).messages("grip"))
