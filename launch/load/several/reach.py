"""Pairs of organs that may touch: those whose undeformed surfaces are nearer than the reach of their contact."""

from __future__ import annotations

from functools import lru_cache
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.engine.faults import Faults
from palpate.launch.load.several.lines import Pair
from palpate.launch.load.values.source import YamlSource
from palpate.messages import Vector3
from palpate.physics.errors import PalpateError
from palpate.units.quantity import UnitError, convert

if TYPE_CHECKING:
    from palpate.physics.geometry.mesh import Mesh

PLACED = (("position", "m"), ("rotation", "rad"))


def pairs_in_reach(organs: list[str], scene: YamlSource, faults: Faults) -> tuple[list[Pair], dict[Pair, str]]:
    """The pairs in the order of the list, and the others with the reason. A fault for each pair that overlaps, with its
    depth. Organs that cannot be read count as in reach: their nodes report why."""
    from palpate.nodes.contact.between import OVERLAP, Between  # numba and scipy, which few graphs need

    found: list[Pair] = []
    apart: dict[Pair, str] = {}
    reach = _number(scene.data.get("between"), "reach", Between.reach)
    for first, second in combinations(organs, 2):
        one, other = (_surface(scene.data[name].get("surface")) for name in (first, second))
        away = None if one is None or other is None else _distance(one, other, reach)
        if away is not None and away < -OVERLAP:
            faults.add(
                f"organs: {first} and {second} overlap by {-1e3 * away:.3g} mm at the start, expected a gap",
                f"Move one of them: `position` of {second} in the scene's list.", scene.place(second, "surface"),
            )  # fmt: skip
        if away is None or away < reach:
            found.append((first, second))
        else:
            apart[first, second] = f"{first} and {second} are farther apart than {1e3 * reach:.3g} mm (between.reach)"
    return found, apart


def _number(given: Any, key: str, default: float) -> float:
    """A length [m] of a part of the scene; the default if it is missing or no length, which its node reports."""
    value = given.get(key, default) if isinstance(given, dict) else default
    try:
        return convert(value, "m") if isinstance(value, str) else float(value)
    except (UnitError, TypeError, ValueError):
        return default


Surface = tuple[str, int, Vector3, Vector3, str, int, float, bytes]


def _surface(given: Any) -> Surface | None:
    """Name, vertices, position [m], rotation [rad], unit, piece, refinement [m] and digest of the file of a surface;
    None: it is not complete, or has a wrong value."""
    from palpate.nodes.base.surface import LEVEL, OnSurface, content_of

    if not isinstance(given, dict):
        return None
    try:
        position, rotation = (_vector(given.get(key, LEVEL), unit) for key, unit in PLACED)
        count, piece = int(given.get("vertices", OnSurface.vertices)), int(given.get("piece", OnSurface.piece))
    except (UnitError, TypeError, ValueError):
        return None
    unit, refine = str(given.get("file_unit", OnSurface.file_unit)), _number(given, "refine", OnSurface.refine)
    name = str(given.get("surface"))
    return name, count, position, rotation, unit, piece, refine, content_of(name)


def placed_mesh(given: Any) -> tuple[Mesh | None, np.ndarray, np.ndarray]:
    """The surface of an organ where it lies [m], its rotation (3,3) and position [m] (3). None: it cannot be read."""
    from palpate.nodes.base.surface import rotation_matrix, surface_mesh

    known = _surface(given)
    if known is None:
        return None, np.eye(3), np.zeros(3)
    name, count, position, rotation, unit, piece, refine, _ = known
    try:
        mesh = surface_mesh(name, count, position, rotation, unit, piece=piece, refine=refine)
        return mesh, rotation_matrix(rotation), np.array(position)
    except (PalpateError, ValueError):
        return None, np.eye(3), np.zeros(3)


def _vector(given: Any, unit: str) -> Vector3:
    """UnitError, TypeError, ValueError: not three numbers."""
    x, y, z = (convert(v, unit) if isinstance(v, str) else float(v) for v in given)
    return x, y, z


@lru_cache(maxsize=64)
def _distance(one: Surface, other: Surface, reach: float) -> float | None:
    """The smallest signed distance [m] of two surfaces where they are nearer than the reach, infinite elsewhere; None:
    one of them cannot be read."""
    from palpate.nodes.base.surface import surface_mesh
    from palpate.physics.contact.organs.candidates import nearest_distance

    try:
        first, second = (
            surface_mesh(name, count, position, rotation, unit, piece=piece, refine=refine)
            for name, count, position, rotation, unit, piece, refine, _ in (one, other)
        )
        return nearest_distance(first, second, reach)
    except (PalpateError, ValueError):
        return None
