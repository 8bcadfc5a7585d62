"""Every benchmark, study and drawing script can be loaded: its imports work. Drawing scripts explain themselves."""

import runpy
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FOLDERS = ("benchmarks", "benchmarks/measured", "docs/studies", "docs/pictures", "docs/examples")
SCRIPTS = [path for folder in FOLDERS for path in sorted((ROOT / folder).glob("*.py"))]
PICTURES = [path for path in SCRIPTS if path.parent.name == "pictures" and path.name != "target.py"]
PEERS = {"felupe", "pypardiso", "sksparse"}
"""Solvers that `benchmarks/fe.py` compares with; only it needs them."""


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_a_script_loads(path, monkeypatch):
    monkeypatch.setattr(sys, "path", [str(path.parent), *sys.path])
    before = set(sys.modules)
    try:
        runpy.run_path(str(path), run_name="loaded")
    except ModuleNotFoundError as error:
        if error.name not in PEERS:
            raise
        pytest.skip(f"{error.name} is not installed")
    finally:
        for name in set(sys.modules) - before:
            if getattr(sys.modules[name], "__file__", None) and Path(sys.modules[name].__file__).parent == path.parent:
                del sys.modules[name]  # short names such as `tables` belong to this folder only


@pytest.mark.parametrize("path", PICTURES, ids=lambda path: path.name)
def test_a_drawing_script_prints_its_help_and_makes_no_folder(path, monkeypatch, tmp_path, capsys):
    """The scripts took `--help` for the name of a folder."""
    monkeypatch.setattr(sys, "path", [str(path.parent), *sys.path])
    monkeypatch.setattr(sys, "argv", [str(path), "--help"])
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit, match=r"^0$"):
        runpy.run_path(str(path), run_name="__main__")
    assert "usage:" in capsys.readouterr().out and not list(tmp_path.iterdir())
