"""The public surface is small and stated: `__all__` of six packages, and the reference lists these names only."""

import inspect
import re
import runpy
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import palpate
import palpate.messages
import palpate.models.fe
import palpate.nodes
import palpate.physics

ROOT = Path(__file__).parents[1]
PACKAGES = [palpate, palpate.messages, palpate.nodes, palpate.physics, palpate.models.fe]
MOST = 250  # public names


def gym():
    return pytest.importorskip("palpate.gym", reason="gymnasium is missing", exc_type=ImportError)


def test_the_public_names_exist_once_in_their_package_and_are_few():
    packages = [*PACKAGES, gym()]
    for package in packages:
        assert len(set(package.__all__)) == len(package.__all__)
        for name in package.__all__:
            assert getattr(package, name) is not None
    assert sum(len(package.__all__) for package in packages) <= MOST


@pytest.mark.parametrize("name", palpate.physics.__all__)
def test_a_public_law_has_a_docstring(name):
    thing = getattr(palpate.physics, name)
    thing = getattr(thing, "py_func", thing)
    assert inspect.getdoc(thing) and thing.__doc__


def test_an_unknown_law_is_an_attribute_error_that_lists_the_laws():
    with pytest.raises(AttributeError, match=r"'palpate.physics' has no attribute 'hooke'; public: .*lugre"):
        palpate.physics.hooke  # noqa: B018


def test_the_reference_lists_the_public_names_only(monkeypatch):
    gym()
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "site"))
    import python

    page = python.public()
    for package in python.PACKAGES:
        prefix = re.escape(package.__name__)
        assert re.findall(rf"^## {prefix}\.(\w+)$", page, re.M) == list(package.__all__)
    found = [name for _, text in python.library() for name in re.findall(r"^### (\w+)$", text, re.M)]
    data = {name for name in palpate.physics.__all__ if not callable(getattr(palpate.physics, name))}
    assert sorted(found) == sorted(set(palpate.physics.__all__) - data)
    sys.modules.pop("python")


EXAMPLE = ROOT / "docs" / "examples" / "public_api.py"


def test_a_script_on_the_public_api_runs(tmp_path, monkeypatch, capsys):
    gym()
    monkeypatch.chdir(tmp_path)
    script = runpy.run_path(str(EXAMPLE))
    for part in ("touch", "many", "learn", "alone"):
        script[part]()
    assert "contact.force [N] 100" in capsys.readouterr().out


@pytest.mark.long
def test_pyright_reports_nothing_on_a_script_that_uses_the_public_api():
    """Kernels are skipped as a whole (nodes/base/kernels.py)."""
    pyright = shutil.which("pyright", path=str(Path(sys.executable).parent)) or shutil.which("pyright")
    if pyright is None:
        pytest.skip("pyright is not installed")
    done = subprocess.run([pyright, "--pythonpath", sys.executable, EXAMPLE], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
