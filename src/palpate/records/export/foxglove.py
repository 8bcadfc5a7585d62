"""MCAP for Foxglove: every stream as JSON, which PlotJuggler and the `mcap` command also read."""

import json
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from mcap.writer import CompressionType, Writer

from palpate.messages import Message, fields
from palpate.messages.base import HEADER
from palpate.physics.archive import replacing
from palpate.records.reader import Recording

_CHUNK = 4 << 20  # [B] room for several surfaces, which compress well together


def write_foxglove(recording: Recording, target: Path, streams: tuple[str, ...], every: int | None) -> list[Path]:
    """Write one file. Each stream is a channel `/STREAM` of JSON objects; arrays are flat, in row-major order.

    RecordingError: a message does not fit its type.
    """
    kinds = {name: recording.streams[name].type for name in streams}
    seen = dict.fromkeys(streams, 0)
    with replacing(target) as part, open(part, "wb") as file:
        writer = Writer(file, chunk_size=_CHUNK, compression=CompressionType.ZSTD)
        writer.start(profile="", library="palpate")
        channels = {}
        for name, kind in kinds.items():
            schema = json.dumps(json_schema(kind)).encode()
            number = writer.register_schema(f"palpate.{kind.__name__}", "jsonschema", schema)
            channels[name] = writer.register_channel(f"/{name}", "json", number)
        for name, tick, time, payload in recording.raw():
            if name not in kinds:
                continue
            seen[name] += 1
            if (seen[name] - 1) % (every or 1):
                continue
            body = as_plain(recording.decode(name, tick, payload, kinds[name]), rows=False)
            writer.add_message(channels[name], time, msgspec.json.encode(body), time, tick)
        writer.finish()
    return [target]


def as_plain(message: Message, rows: bool = True) -> dict[str, Any]:
    """A message as numbers, texts and lists; arrays as nested lists (`rows`), or flat in row-major order."""
    plain = {name: getattr(message, name) for name in (*HEADER, *(field.name for field in fields(type(message))))}
    plain["delayed"] = plain["delayed"] or 0
    for name, value in plain.items():
        if isinstance(value, np.ndarray):
            plain[name] = (value if rows else value.ravel()).tolist()
    return plain


def json_schema(kind: type[Message]) -> dict[str, Any]:
    """JSON schema of `as_plain` with flat arrays, since Foxglove refuses nested lists. The title of a field has its
    unit, `force [N]`; the description of an array has its shape."""
    plain: dict[Any, str] = {int: "integer", bool: "boolean", str: "string", float: "number"}
    properties: dict[str, Any] = {
        "tick": {"type": "integer"},
        "time": {"type": "integer", "title": "time [ns]"},
        "source": {"type": "string"},
        "used": {"type": "array", "items": {"type": "integer"}},
        "delayed": {"type": "integer", "title": "delayed [ns]"},
    }
    assert tuple(properties) == HEADER
    for field in fields(kind):
        if field.dtype is None and not field.shape:
            schema: dict[str, Any] = {"type": plain.get(field.type, "string")}
        else:
            whole = field.dtype is not None and field.dtype.kind in "iu"
            schema = {"type": "array", "items": {"type": "integer" if whole else "number"}}
            if len(field.shape) > 1:
                schema["description"] = f"({', '.join(map(str, field.shape))}) row by row"
        properties[field.name] = {**schema, "title": field.label}
    about = (kind.__doc__ or "").partition("\n")[0]
    return {"title": kind.__name__, "description": about, "type": "object", "properties": properties}
