"""The folder in which compiled kernels are cached: one per version of Python, numba, llvmlite and numpy.

The name of a file in it is a hash of what its code depends on (`code_cache`), so that copies of the sources, branches
and earlier states of a file share the folder. The files that were not used for longest are removed. Folders that
another user can have written are not used (`trust`).
"""

import atexit
import contextlib
import functools
import hashlib
import importlib.metadata
import os
import shutil
import stat
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from palpate.compiler.trust import check_folder, check_trust, user_cache, warn

KEPT = 4  # Folders that are kept, of the versions that were used last
SIZE = (
    180_000_000  # [bytes] Size of a folder; the kernels of all graphs take 92 MB, so that a branch recompiles nothing
)
PREFIX = "kernels-"
COMPILED = (
    "palpate.compiler",
    "palpate.physics",
    "palpate.models.fe",
    "palpate.nodes",
    "palpate.engine",
    "palpate.launch.run.hop",
)

SHIPPED = Path(__file__).parent / "compiled"  # Folders that a wheel contains (docs/release/backend.py)

ROOM = 100_000_000
"""[bytes] Free disk space required for a new folder, about three times its size."""


def folder(given: str = "") -> Path:
    """The cache folder for the current versions, below `given`, else `NUMBA_CACHE_DIR`, else a default location."""
    return _folder(given or os.environ.get("NUMBA_CACHE_DIR", ""))


@functools.cache
def shipped_folder() -> Path | None:
    """The folder of kernels that the installation contains for this minor version of numba."""
    path = SHIPPED / f"{PREFIX}{versions(minor=True)}"
    return path if path.is_dir() else None


@functools.cache
def _folder(given: str) -> Path:
    """The first usable location of `given`, the user's cache, which copies of the sources share, and a folder next to
    the sources; else a temporary folder. A warning reports that `given` or an existing folder is not used."""
    name = f"{PREFIX}{versions()}"
    places = [user_cache(), Path(__file__).parent / "__pycache__"]
    refused = ""
    for place in [Path(given), *places] if given else places:
        try:
            path = _make_folder(place, name)
        except OSError as error:
            if given or (place / name).exists():
                refused = refused or f"{place if given else place / name}: {error.strerror or error}"
            continue
        break
    else:
        path = Path(tempfile.mkdtemp(prefix="palpate-"))
        atexit.register(_remove, path, os.getpid())
        refused = refused or f"{places[-1]}: no place for compiled kernels"
    if refused:
        remedy = f"name a folder of yours with NUMBA_CACHE_DIR{', or unset it' if given else ''}"
        warn(f"{refused}; kernels are cached in {path}. Remedy: {remedy}")
    return path


def _make_folder(place: Path, name: str) -> Path:
    """The folder `name` in a location, created if necessary. OSError: cannot be used or may not be trusted."""
    if place.exists() and not place.is_dir():
        raise OSError("is not a folder")
    place.mkdir(0o755, parents=True, exist_ok=True)
    check_trust(place.stat(), sticky=True)
    path = place / name
    new = not os.path.lexists(path)
    if new:
        if shutil.disk_usage(place).free < ROOM:
            raise OSError(f"less than {ROOM / 1e6:.0f} MB free")
        path.mkdir(0o755, exist_ok=True)
    check_folder(path)
    if not os.access(path, os.W_OK):
        raise OSError("not writable")
    os.utime(path)
    if new:
        _clear(place)
    return path


def key(packages: Sequence[str] = COMPILED) -> str:
    """A hash of the names and contents of all sources of the packages, by default of those that contain kernels."""
    hasher = hashlib.sha256()
    for package in packages:
        for folder in _folders(package):
            for file in sorted(Path(folder).rglob("*.py")):
                content = hashlib.sha256(file.read_bytes()).digest()
                hasher.update(f"{package}/{file.relative_to(folder)}".encode() + b"\0" + content)
    return hasher.hexdigest()[:16]


def _folders(package: str) -> Sequence[str]:
    """The folders of a package, which is not imported for that."""
    if package in sys.modules:
        return sys.modules[package].__path__
    return [os.path.join(folder, *package.split(".")[1:]) for folder in sys.modules["palpate"].__path__]


@functools.cache
def versions(minor: bool = False) -> str:
    """Versions of Python, numba, llvmlite and numpy, which determine the code of a kernel; `minor`: those that kernels
    of palpate depend on, without their last number. numba's code for functions of numpy depends on its minor version;
    kernels of palpate use none of those that differ."""
    found = {name: importlib.metadata.version(name).split(".") for name in ("numba", "llvmlite", "numpy")}
    numba, llvmlite = (".".join(found[name][: 2 if minor else None]) for name in ("numba", "llvmlite"))
    python = f"py{sys.version_info[0]}{sys.version_info[1]}{getattr(sys, 'abiflags', '')}"
    numpy = "" if minor else f"-numpy{'.'.join(found['numpy'][:2])}"
    return f"{python}-numba{numba}-llvmlite{llvmlite}{numpy}"


@functools.cache
def limit_size(folder: Path) -> None:
    """Remove the files of a folder that were not used for longest, above `SIZE`; once per process."""
    remove_oldest(folder, SIZE)


def remove_oldest(folder: Path, most: int) -> None:
    """Remove the files of a folder that were not used for longest, above `most` [bytes]."""
    try:
        found = [(entry.stat(follow_symlinks=False), entry.path) for entry in os.scandir(folder)]
    except OSError:
        return
    files = sorted(
        ((each.st_mtime, each.st_size, path) for each, path in found if stat.S_ISREG(each.st_mode)), reverse=True
    )
    total = 0
    for _, size, path in files:
        total += size
        if total > most:
            with contextlib.suppress(OSError):
                os.unlink(path)


def _clear(place: Path) -> None:
    """Remove all but the most recently used folders of this user. A process that still uses a removed one
    recompiles."""
    folders = sorted(filter(_is_trusted, place.glob(f"{PREFIX}*")), key=_mark_used, reverse=True)
    for folder in folders[KEPT:]:
        shutil.rmtree(folder, ignore_errors=True)


def _is_trusted(folder: Path) -> bool:
    try:
        check_folder(folder)
    except OSError:
        return False
    return True


def _mark_used(folder: Path) -> float:
    try:
        return folder.stat().st_mtime
    except FileNotFoundError:
        return 0.0


def _remove(path: Path, process: int) -> None:
    """Remove a temporary folder when the process that created it ends, but not its children."""
    if os.getpid() == process:
        shutil.rmtree(path, ignore_errors=True)
