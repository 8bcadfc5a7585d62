"""A recording in Python: fields as numpy arrays with unit and times, tables, comparisons, plots.

run = Run("kidney.mcap")
run.contact.force            # Samples [N] (n); .time [s], .unit
run["tissue"].displacement   # list of arrays, if the length varies
run.frame("contact")         # pandas
run.plot("contact.force")    # matplotlib
"""

from __future__ import annotations

import html
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.engine.faults import choices
from palpate.launch.run.notes import RunNote
from palpate.physics.extras import require_extra
from palpate.records.reader import Recording
from palpate.records.samples import RecordedStream, Samples
from palpate.records.stored import RecordingError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from palpate.records.compare import Variant
    from palpate.views.page.server import PageServer


class Comparison:
    """One touch computed with several variants; differences are from the first.

    variants  the variants with name, differences and step times
    """

    def __init__(self, variants: Sequence[Variant]) -> None:
        self.variants = list(variants)

    def report(self) -> list[dict[str, Any]]:
        return [variant.report() for variant in self.variants]

    def __repr__(self) -> str:
        first, *others = self.variants
        lines = [f"against {first.name}, peak {first.force.scale:.4g} N, {1e3 * first.indentation.scale:.4g} mm:"]
        for variant in others:
            force, depth, step = variant.force.report(), variant.indentation.report(), variant.step.report()
            lines.append(
                f"  {variant.name}: force error {force['rms']:.4g} N rms, {force['peak']:.4g} N at most; indentation "
                f"{1e3 * depth['rms']:.4g} mm, {1e3 * depth['peak']:.4g} mm; step {1e6 * step['p50']:.1f} us (median)"
            )
        lines += [f"  {variant.name}: {note}" for variant in self.variants for note in variant.notes]
        return "\n".join(lines)

    def plot(self) -> Figure:
        """Force and indentation of every variant over time, and their differences from the first."""
        from palpate.views.pictures.models.compare import figure

        return figure(self.variants)


class Run:
    """A recorded run; its streams are attributes, or items if their name is not a Python identifier.

    path     the file
    streams  names of the recorded streams
    about    provenance: resolved graph, versions, machine
    notes    lines about the run, each with `node`, `time` [s] and `text`, as `palpate run` prints them

    RecordingError: the file is missing or not a recording.
    """

    def __init__(self, file: str | Path) -> None:
        self._recording = Recording(file)
        self._streams: dict[str, RecordedStream] = {}
        self.path = self._recording.path
        self.about: dict[str, Any] = self._recording.about
        self.notes: list[RunNote] = [RunNote(*note) for note in self._recording.notes]

    @property
    def streams(self) -> list[str]:
        return list(self._recording.streams)

    def __iter__(self) -> Iterator[str]:
        return iter(self.streams)

    def __len__(self) -> int:
        return len(self.streams)

    def __contains__(self, name: object) -> bool:
        return name in self._recording.streams

    def __getitem__(self, name: str) -> Any:
        """A stream, `run["contact"]`, or a field, `run["contact.force"]`. RecordingError: unknown stream or field.

        Stream names may contain a dot, `pad.Slip`: the longest match is the stream.
        """
        if not isinstance(name, str):
            raise RecordingError(
                f"{self.path}: found [{name!r}], expected the name of a stream: {', '.join(self.streams)}; "
                "messages are those of a stream, run.contact[500]"
            )
        whole = name in self._recording.streams or "." not in name
        stream, _, field = (name, "", "") if whole else name.rpartition(".")
        if stream not in self._streams:
            self._streams[stream] = RecordedStream(self._recording, stream)
        return self._streams[stream] if whole else self._streams[stream][field]

    def __getattr__(self, name: str) -> RecordedStream:
        if name.startswith("_") or name in ("path", "about", "notes"):
            raise AttributeError(name)
        if name not in self._recording.streams:
            close = choices("Streams", name, self._recording.streams)
            raise AttributeError(f"{self.path}: no stream {name!r}. {close}")
        return self[name]

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *(name for name in self.streams if name.isidentifier())})

    def frame(self, streams: str | Sequence[str]) -> Any:
        """A stream as a pandas DataFrame over time [s]: one column per number, `force[0] [N]`, as in exported tables,
        without arrays of variable length. Several streams are joined by tick, each with its name as upper column level,
        `table["contact"]["force [N]"]`; missing messages are NaN.

        RecordingError: pandas is missing, or an unknown stream.
        """
        with require_extra("frame()", "table", RecordingError):
            import pandas
        if isinstance(streams, str):
            return self._table(streams).set_index("time [s]")
        if not streams:
            raise RecordingError(f"frame: found no stream, expected some of {', '.join(self.streams)}")
        tables = [self._table(name).set_index("tick") for name in streams]
        joined = pandas.concat(tables, axis=1, keys=list(streams)).sort_index()
        times = joined.xs("time [s]", axis=1, level=1)
        joined = joined.drop(columns="time [s]", level=1)
        return joined.set_index(times.bfill(axis=1).iloc[:, 0].rename("time [s]"))

    def xarray(self, streams: str | Sequence[str] = ()) -> Any:
        """Streams (default: all) as an xarray Dataset over `time` [s], with the dimension `axis` for vectors: variables
        "stream.field" with their unit, missing messages NaN. Without texts and arrays of variable length.

        RecordingError: xarray is missing, or an unknown stream.
        """
        with require_extra("xarray()", "study", RecordingError):
            import xarray
        made = []
        for name in [streams] if isinstance(streams, str) else list(streams) or self.streams:
            source = self[name]
            if not isinstance(source, RecordedStream):
                raise RecordingError(f"{name!r} is a field; expected a stream: {', '.join(self.streams)}")
            data: dict[str, Any] = {}
            for field_name, field in source.columns.items():
                values = source[field_name]
                if isinstance(values, Samples) and values.ndim <= 2 and values.dtype.kind in "fiub":
                    axes = tuple(f"axis{'' if n == 3 else n}" for n in values.shape[1:])
                    data[f"{name}.{field_name}"] = (("time", *axes), np.asarray(values), {"units": field.unit})
            made.append(xarray.Dataset(data, {"time": ("time", source.time, {"units": "s"})}))
        return xarray.merge(made, join="outer", combine_attrs="drop_conflicts").assign_attrs(graph=self.path.stem)

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
        """Recompute the touch with other models or settings, as `palpate compare` does. Forces, indentations and shapes
        are compared with the first variant or `reference`; a single variant with the recording.

        variants, reference  each "tissue.use=deformation.Rigid", a list of such texts, or a dict like the keywords of
                             `palpate.run`: {"tissue": "deformation.Rigid"}; []: the recorded graph

        PalpateError: an override does not fit, or a node failed.
        """
        from palpate.launch.load.values.overrides import overrides
        from palpate.records.compare import compare

        given = [overrides(variant) for variant in variants]
        base = overrides(reference) if reference is not None else [] if len(given) == 1 else None
        return Comparison(compare(self._recording, given, reference=base))

    def plot(self, *names: str, over: str | None = None) -> Figure:
        """Plot fields over time, or over another field: `plot("contact.force", over="contact.indentation")`, one axis
        each. PictureError: a field cannot be drawn."""
        from palpate.views.plot import plot

        return plot(self, names, over)

    def view(self, *others: str | Path, port: int = 0, show: bool = True) -> PageServer:
        """Show the recording in the browser, next to a second one if given, as `palpate view` does. The page is served
        until it is closed or the program ends.

        RecordingError: nothing to show. PalpateError: the page's package is missing, or the port is in use.
        """
        from palpate.views.page import serve
        from palpate.views.page.reel import Reels

        page = serve(Reels([self.path, *map(Path, others)]), port)
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
