"""The commit in a recording is that of palpate's source, or none."""

import shutil
import subprocess
from pathlib import Path

import pytest

from palpate.engine import provenance

SOURCE = Path(provenance.__file__).resolve()


def git(folder, *what):
    identity = ("-c", "user.name=x", "-c", "user.email=x@example.org", "-c", "commit.gpgsign=false")
    done = subprocess.run(["git", *identity, *what], cwd=folder, capture_output=True, text=True, check=True)
    return done.stdout.strip()


@pytest.fixture
def repository(tmp_path, monkeypatch):
    """Another repository, in which the process runs, and its commit."""
    git(tmp_path, "init", "-q")
    (tmp_path / "notes.txt").write_text("x")
    git(tmp_path, "add", "notes.txt")
    git(tmp_path, "commit", "-qm", "x")
    monkeypatch.chdir(tmp_path)
    return tmp_path, git(tmp_path, "rev-parse", "HEAD")


def own():
    """The commit of the folder that these tests lie in; None where it is no repository."""
    try:
        return git(SOURCE.parent, "rev-parse", "HEAD") if git(SOURCE.parent, "ls-files", SOURCE.name) else None
    except subprocess.CalledProcessError:
        return None


@pytest.mark.parametrize("hook", [False, True])
def test_in_another_repository_the_commit_is_that_of_palpate(repository, monkeypatch, hook):
    (folder, other), expected = repository, own()
    if hook:  # what git sets for the commands that it calls
        monkeypatch.setenv("GIT_DIR", str(folder / ".git"))
        monkeypatch.setenv("GIT_WORK_TREE", str(folder))
    provenance._commit.cache_clear()
    assert provenance.commit() == expected != other


@pytest.mark.parametrize("ignored", [True, False])
def test_a_package_that_is_installed_inside_another_repository_has_no_commit(repository, monkeypatch, ignored):
    folder, _ = repository
    if ignored:
        (folder / ".gitignore").write_text(".venv\n")
    place = folder / ".venv" / "lib" / "site-packages" / "palpate" / "engine" / SOURCE.name
    place.parent.mkdir(parents=True)
    shutil.copy(SOURCE, place)
    monkeypatch.setattr(provenance, "__file__", str(place))
    assert provenance.commit() is None
    assert provenance.machine()["commit"] is None and provenance.made_by(None).endswith(
        str(provenance.package_version("palpate"))
    )


def test_a_source_in_git_has_its_commit_also_through_links(repository, monkeypatch):
    folder, _ = repository
    place = folder / "engine" / SOURCE.name
    place.parent.mkdir()
    shutil.copy(SOURCE, place)
    git(folder, "add", "engine")
    git(folder, "commit", "-qm", "y")
    (folder / "src").symlink_to(folder / "engine")
    monkeypatch.chdir("/")
    monkeypatch.setattr(provenance, "__file__", str(folder / "src" / SOURCE.name))
    assert provenance.commit() == git(folder, "rev-parse", "HEAD")
