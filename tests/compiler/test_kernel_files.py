"""Files of the kernel cache: what another user can have written is never loaded, and damage means compiling again."""

import hashlib
import os
import pickle
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from numba.core.caching import UserProvidedCacheLocator

from palpate.compiler import kernel_files, trust
from palpate.compiler.kernel_cache import PREFIX

SOURCE = """
from palpate.compiler.kernel import kernel

@kernel
def inner(x):
    return 3.0 * x

@kernel
def outer(x):
    return inner(x) + 1.0

@kernel
def other(x):
    return 0.0
"""

CASES = """
import os, sys
import numba, palpate.compiler.kernel
sys.path.insert(0, sys.argv[1])
for case in sys.argv[2:]:
    child = os.fork()
    if not child:
        os.dup2(os.open(case + ".txt", os.O_WRONLY | os.O_CREAT | os.O_TRUNC), 2)
        numba.config.CACHE_DIR = case
        import cached_kernels as kernels
        value = kernels.outer(2.0)
        second = kernels.other(2.0) if "poison" not in case else 0.0
        hits = sum(map(lambda one: sum(one.stats.cache_hits.values()), (kernels.outer, kernels.other)))
        print(value, second, hits, kernels.outer.stats.cache_path, flush=True)
        os._exit(0)
    status = os.waitpid(child, 0)[1]
    if status:
        print("status", status, flush=True)
"""
"""Runs each case in a separate process, forked after the imports; prints values of both kernels, hits and folder. A
poisoned case calls one kernel."""

ROOT = hasattr(os, "geteuid") and os.geteuid() == 0
STRANGER = 65534


class Poison:
    """Creates a file when it is unpickled."""

    def __init__(self, file):
        self.file = file

    def __reduce__(self):
        return os.system, (f"touch {self.file}",)


@pytest.fixture(scope="module")
def sources(tmp_path_factory):
    """The kernels, and a cache of them."""
    folder = tmp_path_factory.mktemp("kernels")
    (folder / "cached_kernels.py").write_text(SOURCE)
    [made] = run(folder, folder / "made")
    assert made[:3] == ["7.0", "0.0", "0"]
    return folder


def run(sources, *cases):
    """What each case prints. A warning of the case is in a file next to its folder."""
    environment = {**os.environ, "XDG_CACHE_HOME": str(sources / "caches")}
    words = [sys.executable, "-c", CASES, str(sources), *map(str, cases)]
    done = subprocess.run(words, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return [line.split(" ", 3) for line in done.stdout.splitlines()]


def copied(sources, tmp_path, name):
    """A copy of the cache, and its file of the kernel `outer`."""
    [folder] = shutil.copytree(sources / "made", tmp_path / name).glob(f"{PREFIX}*")
    [file] = folder.glob("cached_kernels.outer-*.nbc")
    return folder, file


def poison(folder, file, proof):
    """Replace the kernel by a valid file whose pickle creates `proof`, and add numba's index with the same pickle."""
    content = pickle.dumps(Poison(proof))
    kernel_files.write(folder, file.name, content)
    where = folder / UserProvidedCacheLocator.get_suitable_cache_subpath(str(folder / "cached_kernels.py"))
    where.mkdir()
    (where / f"cached_kernels.outer-9.py{sys.version_info[0]}{sys.version_info[1]}.nbi").write_bytes(content)


def open_folder(folder, file):
    folder.chmod(0o777)


def open_file(folder, file):
    file.chmod(0o666)


def open_place(folder, file):
    folder.parent.chmod(0o777)


def linked_folder(folder, file):
    folder.symlink_to(folder.rename(folder.parent.with_name("elsewhere")))


def linked_file(folder, file):
    file.symlink_to(file.rename(folder.parent.with_name("elsewhere.nbc")))


def foreign_place(folder, file):
    os.chown(folder.parent, STRANGER, -1)
    folder.parent.chmod(0o777)


def foreign_folder(folder, file):
    os.chown(folder, STRANGER, -1)


def foreign_file(folder, file):
    os.chown(file, STRANGER, -1)


UNSAFE = [open_folder, open_file, open_place, linked_folder, linked_file]
UNSAFE += [foreign_place, foreign_folder, foreign_file] if ROOT else []


def test_a_pickle_that_others_can_have_written_is_never_loaded(sources, tmp_path):
    """The same poisoned pickle runs from a folder of this user, so only the checks keep it from running."""
    cases = []
    for unsafe in [None, *UNSAFE]:
        name = unsafe.__name__ if unsafe else "safe"
        (tmp_path / name).mkdir()
        folder, file = copied(sources, tmp_path / name, "poisoned")
        poison(folder, file, tmp_path / f"{name}.proof")
        if unsafe:
            unsafe(folder, file)
        cases.append(folder.parent)
    results = run(sources, *cases)
    assert [result[:2] for result in results] == [["7.0", "0.0"]] * len(cases)
    assert [file.name for file in tmp_path.glob("*.proof")] == ["safe.proof"]
    for case, unsafe, result in zip(cases[1:], UNSAFE, results[1:], strict=True):
        warned = case.with_name("poisoned.txt").read_text()
        assert len(warned.splitlines()) == (0 if unsafe is linked_file else 1), f"{unsafe.__name__}: {warned}"
        assert unsafe is linked_file or (str(case) in warned and "RuntimeWarning" in warned)
        inside = unsafe in (open_file, linked_file, foreign_file)
        assert (str(case) in result[3]) == inside, f"{unsafe.__name__}: {result}"


def emptied(file):
    file.write_bytes(b"")


def truncated(file):
    file.write_bytes(file.read_bytes()[:-100])


def flipped(file):
    data = bytearray(file.read_bytes())
    data[len(data) // 2] ^= 1
    file.write_bytes(data)


def swapped(file):
    [other] = file.parent.glob("cached_kernels.other-*.nbc")
    data = other.read_bytes()
    other.write_bytes(file.read_bytes())
    file.write_bytes(data)


def foreign_entry(file):
    """A valid file with a pickle of something else, as an unknown version might leave it."""
    kernel_files.write(file.parent, file.name, pickle.dumps({"a": 1}))


def a_folder(file):
    file.unlink()
    file.mkdir()


def a_pipe(file):
    file.unlink()
    os.mkfifo(file)


DAMAGE = [emptied, truncated, flipped, swapped, foreign_entry, a_folder, a_pipe]


def test_damaged_files_are_compiled_again(sources, tmp_path):
    cases = []
    for damage in DAMAGE:
        folder, file = copied(sources, tmp_path, damage.__name__)
        damage(file)
        cases.append(folder.parent)
    hits = [1] * len(DAMAGE)
    hits[DAMAGE.index(swapped)] = 0
    assert [result[:3] for result in run(sources, *cases)] == [["7.0", "0.0", str(count)] for count in hits]
    hits = [2] * len(DAMAGE)
    hits[DAMAGE.index(a_folder)] = 1  # cannot be replaced
    assert [result[:3] for result in run(sources, *cases)] == [["7.0", "0.0", str(count)] for count in hits]
    assert not any(case.with_name(f"{case.name}.txt").read_text() for case in cases)


def test_an_unusable_folder_is_reported_in_one_line_with_a_remedy(sources, tmp_path):
    (tmp_path / "file").touch()
    (tmp_path / "link").symlink_to(tmp_path / "nowhere" / "deep")
    cases = [tmp_path / "file", tmp_path / "link"]
    for case, result in zip(cases, run(sources, *cases), strict=True):
        assert result[:2] == ["7.0", "0.0"]
        [line] = Path(f"{case}.txt").read_text().splitlines()
        assert str(case) in line and "NUMBA_CACHE_DIR" in line and result[3] in line


def test_only_this_user_and_root_are_trusted(monkeypatch):
    def check(mode, owner, user, **options):
        monkeypatch.setattr(os, "geteuid", lambda: user, raising=False)
        try:
            trust.check_trust(os.stat_result((mode, 0, 0, 1, owner, 0, 0, 0, 0, 0)), **options)
        except trust.UntrustedError as error:
            return str(error)
        return "trusted"

    assert check(0o40755, 1000, 1000) == check(0o40755, 0, 1000) == check(0o40700, 0, 0) == "trusted"
    assert check(0o40700, 1000, 0) == "belongs to user 1000, expected root"
    assert check(0o40700, 1001, 1000) == "belongs to user 1001, expected 1000 or root"
    assert "mode 775" in check(0o40775, 1000, 1000) and "mode 757" in check(0o40757, 0, 0)
    assert "mode 1777" in check(0o41777, 0, 1000)
    assert check(0o41777, 0, 1000, sticky=True) == "trusted"  # /tmp as NUMBA_CACHE_DIR
    assert check(0o41777, 1001, 1000, sticky=True) != "trusted"


def test_a_failed_write_leaves_the_previous_file(tmp_path, monkeypatch):
    tmp_path.chmod(0o700)
    kernel_files.write(tmp_path, "one.nbc", b"first")

    def full(_):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch, pytest.raises(OSError, match="No space"):
        patch.setattr(os, "fsync", full)
        kernel_files.write(tmp_path, "one.nbc", b"second")
    assert kernel_files.read(tmp_path, "one.nbc") == b"first"
    assert [file.name for file in tmp_path.iterdir()] == ["one.nbc"]
    data = (tmp_path / "one.nbc").read_bytes()
    assert data[24:56] == hashlib.sha256(b"one.nbc\0first").digest()
