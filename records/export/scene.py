"""Foxglove's message types of a 3-D scene as JSON: their schemas, and messages that fit them.

Foxglove's 3-D panel knows a type by the name of its schema (https://docs.foxglove.dev/docs/sdk/schemas). Of what an
entity may hold, a scene here has triangles and arrows; the other lists are demanded by the type and stay empty.
"""

from __future__ import annotations

from typing import Any

import numpy as np

WORLD = "world"  # frame of all places in messages
SHAFT, HEAD = 1e-3, 2.5e-3
"""[m] Diameters of an arrow; its head is twice as long as wide, but no more than half of the arrow."""
DIGITS = 6  # of lengths in metres: a micrometre


def _object(title: str, **properties: Any) -> dict[str, Any]:
    """Schema of an object that has all of these."""
    return {"title": title, "type": "object", "properties": properties, "required": list(properties)}


def _list(items: dict[str, Any]) -> dict[str, Any]:
    return {"type": "array", "items": items}


_TEXT, _FLAG, _NUMBER = {"type": "string"}, {"type": "boolean"}, {"type": "number"}
_NANOSECONDS = {"type": "integer", "minimum": 0, "maximum": 999999999}
_TIME = _object("time", sec={"type": "integer", "minimum": 0}, nsec=_NANOSECONDS)
_SPAN = _object("duration", sec={"type": "integer"}, nsec=_NANOSECONDS)
_PLACE = _object("foxglove.Vector3", x=_NUMBER, y=_NUMBER, z=_NUMBER)
_TURN = _object("foxglove.Quaternion", x=_NUMBER, y=_NUMBER, z=_NUMBER, w=_NUMBER)
_POSE = _object("foxglove.Pose", position=_PLACE, orientation=_TURN)
_COLOUR = _object("foxglove.Color", r=_NUMBER, g=_NUMBER, b=_NUMBER, a=_NUMBER)
_ARROW = _object(
    "foxglove.ArrowPrimitive", pose=_POSE, shaft_length=_NUMBER, shaft_diameter=_NUMBER, head_length=_NUMBER,
    head_diameter=_NUMBER, color=_COLOUR,
)  # fmt: skip
_TRIANGLES = _object(
    "foxglove.TriangleListPrimitive", pose=_POSE, points=_list(_PLACE), color=_COLOUR, colors=_list(_COLOUR),
    indices=_list({"type": "integer", "minimum": 0}),
)  # fmt: skip
_UNUSED = ("cubes", "spheres", "cylinders", "lines", "texts", "models")
_ENTITY = _object(
    "foxglove.SceneEntity", timestamp=_TIME, frame_id=_TEXT, id=_TEXT, lifetime=_SPAN, frame_locked=_FLAG,
    metadata=_list(_object("foxglove.KeyValuePair", key=_TEXT, value=_TEXT)),
    arrows=_list(_ARROW), triangles=_list(_TRIANGLES), **{name: _list(_object(name)) for name in _UNUSED},
)  # fmt: skip
_DELETION = _object("foxglove.SceneEntityDeletion", timestamp=_TIME, type={"type": "integer"}, id=_TEXT)
SCENE = _object("foxglove.SceneUpdate", deletions=_list(_DELETION), entities=_list(_ENTITY))
FRAMES = _object(
    "foxglove.FrameTransforms",
    transforms=_list(_object(
        "foxglove.FrameTransform", timestamp=_TIME, parent_frame_id=_TEXT, child_frame_id=_TEXT, translation=_PLACE,
        rotation=_TURN,
    )),
)  # fmt: skip

_LEVEL = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
_PLAIN = {"r": 0.8, "g": 0.8, "b": 0.8, "a": 1.0}


def surface(
    time: int, name: str, points: np.ndarray, triangles: np.ndarray, colours: np.ndarray, about: dict[str, str]
) -> dict[str, Any]:
    """A scene update with one surface, in place of the one of this name before.

    points [m] (V,3), triangles (T,3), colours (V,3) red, green, blue from 0 to 255, about what a click on it tells
    """
    part = {
        "pose": {"position": _place(np.zeros(3)), "orientation": _LEVEL},
        "points": _places(points),
        "color": _PLAIN,
        "colors": [{"r": r, "g": g, "b": b, "a": 1.0} for r, g, b in np.round(colours / 255.0, 3).tolist()],
        "indices": triangles.ravel().tolist(),
    }
    return _update(time, name, about, triangles=[part])


def arrow(
    time: int, name: str, foot: np.ndarray, vector: np.ndarray, colour: str, about: dict[str, str]
) -> dict[str, Any]:
    """A scene update with one arrow, in place of the one of this name before; with none, where it is shorter than a
    micrometre.

    foot [m] (3) where it begins, vector [m] (3) to its tip, colour as `#rrggbb`, about what a click on it tells
    """
    length = float(np.linalg.norm(vector))
    if length < 10.0**-DIGITS:
        return _update(time, name, about)
    head = min(2.0 * HEAD, 0.5 * length)
    red, green, blue = (value / 255.0 for value in bytes.fromhex(colour[1:]))
    part = {
        "pose": {"position": _place(foot), "orientation": _towards(vector / length)},
        "shaft_length": length - head,
        "shaft_diameter": SHAFT,
        "head_length": head,
        "head_diameter": HEAD,
        "color": {"r": red, "g": green, "b": blue, "a": 1.0},
    }
    return _update(time, name, about, arrows=[part])


def frames(time: int, name: str, place: np.ndarray) -> dict[str, Any]:
    """Where a frame of this name is in the world: at a place [m] (3), not turned."""
    moved = {
        "timestamp": _stamp(time), "parent_frame_id": WORLD, "child_frame_id": name, "translation": _place(place),
        "rotation": _LEVEL,
    }  # fmt: skip
    return {"transforms": [moved]}


def _update(time: int, name: str, about: dict[str, str], **parts: list[dict[str, Any]]) -> dict[str, Any]:
    entity = {
        "timestamp": _stamp(time),
        "frame_id": WORLD,
        "id": name,
        "lifetime": {"sec": 0, "nsec": 0},  # until the next one of this name
        "frame_locked": False,
        "metadata": [{"key": key, "value": value} for key, value in about.items()],
        **{kind: [] for kind in ("arrows", "triangles", *_UNUSED)},
    }
    return {"deletions": [], "entities": [entity | parts]}


def _stamp(time: int) -> dict[str, int]:
    return {"sec": time // 1_000_000_000, "nsec": time % 1_000_000_000}


def _places(points: np.ndarray) -> list[dict[str, float]]:
    return [{"x": x, "y": y, "z": z} for x, y, z in np.round(points, DIGITS).tolist()]


def _place(point: np.ndarray) -> dict[str, float]:
    return _places(np.asarray(point, dtype=float)[None])[0]


def _towards(way: np.ndarray) -> dict[str, float]:
    """The shortest turn, as a unit quaternion, that brings +x to a unit vector (3)."""
    if way[0] < -1.0 + 1e-12:
        return {"x": 0.0, "y": 0.0, "z": 1.0, "w": 0.0}
    turn = np.array([0.0, -way[2], way[1], 1.0 + way[0]])
    x, y, z, w = (turn / np.linalg.norm(turn)).tolist()
    return {"x": x, "y": y, "z": z, "w": w}
