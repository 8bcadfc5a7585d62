"""Runs that a relation compares, computed as lanes of this process."""

from __future__ import annotations

import json
import shlex
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from palpate.launch.load.launchfile import LaunchFile, find
from palpate.launch.run.lane_runner import LaneKeep, LaneRunner
from palpate.launch.run.lanes import Prepared, columns_of, prepare
from palpate.physics.errors import PalpateError

LENGTH = 1.2  # [s] of each run; a touch that takes longer ends before its hand lifts
FIELDS = (
    ("finger", "position"), ("contact", "force"), ("contact", "foot"), ("contact", "normal"),
    ("contact", "indentation"), ("collision", "approach"), ("controller", "force"),
)  # fmt: skip
"""Stream and field of what is compared, of one finger."""


@dataclass(frozen=True)
class Run:
    """One run.

    graph  a shipped graph
    sets   values of `--set` by path
    tag    end of the names of the nodes of the finger that is compared
    """

    graph: str
    sets: Mapping[str, Any]
    rate: float
    tag: str = ""

    def but(self, changes: Mapping[str, Any], **others: Any) -> Run:
        """The run with these values of `--set`; `others` replace graph, rate or tag."""
        return replace(self, sets={**self.sets, **changes}, **others)

    def without(self, *paths: str) -> Run:
        """The run without values of these paths, which another graph does not take."""
        return replace(self, sets={path: value for path, value in self.sets.items() if path not in paths})

    @property
    def texts(self) -> list[str]:
        return [f"{path}={_text(value)}" for path, value in {**self.sets, "rate": self.rate}.items()]

    def launch(self) -> LaunchFile:
        return find(self.graph).but(overrides=self.texts, duration=LENGTH)

    def command(self) -> str:
        """The command of this run."""
        sets = " ".join(f"--set {shlex.quote(text)}" for text in self.texts)
        return f"palpate run {self.graph} --fused --duration {LENGTH:g} {sets}"


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)


@dataclass(frozen=True)
class Trace:
    """What a run did: its fields by "stream.field" without tag, (T) or (T,3), in SI units.

    error  why it was refused or failed; "": it was not
    """

    values: Mapping[str, np.ndarray] = field(default_factory=dict)
    step: float = 1e-3
    error: str = ""

    def __getitem__(self, name: str) -> np.ndarray:
        return self.values[name]

    def between(self, first: int, last: int | None) -> Trace:
        """The trace of the ticks `first` to `last`, as a slice has them."""
        return replace(self, values={name: column[first:last] for name, column in self.values.items()})

    @property
    def force(self) -> np.ndarray:
        """Contact force [N] (T)."""
        return self.values["contact.force"]

    @property
    def peak(self) -> float:
        """[N] of the contact force."""
        return float(self.force.max())


class Runner:
    """Runs lanes; those of one rate share started nodes between calls.

    threads  None: one per core
    """

    def __init__(self, threads: int | None = None) -> None:
        self._threads = threads
        self._runners: dict[tuple[str, float], LaneRunner] = {}

    def __enter__(self) -> Runner:
        return self

    def __exit__(self, *_: object) -> None:
        for runner in self._runners.values():
            runner.close()

    def run(self, runs: Sequence[Run]) -> list[Trace]:
        """The traces of these runs, in their order. A run that is refused or fails has its error."""
        found: dict[int, Trace] = {}
        groups: dict[tuple[str, float], list[int]] = defaultdict(list)
        for place, one in enumerate(runs):
            groups[one.tag, one.rate].append(place)
        for (tag, rate), places in groups.items():
            traces = self._run_group(tag, rate, [runs[place] for place in places])
            found |= dict(zip(places, traces, strict=True))
        return [found[place] for place in range(len(runs))]

    def _run_group(self, tag: str, rate: float, runs: Sequence[Run]) -> list[Trace]:
        keep, ticks = [(stream + tag, name) for stream, name in FIELDS], round(LENGTH * rate)
        prepared, traces = dict[int, Prepared](), dict[int, Trace]()
        for place, one in enumerate(runs):
            try:
                prepared[place] = prepare(one.launch(), keep)
            except PalpateError as error:
                traces[place] = Trace(error=str(error))
        if prepared:
            rows, lanes = list(prepared), list(prepared.values())
            columns = columns_of(lanes[0], keep, len(lanes), ticks)
            if (tag, rate) not in self._runners:
                self._runners[tag, rate] = LaneRunner(LaneKeep(keep, ticks), self._threads)
            outcome = self._runners[tag, rate].run(lanes.__getitem__, columns)
            names = [f"{stream}.{name}" for stream, name in FIELDS]
            for row, place in enumerate(rows):
                failure = outcome.failures.get(row)
                values = dict(zip(names, (column[row] for column in columns), strict=True))
                traces[place] = Trace(values, 1.0 / rate, str(failure) if failure else "")
        return [traces[place] for place in range(len(runs))]
