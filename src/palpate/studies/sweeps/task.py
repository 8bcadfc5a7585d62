"""The task of a study: computes points in any process with the same sources and files."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from palpate.launch.load.dependencies import digest
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.load.placement import FUSED
from palpate.launch.run.lane_values import Preparation
from palpate.launch.run.tasks.task import Beat
from palpate.physics.errors import PalpateError, RunError
from palpate.studies.sweeps import lane
from palpate.studies.sweeps.identity import origin
from palpate.studies.sweeps.keep import Kept
from palpate.studies.sweeps.point import Computed, Point, overrides, text_of
from palpate.studies.sweeps.recorded import record_point


@dataclass
class PointTask:
    """The part that all points of a study share.

    launch    the run without the variations
    keep      kept results
    limit     timeout of a point [s]; None: no timeout
    extremes  of the values of each path, see `launch.run.lane_values.extremes`
    base      hash of everything that the points share; "": not checked
    """

    launch: LaunchFile
    keep: tuple[Kept, ...]
    limit: float | None = None
    extremes: Mapping[str, tuple[Any, ...]] = field(default_factory=dict)
    base: str = ""

    def run(self, values: Mapping[str, Any], record: Path | None = None) -> LaunchFile:
        """The run with these values by path, in one process."""
        return self.launch.but(overrides=overrides(values), place=FUSED, clock="simulated", record=record)

    @cached_property
    def preparation(self) -> Preparation:
        """Prepares its points for a lane."""
        return lane.preparation(self.run, self.keep, self.extremes)

    def check(self) -> None:
        """RunError: this machine has other files than the one that made the task."""
        try:
            same = not self.base or digest(origin(self.launch, self.launch.load())) == self.base
        except PalpateError as error:
            raise RunError(f"the graph does not load here: {error}") from None
        if not same:
            raise RunError("the graph or a file that it names has other contents here; expected a shared folder")

    def compute(self, points: Sequence[Point], beat: Beat = lambda: None) -> Iterator[tuple[int, Computed]]:
        """The results of points, by their place: together as lanes, or one after another as `palpate run` does."""
        left = dict(enumerate(points))
        for place, done in lane.compute(self.run, self.preparation, self.keep, points, beat):
            del left[place]
            yield place, done
        for place, point in left.items():
            since = time.monotonic()

            def begin() -> None:
                nonlocal since
                beat()
                since = time.monotonic()

            try:
                done = record_point(self.run, self.keep, point, begin)
            except OSError as error:
                done = Computed(lost=f"{error.filename or point.recording}: {error.strerror or error}")
            except Exception as error:
                done = Computed(error=text_of(error))
            yield place, replace(done, seconds=time.monotonic() - since)
