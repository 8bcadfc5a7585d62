"""Stored bases of the reduced body: what each was made from, where it lies, and whether it still fits.

A basis is found by a hash of all that it depends on: the settings that it is built with, the vertices and triangles of
the surface, the constants of the code that builds it (layers and moduli of the fingertip, the places that are pressed,
tolerances), and `METHOD`. The file says all of it, with the version, commit and command that built it and its error.
"""

from __future__ import annotations

import ast
import hashlib
import importlib.util
import json
import os
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from palpate.physics.archive import ArchiveError, read_arrays
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.mesh_closest import MeshClosestPoint

SHIPPED = Path(__file__).parent / "bases"
METHOD = 3
"""Number of what the code computes. Raise it whenever a rebuilt basis has other numbers: all older ones are unknown
then. A test holds the numbers of a small basis to it."""
ORGAN = (
    "fe/meshing/organ.py", "fe/reduce/dents.py", "fe/reduce/indentation.py", "physics/bodies/dents.py:SPACING,SOFTEST",
    "physics/materials/hyperelastic.py",
)  # fmt: skip
SAMPLED = ("fe/reduce/reduction.py", "fe/reduce/sampling.py", "fe/reduce/snapshots.py")
FINGER = ("fe/meshing/fingertip.py", "fe/meshing/layers.py", "fe/reduce/reducible.py")
"""Files whose constants and default fields a basis of an organ, a sampled one and the fingertip's depend on: all of
them, or those named."""
HOMES = {"fe": "models.fe"}
"""Packages whose name in a key is older than their place: the bases that ship stay valid."""
GRID = 1e-7
"""[m] To which vertices are rounded before they are hashed, as another processor rounds the last bits otherwise."""
NEAR = 0.01
"""[1] Farthest that a vertex of a basis may lie off the surface, over its extent, where the surface was meshed anew."""


def digest(mesh: Mesh) -> str:
    """A hash of the vertices and triangles of a mesh."""
    grid = np.floor(mesh.vertices / GRID + 0.3719).astype("<i8")  # off the places where round numbers fall
    return hashlib.sha256(grid.tobytes() + mesh.triangles.astype("<i8").tobytes()).hexdigest()[:16]


@lru_cache(maxsize=8)
def constants(files: tuple[str, ...]) -> dict[str, str]:
    """Upper-case constants and default fields of classes in these files of the package, as they are written."""
    assignments = {}
    for file in files:
        name, _, only = file.partition(":")
        top, _, rest = name.partition("/")
        spec = importlib.util.find_spec(f"palpate.{HOMES.get(top, top)}")
        assert spec is not None and spec.submodule_search_locations
        tree = ast.parse((Path(next(iter(spec.submodule_search_locations))) / rest).read_text(encoding="utf-8"))
        scopes = [("", tree.body)] + [(f"{c.name}.", c.body) for c in tree.body if isinstance(c, ast.ClassDef)]
        for scope, body in scopes:
            for line in body:
                if scope and not isinstance(line, ast.AnnAssign):  # a field has its type
                    continue
                targets = line.targets if isinstance(line, ast.Assign) else [getattr(line, "target", None)]
                value = getattr(line, "value", None)
                for target in targets:
                    names = target.elts if isinstance(target, ast.Tuple) else [target]
                    own = [n.id for n in names if isinstance(n, ast.Name)]
                    chosen = not only or set(own) & set(only.split(","))
                    if value is not None and own and chosen and (scope or own[0].isupper()):
                        assignments[f"{name}:{scope}{','.join(own)}"] = ast.unparse(value)
    return assignments


def key(inputs: dict[str, Any]) -> str:
    """The hash that a basis made from these is found by."""
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
    flat = [
        {**{k: v for k, v in inputs.items() if k != "constants"}, **inputs.get("constants", {})}
        for inputs in (made, wanted)
    ]
    return [
        f"{name} was {flat[0].get(name)}, is {flat[1].get(name)}"
        for name in sorted(flat[0].keys() | flat[1].keys())
        if flat[0].get(name) != flat[1].get(name)
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
    """Folder of the full solutions that `palpate reduce` keeps while it builds."""
    return cache().with_name("touches")
