"""Making a complete recording of one that was cut off or damaged."""

from __future__ import annotations

import json
import os
from pathlib import Path

from palpate.nodes.logger.mcap import PROFILE
from palpate.records.format.mcap_writer import McapWriter
from palpate.records.reader import Recording, RecordingError


def recover(path: Path, out: Path | None = None) -> tuple[Path, dict[str, int]]:
    """Write what can be read of a recording to a complete file, with its index.

    out  None: beside the file, with `-recovered` in its name

    Returns the new file and the number of messages per stream. RecordingError: there is nothing to recover.
    """
    recording = Recording(path)
    target = out or path.with_name(f"{path.stem}-recovered{path.suffix}")
    if target.exists():
        raise RecordingError(f"{target} exists; name another file with --out")
    counts = dict.fromkeys(recording.streams, 0)
    part = target.with_name(target.name + ".part")
    target.parent.mkdir(parents=True, exist_ok=True)
    with open(part, "wb") as file:
        writer = McapWriter(file, PROFILE)
        about = {**recording.about, "recovered_from": str(path)}
        writer.add_metadata("palpate.about", {key: json.dumps(value) for key, value in about.items()})
        for node, ticks in recording.restarted.items():
            for tick in ticks:
                writer.add_metadata("palpate.restarted", {"node": node, "tick": str(tick)})
        schemas: dict[str, int] = {}
        channels = {}
        for name, stream in recording.streams.items():
            kind, title = stream.schema["class"], stream.schema["title"]
            if kind not in schemas:
                schemas[kind] = writer.add_schema(title, json.dumps(stream.schema).encode())
            metadata = {"producer": stream.producer, "every": str(stream.every), "thin": str(stream.thin)}
            channels[name] = writer.add_channel(name, "msgpack", schemas[kind], metadata)
        for name, tick, time, payload in recording.raw():
            writer.add_message(channels[name], tick, time, payload)
            counts[name] += 1
        if recording.counts and recording.complete:  # what was lost on the way is only known for a whole run
            writer.add_metadata("palpate.counts", {k: json.dumps(v) for k, v in recording.counts.items()})
        writer.finish()
    os.replace(part, target)
    return target, counts
