"""The surface of an organ as glTF 2.0 with haptic materials (extension MPEG_haptic_material of ISO/IEC 23090-14)."""

import base64
import json
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from palpate.engine.plan import Plan
from palpate.messages import Surface
from palpate.messages.vibration import Vibration
from palpate.physics.archive import replacing
from palpate.physics.geometry.mesh import Mesh
from palpate.records.export import source
from palpate.records.player import plan_of
from palpate.records.reader import Recording
from palpate.records.stored import RecordingError

EXTENSION = "MPEG_haptic_material"
WIDEST = 16_384  # [pixels] largest width of a texture that renderers accept
EVERY = 4  # points of a texture's table per pixel; this leaves 4 pixels per shortest wavelength
FLOATS, INDICES = 5126, 5125  # glTF codes of float32 and uint32
ATTRIBUTES, ELEMENTS = 34962, 34963  # glTF codes of the buffers of vertices and triangles


def write_gltf(recording: Recording, target: Path, streams: tuple[str, ...], every: int | None) -> list[Path]:
    """Write the mesh at rest of the first body, in one file, y upward as glTF demands.

    Its haptic material has the textures `stiffness` (coefficient K of the body's law at rest, median of the recording),
    and where the graph computes them `friction` (coefficient of sliding) and `vibrotactileTexture` (one period of the
    fluctuation of the lateral force over the normal force, along x or the texture's direction). Pixels are 16-bit grey
    levels g from 0 to 1; `extras` of each texture has offset, scale and unit: value = offset + scale g.

    RecordingError: no body with a mesh, or a texture without a spatial pattern.
    """
    stream = source(recording, Surface, streams, "`palpate run kidney` records one")
    planned, sender = plan_of(recording), recording.streams[stream].producer
    try:
        body: Any = planned.make(sender)
        mesh = body.mesh()
    except (AttributeError, ValueError, OSError) as error:
        raise RecordingError(f"{recording.path}: the mesh of node {sender!r} is not known here: {error}") from None
    law = recording.columns(stream)
    valid = np.isfinite(law["stiffness"]) & (law["stiffness"] > 0.0)
    maps: dict[str, tuple[np.ndarray, dict[str, Any]]] = {}
    if valid.any():
        exponent = float(np.median(law["exponent"][valid]))
        unit = "N/m" if exponent == 1.0 else f"N/m^{exponent:g}"
        rest = law["step"] / (law["step"] + law["relaxation"])  # the law of a tick includes the viscous force
        stiffness = (law["stiffness"] * rest ** law["exponent"])[valid]
        maps["stiffness"] = np.median(stiffness, keepdims=True), {"unit": unit, "exponent": exponent}
    nodes = [planned.graph.nodes[name].settings for name in planned.order]
    sliding = [each.get("mu_slide", each.get("mu")) for each in nodes if {"mu_slide", "mu"} & set(each)]
    if sliding:
        maps["friction"] = np.array(sliding[:1]), {"unit": "1"}
    along, length = np.array([1.0, 0.0, 0.0]), 1.0
    textured = recording.stream_of(Vibration)
    if textured is not None:
        pattern, length, along = _pattern(recording, planned, recording.streams[textured].producer)
        maps["vibrotactileTexture"] = pattern, {"unit": "1", "length [m]": length}
    document = gltf(mesh, maps, mesh.vertices @ along / length, f"{sender} of {recording.path.name}")
    with replacing(target) as part:
        part.write_text(json.dumps(document), encoding="utf-8")
    return [target]


def _pattern(recording: Recording, planned: Plan, sender: str) -> tuple[np.ndarray, float, np.ndarray]:
    """One period (n) [1] of the texture of a node, its length [m], and the direction [1] (3) of its path."""
    node: Any = planned.make(sender)
    try:
        table, spacing = node.period()
        direction = np.array(node.direction)
    except (AttributeError, ValueError) as error:
        raise RecordingError(
            f"{recording.path}: node {sender!r} has no pattern over the surface to export ({error}); expected "
            "texture.Spectral"
        ) from None
    if len(table) > EVERY * WIDEST:
        raise RecordingError(
            f"{recording.path}: a period of the texture of node {sender!r} has {len(table)} points; expected at most "
            f"{EVERY * WIDEST}, with a narrower range of its spectrum"
        )
    size = float(np.linalg.norm(direction))
    return table[::EVERY], len(table) * spacing, direction / size if size > 0.0 else np.array([1.0, 0.0, 0.0])


def gltf(mesh: Mesh, maps: dict[str, tuple[np.ndarray, dict[str, Any]]], u: np.ndarray, name: str) -> dict[str, Any]:
    """The document of a mesh with a haptic material.

    maps  values (n) along u of each haptic property, and what to add to its `extras`
    u     [1] (V)  texture coordinate of each vertex, in periods
    """
    data, views, accessors = bytearray(), [], []

    def add(part: bytes, **more: int) -> int:
        data.extend(bytes(-len(data) % 4))
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": len(part), **more})
        data.extend(part)
        return len(views) - 1

    def accessor(array: np.ndarray, kind: str, code: int, purpose: int) -> int:
        entry = {"bufferView": add(array.tobytes(), target=purpose), "componentType": code, "type": kind,
                 "count": len(array) if array.ndim > 1 else array.size}  # fmt: skip
        if kind == "VEC3":
            entry |= {"min": array.min(axis=0).tolist(), "max": array.max(axis=0).tolist()}
        accessors.append(entry)
        return len(accessors) - 1

    # vertices and triangles
    attributes = {
        "POSITION": accessor(mesh.vertices.astype("<f4"), "VEC3", FLOATS, ATTRIBUTES),
        "NORMAL": accessor(mesh.normals.astype("<f4"), "VEC3", FLOATS, ATTRIBUTES),
        "TEXCOORD_0": accessor(np.column_stack([u, np.full(len(u), 0.5)]).astype("<f4"), "VEC2", FLOATS, ATTRIBUTES),
    }
    indices = accessor(mesh.triangles.astype("<u4").ravel(), "SCALAR", INDICES, ELEMENTS)
    # an image for each haptic property
    material: dict[str, Any] = {"name": name}
    images = []
    for index, (prop, (values, extras)) in enumerate(maps.items()):
        offset = min(float(values.min()), 0.0)
        scale = float(values.max()) - offset or 1.0
        images.append({"bufferView": add(png((values - offset) / scale)), "mimeType": "image/png", "name": prop})
        material[prop] = [{"type": "High_Resolution" if len(values) > 1 else "Low_Resolution",
                           "texture": {"index": index, "texCoord": 0},
                           "extras": {"offset": offset, "scale": scale, **extras}}]  # fmt: skip
    document: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "palpate"}, "extensionsUsed": [EXTENSION], "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": name, "rotation": [-(0.5**0.5), 0.0, 0.0, 0.5**0.5]}],  # z up to y up
        "meshes": [{"primitives": [{"attributes": attributes, "indices": indices}],
                    "extensions": {EXTENSION: {"hapticMaterialIndex": 0}}}],
        "accessors": accessors, "bufferViews": views, "extensions": {EXTENSION: {"materials": [material]}},
    }  # fmt: skip
    if images:
        document |= {"images": images, "samplers": [{"wrapS": 10497, "wrapT": 10497}],  # repeat
                     "textures": [{"source": i, "sampler": 0} for i in range(len(images))]}  # fmt: skip
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    return document | {"buffers": [{"byteLength": len(data), "uri": uri}]}


def png(level: np.ndarray) -> bytes:
    """A PNG of one row (n) of 16-bit grey levels from 0 to 1."""

    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    head = struct.pack(">IIBBBBB", len(level), 1, 16, 0, 0, 0, 0)
    row = b"\0" + np.round(65535.0 * level).astype(">u2").tobytes()
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(row)) + chunk(b"IEND", b"")
