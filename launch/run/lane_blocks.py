"""Runs any number of lanes in blocks, so that their memory is bounded."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from palpate.launch.load.dependencies import digest
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.run.lane_runner import LaneKeep, LaneRunner, Memory
from palpate.launch.run.lane_values import LanePreparation, Values, identity
from palpate.launch.run.lanes import Prepared, columns_of
from palpate.launch.run.tasks.task import Beat
from palpate.launch.run.work.compiling import compiling
from palpate.physics.errors import PalpateError, RunError

LANES = 2048  # Maximum number of lanes in a block
STEPS = 1_000_000  # Maximum number of ticks of all lanes of a block, which a core computes in 2 to 10 s
RESULTS = 1 << 26  # [bytes] Maximum size of the results of a block


class Block(NamedTuple):
    """Results of some lanes, valid until the next block.

    first    number of the first lane
    columns  kept fields, each (lanes, rows, ...)
    errors   text of each lane that failed, by its number
    notes    (lane, node, text)
    """

    first: int
    columns: list[np.ndarray]
    errors: dict[int, str]
    notes: list[tuple[int, str, str]]
    memory: Memory


def block_size(lanes: int, row: int, ticks: int) -> int:
    """Number of lanes in a block; the last one may be smaller. `row`: size of the kept fields of a lane [bytes]."""
    most = max(1, min(LANES, RESULTS // max(row, 1), STEPS // ticks))
    return -(-lanes // -(-lanes // most))


class LaneBlocks:
    """Blocks of lanes.

    prepared  prepares a lane by its number; PalpateError: it is refused
    first     a lane; its streams have the fields of all
    lanes     number of lanes;  size  number of lanes in a block
    """

    def __init__(
        self, prepared: Callable[[int], Prepared], first: Prepared, lanes: int, size: int, keep: LaneKeep
    ) -> None:
        self._prepared, self._first, self.lanes, self.size, self._keep = prepared, first, lanes, size, keep
        self._runner: LaneRunner | None = None

    def run(self, firsts: Sequence[int], threads: int | None, done: Callable[[float], None]) -> Iterator[Block]:
        """Run the blocks that begin with these lanes; `done` takes the number of lanes that have run."""
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
        """Run the block that begins with this lane; `done` as for `LaneRunner.run`."""
        if self._runner is None:
            self._runner = LaneRunner(self._keep, threads)
            self._columns = columns_of(self._first, self._keep.fields, self.size, self._keep.rows)
        columns = [column[: self.lanes - first] for column in self._columns]
        found = self._runner.run(lambda row: self._prepared(first + row), columns, done)
        failures = {first + row: str(error) for row, error in sorted(found.failures.items())}
        notes = [(first + row, node, text) for row in sorted(found.notes) for node, text in found.notes[row]]
        return Block(first, columns, failures, notes, self._runner.memory)

    def close(self) -> None:
        """Stop the nodes."""
        if self._runner is not None:
            self._runner.close()
            self._runner = None
            del self._columns


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
    extremes: Mapping[str, tuple[Any, ...]]
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

    def compute(self, items: Sequence[tuple[int, Mapping[str, Values]]], beat: Beat) -> Iterator[tuple[int, Block]]:
        for place, (begin, over) in enumerate(items):
            self._prepare.give(begin, over)
            with compiling(lambda count: beat()):
                yield place, self._blocks.block(begin, 1, lambda ran: beat())
