"""Binary records, without JSON, of the page's messages for external renderers (docs/renderers.md)."""

import struct
from typing import Any

import msgspec

VERSION = 1
RATE = 60.0  # [1/s] of frames while a renderer listens
MESH = struct.Struct("<4sHHIIfI")
"""Magic, version, fingers, vertices, triangles, thickness of the fingertip [m], 0."""
FRAME = struct.Struct("<4sHHIId")  # Magic, version, fingers, moved vertices, late ticks, time [s]
FINGER = struct.Struct("<12f3fI")
"""Tip, foot [m], normal [1], force on the hand [N] (3 each), normal force [N], indentation, compression [m], state."""
TOUCHES, TIP, FORCE, FRICTION, STICKS = (1 << bit for bit in range(5))
"""Bits of the state: in contact; tip, force and friction are known; the contact sticks."""
ZERO = (0.0, 0.0, 0.0)


def binary(data: bytes) -> bytes:
    """The record of a mesh or frame of the page (`feed.packed`)."""
    (length,) = struct.unpack_from("<I", data)
    head = msgspec.json.decode(data[4 : 4 + length])
    first, second, _ = (4 * size for size in head["sizes"])
    indices, values = data[4 + length : 4 + length + first], data[4 + length + first : 4 + length + first + second]
    if head["kind"] == "mesh":
        counts = len(head.get("fingers", (0,))), len(values) // 12, len(indices) // 12
        return MESH.pack(b"PLPM", VERSION, *counts, head.get("thickness", 0.0), 0) + values + indices
    fingers = [head, *head["others"]]
    begin = FRAME.pack(b"PLPF", VERSION, len(fingers), len(indices) // 4, head["late"], head["time"])
    return b"".join((begin, *map(_finger, fingers), indices, values))


def _finger(told: dict[str, Any]) -> bytes:
    state = TOUCHES * (told["load"] > 0.0) + TIP * ("tip" in told) + FORCE * ("force" in told)
    state += FRICTION * ("stick" in told) + STICKS * bool(told.get("stick"))
    places = told.get("tip", told["foot"]), told["foot"], told["normal"], told.get("force", ZERO)
    numbers = told["load"], told["depth"], told["squeeze"]
    return FINGER.pack(*(number for place in places for number in place), *numbers, state)
