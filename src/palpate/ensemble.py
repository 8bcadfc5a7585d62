"""`palpate.Ensemble`: many runs of one graph in parallel (docs/ensembles.md)."""

import math
import sys
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from palpate.bases import build_for_each, depends
from palpate.compiler import kernel_cache
from palpate.engine.faults import choices
from palpate.engine.graph import Graph
from palpate.engine.job import NodeJob
from palpate.engine.schedule import nanoseconds
from palpate.gradients.gradient import Gradient
from palpate.launch.load.arguments import Organ, check_over, check_path, check_texts, describe_run
from palpate.launch.load.dependencies import digest
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.load.values.distributions import is_law, law_of, quantiles, values_at
from palpate.launch.run.busy import free_memory
from palpate.launch.run.lane_blocks import Block, LaneBlocks, LaneTask, block_size
from palpate.launch.run.lane_runner import LaneKeep, Memory
from palpate.launch.run.lane_values import (
    LanePreparation,
    Values,
    describe_values,
    digest_values,
    extremes,
    identity,
    value_of,
    with_values,
)
from palpate.launch.run.lanes import Prepared
from palpate.launch.run.notes import LaneNotes, read_notes, warn, write_notes
from palpate.launch.run.progress import StageBars
from palpate.launch.run.tasks.spread import Executor, Finished, spread
from palpate.launch.run.tasks.task import Ended, about
from palpate.messages import Field, fields
from palpate.messages.record import layout
from palpate.nodes.base import plain, settings
from palpate.physics.errors import ArgumentError, PalpateWarning, RunError
from palpate.records.lane_store import NOTES, KeptField, LaneStore, as_coordinate
from palpate.records.lerobot.frames import Frames
from palpate.records.lerobot.lanes import LaneEpisodes, lane_sources
from palpate.records.samples import Samples

FORMS = "zarr", "lerobot"  # of results on the disk
TOLERANCE = 1e-4
"""[1] Largest error of a derivative over its RMS."""
SHOWN = 3  # number of failed lanes that a warning lists
OBJECTS = 200  # [bytes] of a lane next to its results: its error, its note, its place in the Dataset
OTHER = 1 << 28
"""[bytes] Roughly what a run takes next to the results: kernels, meshes, bases, images of nodes (`IMAGES`)."""


class Ensemble:
    """One graph run many times in parallel. Each lane has its settings and computes the same bits as a single run.

    graph      name of a shipped launch file or graph, or a path; all its nodes are compiled
    lanes      number of runs
    over       settings that differ: a path in the form of `--set`, "tissue.stiffness", with an array or list of one
               value per lane, one value for all lanes, or a distribution, {"uniform": [130, 390]} (docs/studies.md)
    keep       fields that `run` returns, "stream.field"
    every      keep every n-th tick
    scene, duration, organ, sets, nodes  see `palpate.run`
    threads    number of threads; None: one per core
    seed       of the distributions, which are sampled together, by a Sobol sequence

    GraphError, ArgumentError: invalid arguments; raised before anything runs.
    """

    memory: Memory

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
        seed: int = 0,
        **nodes: str | Mapping[str, Any],
    ) -> None:
        for name, value, least in (
            ("lanes", lanes, 1),
            ("every", every, 1),
            ("threads", threads, 1),
            ("seed", seed, 0),
        ):
            if value is not None and (isinstance(value, bool) or not isinstance(value, int) or value < least):
                raise ArgumentError(f"{name}: found {value!r}, expected a whole number from {least}")
        check_over(over or {})
        keep = [keep] if isinstance(keep, str) else keep
        check_texts("keep", keep, "contact.force")
        launch = describe_run(graph, scene=scene, duration=duration, sets=sets, nodes=nodes, organ=organ)
        self._laws, self._seed = {path: str(given) for path, given in (over or {}).items() if is_law(given)}, seed
        self._prepare(graph, launch, lanes, _drawn(over or {}, lanes, seed), keep, every, threads)

    def _prepare(
        self,
        graph: str | Path,
        launch: LaunchFile,
        lanes: int,
        over: Mapping[str, Any],
        keep: Sequence[str],
        every: int,
        threads: int | None,
    ) -> None:
        """Check everything and prepare the first block of lanes."""
        if launch.duration is None:
            raise ArgumentError(f"{graph}: the graph has no duration; pass duration=2.0 [s]")
        base = launch.load()
        self.notes, self._launch, self._base = LaneNotes(), launch, base
        self._watch: Callable[[int, Sequence[NodeJob]], None] | None = None  # takes each lane before it runs
        self.name, self.count, self._threads, self._every = base.path.stem, lanes, threads, every
        self.over = {_path(path, base): _each(path, given, lanes) for path, given in over.items()}
        several = range(lanes) if any(map(depends, self.over)) else range(1)
        points = (self._values(lane) for lane in several)
        build_for_each(lambda values: with_values(launch, values, 0), points, not sys.stderr.isatty())
        self._units = {path: unit for path in self.over if (unit := _unit(path, base))}
        self._keep = [_kept_field(text, base) for text in keep]
        if not self._keep:
            raise ArgumentError("keep: found nothing, expected a list such as ['contact.force']")
        self.rate = base.rate
        """Rate of ticks [Hz]."""
        self.ticks = max(1, round(launch.duration * self.rate))
        rows = -(-self.ticks // every)
        names, self._fields = [(stream, field.name) for stream, field in self._keep], list[KeptField]()
        for stream, field in self._keep:
            dtype = layout(base.streams[stream])[field.name]
            shape, unit = (rows, *dtype.shape), field.unit
            self._fields.append(KeptField(f"{stream}.{field.name}", dtype.base, shape, unit, tuple(field.words)))
        self._row = sum(field.dtype.itemsize * math.prod(field.shape) for field in self._fields)
        first = self._values(0)
        varied = {path: extremes(values) for path, values in self.over.items()}
        self._lane = LanePreparation(launch, names, first, varied)
        self._lane.give(0, self.over)
        kept, self._size = LaneKeep(names, self.ticks, every), block_size(lanes, self._row, self.ticks)
        self._prepared = [self._lane(lane) for lane in range(self._size)]
        same = digest(identity(self._lane.first))
        self._task = LaneTask(launch, first, varied, lanes, self._size, kept, same)

    def _values(self, lane: int) -> dict[str, Any]:
        """The settings of a lane by path."""
        return {path: value_of(values, lane) for path, values in self.over.items()}

    def _check_lane(self, lane: int) -> Prepared:
        """A lane. GraphError, ArgumentError: it is refused."""
        one = self._prepared[lane] if lane < len(self._prepared) else self._lane(lane)
        if self._watch is not None:
            self._watch(lane, one.job.nodes)
        return one

    def settings(self, lane: int) -> str:
        """The settings of a lane that differ from the graph, as text."""
        return describe_values(self._values(lane))

    def run(
        self,
        *,
        out: str | Path | None = None,
        form: str = "zarr",
        fps: int = 30,
        touch_rate: float = 150.0,
        quiet: bool = False,
        executor: Executor | None = None,
    ) -> Any:
        """Run all lanes from the start.

        Returns an xarray Dataset with the dimensions `lane` and `time` [s], and `axis` for vectors. Without xarray it
        is a dictionary of numpy arrays with units. Varied settings are coordinates of `lane`. A stream that is not sent
        at a tick keeps its last value.

        A lane that fails is NaN from that tick on; `error` has its message, and a warning lists the failed lanes. Lines
        that `palpate run` would print about a lane are in `notes`, also of the Dataset, there with the name of the
        node; the first of each kind is also a PalpateWarning.

        out    folder of a zarr store to write, in bounded memory for any number of lanes. Ctrl-C keeps whole blocks of
               lanes; the same call continues an unfinished store. The Dataset reads from it
        form   of `out`: "zarr", or "lerobot", a data set for robot learning with an episode for each lane that does not
               fail (docs/lerobot.md), whose folder is returned; `keep` then selects nothing
        fps, touch_rate  of this set: rates of the frames and of the touch samples [Hz]
        quiet  no progress bar
        executor  what computes blocks of lanes, anything with `submit`: an executor of `concurrent.futures`, mpi4py or
               loky, a `dask.distributed.Client`; None: the threads of this process. The results are the same

        ArgumentError: the results do not fit into the memory, or `out` has something else. RunError: all lanes failed.
        KeyboardInterrupt: Ctrl-C, within 0.1 s.
        """
        if form not in FORMS:
            raise ArgumentError(f"form: found {form!r}, expected one of {', '.join(FORMS)}")
        if form == "lerobot":
            return self._run_episodes(out, Frames(fps, float(touch_rate)), quiet, executor)
        time = self._times()
        self._check_room(out is None)
        if out is None:
            columns, errors, notes = self._in_memory(quiet, executor)
            self._report()
            warn(self.notes)
            return self._dataset(time, columns, {"error": errors, NOTES: notes})
        coordinates = {path: (values, self._units.get(path, "")) for path, values in self.over.items()}
        store = LaneStore(
            check_path("out", out), self._identity(), self.count, self._size, time, self._fields, coordinates, self.name
        )
        try:
            self._run(store.write, quiet, executor, store.missing, self._size, read_notes(store.notes))
        finally:
            store.close()
        self._report()
        warn(self.notes)
        import xarray

        return xarray.open_zarr(out, consolidated=False, chunks=None)

    def gradient(
        self,
        by: Sequence[str],
        *,
        reduce: Mapping[str, tuple[str, str | Callable[[np.ndarray], Any]]] | None = None,
        scale: Mapping[str, float] | None = None,
        tolerance: float = TOLERANCE,
        quiet: bool = False,
        executor: Executor | None = None,
    ) -> Any:
        """The derivatives of the kept fields of all lanes, by central differences at three steps, in one run of more
        lanes: 6 for each parameter, 3 if its value is at a limit, and 1 (docs/backwards.md).

        by         parameters: numeric settings by path, "tissue.stiffness", "scene.finger.thickness", also numbers in
                   lists, "scene.hand.path[1].to[2]"
        reduce     numbers whose derivatives are taken instead, by name: a kept field, and "max", "min", "mean", "last",
                   "rms" or a function of its values (times, ...)
        scale      of a change of a parameter [its unit]; the default is its value
        tolerance  largest error of a derivative over its RMS
        quiet, executor  see `run`

        Returns a Dataset with the kept fields, or the reductions, and for each NAME also `NAME.derivative` and its
        error `NAME.error` (lane, parameter, time, ...) per unit of the parameter, and `NAME.reason` (lane, parameter).
        A derivative whose steps do not agree is NaN, and the reason says why; so are all derivatives of a graph whose
        results jump, such as with the counts of an encoder (`hand: {ideal: true}` removes them).

        ArgumentError: a parameter is no number, or no kept field needs it. RunError: all lanes failed.
        """
        work = Gradient(
            self._base, [f"{stream}.{field.name}" for stream, field in self._keep], by, self.over,
            self.count, self._prepared[0].job, reduce or {}, scale, tolerance,
        )  # fmt: skip
        if work.scout:
            columns, errors = self._other_lanes(self.count, self.over, work.scout, quiet, executor)[:2]
            work.leave_out(columns, errors)
        columns, errors, more = self._other_lanes(work.lanes, work.over, work.keep, quiet, executor)
        if work.take_back(columns, errors):
            columns, errors, more = self._other_lanes(work.lanes, work.over, work.keep, quiet, executor)
        more._report()
        return work.dataset(columns, errors, self._times(), [field.unit for field in self._fields])

    def _times(self) -> np.ndarray:
        """Times of the kept values [s]."""
        return np.array([nanoseconds(tick, self.rate) * 1e-9 for tick in range(0, self.ticks, self._every)])

    def _run_episodes(self, out: str | Path | None, frames: Frames, quiet: bool, executor: Executor | None) -> Path:
        """Run all lanes, and write each as an episode of a new data set; returns its folder."""
        if out is None:
            raise ArgumentError("form='lerobot': found no `out`, expected the folder of the data set")
        folder = check_path("out", out)
        sources, left = lane_sources(self._base)
        if left:
            warnings.warn(f"{self.name}: {', '.join(left)}: not in the data set, because lanes keep no fields of "
                          "variable length; export recordings instead", PalpateWarning, stacklevel=3)  # fmt: skip
        more: Ensemble = Ensemble.__new__(Ensemble)
        keep = [f"{stream}.{name}" for stream, name in sources.fields]
        more._prepare(self.name, self._launch, self.count, self.over, keep, self._every, self._threads)
        more._check_room(False)
        about: dict[str, Any] = {"graph": self.name, "identity": more._identity(), "units": self._units}
        about |= {"distributions": self._laws, "seed": self._seed}
        written = LaneEpisodes(
            folder, self._base, sources, frames, self._times(), self.count, self.over,
            lambda lane: more._check_lane(lane).job.nodes, about,
        )  # fmt: skip
        more._watch = written.watch
        more._run(written.write, quiet, executor, range(0, self.count, more._size), more._size)
        self.notes, self.memory = more.notes, more.memory
        more._report()
        warn(more.notes)
        return folder

    def _other_lanes(
        self, lanes: int, over: Mapping[str, Any], keep: Sequence[str], quiet: bool, executor: Executor | None
    ) -> tuple[list[np.ndarray], list[str], "Ensemble"]:
        """The fields and errors of other lanes of this graph, with the ensemble that they are."""
        more = Ensemble.__new__(Ensemble)
        more._prepare(self.name, self._launch, lanes, over, keep, self._every, self._threads)
        more._check_room(True)
        columns, errors, _ = more._in_memory(quiet, executor)
        return columns, errors, more

    def _in_memory(self, quiet: bool, executor: Executor | None) -> tuple[list[np.ndarray], list[str], list[str]]:
        """The kept fields of all lanes, their errors and their notes."""
        columns: list[np.ndarray] = []
        errors, notes, whole = [""] * self.count, [""] * self.count, executor is None

        def take(first: int, found: Sequence[np.ndarray], failed: Mapping[int, str], noted: Mapping[int, str]) -> None:
            if not columns:
                columns.extend(found if whole else [np.empty((self.count, *c.shape[1:]), c.dtype) for c in found])
            for column, part in zip(columns, found, strict=True):
                if column is not part:
                    column[first : first + len(part)] = part
            for texts, given in ((errors, failed), (notes, noted)):
                for lane, text in given.items():
                    texts[lane] = text

        size = self.count if whole else self._size
        self._run(take, quiet, executor, range(0, self.count, size), size)
        return columns, errors, notes

    def _run(
        self,
        take: Callable[[int, Sequence[np.ndarray], Mapping[int, str], Mapping[int, str]], None],
        quiet: bool,
        executor: Executor | None,
        firsts: Sequence[int],
        size: int,
        noted: Iterable[tuple[int, str, str]] = (),
    ) -> None:
        """Run the blocks of this size that begin with these lanes, and give the results of each away.

        noted  lane, node and text of the notes of lanes that have run before
        """
        self.memory, self.notes = Memory(), LaneNotes(nanoseconds(self.ticks, self.rate) * 1e-9)
        for note in noted:
            self.notes.add(*note)
        self._failed: dict[int, str] = {}
        self._ran = sum(min(size, self.count - first) for first in firsts)
        before = self.count - self._ran
        with StageBars(quiet or not sys.stderr.isatty()) as bars:
            bar = bars.begin(f"{self.count} lanes of {self.name}")
            begun = perf_counter()

            def done(lanes: float) -> None:
                rate = lanes * self.ticks / (perf_counter() - begun)
                bar((before + lanes) / self.count, f"{rate:.3g} touch-steps/s")

            def add(block: Block) -> None:
                take(block.first, block.columns, block.errors, write_notes(block.notes))
                self.memory = max(self.memory, block.memory, key=sum)
                for note in block.notes:
                    self.notes.add(*note)
                self._failed |= block.errors

            if executor is None:
                blocks = LaneBlocks(self._check_lane, self._lane.first, self.count, size, self._task.keep)
                for block in blocks.run(firsts, self._threads, done):
                    add(block)
            else:
                self._spread(executor, firsts, add, done)
        self._failed = dict(sorted(self._failed.items()))

    def _spread(
        self, executor: Executor, firsts: Sequence[int], add: Callable[[Block], None], done: Callable[[float], None]
    ) -> None:
        """Run blocks on an executor."""
        ran, ended = 0, ""

        def add_blocks(blocks: Finished) -> None:
            nonlocal ran, ended
            for (first, _), found in blocks:
                count = min(self._size, self.count - first)
                if isinstance(found, Ended):
                    ended = f"lanes {first} to {first + count - 1}: {found.why}"
                    continue
                add(found)
                ran += count
                done(ran)

        slices = [slice(first, min(first + self._size, self.count)) for first in firsts]
        items = [(part.start, {path: values[part] for path, values in self.over.items()}) for part in slices]
        spread(executor, about(), self._task, items, add_blocks, lambda text: warnings.warn(text, PalpateWarning, 2))
        if ended:
            raise RunError(f"{ended}; the other lanes have run")

    def _check_room(self, whole: bool) -> None:
        """ArgumentError: the results of all lanes, or of a block unless `whole`, do not fit into the memory."""
        each, room = self._row + OBJECTS, free_memory() - OTHER
        if whole:  # words are shown as objects, each with an address
            each += sum(8 * math.prod(field.shape) for field in self._fields if field.words)
        lanes = self.count if whole else self._size
        if lanes * each > room:
            cure = "an `every` greater than 1" if whole and self._every == 1 else "a greater `every`"
            raise ArgumentError(
                f"keep: {lanes} lanes of {each / 1e3:.3g} kB take {lanes * each / 1e9:.3g} GB, and the rest of the "
                f"process {OTHER / 1e9:.3g} GB; {(room + OTHER) / 1e9:.3g} GB are free; expected at most "
                f"{max(0, int(room // each))} lanes, fewer fields, a shorter duration, {cure}"
                + (", or run(out='touches.zarr'), which needs little memory" if whole else "")
            )

    def _identity(self) -> str:
        """Hash of everything that determines the results."""
        kept = [(field.name, field.dtype.str, field.shape) for field in self._fields]
        lane = identity(self._lane.first)
        over = {path: digest_values(values) for path, values in self.over.items()}
        return digest([kernel_cache.key(), *lane, over, self.count, self._every, kept, self._size])

    def _dataset(self, time: np.ndarray, columns: Sequence[np.ndarray], texts: Mapping[str, list[str]]) -> Any:
        """The results as a Dataset, or as a dictionary without xarray."""
        found = [field.decode_words(column) for field, column in zip(self._fields, columns, strict=True)]
        try:
            import xarray
        except ImportError:
            plain = {
                field.name: Samples(values, field.name, field.unit, np.empty(0))
                for field, values in zip(self._fields, found, strict=True)
            }
            return {**plain, "time": time, **{name: np.array(lines) for name, lines in texts.items()}}
        data: dict[str, Any] = {
            field.name: (field.dimensions, values, {"units": field.unit})
            for field, values in zip(self._fields, found, strict=True)
        }
        data |= {name: ("lane", np.array(lines, dtype=object), {}) for name, lines in texts.items()}
        coordinates: dict[str, Any] = {"lane": np.arange(self.count), "time": ("time", time, {"units": "s"})}
        for path, values in self.over.items():
            coordinate, unit = as_coordinate(values), self._units.get(path)
            shown = coordinate.astype(str) if coordinate.dtype == object else coordinate
            coordinates[path] = "lane", shown, {"units": unit} if unit else {}
        return xarray.Dataset(data, coordinates, {"graph": self.name})

    def _report(self) -> None:
        """Warn about failed lanes. RunError: all lanes that ran failed."""
        errors, ran = self._failed, self._ran
        if not errors:
            return
        lines = [f"lane {lane} ({self.settings(lane)}): {errors[lane]}" for lane in list(errors)[:SHOWN]]
        if len(errors) > SHOWN:
            lines.append(f"and {len(errors) - SHOWN} more; `error` has all")
        text = f"{len(errors)} of {ran} lanes failed:\n" + "\n".join(lines)
        if len(errors) == ran:
            raise RunError(text)
        warnings.warn(text, RuntimeWarning, stacklevel=3)


def ensemble_of(launch: LaunchFile, keep: Sequence[str], lanes: int = 1) -> Ensemble:
    """The lanes of a run that is described already. GraphError, ArgumentError: it is refused."""
    made = Ensemble.__new__(Ensemble)
    made._laws, made._seed = {}, 0
    made._prepare(launch.graph.stem, launch, lanes, {}, keep, 1, None)
    return made


def gradient(
    graph: str | Path = "kidney",
    by: Sequence[str] = ("tissue.stiffness",),
    keep: Sequence[str] = ("contact.force",),
    *,
    scene: str | None = None,
    duration: float | str | None = None,
    organ: Organ = None,
    sets: Sequence[str] = (),
    every: int = 1,
    reduce: Mapping[str, tuple[str, str | Callable[[np.ndarray], Any]]] | None = None,
    scale: Mapping[str, float] | None = None,
    tolerance: float = TOLERANCE,
    **nodes: str | Mapping[str, Any],
) -> Any:
    """The derivatives of one touch by settings, see `Ensemble.gradient`; the other arguments are those of `Ensemble`.

    found = palpate.gradient("kidney", ["tissue.stiffness"], sets=["scene.hand.ideal=true"], duration=1.2)
    found["contact.force.derivative"]       # (parameter, time) [N per N/m^n]
    """
    given: dict[str, Any] = dict(nodes)
    touch = Ensemble(graph, 1, {}, keep, scene=scene, duration=duration, organ=organ, sets=sets, every=every, **given)
    found = touch.gradient(by, reduce=reduce, scale=scale, tolerance=tolerance, quiet=True)
    return {k: v if k == "time" else v[0] for k, v in found.items()} if isinstance(found, dict) else found.isel(lane=0)


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


def _drawn(over: Mapping[str, Any], lanes: int, seed: int) -> dict[str, Any]:
    """The settings with a value for each lane in place of each distribution. ArgumentError: one is invalid."""
    laws = {path: given for path, given in over.items() if is_law(given)}
    if not laws:
        return dict(over)
    frozen = [law if hasattr(law, "ppf") else law_of(path, *next(iter(law.items())))[0] for path, law in laws.items()]
    shares = quantiles("sobol", len(laws), lanes, seed).T
    return {
        **over,
        **{path: values_at(*pair) for path, pair in zip(laws, zip(frozen, shares, strict=True), strict=True)},
    }


def _each(path: str, given: Any, lanes: int) -> Values:
    """One value per lane. ArgumentError: the number of values is wrong."""
    several = isinstance(given, Sequence) or (isinstance(given, np.ndarray) and given.ndim > 0)
    if isinstance(given, str) or not several:
        return [plain(given)] * lanes
    if len(given) != lanes:
        raise ArgumentError(f"over {path!r}: found {len(given)} values, expected {lanes}, one for each lane, or one")
    if isinstance(given, np.ndarray) and given.dtype.kind in "biuf":
        return given.copy()
    return [value_of(given, place) for place in range(lanes)]


def _kept_field(text: str, graph: Graph) -> tuple[str, Field]:
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
