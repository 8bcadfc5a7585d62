"""The head of a recording that a page makes: what `logger.Mcap` writes before the first message."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import msgspec
from mcap.records import Channel, Metadata, Schema

from palpate.engine.imports import load_class
from palpate.engine.slot import make
from palpate.messages import Message
from palpate.nodes.base import Observer, Stream
from palpate.records.format.head import PROFILE
from palpate.records.format.mcap_file import McapRecords
from palpate.records.format.mcap_writer import LIBRARY
from palpate.web.started import Started


def recording_head(run: Started) -> dict[str, Any]:
    """Schemas, channels and metadata of a recording of a run, and for each channel the divisor of the ticks whose
    messages are recorded, for JSON."""
    (given,) = (job for job in run.job.observers if "path" in job.settings)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / Path(str(given.settings["path"])).name
        logger: Any = make(msgspec.structs.replace(given, settings={**given.settings, "path": str(file)}))
        assert isinstance(logger, Observer)
        logger.listen(tuple(_stream(name, job) for name, job in given.streams.items()), run.job.about)
        logger.start()
        keep = {name: logger.period(name) for name in given.streams}
        logger.stop()
        with file.open("rb") as opened:
            records = McapRecords(opened).read_index()
    schemas = [record for record in records if isinstance(record, Schema)]
    channels = [record for record in records if isinstance(record, Channel)]
    first = [record for record in records if isinstance(record, Metadata) and record.name == "palpate.about"]
    return {
        "profile": PROFILE,
        "library": LIBRARY,
        "metadata": [{"name": one.name, "metadata": one.metadata} for one in first],
        "schemas": [{"id": s.id, "name": s.name, "encoding": s.encoding, "data": s.data.decode()} for s in schemas],
        "channels": [
            {"id": c.id, "schema": c.schema_id, "topic": c.topic, "encoding": c.message_encoding,
             "metadata": c.metadata, "keep": keep[c.topic]}
            for c in channels
        ],
    }  # fmt: skip


def _stream(name: str, job: Any) -> Stream:
    return Stream(name, load_class(job.type, Message), job.producer, job.every)
