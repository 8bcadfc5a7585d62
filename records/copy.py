"""A new recording with the streams and the provenance of another one."""

from __future__ import annotations

import json
from typing import IO, Any

from palpate.nodes.logger.mcap import PROFILE
from palpate.records.format.mcap_writer import McapWriter
from palpate.records.stored import Stored


def begin_copy(recording: Stored, file: IO[bytes], about: dict[str, Any]) -> tuple[McapWriter, dict[str, int]]:
    """A writer for it, and the number of each stream's channel. `about` replaces the provenance."""
    writer = McapWriter(file, PROFILE)
    write_json(writer, "palpate.about", about)
    for node, ticks in recording.restarted.items():
        for tick in ticks:
            writer.add_metadata("palpate.restarted", {"node": node, "tick": str(tick)})
    schemas: dict[str, int] = {}
    channels = {}
    for name, stream in recording.streams.items():
        kind, title = stream.schema["class"], stream.schema["title"]
        if kind not in schemas:
            schemas[kind] = writer.add_schema(title, json.dumps(stream.schema).encode())
        about_stream = {"producer": stream.producer, "every": str(stream.every), "thin": str(stream.thin)}
        if stream.kept:
            about_stream["kept"] = stream.kept
        channels[name] = writer.add_channel(name, "msgpack", schemas[kind], about_stream)
    return writer, channels


def write_json(writer: McapWriter, name: str, data: dict[str, Any]) -> None:
    """Metadata, each value of them as JSON."""
    writer.add_metadata(name, {key: json.dumps(value) for key, value in data.items()})
