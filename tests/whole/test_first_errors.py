"""The outputs in docs/first_errors.md are those of palpate: each command runs, and its output contains each line."""

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
def test_the_page_shows_the_printed_text(command, printed, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    alone = tempfile.TemporaryDirectory(
        prefix="p", dir="/tmp"
    )  # a short path, since socket paths are limited; separate from the runs of other tests
    monkeypatch.setenv("COLUMNS", "1000")
    with alone as folder:
        monkeypatch.setenv("XDG_RUNTIME_DIR", folder)
        result = CliRunner().invoke(app, shlex.split(command))
    output_text = result.output + (str(result.exception) if isinstance(result.exception, PalpateError) else "")
    assert result.exit_code != 0
    pattern = r".*".join(re.escape(part.strip()) for part in " ".join(printed.split()).split("..."))
    assert re.search(pattern, " ".join(output_text.split())), output_text


def test_the_page_has_ten_errors():
    assert len(re.findall(r"^## \d+\.", PAGE, re.MULTILINE)) == 10 and len(SHOWN) >= 8
