"""Parquet or CSV tables of each stream: one row per message, one column per number, `force[0] [N]`."""

import csv
import json
import math
from collections.abc import Iterable, Iterator
from itertools import chain, islice, zip_longest
from pathlib import Path
from typing import Any

from palpate.messages import Field, Message, fields
from palpate.messages.fields import Shape
from palpate.physics.archive import replacing
from palpate.physics.extras import require_extra
from palpate.records.reader import Recording
from palpate.records.stored import RecordingError

ROWS = 4096  # rows of a Parquet row group
TIME, NANOSECONDS = "time [s]", "time [ns]"  # nanoseconds are exact, for joins


def write_csv(recording: Recording, folder: Path, streams: tuple[str, ...], every: int | None) -> list[Path]:
    """Write a file per stream: tick, time [s] and [ns], `used` (the ticks of its inputs), then a column per number.
    Arrays of variable length go into one file per length variable, `tissue-k.csv`: one row per element, with the tick
    of its message."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for name in streams:
        layout = Layout(recording, name, every)
        tables: dict[str, tuple[list[str], Iterable[list[Any]]]] = {}
        tables[name] = (layout.columns(), map(layout.cells, layout.messages()))
        for length, arrays in layout.filled.items():
            titles = ["tick", TIME, NANOSECONDS, length, *(c for field in arrays for c in layout.titles(field))]
            tables[f"{name}-{length}"] = titles, layout.elements(arrays)
        for table, (titles, rows) in tables.items():
            paths.append(folder / f"{table}.csv")
            with replacing(paths[-1]) as part, open(part, "w", newline="") as file:
                csv.writer(file).writerows(chain([titles], rows))
    return paths


class Layout:
    """The columns of a stream's messages, found by reading them once.

    plain   fields with one number or a short vector
    arrays  the other fields, by the letter of their length
    filled  the arrays that are not empty in all messages
    width   number of columns of each field
    """

    def __init__(self, recording: Recording, name: str, every: int | None) -> None:
        self._recording, self._name, self._every = recording, name, every or 1
        declared = fields(recording.streams[name].type)
        self.plain = [field for field in declared if field.dtype is None]
        self.arrays: dict[str, list[Field]] = {}
        for field in declared:
            if field.dtype is not None:
                self.arrays.setdefault(str(field.shape[0]), []).append(field)
        self.width = {
            field.name: _fixed_size(field.shape if field.dtype is None else field.shape[1:]) for field in declared
        }
        open_ = [field for field in declared if self.width[field.name] is None]
        self.inputs = 0
        filled: set[str] = set()
        for message in self.messages():
            self.inputs = max(self.inputs, len(message.used))
            for field in open_:
                value = getattr(message, field.name)
                size = len(value) if field.dtype is None else value.size // max(len(value), 1)
                self.width[field.name] = max(self.width[field.name] or 0, size)
            filled.update(k for k, group in self.arrays.items() if any(len(getattr(message, f.name)) for f in group))
        self.filled = {length: group for length, group in self.arrays.items() if length in filled}

    def messages(self) -> Iterator[Message]:
        return islice(self._recording.messages(self._name), 0, None, self._every)

    def titles(self, field: Field) -> list[str]:
        """Titles of the columns of a field."""
        if not (field.shape if field.dtype is None else field.shape[1:]):
            return [field.label]
        return [f"{field.name}[{i}] [{field.unit}]" for i in range(self.width[field.name] or 0)]

    def columns(self) -> list[str]:
        """Titles of the table with one row per message."""
        used = [f"used[{i}]" for i in range(self.inputs)]
        return ["tick", TIME, NANOSECONDS, *used, *(c for field in self.plain for c in self.titles(field))]

    def cells(self, message: Message) -> list[Any]:
        """The row of a message; None for missing elements."""
        row: list[Any] = [message.tick, message.time / 1e9, message.time, *_fill_rows(message.used, self.inputs)]
        for field in self.plain:
            value = getattr(message, field.name)
            row += _fill_rows(value, self.width[field.name] or 0) if field.shape else [value]
        return row

    def elements(self, arrays: list[Field]) -> Iterator[list[Any]]:
        """The rows of arrays of one length."""
        widths = [self.width[field.name] or 0 for field in arrays]
        for message in self.messages():
            values = (getattr(message, field.name) for field in arrays)
            parts = [value.reshape(len(value), -1).tolist() if len(value) else [] for value in values]
            for k, rows in enumerate(zip_longest(*parts, fillvalue=())):
                numbers = [x for row, width in zip(rows, widths, strict=True) for x in _fill_rows(row, width)]
                yield [message.tick, message.time / 1e9, message.time, k, *numbers]


def _fixed_size(shape: Shape) -> int | None:
    """Number of elements of a shape; None if it depends on the message."""
    known = [size for size in shape if isinstance(size, int)]
    return math.prod(known) if len(known) == len(shape) else None


def _fill_rows(values: Any, width: int) -> list[Any]:
    return [*values, *([None] * (width - len(values)))]


def write_parquet(recording: Recording, folder: Path, streams: tuple[str, ...], every: int | None) -> list[Path]:
    """Write a file per stream with the columns of the CSV, and arrays as nested lists, `displacement [m]`. Units, type
    and provenance are also in the metadata. Rows are written in groups, so that a stream need not fit into memory."""
    with require_extra("Parquet", "export", RecordingError):
        import pyarrow as pa
        import pyarrow.parquet as pq
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for name in streams:
        kind = recording.streams[name].type
        layout = Layout(recording, name, every)
        arrays = [field for group in layout.arrays.values() for field in group]
        metadata = {"stream": name, "type": kind.__name__, "about": json.dumps(recording.about)}
        schema = pa.schema([
            pa.field("tick", pa.int64()),
            pa.field(TIME, pa.float64(), metadata={"unit": "s"}),
            pa.field(NANOSECONDS, pa.int64(), metadata={"unit": "ns"}),
            *(pa.field(f"used[{i}]", pa.int64()) for i in range(layout.inputs)),
            *(pa.field(c, _number(pa, f), metadata={"unit": f.unit}) for f in layout.plain for c in layout.titles(f)),
            *(pa.field(f.label, _nested_type(pa, f), metadata={"unit": f.unit}) for f in arrays),
        ], metadata=metadata)  # fmt: skip
        path = folder / f"{name}.parquet"
        messages = layout.messages()
        with replacing(path) as part, pq.ParquetWriter(part, schema, compression="zstd") as writer:
            while rows := list(islice(messages, ROWS)):
                cells = [[*layout.cells(m), *(getattr(m, f.name).tolist() for f in arrays)] for m in rows]
                columns = zip(*cells, strict=True)
                writer.write_table(
                    pa.table([pa.array(x, type=f.type) for x, f in zip(columns, schema, strict=True)], schema=schema)
                )
        paths.append(path)
    return paths


def _number(pa: Any, field: Field) -> Any:
    kind = next((t for t in (bool, int, float) if t is field.type or t in getattr(field.type, "__args__", ())), str)
    return {bool: pa.bool_(), int: pa.int64(), float: pa.float64(), str: pa.string()}[kind]


def _nested_type(pa: Any, field: Field) -> Any:
    element = pa.from_numpy_dtype(field.dtype)
    for size in reversed(field.shape):
        element = pa.list_(element, size) if isinstance(size, int) else pa.list_(element)
    return element
