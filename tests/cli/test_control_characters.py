"""Text of a file or of another program never controls the terminal."""

import io
import os

import pytest

from palpate.cli.terminal import output
from palpate.physics.archive import replacing

CLIPBOARD = "\x1b]52;c;ZXZpbA==\x07"  # xterm's OSC 52: write to the clipboard
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
