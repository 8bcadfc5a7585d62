"""Prepared surfaces are stored by content, shared by later processes, and never read from a damaged or foreign file."""

import os
import shutil
import threading

import numpy as np
import pytest

from palpate.compiler.kernel_cache import remove_oldest
from palpate.launch.run import progress
from palpate.nodes.base import felt, mesh_file, surface
from palpate.nodes.base.stored import prepares, surfaces, watched
from palpate.physics.geometry.mesh import Mesh, write_ply
from palpate.studies.organs.shapes import boxes
from palpate.studies.organs.zoo import mesh_of

WIDTH, REFINE, MM = 4e-3, 2e-3, 1e-3


def smooth():
    return mesh_of("ball-5", 60)


def grooved():
    """A block of 12 x 2 x 6 mm with a groove of 1 mm."""
    full = np.array([[[True, True]], [[True, False]], [[True, True]]])
    return boxes((-6 * MM, -MM / 2, MM / 2, 6 * MM), (-MM, MM), (-3 * MM, 0.0, 3 * MM), full, 100)


def forget():
    surface.surface_mesh.cache_clear()
    felt._felt_surface.cache_clear()


@pytest.fixture(scope="module", params=[smooth, grooved], ids=["smooth", "grooved"])
def once(request, tmp_path_factory):
    """The file of a body that the finger touches everywhere, or of one with a groove; what is prepared of it, and the
    store with it."""
    folder = tmp_path_factory.mktemp("organ")
    write_ply(folder / "organ.ply", request.param())
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv("XDG_CACHE_HOME", str(folder / "cache"))
        arrays, made = prepare(folder / "organ.ply")
    assert made == 2 and (len(arrays) > 4) == (request.param is grooved)
    return folder, arrays


ONE = pytest.mark.parametrize("once", [smooth], ids=["smooth"], indirect=True)


@pytest.fixture
def file(once):
    return once[0] / "organ.ply"


@pytest.fixture
def first(once):
    return once[1]


@pytest.fixture
def store(once, tmp_path, monkeypatch):
    """A copy of the store."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    shutil.copytree(once[0] / "cache", tmp_path / "cache")
    yield surfaces.folder()
    forget()


def prepare(path, refine=REFINE, width=WIDTH):
    """All that is prepared of a file, as arrays, and for how many surfaces it was computed; cleared caches of the
    functions make it a new process."""
    forget()
    made = []

    class Watch:
        def __init__(self, what):
            made.append(what)

        def __enter__(self):
            pass

        def __exit__(self, *_):
            pass

    with watched(Watch):
        mesh = surface.surface_mesh(str(path), 0, refine=refine)
        found, fault = felt._felt_surface(str(path), 0, "m", 0, refine, surface.content_of(str(path)), width)
    assert fault == ""
    change = np.array(surface.refinement(str(path), "m", 0, refine))
    arrays = [mesh.vertices, mesh.triangles, mesh.normals, change]
    if found is not None:
        arrays += [found.mesh.vertices, found.mesh.triangles, found.mesh.normals, found.origin, found.touchable]
        arrays += [np.array([found.area, found.depth]), found.place]
    return arrays, len(made)


def same(one, other):
    return len(one) == len(other) and all(
        a.dtype == b.dtype and np.array_equal(a, b) for a, b in zip(one, other, strict=True)
    )


def test_a_later_process_reads_the_same_arrays_and_computes_nothing(file, first, store, tmp_path):
    again, made = prepare(file)
    assert made == 0 and same(first, again)
    # the content counts, not the name
    other = tmp_path / "another name.ply"
    shutil.copy(file, other)
    moved, made = prepare(other)
    assert made == 0 and same(first, moved) and len(list(store.iterdir())) == 2


@ONE
def test_other_settings_and_contents_are_prepared_separately(file, first, store, tmp_path):
    finer, made = prepare(file, refine=1.5e-3)
    assert made == 2 and not same(first, finer)
    assert prepare(file, width=3e-3)[1] == 1  # the refined mesh is shared
    changed = tmp_path / "organ.ply"
    changed.write_bytes(file.read_bytes() + b"\n")
    assert prepare(changed)[1] == 2
    assert prepare(file)[1] == 0


def damaged_file(path):
    """A box without a triangle, with a part inside out."""
    mesh = boxes((-6 * MM, 6 * MM), (-MM, MM), (-3 * MM, 3 * MM), np.ones((1, 1, 1), bool), 100)
    triangles = mesh.triangles[1:].copy()
    triangles[:5] = triangles[:5, ::-1]
    write_ply(path, Mesh(mesh.vertices, triangles))
    return path


@ONE
def test_flaws_are_searched_once_for_each_content_and_name_the_file(store, tmp_path, monkeypatch):
    searched, find = [], mesh_file._find_flaws

    def noted(*given):
        searched.append(given)
        return find(*given)

    monkeypatch.setattr(mesh_file, "_find_flaws", noted)

    def flaws(path, piece=0):
        mesh_file._flaws.cache_clear()
        mesh_file._read_once.cache_clear()
        return mesh_file.flaws(str(path), piece)

    one = damaged_file(tmp_path / "one.ply")
    first = flaws(one)
    assert len(first) == 2 and "is open" in first[0] and "partly inside out: 5" in first[1] and len(searched) == 1
    assert flaws(one) == first and len(searched) == 1
    # another name: the same flaws, with this name
    other = tmp_path / "{0} other.ply"
    shutil.copy(one, other)
    assert flaws(other) == [line.replace(str(one), str(other)) for line in first] and len(searched) == 1
    assert flaws(one, piece=1) == first and len(searched) == 2
    # other contents, and an entry that is damaged
    damaged_file(one).write_bytes(one.read_bytes() + b"\n")
    assert "1 bytes after its last element are ignored" in flaws(one)[0] and len(searched) == 3
    for path in sorted(store.glob("flaws-*")):
        flip(path)
    assert flaws(other)[1:] == [first[1].replace(str(one), str(other))] and len(searched) == 4


@ONE
def test_triangles_are_oriented_once(file, store, monkeypatch):
    turned, outward = [], mesh_file.outward

    def noted(*given):
        turned.append(given)
        return outward(*given)

    monkeypatch.setattr(mesh_file, "outward", noted)
    for each in (mesh_file._right, mesh_file._flaws, mesh_file._read_once):
        each.cache_clear()
    shutil.rmtree(store)
    mesh_file.read_mesh(str(file), 1.0)
    assert mesh_file.flaws(str(file)) == [] and len(turned) == 1


def cut(path):
    path.write_bytes(path.read_bytes()[:-200])


def flip(path):
    content = bytearray(path.read_bytes())
    content[len(content) // 3] ^= 4
    path.write_bytes(bytes(content))


def empty(path):
    path.write_bytes(b"")


def exchange(path):
    """The entry of other inputs under this name."""
    with np.load(path) as stored:
        arrays = dict(stored)
    arrays["about"] = np.array(str(arrays["about"]).replace('"refine": 0.002', '"refine": 0.005'))
    with path.open("wb") as out:
        np.savez(out, **arrays)


def objects(path):
    """A pickled object, which could run code."""
    with path.open("wb") as out:
        np.savez(out, about=np.array([{"run": "code"}], dtype=object))


@ONE
@pytest.mark.parametrize("damage", [cut, flip, empty, exchange, objects])
def test_a_damaged_or_exchanged_entry_is_made_again(file, first, store, damage):
    for path in sorted(store.iterdir()):
        damage(path)
    again, made = prepare(file)
    assert made == 2 and same(first, again)
    assert prepare(file)[1] == 0


def lend(path):
    path.chmod(0o664)


def link(path):
    target = path.with_suffix(".elsewhere")
    path.rename(target)
    path.symlink_to(target)


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="user folders have access lists")
@ONE
@pytest.mark.parametrize("expose", [lend, link])
def test_an_entry_that_another_user_can_have_written_is_not_read(file, first, store, expose):
    for path in sorted(store.iterdir()):
        expose(path)
    with pytest.warns(RuntimeWarning, match="is not read.*XDG_CACHE_HOME"):
        again, made = prepare(file)
    assert made == 2 and same(first, again)


@ONE
def test_a_store_that_cannot_be_written_changes_nothing(file, first, store):
    shutil.rmtree(store)
    store.write_text("a file in place of the folder")
    with pytest.warns(RuntimeWarning, match="is not read.*XDG_CACHE_HOME"):
        again, made = prepare(file)
    assert made == 2 and same(first, again)


def test_the_entries_that_were_not_used_for_longest_are_removed(tmp_path):
    for age, name in enumerate("abcd"):
        (tmp_path / name).write_bytes(bytes(100))
        os.utime(tmp_path / name, (1e9 - age, 1e9 - age))
    remove_oldest(tmp_path, 250)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b"]


@ONE
def test_a_preparation_that_takes_long_is_reported(file, store, tmp_path, monkeypatch, capsys):
    begun, begin = threading.Event(), progress.StageBars.begin

    def noted(*given, **more):
        begin(*given, **more)
        begun.set()

    monkeypatch.setattr(progress, "SOON", 0.0)
    monkeypatch.setattr(progress.StageBars, "begin", noted)
    with progress.preparing(), prepares("organ.ply, smooth surface"):
        assert begun.wait(60.0)
    assert capsys.readouterr().err == "Preparing: organ.ply, smooth surface ...\n"
    # nothing is reported of what is stored, or soon done
    begun.clear()
    monkeypatch.setattr(progress, "SOON", 60.0)
    with progress.preparing():
        prepare(file, refine=2.5e-3)
        prepare(file)
    assert not begun.is_set() and capsys.readouterr().err == ""
