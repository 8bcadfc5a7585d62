"""MCAP with JSON channels, which Foxglove, PlotJuggler and the `mcap` command decode."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from mcap.writer import CompressionType, Writer

from palpate.launch.recording.reader import Recording, RecordingError
from palpate.messages import Message, MessageError, fields, unpack
from palpate.messages.base import HEADER

_CHUNK = 1 << 20


def write_foxglove(recording: Recording, target: Path, streams: tuple[str, ...], every: int = 1) -> list[Path]:
    """One file: channel and schema per stream, each message a JSON object; arrays become lists of lists."""
    if target.exists() and target.samefile(recording.path):
        raise RecordingError(f"{target} is the recording itself; name another file with --out")
    target.parent.mkdir(parents=True, exist_ok=True)
    part = target.with_name(target.name + ".part")
    kinds = {name: recording.streams[name].type for name in streams}
    seen = dict.fromkeys(streams, 0)
    with open(part, "wb") as file:
        writer = Writer(file, chunk_size=_CHUNK, compression=CompressionType.ZSTD)
        writer.start(profile="", library="palpate")
        schemas = {
            kind: writer.register_schema(
                f"palpate.{kind.__name__}", "jsonschema", json.dumps(json_schema(kind)).encode()
            )
            for kind in dict.fromkeys(kinds.values())
        }
        channels = {name: writer.register_channel(f"/{name}", "json", schemas[kind]) for name, kind in kinds.items()}
        for name, tick, time, payload in recording.raw():
            if name not in kinds:
                continue
            seen[name] += 1
            if (seen[name] - 1) % every:
                continue
            try:
                message = unpack(payload, kinds[name])
            except MessageError as error:
                raise RecordingError(f"{recording.path}: stream {name!r}, tick {tick}: {error}") from None
            writer.add_message(channels[name], time, msgspec.json.encode(as_plain(message)), time, tick)
        writer.finish()
    os.replace(part, target)
    return [target]


def as_plain(message: Message) -> dict[str, Any]:
    """A message as numbers, texts and lists."""
    plain: dict[str, Any] = {"tick": message.tick, "time": message.time, "source": message.source, "used": message.used}
    for field in fields(type(message)):
        value = getattr(message, field.name)
        plain[field.name] = value.tolist() if isinstance(value, np.ndarray) else value
    return plain


def json_schema(kind: type[Message]) -> dict[str, Any]:
    """JSON schema of `as_plain`; the unit stands in each field's title, as `force [N]`."""
    plain: dict[Any, str] = {int: "integer", bool: "boolean", str: "string", float: "number"}
    properties: dict[str, Any] = {
        "tick": {"type": "integer"},
        "time": {"type": "integer", "title": "time [ns]"},
        "source": {"type": "string"},
        "used": {"type": "array", "items": {"type": "integer"}},
    }
    assert tuple(properties) == HEADER
    for field in fields(kind):
        if field.dtype is None and not field.shape:
            schema: dict[str, Any] = {"type": plain.get(field.type, "string")}
        else:
            whole = field.dtype is not None and field.dtype.kind in "iu"
            schema = {"type": "integer" if whole else "number"}
            for _ in field.shape:
                schema = {"type": "array", "items": schema}
        properties[field.name] = {**schema, "title": field.label}
    about = (kind.__doc__ or "").partition("\n")[0]
    return {"title": kind.__name__, "description": about, "type": "object", "properties": properties}
