"""The notebooks of the docs run completely and show figures."""

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from typer.testing import CliRunner

from palpate.cli.__main__ import app

nbformat = pytest.importorskip("nbformat")
nbclient = pytest.importorskip("nbclient")
pytest.importorskip("ipykernel")

FOLDER = Path(__file__).parents[2] / "docs" / "notebooks"


@pytest.mark.parametrize(
    "name",
    ["touch_a_kidney", pytest.param("own_material", marks=pytest.mark.long)],  # the long one: its cells, below
)
def test_a_notebook_runs(tmp_path, name, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    book = nbformat.read(FOLDER / f"{name}.ipynb", 4)
    book = nbclient.NotebookClient(book, timeout=600, resources={"metadata": {"path": str(tmp_path)}}).execute()
    outputs = [output for cell in book.cells for output in cell.get("outputs", [])]
    assert not any(output.output_type == "error" for output in outputs)
    assert any("image/png" in output.get("data", {}) for output in outputs)


@pytest.mark.long
def test_the_cells_of_a_notebook_run_in_this_process(tmp_path, monkeypatch):
    """Includes the command that one of them starts."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    commands, process = [], subprocess.run

    def run(command, **how):
        if command[:3] != [sys.executable, "-m", "palpate.cli"]:
            return process(command, **how)
        commands.append(command[3:5])
        done = CliRunner().invoke(app, command[3:])
        return SimpleNamespace(returncode=done.exit_code, stdout=done.stdout, stderr=done.stderr)

    monkeypatch.setattr(subprocess, "run", run)
    names: dict[str, object] = {}
    for cell in nbformat.read(FOLDER / "own_material.ipynb", 4).cells:
        if cell.cell_type == "code":
            exec(cell.source, names)
    assert commands == [["build", "basis"]]


def test_the_docs_have_two_notebooks():
    assert sorted(path.stem for path in FOLDER.glob("*.ipynb")) == ["own_material", "touch_a_kidney"]
