"""palpate without its repository: the wheel in environments of its own, with nothing but what it asks for.

What these tests install comes from the package index; where none can be reached they are skipped.
"""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from palpate.launch.load.extras import EXTRAS

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
pytestmark = [pytest.mark.long, pytest.mark.timeout(1200)]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    subprocess.run(["git", "clone", "-q", str(ROOT), str(folder / "clone")], check=True)
    built = subprocess.run(
        [sys.executable, "-m", "build", "--outdir", str(folder), str(folder / "clone")], capture_output=True, text=True
    )
    if built.returncode:
        pytest.skip(f"cannot be built here: {built.stderr[-300:]}")
    return next(folder.glob("*.whl"))


@pytest.fixture
def install(wheel, tmp_path):
    """Make an environment with the wheel; returns its folder."""

    def make(extra="", more=()):
        subprocess.run([sys.executable, "-m", "venv", str(tmp_path / "env")], check=True)
        what = f"palpate{f'[{extra}]' if extra else ''} @ {wheel.as_uri()}"
        pip = [str(tmp_path / "env/bin/python"), "-m", "pip", "install", "--only-binary", ":all:", *more, what]
        done = subprocess.run(pip, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr[-2000:]
        return tmp_path / "env"

    return make


def palpate(env, folder, *words):
    """A command in an environment that knows nothing but its own programs: no compiler, no git."""
    folder.mkdir(exist_ok=True)
    return subprocess.run(
        [str(env / "bin/palpate"), *words], cwd=folder, capture_output=True, text=True,
        env={"PATH": str(env / "bin"), "HOME": str(folder), "COLUMNS": "200"},
    )  # fmt: skip


def touches_a_kidney(env, folder):
    done = palpate(env, folder, "run", "kidney", "--fused", "--duration", "0.4", "--record", "touch.mcap")
    assert done.returncode == 0, done.stdout + done.stderr
    checked = palpate(env, folder, "replay", "touch.mcap", "--check")
    assert checked.returncode == 0, checked.stdout + checked.stderr
    return done.stdout + done.stderr


def test_in_an_empty_folder_it_touches_a_kidney_and_says_how_to_get_pictures(install, tmp_path):
    env = install()
    said = touches_a_kidney(env, tmp_path / "empty")
    assert 'pip install "palpate[view]"' in said
    assert palpate(env, tmp_path / "empty", "tissues").returncode == 0


@pytest.mark.parametrize("extra", sorted(set(PROJECT["optional-dependencies"]) - {"all", "dev"}))
def test_each_extra_by_itself_brings_what_it_promises(install, tmp_path, extra):
    env = install(extra)
    modules = [module for module in EXTRAS.get(extra, {}).values() if module != "pylsl"]  # needs a library of Debian's
    code = "\n".join(f"import {module}" for module in modules)
    done = subprocess.run([str(env / "bin/python"), "-c", code], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert palpate(env, tmp_path / "empty", "check", "kidney").returncode == 0


def test_the_oldest_versions_that_are_allowed_do(install, tmp_path):
    oldest = [re.sub(r">=(.*)", r"==\1.*", one) for one in PROJECT["dependencies"]]
    (tmp_path / "oldest.txt").write_text("\n".join(oldest))
    if sys.version_info[:2] != (3, 11):
        pytest.skip("their wheels are of Python 3.11")
    touches_a_kidney(install(more=["-c", str(tmp_path / "oldest.txt")]), tmp_path / "empty")


def test_every_extra_names_its_packages():
    """What the loader tells users to install is what the extra installs."""
    for extra, packages in EXTRAS.items():
        told = {re.split(r"[ >=;\[]", one)[0].lower() for one in PROJECT["optional-dependencies"][extra]}
        assert {name.lower() for name in packages} <= told, extra
