"""A study: one graph at many points.

study = palpate.Study("kidney", over={"tissue.stiffness": {"linspace": [2e3, 4e3, 8]}}, keep=["peak contact.force"])
study.run("out/")
study.table()
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from functools import cache, cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from palpate.engine.faults import GraphError
from palpate.engine.graph import Graph
from palpate.launch.load.files import SCENES, find_file
from palpate.launch.load.launchfile import find
from palpate.launch.load.values.followers import followers, unit_of
from palpate.physics.errors import ArgumentError
from palpate.studies.sweeps.axes import axis
from palpate.studies.sweeps.checks import accepted, check, path, seconds, space
from palpate.studies.sweeps.identity import changes, content, digest, files_of
from palpate.studies.sweeps.keep import RECORDING, kept
from palpate.studies.sweeps.point import Computed, Point, Task, fingerprint, overrides
from palpate.studies.sweeps.results import Results

if TYPE_CHECKING:
    from distributed import Client
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from palpate.studies.sweeps.local import Local

LONG = 200  # letters of the values of a path in `study.json`
SEVERAL = 8  # values of a path that are tried for its unit
MANY = 100_000  # Points that a study computes without `yes`


class Study(Results):
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
        launch = find(str(graph)).but(overrides=sets, scene=given, duration=seconds("duration", duration))
        self.limit = seconds("limit", limit)
        base = launch.load()
        self.keep = kept(keep, base)
        self.recorded = RECORDING in keep
        self.launch, self.name = replace(launch, pace=None, only=None), launch.graph.stem
        self.space = space(
            [axis(path(name, base), what) for name, what in over.items()], samples, design, seed, sensitivity
        )
        self.sensitivity = sensitivity
        check(launch, base, self.space)
        self._about: dict[str, Any] = {
            "graph": base.source, "scene": base.scene, "rate": base.rate, "duration": launch.duration,
            "effects": {name: choice.word for name, choice in base.effects.items()}, "keep": sorted(keep),
            "files": dict(files_of(base)), "versions": fingerprint(),
        }  # fmt: skip
        self.base = digest(self._about)

    def __repr__(self) -> str:
        return f"<study of {self.name}: {len(self)} points over {', '.join(self.space.paths)}>"

    @cached_property
    def points(self) -> list[Point]:  # type: ignore[override]
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
        client: Client | Local | None = None,
        *,
        workers: int | None = None,
        retry: bool = False,
        yes: bool = False,
        told: Callable[[str], None] = lambda text: None,
        done: Callable[[Point, Computed, int], None] = lambda point, computed, left: None,
    ) -> Study:
        """Compute the points that the folder does not have yet, and keep them there.

        client   of Dask, or a pool of `local`; None: `workers` processes of this machine, one for each core where that
                 is None, too
        retry    compute again what failed before
        yes      compute more than 100 000 points
        told     called with lines on what goes on: what changed since, that no worker is there
        done     called after each point, with the number of those that are left

        RunError: the scheduler is lost, the disk is full ... What was computed before is stored, also on Ctrl-C.
        """
        from palpate.studies.sweeps.batches import compute
        from palpate.studies.sweeps.local import Local, cores, local
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
                waits = cache(lambda: told("waiting for a worker"))
                if client is None:
                    workers = min(workers or cores(), left)
                    pool: Any = local(workers, store.folder / "workers.log")
                elif isinstance(client, Local):
                    pool = nullcontext(client)
                else:
                    from palpate.studies.sweeps.cluster import pool as of_dask

                    pool = of_dask(client)
                try:
                    with pool as them:
                        compute(them, task, missing, add, waits)
                finally:
                    store.flush()
        finally:
            store.close()
        return self

    def _missing(self, store: Any, retry: bool, told: Callable[[str], None]) -> list[Point]:
        """The points that a folder does not have, with the slots of their rows; what changed since is told."""
        before = store.about.get("base")
        study = {"over": self._described(), "samples": self.space.samples, "design": self.space.design,
                 "seed": self.space.seed}  # fmt: skip
        lines = []
        if before is not None:
            old = {**store.about["bases"][before], "study": store.about["study"]}
            lines = changes(old, json.loads(json.dumps({**self._about, "study": study}, default=str)))
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

    @cached_property
    def units(self) -> dict[str, str]:  # type: ignore[override]
        """Of each path whose values are numbers. GraphError: the graph is no longer what it was.

        Without a unit is what changes no setting, and what changes only together with other paths.
        """
        first, found = accepted(self.launch, self.space), dict[str, str]()
        if first is None:
            return found
        base = self.launch.but(overrides=overrides(first)).load()
        for one in self.space.axes:
            for k, name in enumerate(one.paths):
                values = one.law.ppf([0.4, 0.6]).tolist() if one.law is not None else [row[k] for row in one.values]
                if not all(type(value) in (int, float) for value in values) or len(set(values)) == 1:
                    continue
                if unit := "Hz" if name == "rate" else self._unit(base, first, name, values):
                    found[name] = unit
        return found

    def _unit(self, base: Graph, first: Mapping[str, Any], name: str, values: Sequence[float]) -> str | None:
        """The unit of the first setting that follows a path; `base` is the graph at the values `first`."""
        others = [value for value in dict.fromkeys(values) if value != first[name]]
        tried = [{name: value} for value in others[:: min(-1, -len(others) // SEVERAL)]]
        fixed = {path: value for path, value in first.items() if path != name}
        for change in [*tried, {}]:  # at last the graph's value
            try:
                after = self.launch.but(overrides=overrides(fixed | change)).load()
            except GraphError:  # a point that fails, which its row tells; or a value that only goes with others
                continue
            if follower := next(iter(followers(base, after)), None):
                return unit_of(base, *follower)
        return None

    # -- results -------------------------------------------------------------------------------------------------

    def xarray(self) -> Any:
        """An xarray Dataset: a dimension for each crossed axis, named after its first path, `sample` for what is drawn
        of distributions, `time` [s] for curves."""
        from palpate.studies.sweeps.dataset import dataset

        return dataset(self)

    def plot(self, name: str, ax: Axes | None = None) -> Figure:
        """A quantity, such as "contact.force", or one thing that is kept, such as "peak contact.force": curves over
        time, a number over the first axis with numbers, or the sensitivity indices; into the axes `ax`, or a figure
        that is also the current one of pyplot. PictureError: what cannot be drawn."""
        from palpate.studies.sweeps.picture import draw

        return draw(self, name, ax)

    def _described(self) -> dict[str, str]:
        """The values of each path in words."""
        given = {path: [row[k] for row in one.labels] for one in self.space.crossed for k, path in enumerate(one.paths)}
        given |= {one.paths[0]: self.space.drawn[:, k].tolist() for k, one in enumerate(self.space.sampled)}
        words = {}
        for name, values in given.items():
            numbers = all(isinstance(value, int | float) for value in values)
            which = f"{min(values):g} to {max(values):g}" if numbers else ", ".join(map(str, values))
            words[name] = f"{len(set(values))} values, {which[:LONG]}"
        return words
