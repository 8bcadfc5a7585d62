"""`palpate.Ensemble`: many runs of one graph in parallel (docs/ensembles.md)."""

import os
import sys
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from palpate.bases import build_for_each
from palpate.calling import Organ, described
from palpate.engine.faults import choices
from palpate.engine.graph import Graph
from palpate.engine.schedule import nanoseconds
from palpate.launch.run.lanes import LaneRun, prepare_all, with_values
from palpate.launch.run.notes import RunNote, warn
from palpate.launch.run.progress import StageBars
from palpate.messages import Field, fields
from palpate.messages.record import layout
from palpate.nodes.base import settings
from palpate.physics.errors import ArgumentError, RunError
from palpate.records.samples import Samples

SHOWN = 3  # number of failed lanes that a warning lists


class Ensemble:
    """One graph run many times in parallel. Each lane has its settings and computes the same bits as a single run.

    graph      name of a shipped launch file or graph, or a path; all its nodes are compiled
    lanes      number of runs
    over       settings that differ: a path in the form of `--set`, "tissue.stiffness", with an array or list of one
               value per lane, or one value for all lanes
    keep       fields that `run` returns, "stream.field"
    every      keep every n-th tick
    scene, duration, organ, sets, nodes  see `palpate.run`
    threads    number of threads; None: one per core

    GraphError, ArgumentError: invalid arguments; raised before anything runs.
    """

    def __init__(
        self,
        graph: str | Path = "kidney",
        lanes: int = 1,
        over: Mapping[str, Any] | None = None,
        keep: Sequence[str] = ("contact.force",),
        *,
        scene: str | None = None,
        duration: float | str | None = None,
        organ: Organ = None,
        sets: Sequence[str] = (),
        every: int = 1,
        threads: int | None = None,
        **nodes: str | Mapping[str, Any],
    ) -> None:
        for name, value in (("lanes", lanes), ("every", every), ("threads", threads)):
            if value is not None and (isinstance(value, bool) or not isinstance(value, int) or value < 1):
                raise ArgumentError(f"{name}: found {value!r}, expected a whole number from 1")
        launch = described(graph, scene=scene, duration=duration, sets=sets, nodes=nodes, organ=organ)
        if launch.duration is None:
            raise ArgumentError(f"{graph}: the graph has no duration; pass duration=2.0 [s]")
        base = launch.load()
        self.name, self.count, self._threads, self._every = base.path.stem, lanes, threads, every
        self.over = {_path(path, base): _each(path, given, lanes) for path, given in (over or {}).items()}
        points = ({path: values[lane] for path, values in self.over.items()} for lane in range(lanes))
        build_for_each(lambda values: with_values(launch, values, 0), points, not sys.stderr.isatty())
        self._units = {path: unit for path in self.over if (unit := _unit(path, base))}
        self._keep = [_kept(text, base) for text in ([keep] if isinstance(keep, str) else keep)]
        if not self._keep:
            raise ArgumentError("keep: found nothing, expected a list such as ['contact.force']")
        self.rate = base.rate
        """Rate of ticks [Hz]."""
        self.ticks = max(1, round(launch.duration * self.rate))
        rows = -(-self.ticks // every)
        size = lanes * rows * sum(layout(base.streams[s])[f.name].itemsize for s, f in self._keep)
        room = os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
        if size > room:
            raise ArgumentError(
                f"keep: {lanes} lanes of {rows} rows take {size / 1e9:.3g} GB, {room / 1e9:.3g} GB are free; "
                "expected fewer lanes or fields, a shorter duration, or every=10"
            )
        self._names = [(stream, field.name) for stream, field in self._keep]
        self._prepared = prepare_all(launch, self.over, lanes, self._names)
        first = self._prepared[0]
        for lane, one in enumerate(self._prepared):
            if one.structure != first.structure or one.job.rate != self.rate:
                raise ArgumentError(
                    f"lane {lane} ({self.settings(lane)}): found other nodes, streams or rates than in lane 0 "
                    f"({self.settings(0)}), expected lanes that differ in settings alone; make an ensemble of each kind"
                )

    def settings(self, lane: int) -> str:
        """The settings of a lane that differ from the graph, as text."""
        return ", ".join(f"{path}={values[lane]}" for path, values in self.over.items()) or "the settings of the graph"

    def run(self, *, quiet: bool = False) -> Any:
        """Run all lanes from the start.

        Returns an xarray Dataset with the dimensions `lane` and `time` [s], and `axis` for vectors. Without xarray it
        is a dictionary of numpy arrays with units. Varied settings are coordinates of `lane`. A stream that is not sent
        at a tick keeps its last value.

        A lane that fails is NaN from that tick on; `error` has its message, and a warning lists the failed lanes. Lines
        that `palpate run` would print about a lane are in `notes`; the first of each kind is also a PalpateWarning.

        quiet  no progress bar

        RunError: all lanes failed. KeyboardInterrupt: Ctrl-C, within 0.1 s.
        """
        with StageBars(quiet or not sys.stderr.isatty()) as bars:
            done, total = bars.begin(f"{self.count} lanes of {self.name}"), self.count * self.ticks
            lanes = LaneRun(self._prepared, self._names, -(-self.ticks // self._every), self._every)
            try:
                lanes.run(self.ticks, self._threads, lambda ticks: done(ticks / total))
            finally:
                lanes.close()
        self.memory = lanes.lanes.memory
        """[bytes] of the state of all lanes, and of what they share, after `run`."""
        errors = [str(lanes.failures.get(lane, "")) for lane in range(self.count)]
        if lanes.failures:
            self._report(errors)
        end = nanoseconds(self.ticks, self.rate) * 1e-9
        self.notes = [
            RunNote(text, node, end, lane)
            for lane in range(self.count)
            if lane not in lanes.failures
            for node, text in lanes.lanes.notes(lane)
        ]
        """Lines about the lanes, each with `lane`, `node`, `time` [s] and `text`, after `run`."""
        warn(self.notes)
        time = np.array([nanoseconds(tick, self.rate) * 1e-9 for tick in range(0, self.ticks, self._every)])
        found = {
            f"{stream}.{field.name}": np.array(field.words)[column] if field.words else column
            for (stream, field), column in zip(self._keep, lanes.lanes.columns, strict=True)
        }
        units = {f"{stream}.{field.name}": field.unit for stream, field in self._keep}
        try:
            import xarray
        except ImportError:
            plain = {name: Samples(values, name, units[name], np.empty(0)) for name, values in found.items()}
            return {**plain, "time": time, "error": np.array(errors)}
        data: dict[str, Any] = {
            name: (("lane", "time", *(f"axis{n if n != 3 else ''}" for n in values.shape[2:])), values,
                   {"units": units[name]}) for name, values in found.items()
        }  # fmt: skip
        data["error"] = ("lane", np.array(errors, dtype=object), {})
        coordinates: dict[str, Any] = {"lane": np.arange(self.count), "time": ("time", time, {"units": "s"})}
        for path, values in self.over.items():
            shown = values if all(isinstance(v, bool | int | float | str) for v in values) else list(map(str, values))
            coordinates[path] = ("lane", shown, {"units": unit} if (unit := self._units.get(path)) else {})
        return xarray.Dataset(data, coordinates, {"graph": self.name})

    def _report(self, errors: Sequence[str]) -> None:
        """Warn about failed lanes. RunError: all lanes failed."""
        failed = [lane for lane, error in enumerate(errors) if error]
        lines = [f"lane {lane} ({self.settings(lane)}): {errors[lane]}" for lane in failed[:SHOWN]]
        if len(failed) > SHOWN:
            lines.append(f"and {len(failed) - SHOWN} more; `error` has all")
        text = f"{len(failed)} of {self.count} lanes failed:\n" + "\n".join(lines)
        if len(failed) == self.count:
            raise RunError(text)
        warnings.warn(text, RuntimeWarning, stacklevel=3)


def _path(path: str, base: Graph) -> str:
    """The full path of a setting: `scene.` may be left out before a part of the scene that no node is named after."""
    head = path.partition(".")[0]
    if "." not in path:
        raise ArgumentError(f"over {path!r}: expected a setting, such as tissue.stiffness, or scene.<path>")
    return f"scene.{path}" if head in base.scene and head not in base.nodes else path


def _unit(path: str, base: Graph) -> str:
    """The SI unit of a setting of a node, or of the setting that takes a value of the scene; "": unknown."""
    *_, node, name = ("", *path.split("."))
    spec = base.nodes.get(node)
    known = [settings(spec.cls)] if spec is not None else [settings(each.cls) for each in base.nodes.values()]
    units = {found[name].unit for found in known if name in found}
    return units.pop() if len(units) == 1 else ""


def _each(path: str, given: Any, lanes: int) -> list[Any]:
    """One value per lane. ArgumentError: the number of values is wrong."""
    plain = given.tolist() if isinstance(given, np.ndarray | np.generic) else given
    if isinstance(plain, str | Mapping) or not isinstance(plain, Sequence):
        return [plain] * lanes
    if len(plain) != lanes:
        raise ArgumentError(f"over {path!r}: found {len(plain)} values, expected {lanes}, one for each lane, or one")
    return [value.tolist() if isinstance(value, np.ndarray | np.generic) else value for value in plain]


def _kept(text: str, graph: Graph) -> tuple[str, Field]:
    """The stream and the field of "stream.field". ArgumentError: it does not exist, or its size varies."""
    stream, _, name = str(text).rpartition(".")
    if stream not in graph.streams:
        raise ArgumentError(f"keep {text!r}: no stream {stream!r}. {choices('Streams', stream, graph.streams)}")
    known = {field.name: field for field in fields(graph.streams[stream])}
    if name not in known:
        raise ArgumentError(f"keep {text!r}: {stream} has no field {name!r}. {choices('Fields', name, known)}")
    kind = graph.streams[stream]
    fixed = [field for field in known if layout(kind)[field].base.fields is None]
    if name not in fixed:
        raise ArgumentError(f"keep {text!r}: its arrays change in length. {choices('Fields', name, fixed)}")
    return stream, known[name]
