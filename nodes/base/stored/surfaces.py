"""Surfaces that were prepared before: refined meshes and felt surfaces, stored once per file and settings.

Both depend on the content of a mesh file, a few settings and this code alone. So they are stored next to the bases of
the reduced body, under a hash of these inputs, and every process of every later run reads them, for any position of
the surface. The tree of the closest-point search is not stored: it turns with the surface, and is made in 1 us per
triangle.

An entry is an archive of arrays without objects. One that another user can have written, that is damaged, or that was
made from other inputs is not used, and made again.
"""

import contextlib
import functools
import hashlib
import json
import os
from collections.abc import Callable, Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from palpate.compiler import kernel_cache
from palpate.compiler.trust import make_folder, may_read, user_cache
from palpate.nodes.base.stored import prepares
from palpate.physics.archive import ArchiveError, read_arrays, replacing
from palpate.physics.geometry.felt.bridge import Felt
from palpate.physics.geometry.mesh import Mesh

SOURCES = ("palpate.compiler", "palpate.physics.geometry", "palpate.nodes.base")
"""Their code determines the numbers of a surface: after a change of it, entries are no longer found."""
SIZE = 500_000_000  # [bytes] of the folder; a surface of 200 000 vertices takes 15 MB, and 25 MB with its felt surface
MAKERS = "scikit-image", "manifold3d"  # the packages on whose version a bridge depends
Arrays = Mapping[str, np.ndarray]


def folder() -> Path:
    """Folder of the surfaces that were prepared on this machine."""
    return user_cache() / "surfaces"


def stored(kind: str, inputs: Mapping[str, Any], make: Callable[[], Arrays], what: str) -> Arrays:
    """The arrays that `make` returns for these inputs, read if they are stored, else made and stored.

    kind, inputs  what is prepared, and all that it depends on, as JSON;  what  for the report of progress
    """
    about = json.dumps({"kind": kind, "sources": _version(), **inputs}, sort_keys=True)
    path = folder() / f"{kind}-{hashlib.sha256(about.encode()).hexdigest()[:32]}.npz"
    if (found := _read(path, about)) is not None:
        return found
    with prepares(what):
        arrays = make()
    with contextlib.suppress(OSError):  # a full disk, or a folder without write permission
        make_folder(path.parent)
        with replacing(path, cached=True) as part:
            np.savez(part, about=np.array(about), **arrays)  # type: ignore[arg-type]
        kernel_cache.remove_oldest(path.parent, SIZE)
    return arrays


@functools.cache
def _version() -> str:
    return kernel_cache.key(SOURCES)


def makers() -> list[str]:
    """The versions of the packages that make bridges; "": it is missing, and a body without bridges needs none."""
    return [_version_of(name) for name in MAKERS]


def _version_of(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return ""


def _read(path: Path, about: str) -> Arrays | None:
    """The arrays of an entry; None: it is missing, untrusted, damaged or of other inputs."""
    if not may_read(path):
        return None
    try:
        found = read_arrays(path)
    except ArchiveError:
        return None
    if str(found.pop("about", "")) != about:
        return None
    with contextlib.suppress(OSError):
        os.utime(path)  # by which `remove_oldest` knows what is used
    return found


def arrays_of_mesh(mesh: Mesh) -> dict[str, np.ndarray]:
    """The arrays of a mesh."""
    more = {} if mesh.facing is None else {"facing": mesh.facing}
    return {"vertices": mesh.vertices, "triangles": mesh.triangles, **more}


def mesh_of_arrays(arrays: Arrays) -> Mesh:
    """The mesh of these arrays."""
    return Mesh(arrays["vertices"], arrays["triangles"], arrays.get("facing"))


def arrays_of_felt(felt: Felt | None) -> dict[str, np.ndarray]:
    """The arrays of a felt surface; {} of None."""
    if felt is None:
        return {}
    numbers = np.array([felt.area, felt.depth, *felt.place])
    return {**arrays_of_mesh(felt.mesh), "origin": felt.origin, "touchable": felt.touchable, "numbers": numbers}


def felt_of_arrays(arrays: Arrays) -> Felt | None:
    """The felt surface of these arrays."""
    if not arrays:
        return None
    area, depth, *place = arrays["numbers"].tolist()
    return Felt(mesh_of_arrays(arrays), arrays["origin"], arrays["touchable"], area, depth, np.array(place))
