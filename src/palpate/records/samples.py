"""Fields of a recorded stream as numpy arrays with unit and times."""

from __future__ import annotations

import html
from collections.abc import Iterator
from functools import cached_property
from typing import Any

import numpy as np

from palpate.engine.faults import choices
from palpate.messages import Field, Message, fields
from palpate.records.reader import Recording
from palpate.records.stored import RecordingError


class Samples(np.ndarray):
    """One field of a stream as a numpy array, one row per message, with name, unit and times.

    name  `stream.field`
    unit  SI, as declared by the message
    time  [s] (n) on the graph's clock

    Slices and selections of rows keep them; results of computations are plain arrays or numbers.
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
        """Name and unit, for an axis."""
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

    name     name of the stream
    type     type of its messages
    columns  declared fields by name
    """

    def __init__(self, recording: Recording, name: str) -> None:
        self.name = name
        self.type = recording.find_stream(name).type
        self.columns: dict[str, Field] = {field.name: field for field in fields(self.type)}
        self._recording = recording

    @cached_property
    def messages(self) -> list[Message]:
        """The messages. RecordingError: one does not fit its type."""
        return list(self._recording.messages(self.name))

    @cached_property
    def time(self) -> np.ndarray:
        """Times of the messages [s] (n), on the graph's clock."""
        return np.array([message.time for message in self.messages], dtype=float) / 1e9

    @cached_property
    def tick(self) -> np.ndarray:
        return np.array([message.tick for message in self.messages], dtype=np.int64)

    def __getitem__(self, name: str | int | slice) -> Any:
        """A field by name: Samples, or a list of arrays if their shape changes. A message by index, `[500]` or `[-1]`;
        several as a list, `[10:20]`.

        RecordingError: unknown field; suggests names. IndexError: out of range.
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
