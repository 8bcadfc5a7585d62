"""An edited kernel never runs from the cache of an earlier state, also if a kernel of another file calls it. All states
and copies share one folder."""

import os
import shutil
import subprocess
import sys

import pytest
from compiler_copy import copy_compiler

from palpate.compiler import kernel_cache, kernel_files
from palpate.compiler.kernel_cache import KEPT, PREFIX

KERNEL = "from palpate.compiler.kernel import kernel\n"
INNER = f"{KERNEL}\n\n@kernel\ndef inner(x):\n    return {{}} * x\n"
OUTER = f"from palpate.physics.inner import inner\n{KERNEL}\n\n@kernel\ndef outer(x):\n    return inner(x) + 1.0\n"
NOTEBOOK = "from palpate.physics.outer import outer; print(outer(2.0), outer.stats.cache_hits)"
TEST = "from palpate.physics.outer import outer\n\n\ndef test_outer():\n    assert outer(2.0) == {}\n"


@pytest.fixture
def tree(tmp_path):
    """A source tree with the files of the compiler and two kernels, one of which calls the other."""
    copy_compiler(tmp_path)
    physics = tmp_path / "palpate" / "physics"
    physics.mkdir()
    (physics / "__init__.py").touch()
    (physics / "inner.py").write_text(INNER.format("3.0"))
    (physics / "outer.py").write_text(OUTER)
    (tmp_path / "palpate" / "models").mkdir()
    (tmp_path / "palpate" / "models" / "__init__.py").touch()
    return tmp_path


def run(tree, *arguments, cache=None):
    # Python detects changes by time and size of a source, and both are constant here.
    environment = {**os.environ, "PYTHONPATH": str(tree), "PYTHONDONTWRITEBYTECODE": "1"}
    environment["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"  # importing plugins takes longer than the rest
    environment["NUMBA_CACHE_DIR"] = str(cache or tree / "cache")
    return subprocess.run([sys.executable, *arguments], env=environment, capture_output=True, text=True, cwd=tree)


def notebook(tree, **options):
    """The result of the outer kernel, and whether it came from the cache."""
    done = run(tree, "-c", NOTEBOOK, **options)
    assert done.returncode == 0, done.stderr
    value, hits = done.stdout.split(" ", 1)
    return float(value), hits.strip() != "Counter()"


def test_editing_a_called_kernel_recompiles_its_caller(tree):
    assert notebook(tree) == (7.0, False)
    inner = tree / "palpate" / "physics" / "inner.py"
    before = inner.stat()
    inner.write_text(INNER.format("4.0"))
    os.utime(inner, ns=(before.st_atime_ns, before.st_mtime_ns))  # a checkout or a copy may keep time and size
    assert notebook(tree) == (9.0, False)
    (tree / "test_outer.py").write_text(TEST.format("9.0"))
    assert run(tree, "-m", "pytest", "-q", "-p", "no:cacheprovider", "test_outer.py").returncode == 0
    inner.write_text(INNER.format("3.0").replace("    return", '    """Text."""\n\n    # a comment\n    return'))
    assert notebook(tree) == (7.0, True)  # restored, with other lines: no compilation
    assert len(list((tree / "cache").iterdir())) == 1


def test_numba_imported_first_keeps_the_settings_of_the_program(tree):
    set_before = "import numba; numba.config.FUNCTION_CACHE_SIZE = 7; import palpate.physics; "
    done = run(tree, "-c", f"{set_before}{NOTEBOOK}; print(numba.config.FUNCTION_CACHE_SIZE)")
    assert done.stdout.splitlines()[-1] == "7", done.stderr
    assert notebook(tree) == (7.0, True)


def test_folders_of_old_versions_are_removed(tree):
    for name in range(KEPT + 1):
        (tree / "cache" / f"{PREFIX}{name}").mkdir(0o755, parents=True)
    (tree / "cache" / "of another program").mkdir()
    assert notebook(tree) == (7.0, False)  # kernels are loaded
    assert (tree / "cache" / "of another program").is_dir()
    assert len(list((tree / "cache").glob(f"{PREFIX}*"))) == KEPT


def test_the_user_may_set_the_folder(tree):
    assert notebook(tree, cache=tree / "mine") == (7.0, False)
    assert notebook(tree, cache=tree / "mine") == (7.0, True)
    (folder,) = (tree / "mine").iterdir()
    assert folder.name.startswith(PREFIX) and not list(folder.glob(f"{PREFIX}*"))


def test_without_a_folder_of_the_user_the_cache_is_next_to_the_sources(tree):
    (tree / "a file").touch()  # so that root cannot make a folder there either
    set_before = (
        f"import os; os.environ.update(XDG_CACHE_HOME={str(tree / 'a file')!r}); del os.environ['NUMBA_CACHE_DIR']"
    )
    assert run(tree, "-c", f"{set_before}; {NOTEBOOK}").stdout.split()[0] == "7.0"
    assert list((tree / "palpate" / "compiler" / "__pycache__").glob(f"{PREFIX}*"))


def test_the_files_that_were_not_used_for_longest_are_removed(tree, monkeypatch):
    for number in range(4):
        (tree / f"{number}.nbc").write_bytes(bytes(100))
        os.utime(tree / f"{number}.nbc", (1e9 + number, 1e9 + number))
    monkeypatch.setattr(kernel_cache, "SIZE", 250)
    kernel_cache.limit_size(tree)
    assert sorted(file.name for file in tree.glob("*.nbc")) == ["2.nbc", "3.nbc"]
    assert (tree / "palpate").is_dir()


def test_a_file_that_is_used_counts_as_new(tree):
    tree.chmod(0o700)
    for name in "read", "unread":
        kernel_files.write(tree, name, b"code")
        os.utime(tree / name, (1e9, 1e9))
    assert kernel_files.read(tree, "read") == b"code"
    assert (tree / "read").stat().st_mtime > 1e9 == (tree / "unread").stat().st_mtime


def test_copies_of_the_same_sources_share_the_cache_of_the_user(tree, tmp_path):
    moved = shutil.copytree(tree, tmp_path / "moved")
    for file in moved.rglob("*.py"):
        os.utime(file, (1e9, 1e9))
    assert notebook(tree, cache=tree / "shared") == (7.0, False)
    assert notebook(moved, cache=tree / "shared") == (7.0, True)


def test_shipped_kernels_are_used_at_another_path_before_the_cache(tree, tmp_path):
    """With other times of the files, in a folder that cannot be written, and with group write access as of the sources
    (umask 002). Without the sources' access, they are compiled again."""
    assert notebook(tree) == (7.0, False)
    installed = shutil.copytree(tree, tmp_path / "installed", ignore=shutil.ignore_patterns("cache"))
    [made] = (tree / "cache").glob(f"{PREFIX}*")
    shipped = installed / "palpate" / "compiler" / "compiled" / f"{PREFIX}{kernel_cache.versions(minor=True)}"
    shutil.copytree(made, shipped, ignore=shutil.ignore_patterns("*.lock"))
    for file in [*installed.rglob("*")]:
        os.utime(file, (1e9, 1e9))
    empty = tmp_path / "empty"
    assert notebook(installed, cache=empty) == (7.0, True)
    assert not list(empty.rglob("*.nbc"))
    for file in [shipped, *shipped.iterdir()]:
        file.chmod(file.stat().st_mode | 0o020)
    assert notebook(installed, cache=empty) == (7.0, False)
    for file in installed.rglob("*.py"):
        file.chmod(file.stat().st_mode | 0o020)
    shutil.rmtree(empty)
    assert notebook(installed, cache=empty) == (7.0, True)
