"""An edited kernel is never run from what was compiled before the edit, not even through a kernel of another file."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import palpate.physics
from palpate.physics.kernel_cache import KEPT, PREFIX

KERNEL = "from palpate.physics.kernel import kernel\n"
INNER = f"{KERNEL}\n\n@kernel\ndef inner(x):\n    return {{}} * x\n"
OUTER = f"from palpate.physics.inner import inner\n{KERNEL}\n\n@kernel\ndef outer(x):\n    return inner(x) + 1.0\n"
NOTEBOOK = "from palpate.physics.outer import outer; print(outer(2.0), outer.stats.cache_hits)"
TEST = "from palpate.physics.outer import outer\n\n\ndef test_outer():\n    assert outer(2.0) == {}\n"


@pytest.fixture
def tree(tmp_path):
    """A tree with the first files of the physics and two kernels, one of which calls the other."""
    physics = tmp_path / "palpate" / "physics"
    physics.mkdir(parents=True)
    for name in ("__init__.py", "arithmetic.py", "code_library.py", "kernel.py", "kernel_cache.py"):
        shutil.copy(Path(palpate.physics.__path__[0]) / name, physics)
    (physics / "inner.py").write_text(INNER.format("3.0"))
    (physics / "outer.py").write_text(OUTER)
    (tmp_path / "palpate" / "__init__.py").touch()
    (tmp_path / "palpate" / "models").mkdir()
    (tmp_path / "palpate" / "models" / "__init__.py").touch()
    return tmp_path


def run(tree, *arguments, cache=None):
    # Python goes by time and size of a source, and here both stay.
    environment = {**os.environ, "PYTHONPATH": str(tree), "PYTHONDONTWRITEBYTECODE": "1"}
    environment["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"  # plugins of others take longer to import than all the rest
    environment.pop("NUMBA_CACHE_DIR", None)
    if cache is not None:
        environment["NUMBA_CACHE_DIR"] = str(cache)
    return subprocess.run([sys.executable, *arguments], env=environment, capture_output=True, text=True, cwd=tree)


def notebook(tree, **options):
    """What the outer kernel gives, and whether it was compiled before."""
    done = run(tree, "-c", NOTEBOOK, **options)
    assert done.returncode == 0, done.stderr
    value, hits = done.stdout.split(" ", 1)
    return float(value), hits.strip() != "Counter()"


def test_a_kernel_that_another_one_calls_may_be_edited(tree):
    assert notebook(tree) == (7.0, False)
    inner = tree / "palpate" / "physics" / "inner.py"
    before = inner.stat()
    inner.write_text(INNER.format("4.0"))
    os.utime(inner, ns=(before.st_atime_ns, before.st_mtime_ns))  # a checkout or a copy may keep the time and the size
    assert notebook(tree) == (9.0, False)
    (tree / "test_outer.py").write_text(TEST.format("9.0"))
    assert run(tree, "-m", "pytest", "-q", "-p", "no:cacheprovider", "test_outer.py").returncode == 0
    inner.write_text(INNER.format("3.0"))
    assert notebook(tree) == (7.0, True)  # back again: nothing is compiled


def test_numba_may_come_first_and_keeps_what_a_program_has_set(tree):
    set_before = "import numba; numba.config.FUNCTION_CACHE_SIZE = 7; import palpate.physics; "
    done = run(tree, "-c", f"{set_before}{NOTEBOOK}; print(numba.config.FUNCTION_CACHE_SIZE)")
    assert done.stdout.splitlines()[-1] == "7", done.stderr
    assert notebook(tree) == (7.0, True)


def test_folders_of_old_sources_go(tree):
    inner = tree / "palpate" / "physics" / "inner.py"
    for factor in range(KEPT + 2):
        inner.write_text(INNER.format(f"{factor}.0"))
        assert run(tree, "-c", "import palpate.physics.outer").returncode == 0
    left = list((tree / "palpate" / "physics" / "__pycache__").glob(f"{PREFIX}*"))
    assert len(left) == KEPT


def test_the_user_may_name_the_folder(tree):
    assert notebook(tree, cache=tree / "mine") == (7.0, False)
    assert notebook(tree, cache=tree / "mine") == (7.0, True)
    (folder,) = (tree / "mine").iterdir()
    assert folder.name.startswith(PREFIX) and not list(folder.glob(f"{PREFIX}*"))


def test_sources_that_may_not_be_written_beside(tree, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tree / "caches"))
    (tree / "palpate" / "physics" / "__pycache__").write_text("a file, so that root cannot make this folder either")
    assert notebook(tree) == (7.0, False)
    assert list((tree / "caches" / "palpate").glob(f"{PREFIX}*"))
