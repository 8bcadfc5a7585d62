"""Where numba keeps compiled kernels: a folder per state of the sources.

numba holds a compiled kernel for fresh as long as the file that it stands in is unchanged, but the kernels that it
calls, and the layout of what it is handed, may stand in other files. So the name of the folder is a hash of all
sources that kernels can come from. An edit begins a new folder; the oldest ones go.
"""

import contextlib
import functools
import hashlib
import os
import shutil
import tempfile
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

KEPT = 3  # States of the sources whose kernels are kept: going back and forth between two branches compiles nothing
PREFIX = "kernels-"
COMPILED = ("palpate.physics", "palpate.models.fe", "palpate.nodes", "palpate.engine")

ROOM = 100_000_000
"""[bytes] free where new kernels are kept; all of ours take about a third. numba ends a program on a full disk."""


def folder(given: str = "") -> Path:
    """Where kernels of the sources as they are now are kept. `given`: where the user wants them; else as
    `NUMBA_CACHE_DIR` says, else a place of palpate's."""
    return _folder(given or os.environ.get("NUMBA_CACHE_DIR", ""))


@functools.cache
def _folder(given: str) -> Path:
    name = f"{PREFIX}{key()}"
    path = _root(name, given) / name
    new = not path.exists()
    path.mkdir(parents=True, exist_ok=True)
    os.utime(path)
    if new:
        _clear(path.parent)
    return path


def key(packages: Sequence[str] = COMPILED) -> str:
    """A hash of the names and contents of the sources of packages; without any, of those that kernels stand in."""
    hasher = hashlib.sha256()
    for package in packages:
        spec = find_spec(package)
        for folder in (spec.submodule_search_locations or ()) if spec else ():
            for file in sorted(Path(folder).rglob("*.py")):
                content = hashlib.sha256(file.read_bytes()).digest()
                hasher.update(f"{package}/{file.relative_to(folder)}".encode() + b"\0" + content)
    return hasher.hexdigest()[:16]


def _root(name: str, given: str) -> Path:
    """The user's folder for kernels; else beside the sources; where nobody may write there or the disk is full, the
    user's cache. `name` is that of the folder: where it is there already it needs no room."""
    if given:
        return Path(given)
    caches = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    places = (Path(__file__).parent / "__pycache__", Path(caches) / "palpate")
    for place in places:
        with contextlib.suppress(OSError):
            place.mkdir(parents=True, exist_ok=True)
            if os.access(place, os.W_OK) and ((place / name).exists() or shutil.disk_usage(place).free > ROOM):
                return place
    return Path(tempfile.mkdtemp(prefix="palpate-"))  # of this process alone: what others left there is not to be run


def _clear(root: Path) -> None:
    """Remove all but the folders that were used last. A process that still runs on one of them compiles anew."""
    folders = sorted(root.glob(f"{PREFIX}*"), key=lambda folder: _used(folder), reverse=True)
    for folder in folders[KEPT:]:
        shutil.rmtree(folder, ignore_errors=True)


def _used(folder: Path) -> float:
    try:
        return folder.stat().st_mtime
    except FileNotFoundError:
        return 0.0
