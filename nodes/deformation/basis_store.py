"""Stored bases of the reduced body: what each was made from, where it lies, and whether it still fits.

A basis is found by a hash of all that it depends on: the settings that it is built with, the vertices and triangles of
the surface, and the version of its builder (`BUILDERS`). The file says all of it, with the version of palpate, the
commit and the command that built it, and its error.
"""

import hashlib
import json
import os
from pathlib import Path
from typing import Any

import numpy as np

from palpate.physics.archive import ArchiveError, read_arrays
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.mesh_closest import MeshClosestPoint

SHIPPED = Path(__file__).parent / "bases"
BUILDERS = {"condensed": 4, "sampled": 4}
"""Version of what builds each kind of basis. Raise it whenever a rebuilt basis has other numbers: all older ones are
unknown then. Tests hold the constants and the numbers of a small basis to it."""
GRID = 1e-7
"""[m] To which vertices are rounded before they are hashed, as another processor rounds the last bits otherwise."""
NEAR = 0.01
"""[1] Farthest that a vertex of a basis may lie off the surface, over its extent, where the surface was meshed anew."""


def digest(mesh: Mesh) -> str:
    """A hash of the vertices and triangles of a mesh."""
    grid = np.floor(mesh.vertices / GRID + 0.3719).astype("<i8")  # off the places where round numbers fall
    return hashlib.sha256(grid.tobytes() + mesh.triangles.astype("<i8").tobytes()).hexdigest()[:16]


def key(inputs: dict[str, Any]) -> str:
    """Hash under which the basis made from these inputs is stored."""
    return hashlib.sha256(json.dumps(inputs, sort_keys=True).encode()).hexdigest()[:16]


def shipped() -> dict[str, dict[str, Any]]:
    """What is said of each shipped basis, by the name of its file."""
    index: dict[str, dict[str, Any]] = json.loads((SHIPPED / "index.json").read_text(encoding="utf-8"))
    return index


def find(folder: Path, wanted: str) -> Path | None:
    """The basis with this key in a folder."""
    if folder == SHIPPED:
        names = [name for name, about in shipped().items() if about["key"] == wanted]
        return folder / names[0] if names else None
    return next(iter(sorted(folder.glob(f"*-{wanted}.npz"))), None)


def about(path: Path) -> dict[str, Any] | None:
    """What a stored basis says of itself; None where it says nothing."""
    try:
        provenance = json.loads(str(read_arrays(path, "about")["about"]))
    except (ArchiveError, KeyError, ValueError, RecursionError):
        return None
    return provenance if isinstance(provenance, dict) else None


def differences(made: dict[str, Any], wanted: dict[str, Any]) -> list[str]:
    """What two inputs differ in, one text each."""
    return [
        f"{name} was {made.get(name)}, is {wanted.get(name)}"
        for name in sorted(made.keys() | wanted.keys())
        if made.get(name) != wanted.get(name)
    ]


def off(vertices: np.ndarray, surface: Mesh) -> float:
    """How far the vertices [m] (V,3) of a basis lie from a surface at most, over its extent."""
    across = float(np.ptp(surface.vertices, axis=0).max())
    if vertices.shape == surface.vertices.shape:
        return float(np.linalg.norm(vertices - surface.vertices, axis=1).max()) / across
    foot, *_ = MeshClosestPoint(surface).find(vertices)
    return float(np.linalg.norm(vertices - foot, axis=1).max()) / across


def cache() -> Path:
    """Folder of the bases built on this machine."""
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "palpate" / "bases"


def touches() -> Path:
    """Folder of the full solutions that `palpate build basis` keeps while it builds."""
    return cache().with_name("touches")
