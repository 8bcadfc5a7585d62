"""Files of the cache that another user can have written are neither read nor written; all others are, for any umask."""

import json
import os
import shutil

import numpy as np
import pytest

from palpate.compiler import trust
from palpate.models.build import basis as builder
from palpate.nodes.base import SettingError
from palpate.nodes.deformation import ReducedFE, basis_store
from palpate.studies.accuracy import cells
from palpate.studies.accuracy.cells import Cell

SHIPPED = basis_store.SHIPPED / "plane-condensed.npz"
PLANE = {"surface": "plane"}


@pytest.fixture
def stored(monkeypatch, tmp_path):
    """The basis of a plane in the cache of a user whose umask lets the group write."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    trust.warn.cache_clear()
    before = os.umask(0o002)
    node = ReducedFE(**PLANE)
    path = basis_store.cache() / node.filename()
    trust.make_folder(path.parent)
    node.find_stored(basis_store.SHIPPED)[1].save(path, json.dumps({"error": {}}))
    yield path
    os.umask(before)


def found():
    return basis_store.find(basis_store.cache(), ReducedFE(**PLANE).key())


def test_a_basis_of_this_user_is_read_for_any_umask(stored, recwarn):
    assert found() == stored
    assert not recwarn.list
    assert [p.stat().st_mode & 0o777 for p in (stored, stored.parent, stored.parent.parent)] == [0o644, 0o755, 0o755]


def writable_file(path):
    path.chmod(0o664)
    return "other users may write to it"


def writable_folder(path):
    path.parent.chmod(0o777)
    return "other users may write to it"


def linked_file(path):
    shutil.copy(path, path.parent.parent / "other.npz")
    path.unlink()
    path.symlink_to(path.parent.parent / "other.npz")
    return "is a symbolic link"


def linked_folder(path):
    path.parent.rename(path.parent.with_name("other"))
    path.parent.symlink_to(path.parent.with_name("other"))
    return "is a symbolic link"


def foreign_file(path):
    if os.geteuid() != 0:
        pytest.skip("only root can give a file to another user")
    os.chown(path, 12345, -1)
    return "belongs to user 12345"


@pytest.mark.parametrize("spoil", [writable_file, writable_folder, linked_file, linked_folder, foreign_file])
def test_an_untrusted_basis_is_not_read_and_one_line_reports_it(stored, spoil):
    why = spoil(stored)
    with pytest.warns(RuntimeWarning) as warned:
        assert found() is None
    (line,) = [str(each.message) for each in warned]
    assert str(stored) in line and why in line and "Remove it, or set XDG_CACHE_HOME" in line and "\n" not in line


@pytest.mark.parametrize("spoil", [writable_folder, linked_folder])
def test_nothing_is_built_into_an_untrusted_folder(stored, spoil):
    why = spoil(stored)
    with pytest.raises(SettingError, match=f"bases.*{why}.*set XDG_CACHE_HOME"):
        builder.make(ReducedFE(**PLANE), stored)


def test_results_of_the_bench_and_full_solutions_follow_the_same_rule(stored, tmp_path):
    file = tmp_path / "cell.json"
    file.write_text(json.dumps({"touch": "a", "method": "b", "title": "c", "fidelity": "d", "rate": 1.0}))
    file.chmod(0o644)
    assert isinstance(cells._read(file), Cell)
    file.chmod(0o666)
    with pytest.warns(RuntimeWarning, match=r"cell\.json is not read: .*mode 666"):
        assert cells._read(file) is None
    array = tmp_path / "touch.npy"
    np.save(array, np.zeros(3))
    array.chmod(0o602)
    with pytest.warns(RuntimeWarning, match=r"touch\.npy is not read: .*mode 602"):
        assert not trust.may_read(array)
    assert not trust.may_read(tmp_path / "missing.npy")
