"""Text of a file or of another program never controls the terminal."""

import ast
import io
import json
import os
from pathlib import Path

import pytest
from sources import nodes

import palpate.cli
from palpate.cli.terminal import output
from palpate.launch.run.notes import RunNote, warn
from palpate.physics.archive import replacing
from palpate.physics.errors import PalpateWarning

CLIPBOARD = "\x1b]52;c;ZXZpbA==\x07"  # xterm's OSC 52: write to the clipboard
RAW = {
    ("output.py", "typer.echo"): "of `write`, which shows them",
    ("__main__.py", "typer.echo"): "the version",
    ("kernels.py", "print"): "names of kernels of palpate, over one another",
}
"""Calls that write a text as it is, and why that is safe."""
CONTROLS = [chr(code) for code in (*range(0x20), *range(0x7F, 0xA0)) if chr(code) not in "\t\n\r"]


def printed(*things) -> str:
    out = output.console(file=io.StringIO(), width=200)
    for thing in things:
        out.print(thing)
    return out.file.getvalue()


def test_no_control_character_of_a_text_reaches_the_terminal(capsys):
    assert len(CONTROLS) == 62
    output.say(f"stream {CLIPBOARD}x")
    output.say(f"stream {CLIPBOARD}x", "red", err=True)
    said = "".join(capsys.readouterr())
    table = printed(output.table(("a", "b"), [(f"1{CLIPBOARD}", "".join(CONTROLS))], title=CLIPBOARD), CLIPBOARD)
    for character in CONTROLS:
        assert character not in said and character not in table
    assert "␛]52;c;ZXZpbA==" in said and "␛" in table


def test_no_control_character_of_a_json_text_reaches_the_terminal_and_none_is_lost(capsys):
    output.print_json({"note": "".join(CONTROLS)})
    shown = capsys.readouterr().out
    assert not any(character in shown for character in CONTROLS)
    assert json.loads(shown) == {"note": "".join(CONTROLS)}


def test_every_command_prints_by_the_functions_that_show_control_characters():
    """`typer.echo` and `print` write a text as it is."""
    found = []
    for file in sorted(Path(palpate.cli.__file__).parent.rglob("*.py")):
        for node in nodes(file):
            name = ast.unparse(node.func) if isinstance(node, ast.Call) else ""
            if name in ("print", "typer.echo", "typer.secho", "click.echo", "sys.stdout.write", "Console"):
                found.append((file.name, name))
    assert set(found) <= set(RAW), set(found) - set(RAW)
    assert set(RAW) <= set(found), "a reason that is no longer needed"


def test_the_notes_of_a_run_have_no_control_characters():
    """Python prints them as warnings, and a recording stores them."""
    note = RunNote(f"a{CLIPBOARD}b", "contact")
    assert str(note) == note.text == "a␛]52;c;ZXZpbA==␇b"
    with pytest.warns(PalpateWarning) as warned:
        warn([note])
    assert "\x1b" not in str(warned[0].message)


def test_styles_still_reach_a_terminal():
    out = output.console(file=io.StringIO(), force_terminal=True, color_system="standard")
    out.print("x", style="red")
    assert out.file.getvalue() == "\x1b[31mx\x1b[0m\n"


@pytest.mark.parametrize("cached", [False, True])
def test_a_temporary_file_is_never_a_link_of_another_user(tmp_path, cached):
    """Its name can be predicted, and another user may write to the folder."""
    target, victim = tmp_path / "table.csv", tmp_path / "victim"
    victim.write_text("mine")
    (tmp_path / f"table.csv.{os.getpid()}.part.csv").symlink_to(victim)
    with replacing(target, cached) as part:
        assert not part.is_symlink()
        part.write_text("new")
    assert target.read_text() == "new" and victim.read_text() == "mine" and not target.is_symlink()
