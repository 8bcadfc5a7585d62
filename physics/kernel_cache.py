"""The folder in which numba caches compiled kernels: one per state of the sources.

numba reuses a cached kernel as long as the file that defines it is unchanged, although the kernels that it calls and
the layout of its arguments may be defined in other files. So the name of the folder is a hash of all sources that
contain kernels. Each edit of these creates a new folder; the oldest ones are removed.
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

KEPT = 3  # Folders that are kept, so that switching between two branches recompiles nothing
PREFIX = "kernels-"
COMPILED = ("palpate.physics", "palpate.models.fe", "palpate.nodes", "palpate.engine")

ROOM = 100_000_000
"""[bytes] Free disk space required for a new folder, about three times its size: numba aborts on a full disk."""


def folder(given: str = "") -> Path:
    """The cache folder for the current sources, below `given`, else `NUMBA_CACHE_DIR`, else a default location."""
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
    """A hash of the names and contents of all sources of the packages, by default of those that contain kernels."""
    hasher = hashlib.sha256()
    for package in packages:
        spec = find_spec(package)
        for folder in (spec.submodule_search_locations or ()) if spec else ():
            for file in sorted(Path(folder).rglob("*.py")):
                content = hashlib.sha256(file.read_bytes()).digest()
                hasher.update(f"{package}/{file.relative_to(folder)}".encode() + b"\0" + content)
    return hasher.hexdigest()[:16]


def _root(name: str, given: str) -> Path:
    """The folder that contains the cache folders: `given`, else next to the sources, else the user's cache. A location
    must be writable and have `ROOM` bytes free, unless the folder `name` already exists there."""
    if given:
        return Path(given)
    caches = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    places = (Path(__file__).parent / "__pycache__", Path(caches) / "palpate")
    for place in places:
        with contextlib.suppress(OSError):
            place.mkdir(parents=True, exist_ok=True)
            if os.access(place, os.W_OK) and ((place / name).exists() or shutil.disk_usage(place).free > ROOM):
                return place
    return Path(tempfile.mkdtemp(prefix="palpate-"))  # private: never run kernels that another user may have left


def _clear(root: Path) -> None:
    """Remove all but the most recently used folders. A process that still uses a removed one recompiles."""
    folders = sorted(root.glob(f"{PREFIX}*"), key=lambda folder: _used(folder), reverse=True)
    for folder in folders[KEPT:]:
        shutil.rmtree(folder, ignore_errors=True)


def _used(folder: Path) -> float:
    try:
        return folder.stat().st_mtime
    except FileNotFoundError:
        return 0.0
