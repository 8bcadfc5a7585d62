"""A recording for people who compute with it: fields as numpy arrays with unit and times, tables, plots.

run = Run("kidney.mcap")
run.contact.force            # Samples [N] (n); .time [s], .unit
run["tissue"].displacement   # list of arrays where the length changes from message to message
run.frame("contact")         # pandas
"""

from __future__ import annotations

import html
from collections.abc import Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.engine.faults import choices
from palpate.messages import Field, Message, fields
from palpate.physics.extras import missing
from palpate.records.reader import Recording
from palpate.records.stored import RecordingError

if TYPE_CHECKING:
    from palpate.records.compare import Comparison


class Samples(np.ndarray):
    """One field of a stream, one row a message: a numpy array that knows its name, unit and times.

    name  `stream.field`
    unit  SI, as the message declares it
    time  [s] (n)  on the graph's clock

    Slices and selections of rows keep them; what is computed from it is a plain array or number.
    """

    name: str
    unit: str
    time: np.ndarray

    def __new__(cls, values: Any, name: str, unit: str, time: np.ndarray) -> Samples:
        made = np.asarray(values).view(cls)
        made.name, made.unit, made.time = name, unit, time
        return made

    def __array_finalize__(self, source: Any) -> None:
        self.name, self.unit = getattr(source, "name", ""), getattr(source, "unit", "")
        self.time = getattr(source, "time", np.empty(0))

    def __array_wrap__(self, array: Any, context: Any = None, return_scalar: bool = False) -> Any:
        plain = np.asarray(array)
        return plain[()] if return_scalar else plain

    def __getitem__(self, key: Any) -> Any:
        rows = key[0] if isinstance(key, tuple) and key else key
        part = np.asarray(self)[key]
        if rows is None or isinstance(rows, int | np.integer) or not isinstance(part, np.ndarray):
            return part
        rows = np.asarray(rows) if isinstance(rows, Samples) else rows
        time = self.time if rows is Ellipsis else self.time[rows] if np.ndim(rows) < 2 else None  # type: ignore[arg-type]
        return part if time is None or len(time) != len(part) else Samples(part, self.name, self.unit, time)

    @property
    def label(self) -> str:
        """Name and unit as they stand beside an axis."""
        return f"{self.name} [{self.unit}]"

    def __repr__(self) -> str:
        return f"{self.label}: {self._summary()}"

    __str__ = __repr__

    def _repr_html_(self) -> str:
        return f"<b>{html.escape(self.label)}</b>: {self._summary()}"

    def _summary(self) -> str:
        if not self.size:
            return "no messages"
        plain = np.asarray(self)
        parts = [f"{' x '.join(map(str, self.shape))} values"]
        if plain.dtype.kind in "iuf":
            parts.append(f"{plain.min():.4g} to {plain.max():.4g} {self.unit if self.unit != '1' else ''}".rstrip())
        if len(self.time) == len(self):
            parts.append(f"from {self.time[0]:.3f} s to {self.time[-1]:.3f} s")
        return ", ".join(parts)


class RecordedStream:
    """One stream of a recording; its fields are attributes.

    name     of the stream
    type     of its messages
    columns  the declared fields by name
    """

    def __init__(self, recording: Recording, name: str) -> None:
        self.name = name
        self.type = recording.known(name).type
        self.columns: dict[str, Field] = {field.name: field for field in fields(self.type)}
        self._recording = recording

    @cached_property
    def messages(self) -> list[Message]:
        """The messages as they were sent. RecordingError: bytes that do not fit their type."""
        return list(self._recording.messages(self.name))

    @cached_property
    def time(self) -> np.ndarray:
        """[s] (n) of the messages, on the graph's clock."""
        return np.array([message.time for message in self.messages], dtype=float) * 1e-9

    @cached_property
    def tick(self) -> np.ndarray:
        """[1] (n) of the messages."""
        return np.array([message.tick for message in self.messages], dtype=np.int64)

    def __getitem__(self, name: str | int | slice) -> Any:
        """A field by its name: Samples, or a list of arrays where their shape is not the same in all messages. A
        message by its number, `[500]` or `[-1]`; several as a list, `[10:20]`.

        RecordingError: no such field; names the nearest. IndexError: so many messages there are not.
        """
        if isinstance(name, slice):
            return self.messages[name]
        if isinstance(name, int | np.integer):
            if not -len(self) <= name < len(self):
                raise IndexError(
                    f"{self._recording.path}: stream {self.name!r} has {len(self)} messages, found [{name}]"
                )
            return self.messages[name]
        if name not in self.columns:
            raise RecordingError(
                f"{self._recording.path}: stream {self.name!r} has no field {name!r}. "
                f"{choices('Fields', name, self.columns)}"
            )
        values = [getattr(message, name) for message in self.messages]
        if len({np.shape(value) for value in values}) > 1:
            return values
        return Samples(values, f"{self.name}.{name}", self.columns[name].unit, self.time)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or name == "columns":
            raise AttributeError(name)
        try:
            return self[name]
        except RecordingError as error:
            if name in self.columns:
                raise
            raise AttributeError(str(error)) from None

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *self.columns})

    def __iter__(self) -> Iterator[Message]:
        return iter(self.messages)

    def __len__(self) -> int:
        return len(self.messages)

    def __repr__(self) -> str:
        return f"<stream {self.name}: {', '.join(field.label for field in self.columns.values())}>"


class Run:
    """A run as its recording holds it; its streams are attributes, or items where a name is no word of Python.

    path     of the file
    streams  names of what was recorded
    about    provenance: graph as resolved, versions, machine

    RecordingError: the file is missing or no recording.
    """

    def __init__(self, file: str | Path) -> None:
        self._recording = Recording(file)
        self._streams: dict[str, RecordedStream] = {}
        self.path = self._recording.path
        self.about: dict[str, Any] = self._recording.about

    @property
    def streams(self) -> list[str]:
        return list(self._recording.streams)

    def __iter__(self) -> Iterator[str]:
        """The names of its streams."""
        return iter(self.streams)

    def __len__(self) -> int:
        return len(self.streams)

    def __contains__(self, name: object) -> bool:
        return name in self._recording.streams

    def __getitem__(self, name: str) -> Any:
        """A stream, `run["contact"]`, or a field, `run["contact.force"]`. RecordingError: there is none."""
        if not isinstance(name, str):
            raise RecordingError(
                f"{self.path}: found [{name!r}], expected the name of a stream: {', '.join(self.streams)}; "
                "messages are those of a stream, run.contact[500]"
            )
        stream, field = self._split(name)
        if stream not in self._streams:
            self._streams[stream] = RecordedStream(self._recording, stream)
        return self._streams[stream] if field is None else self._streams[stream][field]

    def _split(self, name: str) -> tuple[str, str | None]:
        """Streams may have a dot in their name, `pad.Slip`: the longest name that fits is the stream."""
        if name in self._recording.streams:
            return name, None
        stream, dot, field = name.rpartition(".")
        return (stream, field) if dot else (name, None)

    def __getattr__(self, name: str) -> RecordedStream:
        if name.startswith("_") or name in ("path", "about"):
            raise AttributeError(name)
        if name not in self._recording.streams:
            close = choices("Streams", name, self._recording.streams)
            raise AttributeError(f"{self.path}: no stream {name!r}. {close}")
        return self[name]

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *(name for name in self.streams if name.isidentifier())})

    def frame(self, streams: str | Sequence[str]) -> Any:
        """A stream as a pandas DataFrame over time [s]: a column for each number, `force[0] [N]`, as in exported
        tables; arrays of changing length are left out. Several streams stand side by side at equal ticks, each below
        its name, `table["contact"]["force [N]"]`; where one has no message its numbers are NaN.

        RecordingError: pandas is missing, or there is no such stream.
        """
        try:
            import pandas
        except ImportError as error:
            raise RecordingError(missing("frame()", error.name, "table")) from None
        if isinstance(streams, str):
            return self._table(streams).set_index("time [s]")
        if not streams:
            raise RecordingError(f"frame: found no stream, expected some of {', '.join(self.streams)}")
        tables = [self._table(name).set_index("tick") for name in streams]
        joined = pandas.concat(tables, axis=1, keys=list(streams)).sort_index()
        times = joined.xs("time [s]", axis=1, level=1)
        joined = joined.drop(columns="time [s]", level=1)
        return joined.set_index(times.bfill(axis=1).iloc[:, 0].rename("time [s]"))

    def _table(self, name: str) -> Any:
        import pandas

        source = self[name]
        if not isinstance(source, RecordedStream):
            raise RecordingError(f"{name!r} is a field; expected a stream: {', '.join(self.streams)}")
        columns: dict[str, Any] = {"time [s]": source.time, "tick": source.tick}
        for field_name, field in source.columns.items():
            values = source[field_name]
            if isinstance(values, Samples) and values.ndim == 1:
                columns[field.label] = np.asarray(values)
            elif isinstance(values, Samples) and field.dtype is None and values.ndim == 2:
                for i in range(values.shape[1]):
                    columns[f"{field_name}[{i}] [{field.unit}]"] = np.asarray(values)[:, i]
        return pandas.DataFrame(columns)

    def compare(self, *variants: Any, reference: Any = None) -> Comparison:
        """The recorded touch computed again with other models or settings, as `palpate compare` does: forces, depths
        and shapes against the first of them, or against `reference`; a single variant against the recording.

        variants, reference  each "tissue.use=deformation.Rigid", several such texts in a list, or as keywords of
                             `palpate.run` in a dict: {"tissue": "deformation.Rigid"}; [] is the graph as recorded

        PalpateError: what does not fit, or which node failed.
        """
        from palpate.launch.load.values.overrides import overrides
        from palpate.records.compare import Comparison, compare

        given = [overrides(variant) for variant in variants]
        base = overrides(reference) if reference is not None else [] if len(given) == 1 else None
        return Comparison(compare(self._recording, given, reference=base))

    def __repr__(self) -> str:
        return f"<run {self.path}: {', '.join(self.streams)}>"

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><td>{html.escape(name)}</td><td>{html.escape(stream.schema['title'])}</td><td>{count}</td></tr>"
            for name, stream in self._recording.streams.items()
            for count in [self._recording.counts.get(name, {}).get("count", "?")]
        )
        ending = f"<p>{html.escape(self._recording.ending)}</p>" if self._recording.ending else ""
        head = "<tr><th>stream</th><th>message</th><th>messages</th></tr>"
        return f"<p><b>{html.escape(str(self.path))}</b></p>{ending}<table>{head}{rows}</table>"
