"""A study: one graph at many points.

study = palpate.Study("kidney", over={"tissue.stiffness": {"linspace": [200, 400, 8]}}, keep=["peak contact.force"])
study.run("out/")
study.table()
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.bases import build_for_each
from palpate.launch.load.arguments import check_over, check_path, check_texts
from palpate.launch.load.dependencies import content, digest
from palpate.launch.load.files import SCENES, find_file
from palpate.launch.load.launchfile import find
from palpate.launch.load.organ_file import organ_of
from palpate.launch.run.lane_values import extremes
from palpate.launch.run.notes import RunNote, warn
from palpate.launch.run.tasks.spread import Executor, Finished, spread
from palpate.launch.run.tasks.task import Ended, about, fingerprint
from palpate.physics.errors import ArgumentError, RunError
from palpate.studies.sweeps.axes import axis
from palpate.studies.sweeps.checks import check, path, seconds, space, units
from palpate.studies.sweeps.identity import changes, describe_space, origin
from palpate.studies.sweeps.keep import RECORDING, Kept, kept_results
from palpate.studies.sweeps.point import Computed, Point
from palpate.studies.sweeps.sensitivity import indices
from palpate.studies.sweeps.task import PointTask

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LEGIBLE = 32  # Maximum length of a value in tables and legends
MANY = 100_000  # Maximum number of points without `yes`


class Study:
    """One graph at many points; the results have the same bytes as those of `palpate.run` at each point.

    graph        name of a shipped launch file or graph, or a path
    over         varied settings: paths in the form of `--set`, each with values or a distribution (see docs/studies.md)
    keep         kept results of each run: "peak contact.force", "curve contact.force", "recording" ...
    scene, duration, organ, sets  see `palpate.run`
    samples, design, seed  number of joint samples of all distributions; sobol, lhs or random; seed of the samples
    sensitivity  sobol or morris: draw the points for the sensitivity indices of `indices`
    limit        timeout of a point, [s] or a text with a unit; None: no timeout

    ArgumentError, GraphError: invalid arguments; raised before anything runs.
    """

    folder: Path | None = None  # with the results, after a run

    def __init__(
        self,
        graph: str | Path = "kidney",
        over: Mapping[str, Any] | None = None,
        keep: Sequence[str] = ("peak contact.force",),
        *,
        scene: str | Mapping[str, Any] | None = None,
        duration: float | str | None = None,
        organ: str | Path | Mapping[str, Any] | None = None,
        sets: Sequence[Any] = (),
        samples: int = 0,
        design: str = "sobol",
        seed: int = 0,
        sensitivity: str | None = None,
        limit: float | str | None = "10 min",
    ) -> None:
        if not over:
            raise ArgumentError("over: found nothing, expected what varies, such as {'tissue.stiffness': [200, 400]}")
        check_over(over)
        check_texts("keep", keep, "peak contact.force")
        if not keep:
            raise ArgumentError("keep: found nothing, expected a list such as ['peak contact.force']")
        given = scene if isinstance(scene, Mapping) or scene is None else find_file(str(scene), SCENES, what="scene")
        launch = find(str(graph)).but(overrides=sets, scene=given, duration=seconds("duration", duration))
        launch = launch.but(organ=None if organ is None else organ_of(organ)).settle_organ()
        self.limit = seconds("limit", limit)
        base = launch.load()
        self.keep = kept_results(keep, base)
        self.recorded = RECORDING in keep
        self.launch, self.name = replace(launch, pace=None, only=None), launch.graph.stem
        self.space = space(
            [axis(path(name, base), what) for name, what in over.items()], samples, design, seed, sensitivity
        )
        self.sensitivity = sensitivity
        check(launch, base, self.space)
        self._origin = origin(launch, base)
        self._about = {**self._origin, "keep": sorted(keep), "versions": fingerprint()}
        self.base = digest(self._about)

    def __len__(self) -> int:
        return len(self.space)

    def __repr__(self) -> str:
        return f"<study of {self.name}: {len(self)} points over {', '.join(self.space.paths)}>"

    @cached_property
    def points(self) -> list[Point]:
        """All points in order."""
        found, known = [], dict[str, str]()
        for number in range(len(self)):
            values, labels = self.space.point(number)
            texts = {value for value in values.values() if isinstance(value, str)}
            known |= {value: content(value) for value in texts - known.keys()}
            files = {value: known[value] for value in texts}
            found.append(Point(number, digest([self.base, values, files]), values, labels))
        return found

    # -- running -------------------------------------------------------------------------------------------------

    def run(
        self,
        folder: str | Path,
        executor: Executor | None = None,
        *,
        workers: int | None = None,
        retry: bool = False,
        yes: bool = False,
        report: Callable[[str], None] = lambda text: None,
        done: Callable[[Point, Computed, int], None] = lambda point, computed, left: None,
    ) -> Study:
        """Compute the points that the folder lacks, and store them in it.

        executor  what computes blocks of points: anything with `submit`, such as an executor of `concurrent.futures`, a
                 `dask.distributed.Client`, or those of mpi4py and loky; None: `workers` processes of this machine, by
                 default one per core. The results are the same
        retry    compute failed points again
        yes      allow more than 100 000 points
        report   called with lines about changes since the last run, and if a cluster has no workers
        done     called after each point, with the number of remaining points

        RunError: the disk is full, for example. All points computed before are stored, also after Ctrl-C.
        """
        from palpate.launch.run.tasks.local import cores, local
        from palpate.studies.sweeps.store import Store

        if len(self) > MANY and not yes:
            raise ArgumentError(
                f"over: {len(self):,} points, {' x '.join(map(str, self.space.shape))}; at 1 s each this takes "
                f"{len(self) / 86400.0:,.1f} days of one core. Expected up to {MANY:,}; to continue: --yes, or yes=True"
            )
        folder = check_path("folder", folder)
        store = Store(folder)
        try:
            missing = self._missing(store, retry, report)
            self.folder = folder
            left = len(missing)

            def add(finished: Finished) -> None:
                nonlocal left
                results = [
                    (point, Computed(error=found.why, seconds=found.seconds) if isinstance(found, Ended) else found)
                    for point, found in finished
                ]
                store.add(self.base, [(point, computed) for point, computed in results if not computed.lost])
                for point, computed in results:
                    if computed.lost:
                        raise RunError(f"{computed.lost}; what was computed before is stored")
                    left -= 1
                    done(point, computed, left)

            if missing:
                task = self._task()
                build_for_each(task.run, (point.values for point in missing), not sys.stderr.isatty(), report)
                workers = min(workers or cores(), left)
                opened = nullcontext(executor) if executor else local(workers, store.folder / "workers.log")
                try:
                    with opened as them:
                        spread(them, about() | self._about["versions"], task, missing, add, report)
                finally:
                    store.flush()
        finally:
            store.close()
        warn(self.notes, what="point")
        return self

    def _task(self) -> PointTask:
        varied = {path: extremes(values) for path, values in self.space.columns().items()}
        return PointTask(self.launch, self.keep, self.limit, varied, digest(self._origin))

    @property
    def notes(self) -> list[RunNote]:
        """Lines that `palpate run` would print about the points, each with `lane` (the number of the point), `node`,
        `time` [s] and `text`, after `run`; the first of each kind is also a PalpateWarning."""
        found = []
        for number, row in enumerate(self.rows()):
            for text, node, time in json.loads(row.get("notes", "[]")):
                found.append(RunNote(text, node, time, number))
        return found

    def _missing(self, store: Any, retry: bool, report: Callable[[str], None]) -> list[Point]:
        """The points that a folder lacks, with the slots of their rows; reports changes since the last run."""
        before = store.about.get("base")
        study = {"over": describe_space(self.space), "samples": self.space.samples, "design": self.space.design,
                 "seed": self.space.seed}  # fmt: skip
        lines = []
        if before is not None:
            old = {**store.about["bases"][before], "study": store.about["study"]}
            lines = changes(old, json.loads(json.dumps({**self._about, "study": study}, default=str)))
        store.describe(self.base, self._about, study)
        stored = [store.rows.get(point.key) for point in self.points]
        missing = [p for p, row in zip(self.points, stored, strict=True) if row is None or (retry and row["error"])]
        for line in lines:
            report(line)
        report(f"{len(self)} points, {len(self) - len(missing)} stored, {len(missing)} to compute")
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

    @cached_property
    def units(self) -> dict[str, str]:
        """SI unit of each path with numbers. GraphError: the graph has changed and no longer loads."""
        return units(self.launch, self.space)

    # -- results -------------------------------------------------------------------------------------------------

    @property
    def numbers(self) -> list[Kept]:
        return [one for one in self.keep if one.how != "curve"]

    @property
    def curves(self) -> list[Kept]:
        return [one for one in self.keep if one.how == "curve"]

    def rows(self) -> list[dict[str, Any]]:
        """One row per point, in order: varied settings, numbers, error, which is "not computed" for a missing point."""
        from palpate.studies.sweeps.store import Store

        stored = Store(self.home(), write=False).rows
        nothing = {"error": "not computed"}
        return [{**stored.get(point.key, nothing), **point.labels} for point in self.points]

    def axis_label(self, path: str) -> str:
        """A path with its unit, for axes and legends."""
        return f"{path} [{self.units[path]}]" if path in self.units else path

    def value_text(self, path: str, value: Any) -> str:
        """A value for tables and legends; a long one, such as a motion, is replaced by its number."""
        text = f"{value:.4g}" if isinstance(value, float) else str(value)
        if len(text) <= LEGIBLE or path not in self.space.paths:
            return text
        axis = next(one for one in self.space.axes if path in one.paths)
        return f"#{[row[axis.paths.index(path)] for row in axis.labels].index(value) + 1}"

    def table(self) -> Any:
        """A pandas DataFrame with one row per point: varied settings, numbers, error. Units are in its `attrs`."""
        import pandas

        numbers = [one.text for one in self.numbers]
        extra = [RECORDING] if self.recorded else []
        table = pandas.DataFrame(self.rows()).reindex(columns=[*self.space.paths, *numbers, *extra, "error"])
        table.attrs["units"] = self.units | {one.text: one.unit for one in self.numbers}
        return table

    def indices(self) -> Any:
        """A pandas DataFrame of the sensitivity indices, with one row per kept number, parameter and combination of the
        crossed axes. ArgumentError: the study has no `sensitivity`, or points failed."""
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

    def home(self) -> Path:
        if self.folder is None:
            raise RunError("this study was not run; `study.run('out/')` computes missing points and opens the folder")
        return self.folder

    def xarray(self) -> Any:
        """An xarray Dataset with one dimension per crossed axis, named after its first path, `sample` for distributions
        and `time` [s] for curves."""
        from palpate.studies.sweeps.dataset import dataset

        return dataset(self)

    def plot(self, name: str, ax: Axes | None = None) -> Figure:
        """Draw a quantity, such as "contact.force", or a kept result, such as "peak contact.force": curves over time, a
        number over the first axis with numbers, or the sensitivity indices. Draws into the axes `ax`, or into a new
        figure that becomes the current one of pyplot. PictureError: it cannot be drawn."""
        from palpate.studies.sweeps.picture import draw_quantity

        return draw_quantity(self, name, ax)
