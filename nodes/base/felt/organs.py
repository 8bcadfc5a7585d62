"""The surface that a finger feels of several organs together, and the part of its patch on each."""

import json
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from palpate.compiler.exact import einsum
from palpate.nodes.base.node import SettingError
from palpate.nodes.base.stored.surfaces import arrays_of_mesh, makers, mesh_of_arrays, stored
from palpate.nodes.base.surface import LEVEL, content_of, place_mesh, rotation_matrix, surface_mesh
from palpate.physics.contact.organs.shared_patch import SharedFelt, close_bodies, near_bodies
from palpate.physics.errors import MeshError
from palpate.physics.extras import missing
from palpate.physics.geometry.mesh import Mesh

NAMES = ("surface", "vertices", "position", "rotation", "file_unit", "piece", "refine")
"""Settings of the surface of an organ, in `WithWidth.organs` and as arguments of `surface_mesh`."""


class Part(NamedTuple):
    """What concerns one organ of a surface that is felt of several.

    mesh       the felt surface, in the world
    share      [1] (V) part of the patch on this organ with the foot at each vertex
    away       [m] (V) distance of each vertex from this organ
    origin     (T) for each triangle the nearest touchable one of this organ
    touchable  (T') whether the finger touches each triangle of this organ
    area, depth, place  as of a `Felt`; the place in the world
    """

    mesh: Mesh
    share: np.ndarray
    away: np.ndarray
    origin: np.ndarray
    touchable: np.ndarray
    area: float
    depth: float
    place: np.ndarray


def organs_text(surfaces: list[dict[str, Any]], own: int) -> str:
    """The setting `organs` of a node on surface number `own` of a finger's surfaces."""
    return json.dumps({"surfaces": [{name: each[name] for name in NAMES} for each in surfaces], "own": own})


def shared_part(text: str, width: float) -> tuple[Part | None, str]:
    """The part of the organ of a node in the felt surface of it and of the organs that are nearer than the width of the
    finger [m]; None: no organ is so near, or the surface could not be made, and why not.

    text  the setting `organs`

    SettingError: it is not what the loader sets.
    """
    try:
        given = json.loads(text)
        listed = [tuple(_value(each[name]) for name in NAMES) for each in given["surfaces"]]
        own = listed[given["own"]]
    except (ValueError, TypeError, KeyError, IndexError):
        raise SettingError(
            "setting 'organs': found no surfaces as JSON; leave it out, it is set when the graph is loaded"
        ) from None
    # in a sorted order, so that it does not matter how a graph lists them
    ordered = tuple(sorted(set(listed), key=repr))
    group = _group(ordered, tuple(content_of(each[0]) for each in ordered), width, ordered.index(own))
    if len(group) < 2:
        return None, ""
    felt, fault = _felt(group, tuple(content_of(each[0]) for each in group), width)
    if felt is None:
        return None, fault
    number, (_, _, position, rotation, *_) = group.index(own), group[0]
    place = einsum("k,jk->j", felt.place, rotation_matrix(rotation)) + position
    return Part(
        place_mesh(felt.mesh, position, rotation), felt.shares[:, number], felt.away[:, number],
        felt.origins[:, number], felt.touchable[number], felt.area, felt.depth, place,
    ), ""  # fmt: skip


def _value(given: Any) -> Any:
    return tuple(given) if isinstance(given, list) else given


@lru_cache(maxsize=16)
def _group(surfaces: tuple, contents: tuple[bytes, ...], width: float, own: int) -> tuple:
    """The surfaces near that number `own`, with it."""
    groups = near_bodies([surface_mesh(*each) for each in surfaces], width)
    return tuple(surfaces[k] for k in next(group for group in groups if own in group))


@lru_cache(maxsize=2)
def _felt(surfaces: tuple, contents: tuple[bytes, ...], width: float) -> tuple[SharedFelt | None, str]:
    """The felt surface in the frame of the first one, so that it does not depend on a motion of all; and why it could
    not be made."""
    _, _, origin, rotation, *_ = surfaces[0]
    turn = rotation_matrix(rotation)

    def local(given: tuple) -> Mesh:
        name, vertices, position, turned, *more = given
        if (position, turned) == (origin, rotation):
            return surface_mesh(name, vertices, LEVEL, LEVEL, *more)
        mesh = surface_mesh(*given)
        facing = None if mesh.facing is None else einsum("ik,kj->ij", mesh.facing, turn)
        points = einsum("ik,kj->ij", mesh.vertices - np.asarray(origin), turn)
        return Mesh(np.ascontiguousarray(points), mesh.triangles, facing)

    def arrays() -> dict[str, np.ndarray]:
        before = [local((*each[:-1], 0.0)) for each in surfaces] if any(contents) else None  # with `refine` of 0
        found = close_bodies([local(each) for each in surfaces], 0.5 * width, before)
        if found is None:
            return {}
        numbers = np.array([found.area, found.depth, *found.place])
        each = {f"touchable{k}": part for k, part in enumerate(found.touchable)}
        return {
            **arrays_of_mesh(found.mesh), "shares": found.shares, "away": found.away, "origins": found.origins,
            "numbers": numbers, **each,
        }  # fmt: skip

    inputs = {
        "surfaces": [list(each) for each in surfaces], "contents": [content.hex() for content in contents],
        "width": width, "made by": makers(),
    }  # fmt: skip
    try:
        made = stored("organs", inputs, arrays, "surface that the finger can touch of several organs")
    except MeshError as error:
        return None, str(error)
    except ImportError as error:
        return None, missing("collision.Mesh", error.name, "mesh")
    if not made:
        return None, ""
    area, depth, *place = made["numbers"].tolist()
    parts = [made[f"touchable{k}"] for k in range(len(surfaces))]
    return SharedFelt(
        mesh_of_arrays(made), made["shares"], made["away"], made["origins"], parts, area, depth, np.array(place)
    ), ""
