"""Temporary folders: removed when closed, and after a kill by the next one, but never while they are in use."""

import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from palpate.physics.scratch import ScratchFolder, remove_leftovers

HELD = """
import sys, time
from palpate.physics.scratch import ScratchFolder
folder = ScratchFolder("held")
open(folder.name + "/data", "w").write("x")
print(folder.name, flush=True)
sys.stdin.read()
"""


@pytest.fixture(autouse=True)
def temporary(tmp_path, monkeypatch):
    """A separate folder for temporary ones, so that those of other tests are left alone."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    return tmp_path


@pytest.fixture
def other(temporary):
    """A process that holds a folder until it is ended, and the folder."""
    process = subprocess.Popen([sys.executable, "-c", HELD], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    yield process, Path(process.stdout.readline().strip())
    process.kill()
    process.communicate()


def test_a_folder_is_removed_when_it_is_closed_or_dropped(temporary):
    with ScratchFolder("a") as name:
        assert Path(name).parent == temporary and Path(name).name.startswith("palpate-a-")
    dropped = ScratchFolder("b")
    del dropped
    assert not list(temporary.iterdir())


def test_the_folder_of_a_killed_process_is_removed_by_the_next_one(other, temporary):
    process, folder = other
    with ScratchFolder("next") as name:
        assert set(temporary.iterdir()) == {folder, Path(name)}  # in use: not removed
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert (folder / "data").exists()  # a kill leaves it
    with ScratchFolder("next") as name:
        assert list(temporary.iterdir()) == [Path(name)]


def test_a_folder_that_a_forked_process_still_uses_is_kept(temporary):
    """The executor's child processes use the folder of their parent."""
    held = ScratchFolder("parent")
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(writing)
        os.read(reading, 1)
        os._exit(0)
    os.close(reading)
    os.close(held._lock)  # as if this process were killed
    held._lock = None
    assert remove_leftovers() == []
    os.close(writing)
    os.waitpid(child, 0)
    assert remove_leftovers() == [Path(held.name)]


def test_a_forked_process_does_not_remove_the_folder_of_its_parent(temporary):
    held = ScratchFolder("parent")
    child = os.fork()
    if child == 0:
        del held
        os._exit(0)
    os.waitpid(child, 0)
    assert Path(held.name).exists()
    held.cleanup()
    assert not Path(held.name).exists()


def test_folders_of_others_are_left_alone(temporary, other):
    process, folder = other
    process.kill()
    process.wait()
    (temporary / "palpate-no-lock").mkdir()
    (temporary / "palpate-file").write_text("")
    (temporary / "another").mkdir()
    (temporary / "another" / ".lock").write_text("")
    (temporary / "palpate-link").symlink_to(temporary / "another", target_is_directory=True)
    (temporary / "palpate-lock-link").mkdir()
    (temporary / "palpate-lock-link" / ".lock").symlink_to(temporary / "another" / ".lock")
    left = set(temporary.iterdir()) - {folder}
    assert remove_leftovers() == [folder] and set(temporary.iterdir()) == left
