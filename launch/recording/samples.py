"""A recording for people who compute with it: fields as numpy arrays with unit and times, tables, plots.

run = Run("kidney.mcap")
run.contact.force            # Samples [N] (n); .time [s], .unit
run["tissue"].displacement   # list of arrays where the length changes from message to message
run.frame("contact")         # pandas
"""

from __future__ import annotations

import html
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.launch.loading.extras import install
from palpate.launch.loading.faults import choices
from palpate.launch.recording.reader import Recording, RecordingError
from palpate.messages import Field, Message, fields

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from palpate.launch.page.shown import Shown


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
        with np.printoptions(threshold=20, edgeitems=3):
            return f"{self._about()}\n{np.asarray(self)!s}"

    __str__ = __repr__

    def _repr_html_(self) -> str:
        label, _, about = self._about().partition(": ")
        return f"<b>{html.escape(label)}</b>: {about}"

    def _about(self) -> str:
        if not self.size:
            return f"{self.label}: no messages"
        plain = np.asarray(self)
        span = f", {self.time[0]:.3f} s to {self.time[-1]:.3f} s" if len(self.time) == len(self) else ""
        reach = f", {plain.min():.4g} to {plain.max():.4g}" if plain.dtype.kind in "iuf" else ""
        return f"{self.label}: {' x '.join(map(str, self.shape))} values{reach}{span}"


class Stream:
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

    def __getitem__(self, name: str) -> Any:
        """A field: Samples; a list of arrays where their shape is not the same in all messages.

        RecordingError: no such field; names the nearest.
        """
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
        self._streams: dict[str, Stream] = {}
        self.path = self._recording.path
        self.about: dict[str, Any] = self._recording.about

    @property
    def streams(self) -> list[str]:
        return list(self._recording.streams)

    def __getitem__(self, name: str) -> Any:
        """A stream, `run["contact"]`, or a field, `run["contact.force"]`. RecordingError: there is none."""
        stream, field = self._split(name)
        if stream not in self._streams:
            self._streams[stream] = Stream(self._recording, stream)
        return self._streams[stream] if field is None else self._streams[stream][field]

    def _split(self, name: str) -> tuple[str, str | None]:
        """Streams may have a dot in their name, `pad.Slip`: the longest name that fits is the stream."""
        if name in self._recording.streams:
            return name, None
        stream, dot, field = name.rpartition(".")
        return (stream, field) if dot else (name, None)

    def __getattr__(self, name: str) -> Stream:
        if name.startswith("_") or name in ("path", "about"):
            raise AttributeError(name)
        if name not in self._recording.streams:
            close = choices("Streams", name, self._recording.streams)
            raise AttributeError(f"{self.path}: no stream {name!r}. {close}")
        return self[name]

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *(name for name in self.streams if name.isidentifier())})

    def frame(self, stream: str) -> Any:
        """A stream as a pandas DataFrame over time [s]: a column for each number, `force[0] [N]`, as in exported
        tables; arrays of changing length are left out.

        RecordingError: pandas is missing, or there is no such stream.
        """
        try:
            import pandas
        except ImportError:
            raise RecordingError(f"frame() needs the package pandas: {install('table')}") from None
        source = self[stream]
        if not isinstance(source, Stream):
            raise RecordingError(f"{stream!r} is a field; expected a stream: {', '.join(self.streams)}")
        columns: dict[str, Any] = {"tick": source.tick}
        for name, field in source.columns.items():
            values = source[name]
            if isinstance(values, Samples) and values.ndim == 1:
                columns[field.label] = np.asarray(values)
            elif isinstance(values, Samples) and field.dtype is None and values.ndim == 2:
                for i in range(values.shape[1]):
                    columns[f"{name}[{i}] [{field.unit}]"] = np.asarray(values)[:, i]
        return pandas.DataFrame(columns, index=pandas.Index(source.time, name="time [s]"))

    def plot(self, *names: str) -> Figure:
        """Fields over time, one axis each, in the look of all pictures. PlotError: what cannot be drawn, and why."""
        from palpate.launch.pictures.plot import plot

        return plot(self, names)

    def view(self, *others: str | Path, port: int = 0, show: bool = True) -> Shown:
        """The recording in the browser, at any time of it, beside another one if one is named; `palpate view` does the
        same from the shell. The page is there until it is closed, or the program ends.

        RecordingError: nothing to show in it. PalpateError: the page's package is missing, or its port taken.
        """
        from palpate.launch.page import needs

        needs.check()
        from palpate.launch.page.shown import Shown

        page = Shown([self.path, *map(Path, others)], port)
        if show:
            import webbrowser

            webbrowser.open(page.address)
        return page

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
