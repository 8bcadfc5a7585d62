"""Runs any number of lanes in blocks, so that their memory is bounded."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from palpate.launch.load.dependencies import digest
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.run.lane_values import LanePreparation, identity
from palpate.launch.run.lanes import LaneRun, Prepared
from palpate.launch.run.tasks.task import Beat
from palpate.launch.run.work.compiling import compiling
from palpate.physics.errors import PalpateError, RunError

LANES = 2048
"""Maximum number of lanes in a block: with 25 to 240 kB a lane, at most 0.5 GB."""
STEPS = 1_000_000  # Maximum number of ticks of all lanes of a block, which a core computes in 2 to 10 s
RESULTS = 1 << 28  # [bytes] Maximum size of the results of a block


class Block(NamedTuple):
    """Results of some lanes, valid until the next block.

    first    number of the first lane
    columns  kept fields, each (lanes, rows, ...)
    errors   text of each lane that failed, by its number
    notes    (lane, node, text)
    memory   [bytes] of the state of the lanes, and of what they share
    """

    first: int
    columns: list[np.ndarray]
    errors: dict[int, str]
    notes: list[tuple[int, str, str]]
    memory: tuple[int, int]


@dataclass(frozen=True)
class LaneKeep:
    """What is kept of lanes.

    fields  stream and name of each field
    ticks   number of ticks of a lane;  every, rows  as for `LaneRun`
    """

    fields: list[tuple[str, str]]
    ticks: int
    every: int = 1

    @property
    def rows(self) -> int:
        return -(-self.ticks // self.every)


def block_size(lanes: int, row: int, ticks: int) -> int:
    """Number of lanes in a block; the last one may be smaller. `row`: size of the kept fields of a lane [bytes]."""
    most = max(1, min(LANES, RESULTS // max(row, 1), STEPS // ticks))
    return -(-lanes // -(-lanes // most))


class LaneBlocks:
    """Lanes of one structure.

    prepared  prepares a lane by its number; PalpateError: it is refused
    first     a lane with this structure
    lanes     number of lanes;  size  number of lanes in a block
    """

    def __init__(
        self, prepared: Callable[[int], Prepared], first: Prepared, lanes: int, size: int, keep: LaneKeep
    ) -> None:
        self._prepared, self._first, self.lanes, self.size, self._keep = prepared, first, lanes, size, keep
        self.checked = range(min(lanes, LANES))
        """Lanes that are prepared before anything runs."""
        self._run: LaneRun | None = None

    def run(self, firsts: Sequence[int], threads: int | None, done: Callable[[float], None]) -> Iterator[Block]:
        """Run the blocks that begin with these lanes; `done` takes the number of lanes that have run. NodeError: a node
        of the first lane does not start."""
        before = 0

        def report(ran: int) -> None:
            done(before + ran / self._keep.ticks)

        try:
            for first in firsts:
                yield self.block(first, threads, report)
                before += min(self.size, self.lanes - first)
        finally:
            self.close()

    def block(self, first: int, threads: int | None, done: Callable[[int], None]) -> Block:
        """Run the block that begins with this lane; `done` as for `LaneRun.run`."""
        given = [self._lane(lane) for lane in range(first, min(first + self.size, self.lanes))]
        if self._run is None:
            self._run = LaneRun([self._first], self._keep.fields, self._keep.rows, self._keep.every, self.size)
        run, count = self._run, len(given)
        run.restart(given)
        run.run(self._keep.ticks, threads, done)
        failures = {first + lane: str(error) for lane, error in sorted(run.failures.items()) if lane < count}
        notes = [
            (first + lane, node, text)
            for lane in range(count)
            if lane not in run.failures
            for node, text in run.lanes.notes(lane)
        ]
        return Block(first, [column[:count] for column in run.lanes.columns], failures, notes, run.lanes.memory)

    def _lane(self, lane: int) -> Prepared | PalpateError:
        try:
            return self._prepared(lane)
        except PalpateError as error:
            return error

    def close(self) -> None:
        """Stop the nodes."""
        if self._run is not None:
            self._run.close()
            self._run = None


@dataclass
class LaneTask:
    """Blocks of lanes for other processes. An item is the first lane of a block and, by path, a value for each of its
    lanes.

    first, extremes  see `LanePreparation`
    lanes, size      see `LaneBlocks`
    identity         hash of everything that determines the results of lane 0
    """

    launch: LaunchFile
    first: Mapping[str, Any]
    extremes: Mapping[str, tuple[float, ...]]
    lanes: int
    size: int
    keep: LaneKeep
    identity: str
    limit: float | None = None

    @cached_property
    def _prepare(self) -> LanePreparation:
        return LanePreparation(self.launch, self.keep.fields, self.first, self.extremes)

    @cached_property
    def _blocks(self) -> LaneBlocks:
        return LaneBlocks(self._prepare, self._prepare.first, self.lanes, self.size, self.keep)

    def check(self) -> None:
        """RunError: this machine has other files than the one that made the task."""
        try:
            same = digest(identity(self._prepare.first)) == self.identity
        except PalpateError as error:
            raise RunError(f"the graph does not load here: {error}") from None
        if not same:
            raise RunError("the graph or a file that it names has other contents here; expected a shared folder")

    def compute(
        self, items: Sequence[tuple[int, Mapping[str, Sequence[Any]]]], beat: Beat
    ) -> Iterator[tuple[int, Block]]:
        for place, (begin, over) in enumerate(items):
            self._prepare.give(begin, over)
            with compiling(lambda count: beat()):
                yield place, self._blocks.block(begin, 1, lambda ran: beat())
