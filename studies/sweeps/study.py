"""A study: one graph at many points.

study = palpate.Study("kidney", over={"tissue.stiffness": {"linspace": [2e3, 4e3, 8]}}, keep=["peak contact.force"])
study.run("out/")
study.table()
"""

from __future__ import annotations

import hashlib
import inspect
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.engine.graph import Graph
from palpate.launch.load.classes import ClassError, find_class
from palpate.launch.load.files import SCENES, find_file
from palpate.launch.load.launchfile import LaunchFile, find
from palpate.launch.load.values.units import UnitError, convert
from palpate.physics.errors import ArgumentError, RunError
from palpate.studies.sweeps.axes import DESIGNS, Axis, Space, axis
from palpate.studies.sweeps.keep import RECORDING, Kept, kept
from palpate.studies.sweeps.point import Computed, Point, Task, fingerprint, overrides
from palpate.studies.sweeps.sensitivity import METHODS, indices

if TYPE_CHECKING:
    from distributed import Client
    from matplotlib.figure import Figure

MANY = 100_000
"""Points that a study computes without `yes`."""
TRIED = 64
"""Combinations of bodies, motions and files that are loaded before anything runs, at most."""
SHOWN = 12
"""Changes that are told one by one."""


class Study:
    """One graph at many points; the results are those of `palpate.run` at each of them, to the byte.

    graph        one that ships, or a launch file or graph
    over         what varies: paths as after `--set`, and for each values or a distribution (see docs/studies.md)
    keep         what is kept of each run: "peak contact.force", "curve contact.force", "recording" ...
    scene, duration, sets  as of `palpate.run`
    samples, design, seed  number of points drawn of all distributions together; sobol, lhs or random; of the draw
    sensitivity  sobol or morris: the points are drawn so that `indices` can tell which parameter matters
    limit        [s] or a text with a unit: what a point may take, None: any time

    ArgumentError, GraphError: what is wrong with them, before anything runs.
    """

    def __init__(
        self,
        graph: str | Path = "kidney",
        over: Mapping[str, Any] | None = None,
        keep: Sequence[str] = ("peak contact.force",),
        *,
        scene: str | Mapping[str, Any] | None = None,
        duration: float | str | None = None,
        sets: Sequence[Any] = (),
        samples: int = 0,
        design: str = "sobol",
        seed: int = 0,
        sensitivity: str | None = None,
        limit: float | str | None = "10 min",
    ) -> None:
        if not over:
            raise ArgumentError("over: found nothing, expected what varies, such as {'tissue.stiffness': [2e3, 4e3]}")
        if isinstance(keep, str) or not keep:
            raise ArgumentError(f"keep: found {keep!r}, expected a list such as ['peak contact.force']")
        given = scene if isinstance(scene, Mapping) or scene is None else find_file(str(scene), SCENES, what="scene")
        launch = find(str(graph)).but(overrides=sets, scene=given, duration=_seconds("duration", duration))
        self.limit = _seconds("limit", limit)
        base = launch.load()
        self.keep = kept(keep, base)
        self.recorded = RECORDING in keep
        self.launch = replace(launch, pace=None, only=None)
        self.space = _space(
            [axis(_path(name, base), what) for name, what in over.items()], samples, design, seed, sensitivity
        )
        self.sensitivity = sensitivity
        self.folder: Path | None = None
        _check(launch, base, self.space)
        self._about: dict[str, Any] = {
            "graph": base.source, "scene": base.scene, "rate": base.rate, "duration": launch.duration,
            "effects": {name: choice.word for name, choice in base.effects.items()}, "keep": sorted(keep),
            "files": dict(_files(base)), "versions": fingerprint(),
        }  # fmt: skip
        self.base = _hash(self._about)

    def __len__(self) -> int:
        return len(self.space)

    def __repr__(self) -> str:
        return f"<study of {self.launch.graph.stem}: {len(self)} points over {', '.join(self.space.paths)}>"

    @cached_property
    def points(self) -> list[Point]:
        """All points in order."""
        found, known = [], dict[str, str]()
        for number in range(len(self)):
            values, labels = self.space.point(number)
            texts = {value for value in values.values() if isinstance(value, str)}
            known |= {value: _sha(value) for value in texts - known.keys()}
            files = {value: known[value] for value in texts}
            found.append(Point(number, _hash([self.base, values, files]), values, labels))
        return found

    # -- running -------------------------------------------------------------------------------------------------

    def run(
        self,
        folder: str | Path,
        client: Client | None = None,
        *,
        workers: int | None = None,
        retry: bool = False,
        yes: bool = False,
        told: Callable[[str], None] = lambda text: None,
        done: Callable[[Point, Computed, int], None] = lambda point, computed, left: None,
    ) -> Study:
        """Compute the points that the folder does not have yet, and keep them there.

        client   of Dask; None: `workers` processes of this machine, one for each core where that is None, too
        retry    compute again what failed before
        yes      compute more than 100 000 points
        told     called with lines on what goes on: what changed since, the address of the dashboard
        done     called after each point, with the number of those that are left

        RunError: the scheduler is lost, the disk is full ... What was computed before is stored, also on Ctrl-C.
        """
        from palpate.studies.sweeps.cluster import compute, cores, local
        from palpate.studies.sweeps.store import Store

        if len(self) > MANY and not yes:
            raise ArgumentError(
                f"over: {len(self):,} points, {' x '.join(map(str, self.space.shape))}; at 1 s each this takes "
                f"{len(self) / 86400.0:,.1f} days of one core. Expected up to {MANY:,}; to go on: --yes, or yes=True"
            )
        store = Store(Path(folder))
        try:
            missing = self._missing(store, retry, told)
            self.folder = Path(folder)
            left = len(missing)

            def add(point: Point, computed: Computed, machine: str) -> None:
                nonlocal left
                left -= 1
                store.add(self.base, point, computed, machine)
                done(point, computed, left)

            if missing:
                task = Task(self.launch, self.keep, self._about["versions"], self.limit)
                waits = lambda: told("waiting for a worker")  # noqa: E731
                try:
                    if client is not None:
                        compute(client, task, missing, add, waits)
                    else:
                        with local(min(workers or cores(), left), store.folder / "workers.log") as here:
                            told(f"dashboard {here.dashboard_link}")
                            compute(here, task, missing, add, lambda: None)
                finally:
                    store.flush()
        finally:
            store.close()
        return self

    def _missing(self, store: Any, retry: bool, told: Callable[[str], None]) -> list[Point]:
        """The points that a folder does not have, with the slots of their rows; what changed since is told."""
        before = store.about.get("base")
        study = {"over": {path: len(set(map(repr, column))) for path, column in self._columns().items()},
                 "points": len(self), "sensitivity": self.sensitivity}  # fmt: skip
        lines = []
        if before is not None:
            old = {**store.about["bases"][before], "study": store.about["study"]}
            lines = _changes(old, json.loads(json.dumps({**self._about, "study": study}, default=str)))
        store.describe(self.base, self._about, study)
        stored = [store.rows.get(point.key) for point in self.points]
        missing = [p for p, row in zip(self.points, stored, strict=True) if row is None or (retry and row["error"])]
        for line in lines:
            told(line)
        told(f"{len(self)} points, {len(self) - len(missing)} stored, {len(missing)} to compute")
        slots = iter(store.free(p.slot for p in missing if p.key not in store.rows))
        folder = store.folder / "recordings"
        if self.recorded:
            folder.mkdir(exist_ok=True)
        return [
            Point(
                store.rows[p.key]["slot"] if p.key in store.rows else next(slots), p.key, p.values, p.labels,
                (folder / f"{p.key}.mcap").absolute() if self.recorded else None,
            )
            for p in missing
        ]  # fmt: skip

    # -- results -------------------------------------------------------------------------------------------------

    @property
    def numbers(self) -> list[Kept]:
        return [one for one in self.keep if one.how != "curve"]

    @property
    def curves(self) -> list[Kept]:
        return [one for one in self.keep if one.how == "curve"]

    def rows(self) -> list[dict[str, Any]]:
        """A row for each point, in order: what was varied, numbers, error; "not computed" where there is none yet."""
        from palpate.studies.sweeps.store import Store

        stored = Store(self._home(), write=False).rows
        nothing = {"error": "not computed"}
        return [{**point.labels, **stored.get(point.key, nothing)} for point in self.points]

    def table(self) -> Any:
        """A pandas DataFrame with a row for each point: what was varied, numbers, error; the units are in its
        `attrs`."""
        import pandas

        numbers = [one.text for one in self.numbers]
        extra = [RECORDING] if self.recorded else []
        table = pandas.DataFrame(self.rows()).reindex(columns=[*self.space.paths, *numbers, *extra, "error"])
        table.attrs["units"] = {one.text: one.unit for one in self.numbers}
        return table

    def xarray(self) -> Any:
        """An xarray Dataset: a dimension for each crossed axis, named after its first path, `sample` for what is drawn
        of distributions, `time` [s] for curves."""
        from palpate.studies.sweeps.dataset import dataset

        return dataset(self)

    def indices(self) -> Any:
        """A pandas DataFrame of the sensitivity indices: a row for each number that is kept and each parameter, and
        for each combination of the crossed axes. ArgumentError: the study was not drawn for that, or points failed."""
        import pandas

        if self.sensitivity is None:
            raise ArgumentError("indices: this study has no `sensitivity`, expected sobol or morris")
        rows = self.rows()
        failed = [row["error"] for row in rows if row["error"]]
        if failed:
            raise ArgumentError(f"indices: {len(failed)} of {len(rows)} points have no result, the first: {failed[0]}")
        names, count, out = [one.paths[0] for one in self.space.sampled], len(self.space.cube), []
        for start in range(0, len(rows), count):
            group = rows[start : start + count]
            where = {path: group[0][path] for path in self.space.paths if path not in names}
            for one in self.numbers:
                values = np.array([row[one.text] for row in group])
                found = indices(self.sensitivity, names, self.space.cube, values, self.space.seed)
                out += [{**where, "of": one.text, "parameter": n, **f} for n, f in zip(names, found, strict=True)]
        return pandas.DataFrame(out)

    def plot(self, name: str) -> Figure:
        """A quantity, such as "contact.force", or one thing that is kept, such as "peak contact.force": curves over
        time, a number over the first axis with numbers, or the sensitivity indices. PictureError: what cannot be
        drawn."""
        from palpate.studies.sweeps.picture import draw

        return draw(self, name)

    def _home(self) -> Path:
        if self.folder is None:
            raise RunError("this study was not run; `study.run('out/')` computes what the folder lacks, and opens it")
        return self.folder

    def _columns(self) -> dict[str, list[Any]]:
        """All values of each path."""
        given = {path: [row[k] for row in one.labels] for one in self.space.crossed for k, path in enumerate(one.paths)}
        return given | {one.paths[0]: list(self.space.drawn[:, k]) for k, one in enumerate(self.space.sampled)}


def _space(axes: list[Axis], samples: int, design: str, seed: int, sensitivity: str | None) -> Space:
    drawn = [one for one in axes if one.law is not None]
    paths = [path for one in axes for path in one.paths]
    twice = {path for path in paths if paths.count(path) > 1}
    if twice:
        raise ArgumentError(f"over: {min(twice)} stands twice, expected each path once")
    if sensitivity is not None:
        if sensitivity not in METHODS:
            raise ArgumentError(f"sensitivity: found {sensitivity!r}, expected {' or '.join(METHODS)}")
        if not drawn:
            raise ArgumentError("sensitivity: no distribution in `over`, expected such as {uniform: [low, high]}")
        design = f"sensitivity {sensitivity}"
    elif design not in DESIGNS:
        raise ArgumentError(f"design: found {design!r}, expected {', '.join(DESIGNS)}")
    if bool(drawn) != bool(samples) or not isinstance(samples, int) or samples < 0:
        why = f"over has {len(drawn)} distributions, expected {'samples from 1' if drawn else 'no samples'}"
        raise ArgumentError(f"samples: found {samples!r}; {why}")
    return Space(tuple(axes), samples, design, seed)


def _path(name: str, base: Graph) -> str:
    """Paths as of `--set`; a part of the scene that no node has the name of needs no `scene.` before it."""

    def full(path: str) -> str:
        head = path.partition(".")[0]
        return f"scene.{path}" if head in base.scene and head not in base.nodes else path

    return ", ".join(full(part.strip()) for part in str(name).split(","))


def _check(launch: LaunchFile, base: Graph, space: Space) -> None:
    """GraphError, ArgumentError: the points could not run, or what varies is not there."""
    if launch.duration is None:
        raise ArgumentError(f"{launch.graph.stem}: the graph has no duration; give one: duration=2.0, or '2 s'")
    devices = [name for name, spec in base.nodes.items() if spec.cls.hardware]
    if launch.clock == "real" or devices:
        what = f"{devices[0]!r} drives a device" if devices else "clock: real"
        raise ArgumentError(f"{launch.graph.stem}: a study needs simulated time, but {what}")
    for path in space.paths:
        if len(path.split(".")) < 2 and path != "rate":
            raise ArgumentError(f"over {path}: expected a setting, such as {path}.stiffness, or scene.<path>")
    first = space.point(0)[0]
    choices = []
    for one in space.axes:
        if one.law is not None or all(isinstance(v, int | float) for row in one.values for v in row):
            texts = [{one.paths[0]: text} for text in one.texts[:1]]
            choices.append([{path: first[path] for path in one.paths}, *texts])
        else:
            choices.append([dict(zip(one.paths, row, strict=True)) for row in one.values])
    for _, combination in zip(range(TRIED), product(*choices), strict=False):
        values = {path: value for part in combination for path, value in part.items()}
        launch.but(overrides=overrides(values)).load()


def _files(base: Graph) -> Iterator[tuple[str, str]]:
    """Files that a graph depends on, with hashes of what is in them: those of settings, and of classes of others."""
    for spec in base.nodes.values():
        if not spec.cls.__module__.startswith("palpate."):
            yield from ((file, _sha(file)) for file in (inspect.getsourcefile(spec.cls),) if file)
        for value in _texts(spec.settings):
            if _sha(value):
                yield value, _sha(value)


def _texts(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping | list | tuple):
        for part in value.values() if isinstance(value, Mapping) else value:
            yield from _texts(part)


def _sha(name: str) -> str:
    """Hash of the file of a name, or of the source of a class that others wrote; "" where a text is neither."""
    path = Path(name)
    try:
        if not path.is_file():
            cls = find_class(name)
            path = Path("" if cls.__module__.startswith("palpate.") else inspect.getsourcefile(cls) or "")
        return hashlib.sha256(path.read_bytes()).hexdigest()[:16] if path.is_file() else ""
    except (OSError, ValueError, ClassError):
        return ""


def _hash(data: Any) -> str:
    return hashlib.sha256(json.dumps(data, sort_keys=True, default=str).encode()).hexdigest()[:16]


def _seconds(name: str, given: float | str | None) -> float | None:
    try:
        length = None if given is None else convert(str(given), "s")
    except UnitError as error:
        raise ArgumentError(f"{name}: {error}") from None
    if length is not None and not 1e-9 <= length <= 1e9:
        raise ArgumentError(f"{name}: found {given!r}, expected a time from 1e-9 to 1e9 s")
    return length


def _changes(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """What changed, a line each."""
    old, new = dict(_flat(before)), dict(_flat(now))
    changed = [name for name in {**new, **old} if old.get(name) != new.get(name)]
    lines = [f"changed: {name}: {new.get(name, 'nothing')}, was {old.get(name, 'nothing')}" for name in changed]
    return lines[:SHOWN] + ([f"... and {len(lines) - SHOWN} more"] if len(lines) > SHOWN else [])


def _flat(data: Any, name: str = "") -> Iterable[tuple[str, Any]]:
    if isinstance(data, Mapping) and data:
        for key, value in data.items():
            yield from _flat(value, f"{name}.{key}" if name else str(key))
    else:
        yield name, data
