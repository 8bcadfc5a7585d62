"""docs/first_errors.md prints what palpate prints: each command is given, and each line looked for in the answer."""

import re
import shlex
import tempfile
from pathlib import Path

import pytest
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.physics.errors import PalpateError

PAGE = (Path(__file__).parents[2] / "docs" / "first_errors.md").read_text(encoding="utf-8")
SHOWN = re.findall(r"^```console\n\$ palpate (.*)\n((?:.|\n)*?)^```", PAGE, re.MULTILINE)


@pytest.mark.parametrize(("command", "printed"), SHOWN, ids=[command for command, _ in SHOWN])
def test_the_page_shows_what_is_printed(command, printed, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    alone = tempfile.TemporaryDirectory(prefix="p", dir="/tmp")  # a short name, as sockets have; no run of another test
    monkeypatch.setenv("COLUMNS", "1000")
    with alone as folder:
        monkeypatch.setenv("XDG_RUNTIME_DIR", folder)
        result = CliRunner().invoke(app, shlex.split(command))
    said = result.output + (str(result.exception) if isinstance(result.exception, PalpateError) else "")
    assert result.exit_code != 0
    pattern = r".*".join(re.escape(part.strip()) for part in " ".join(printed.split()).split("..."))
    assert re.search(pattern, " ".join(said.split())), said


def test_ten_are_shown():
    assert len(re.findall(r"^## \d+\.", PAGE, re.MULTILINE)) == 10 and len(SHOWN) >= 8
