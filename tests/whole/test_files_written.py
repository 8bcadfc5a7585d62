"""Files that palpate writes are complete or unchanged: each is written under a temporary name, then renamed."""

import ast
import os
import resource
import signal
import stat
import threading
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from sources import tree_of

from palpate.physics.archive import replace_text, replacing
from palpate.physics.geometry.mesh import Mesh, write_ply
from palpate.physics.segmentation.region import Region
from palpate.views.pictures.style import figure, save

ROOT = Path(__file__).parents[2]
SOURCES = sorted(path for folder in ("src/palpate", "launch", "nodes") for path in (ROOT / folder).rglob("*.py"))
WRITERS = {"write_text", "write_bytes", "savefig", "savez", "savez_compressed", "save", "to_csv", "export"}
DIRECTLY = {
    "launch/run/work/forked.py": "the standard streams of a process",
    "src/palpate/cli/commands/cost/bench/fits.py": "a press of the search, next to its kept results",
    "src/palpate/models/files/apart.py": "answers to the process that waits for them, in its temporary folder",
    "src/palpate/studies/fits/tables.py": "a table under a temporary name",
    "src/palpate/studies/faults/launcher/scene.py": "a temporary folder",
    "src/palpate/studies/kept.py": "appends results line by line; a cut line is skipped",
    "src/palpate/studies/inverse/measured.py": "a temporary folder of this object",
    "src/palpate/compiler/kernel_files.py": "writes under a temporary name, relative to an opened folder",
    "src/palpate/views/surface/off_screen.py": "a temporary folder, read by a child process",
    "src/palpate/views/surface/render.py": "the same, written by the child process",
    "src/palpate/views/page/steered.py": "a temporary folder of the page",
    "src/palpate/records/lerobot/writer.py": "a folder of the set; its files are renamed when all are complete",
    "src/palpate/web/folder.py": "a folder under a temporary name, which is renamed when it is complete",
    "src/palpate/web/program.py": "a temporary folder of a measurement",
    "src/palpate/studies/peers/calculix.py": "a temporary folder, read by CalculiX",
    "src/palpate/records/reader.py": "a temporary folder of this object",
    "src/palpate/models/build/on_demand.py": "/dev/null",
    "launch/run/work/compiling.py": "/dev/null",
    "launch/run/tasks/local.py": "the log of child processes, which must exist while they run",
    "launch/run/wire/keys.py": "a key, which is created with O_EXCL",
    "nodes/logger/mcap.py": "a recording must keep what was written before a crash",
    "src/palpate/studies/sweeps/store.py": "a lock",
    "src/palpate/studies/sweeps/recorded.py": "a lock",
    "src/palpate/physics/writable.py": "a lock, and a test whether a file can be written",
    "src/palpate/studies/psychophysics/store.py": "rows of trials are appended, each on the disk before the next trial",
}
"""Files with writers outside `replacing`, and why."""
DATA = b"the earlier content\n"


def writes(call: ast.Call) -> bool:
    """Whether a call writes a file by name."""
    name = call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
    if name in ("open", "fdopen"):
        texts = [a.value for a in [*call.args, *(k.value for k in call.keywords)] if isinstance(a, ast.Constant)]
        return any(isinstance(t, str) and t and set(t) <= set("wax+bt") and set(t) & set("wax+") for t in texts)
    if name in ("save", "export"):  # numpy's, and meshes'
        return isinstance(call.func, ast.Attribute) and getattr(call.func.value, "id", "") in ("np", "trimesh")
    return name in WRITERS


def unprotected(tree: ast.AST) -> list[int]:
    """Lines of writing calls outside of `with replacing(...)`."""
    inside = {
        id(node)
        for block in ast.walk(tree)
        if isinstance(block, ast.With)
        and any(isinstance(i.context_expr, ast.Call) and getattr(i.context_expr.func, "id", "") == "replacing"
                for i in block.items)
        for node in ast.walk(block)
    }  # fmt: skip
    return [n.lineno for n in ast.walk(tree) if isinstance(n, ast.Call) and writes(n) and id(n) not in inside]


def test_each_file_is_written_under_a_temporary_name():
    found = {str(path.relative_to(ROOT)): unprotected(tree_of(path)) for path in SOURCES}
    found = {name: lines for name, lines in found.items() if lines}
    # a picture as bytes for a notebook, and what `save` calls with a temporary name
    assert len(found.pop("src/palpate/views/pictures/style.py", [0])) == 2
    assert {name: lines for name, lines in found.items() if name not in DIRECTLY} == {}
    assert set(DIRECTLY) == set(found)  # each reason is still needed


def test_the_search_finds_writers():
    text = "a.write_text(b)\nopen(p, 'wb')\nwith replacing(p) as q:\n    open(q, 'w')\n    x.savefig(q)\nnp.savez(p, a)"
    assert unprotected(ast.parse(text)) == [1, 2, 6]


@contextmanager
def full_disk(room: int):
    """No file can become longer than this number of bytes."""
    before = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, before)


def mesh(path):
    corners = np.random.default_rng(1).normal(size=(60, 3))
    write_ply(path, Mesh(corners, np.arange(60, dtype=np.int32).reshape(20, 3)))


def region(path):
    voxels = np.random.default_rng(1).random((16, 16, 16)) < 0.5
    Region(voxels, np.eye(3, 4)).save(path)


WRITTEN = {
    "picture.png": lambda path: save(figure(3.0, 2.0, "A picture"), path),
    "picture.svg": lambda path: save(figure(3.0, 2.0, "A picture"), path),
    "table.csv": lambda path: replace_text(path, "a,b\n" * 1000),
    "mesh.ply": mesh,
    "region.npz": region,
}


@pytest.mark.parametrize("name", WRITTEN)
@pytest.mark.parametrize("earlier", [False, True])
@pytest.mark.parametrize("room", [0, 300])
def test_a_full_disk_leaves_the_earlier_file_or_none(tmp_path, name, earlier, room):
    path = tmp_path / name
    if earlier:
        path.write_bytes(DATA)
    with full_disk(room), pytest.raises(OSError, match="File too large"):
        WRITTEN[name](path)
    assert [file.read_bytes() for file in tmp_path.iterdir()] == [DATA] * earlier
    WRITTEN[name](path)
    assert path.stat().st_size > 300


def test_a_replaced_file_keeps_its_mode_and_its_link(tmp_path):
    (tmp_path / "file").write_bytes(DATA)
    (tmp_path / "file").chmod(0o640)
    (tmp_path / "link").symlink_to("file")
    replace_text(tmp_path / "link", "new")
    assert (tmp_path / "link").is_symlink() and (tmp_path / "file").read_text() == "new"
    assert stat.S_IMODE((tmp_path / "file").stat().st_mode) == 0o640


def test_a_pipe_is_written_directly(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    read = []
    reader = threading.Thread(target=lambda: read.append(pipe.read_text()))
    reader.start()
    replace_text(pipe, "text")
    reader.join()
    assert read == ["text"] and stat.S_ISFIFO(pipe.stat().st_mode)


def test_a_failure_leaves_no_temporary_file(tmp_path):
    with pytest.raises(KeyboardInterrupt), replacing(tmp_path / "file") as part:
        part.write_text("half")
        raise KeyboardInterrupt
    assert not list(tmp_path.iterdir())
