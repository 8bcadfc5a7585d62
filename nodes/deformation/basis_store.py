"""Stored bases of the reduced body: their inputs, their files, and whether they fit a surface.

The key of a basis is a hash of all its inputs: the settings of the build, the vertices and triangles of the surface,
and the version of the builder (`BUILDERS`). The file contains these inputs, the version of palpate, the commit and the
command of the build, and the error of the basis.
"""

import functools
import hashlib
import json
from pathlib import Path
from typing import Any, Protocol, Self, TypeVar

import numpy as np

from palpate.compiler.trust import may_read, user_cache
from palpate.physics.archive import ArchiveError, read_arrays
from palpate.physics.bodies.condensed_body import Start
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.mesh_closest import MeshClosestPoint

SHIPPED = Path(__file__).parent / "bases"
BUILDERS = {"condensed": 4, "sampled": 4}
"""Version of the builder of each kind of basis. Increase it whenever a rebuilt basis has other numbers; older bases are
then no longer found. Tests compare the constants and the numbers of a small basis with this version."""
GRID = 1e-7
"""[m] Rounding of vertices before they are hashed, since the last bits depend on the processor."""
KEPT = 1.25
"""[1] Vertices of a file over the setting `coarse` up to which the basis has those of the file; beyond, the surface is
reduced to about `coarse` vertices when the basis is built."""
EDGE, MOST_REDUCED = 8e-3, 1500
"""Unless `coarse` is set: length of the edges [m] to which a file is reduced, the radius of a fingertip's patch, and
the largest number of vertices, whose basis takes 50 s of processor time."""
NEAR = 0.01
"""[1] Largest distance of a basis' vertex from the surface over the surface's extent, if the surface was remeshed."""


class Stored(Protocol):
    """A basis that a file contains."""

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read the file. ArchiveError: it is unreadable."""


B = TypeVar("B", bound=Stored)


def digest(mesh: Mesh) -> str:
    """Hash of the vertices and triangles of a mesh."""
    grid = np.floor(mesh.vertices / GRID + 0.3719).astype("<i8")  # offset, so that no round number is at a step
    return hashlib.sha256(grid.tobytes() + mesh.triangles.astype("<i8").tobytes()).hexdigest()[:16]


def key(inputs: dict[str, Any]) -> str:
    """Key of the basis with these inputs."""
    return hashlib.sha256(json.dumps(inputs, sort_keys=True).encode()).hexdigest()[:16]


def shipped_bases() -> dict[str, dict[str, Any]]:
    """Provenance of each shipped basis by the name of its file."""
    index: dict[str, dict[str, Any]] = json.loads((SHIPPED / "index.json").read_text(encoding="utf-8"))
    return index


def find(folder: Path, wanted: str) -> Path | None:
    """Path of the basis with this key in a folder; None if it is missing, or another user can have written it."""
    if folder == SHIPPED:
        names = [name for name, about in shipped_bases().items() if about["key"] == wanted]
        return folder / names[0] if names else None
    found = sorted(folder.glob(f"*-{wanted}.npz"))
    return next((path for path in found if folder != cache() or may_read(path)), None)


def load(kind: type[B], path: Path) -> B:
    """A stored basis. The last ones are kept: parallel runs and studies start thousands of bodies with the same basis.
    ArchiveError: it is unreadable."""
    try:
        stamp = path.stat()
    except OSError as error:
        raise ArchiveError(f"{path}: {error.strerror}") from None
    return _load(kind, path, stamp.st_ino, stamp.st_mtime_ns, stamp.st_size)


@functools.lru_cache(maxsize=2)
def _load(kind: type[B], path: Path, *_: int) -> B:
    return kind.load(path)


def about(path: Path) -> dict[str, Any] | None:
    """Provenance of a stored basis; None if the file has none."""
    try:
        provenance = json.loads(str(read_arrays(path, "about")["about"]))
    except (ArchiveError, KeyError, ValueError, RecursionError):
        return None
    return provenance if isinstance(provenance, dict) else None


def differences(made: dict[str, Any], wanted: dict[str, Any]) -> list[str]:
    """Differences of two inputs, one text each."""
    return [
        f"{name} was {made.get(name)}, is {wanted.get(name)}"
        for name in sorted(made.keys() | wanted.keys())
        if made.get(name) != wanted.get(name)
    ]


def start_key(*arguments: Any) -> str:
    """Hash of the arguments of a body: arrays, numbers and None."""
    hasher = hashlib.sha256()
    for each in arguments:
        array = isinstance(each, np.ndarray)
        hasher.update(f"{each.dtype.str}{each.shape}".encode() if array else repr(each).encode())
        hasher.update(np.ascontiguousarray(each).data if array else b"")
    return hasher.hexdigest()[:32]


@functools.lru_cache(maxsize=4)
def start(path: Path, wanted: str) -> Start | None:
    """The start of a body that a basis contains, for arguments with this key; None: it contains another one or none.
    It has the bits that the body would compute (`benchmarks/extend_bases.py`)."""
    try:
        stored = read_arrays(path, "start", *Start._fields)
        if str(stored["start"]) != wanted:
            return None
        size = len(stored["softness"])
        table = np.zeros((size, size), np.float32)
        table[np.tril_indices(size)] = stored["table"]
    except (ArchiveError, KeyError, ValueError):
        return None
    table = np.where(np.tri(size, dtype=bool), table, table.T)
    return Start(stored["corners"], stored["weights"], table, stored["softness"], stored["holding"])


def off(vertices: np.ndarray, surface: Mesh, reduced: bool = False) -> float:
    """Largest distance of the vertices [m] (V,3) of a basis from a surface, over the extent of the surface [1]: of each
    from that of the same index, unless the basis has a reduced surface, whose vertices may be as many by chance."""
    across = float(np.ptp(surface.vertices, axis=0).max())
    if vertices.shape == surface.vertices.shape and not reduced:
        return float(np.linalg.norm(vertices - surface.vertices, axis=1).max()) / across
    foot, *_ = MeshClosestPoint(surface).find(vertices)
    return float(np.linalg.norm(vertices - foot, axis=1).max()) / across


def cache() -> Path:
    """Folder of the bases that were built on this machine."""
    return user_cache() / "bases"


def touches() -> Path:
    """Folder of the full solutions that `palpate build basis` stores during a build."""
    return cache().with_name("touches")
