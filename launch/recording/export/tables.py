"""Tables: a Parquet or CSV file per stream, one row a message, with units in the column names."""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from palpate.launch.loading.extras import install
from palpate.launch.recording.reader import Recording, RecordingError
from palpate.messages import Field, Message, fields

ROWS = 4096  # of a Parquet row group


def write_csv(recording: Recording, folder: Path, streams: tuple[str, ...], every: int = 1) -> list[Path]:
    """A file per stream: tick, time [s], source, then each number in a column of its own, `force[0] [N]`. Arrays of
    changing length stand as JSON in one cell."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for name in streams:
        path = folder / f"{name}.csv"
        kind = recording.streams[name].type
        with open(path, "w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(["tick", "time [s]", "used", *(c for field in fields(kind) for c in _columns(field))])
            for message in _messages(recording, name, every):
                cells = [x for field in fields(kind) for x in _cells(field, getattr(message, field.name))]
                writer.writerow([message.tick, f"{message.time * 1e-9:.9f}", json.dumps(message.used), *cells])
        paths.append(path)
    return paths


def _messages(recording: Recording, name: str, every: int) -> Iterator[Message]:
    for index, message in enumerate(recording.messages(name)):
        if not index % every:
            yield message


def _columns(field: Field) -> list[str]:
    if field.dtype is None and field.shape and isinstance(field.shape[0], int):
        return [f"{field.name}[{i}] [{field.unit}]" for i in range(field.shape[0])]
    return [field.label]


def _cells(field: Field, value: Any) -> list[Any]:
    if isinstance(value, np.ndarray):
        return [json.dumps(value.tolist())]
    if field.shape:
        return [*map(repr, value)] if isinstance(field.shape[0], int) else [json.dumps(value)]
    return [repr(value) if isinstance(value, float) else value]


def write_parquet(recording: Recording, folder: Path, streams: tuple[str, ...], every: int = 1) -> list[Path]:
    """A file per stream: a column per field, vectors as fixed lists, arrays as nested lists; units, type and the run's
    provenance stand in the metadata. Rows are written in groups, so that no stream has to fit into memory."""
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError:
        raise RecordingError(f"Parquet needs the package pyarrow: {install('export')}") from None
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for name in streams:
        kind = recording.streams[name].type
        metadata = {"stream": name, "type": kind.__name__, "about": json.dumps(recording.about)}
        schema = pa.schema([
            pa.field("tick", pa.int64()),
            pa.field("time", pa.int64(), metadata={"unit": "ns"}),
            pa.field("used", pa.list_(pa.int64())),
            *(pa.field(f.name, _arrow(pa, f), metadata={"unit": f.unit}) for f in fields(kind)),
        ], metadata=metadata)  # fmt: skip
        path = folder / f"{name}.parquet"
        part = path.with_name(path.name + ".part")
        with pq.ParquetWriter(part, schema, compression="zstd") as writer:
            rows: list[Message] = []
            for message in _messages(recording, name, every):
                rows.append(message)
                if len(rows) == ROWS:
                    writer.write_table(_table(pa, rows, schema))
                    rows.clear()
            writer.write_table(_table(pa, rows, schema))
        os.replace(part, path)
        paths.append(path)
    return paths


def _arrow(pa: Any, field: Field) -> Any:
    """The Arrow type of a field."""
    plain: dict[Any, Any] = {int: pa.int64(), bool: pa.bool_(), str: pa.string(), float: pa.float64()}
    if field.dtype is None and not field.shape:
        return plain.get(field.type, pa.string())
    element = pa.float64() if field.dtype is None else pa.from_numpy_dtype(field.dtype)
    for size in reversed(field.shape):
        element = pa.list_(element, size) if isinstance(size, int) else pa.list_(element)
    return element


def _table(pa: Any, rows: list[Message], schema: Any) -> Any:
    def plain(value: Any) -> Any:
        return value.tolist() if isinstance(value, np.ndarray) else value

    return pa.table([pa.array([plain(getattr(m, f.name)) for m in rows], type=f.type) for f in schema], schema=schema)
