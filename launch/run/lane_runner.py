"""Runs lanes of one graph from start to end, in threads.

A lane takes memory only while it runs: each thread has room for a few lanes of each structure.
"""

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import islice
from typing import Any, NamedTuple

import numpy as np

from palpate.compiler.cores import usable_cores
from palpate.engine.slot import NodeError
from palpate.launch.run.lane_threads import FIRST, LaneThreads, adapt_block
from palpate.launch.run.lanes import LaneRun, Prepared
from palpate.physics.errors import PalpateError

BATCH = 16  # Maximum number of lanes that a thread places before it runs them
STRUCTURES = 8  # Maximum number of structures that stay started between calls


@dataclass(frozen=True)
class LaneKeep:
    """Selects the fields and ticks of lanes that are kept.

    fields  stream and name of each field
    ticks   number of ticks of a lane;  every  divisor of those that are kept, `rows` in number
    """

    fields: list[tuple[str, str]]
    ticks: int
    every: int = 1

    @property
    def rows(self) -> int:
        return -(-self.ticks // self.every)


class Memory(NamedTuple):
    """Sizes [bytes].

    lanes    memory of the lanes that exist together, at most `BATCH` for each thread, in pages that are not zero
    shared   arrays that lanes share, such as meshes and bases
    images   started nodes with the settings of recent lanes
    results  kept fields of a block of lanes, or of all lanes if they stay in memory
    """

    lanes: int = 0
    shared: int = 0
    images: int = 0
    results: int = 0


@dataclass
class Outcome:
    """The failures and notes of lanes, by their row.

    failures  cause; their values are NaN from the tick of the failure on
    notes     lines for the user, each with the name of its node, "": about the graph
    """

    failures: dict[int, Exception] = field(default_factory=dict)
    notes: dict[int, list[tuple[str, str]]] = field(default_factory=dict)


class LaneRunner:
    """Runs lanes; those of the same structure share their started nodes.

    keep     what is recorded
    threads  number of threads; None: one per core
    """

    def __init__(self, keep: LaneKeep, threads: int | None = None) -> None:
        self._keep, self._threads = keep, threads or len(usable_cores())
        self._runs: list[tuple[list[Any], LaneRun]] = []  # by structure; the most recently used is last
        self.memory = Memory()
        """Of the last call of `run`."""

    def start(self, one: Prepared, columns: Sequence[np.ndarray]) -> LaneRun:
        """The started nodes of the structure of this lane. NodeError: one does not start."""
        for place, (structure, run) in enumerate(self._runs):
            if structure == one.structure:
                self._runs.append(self._runs.pop(place))
                return run
        run = LaneRun(one, self._keep.fields, columns, self._keep.every, BATCH * self._threads)
        self._runs.append((one.structure, run))
        return run

    def run(
        self,
        prepare: Callable[[int], Prepared],
        columns: Sequence[np.ndarray],
        done: Callable[[int], None] = lambda ticks: None,
    ) -> Outcome:
        """Run a lane for each row of these columns, which get its values.

        prepare  the lane of a row; PalpateError: it fails. Called by one thread at a time. A lane that ends before the
                 others leaves the later values of its row as they are
        done     called ten times a second with the sum of the ticks of all lanes

        On KeyboardInterrupt the threads are stopped before it is raised.
        """
        while len(self._runs) > STRUCTURES:
            self._runs.pop(0)[1].close()
        for _, run in self._runs:
            run.lanes.record_in(columns)
        count = min(self._threads, len(columns[0]))
        rows = _Rows(self, self._keep, prepare, columns, count)
        pool = LaneThreads(count)
        try:
            pool.run([rows.work] * count, lambda: done(sum(rows.ran)))
        finally:
            pool.close()
        done(sum(rows.ran))
        sizes = [(*run.lanes.memory, run.size) for _, run in self._runs]
        lanes, shared, images = (sum(size[part] for size in sizes) for part in range(3))
        self.memory = Memory(lanes, shared, images, sum(column.nbytes for column in columns))
        return rows.found

    def close(self) -> None:
        """Stop the nodes."""
        while self._runs:
            self._runs.pop()[1].close()


class _Rows:
    """The rows of one call of `run`. Each thread places some lanes, then runs them in calls that take about `BLOCK`
    seconds at most: the compiled code of a lane finds that of the last one in the processor's cache.

    threads  number of threads that run `work`
    found    what has failed so far, and the notes
    ran      ticks of the lanes of each thread
    """

    def __init__(
        self,
        runner: LaneRunner,
        keep: LaneKeep,
        prepare: Callable[[int], Prepared],
        columns: Sequence[np.ndarray],
        threads: int,
    ) -> None:
        self._runner, self._keep, self._prepare, self._columns = runner, keep, prepare, columns
        self.found, self.ran = Outcome(), [0] * threads
        self._rows, self._numbers = iter(range(len(columns[0]))), iter(range(threads))
        self._batch = max(1, min(BATCH, len(columns[0]) // (2 * threads)))
        self._lock = threading.Lock()  # one thread at a time runs Python code

    def work(self, stopped: Callable[[], bool]) -> None:
        """Run lanes until there are no more rows."""
        with self._lock:
            number, block = next(self._numbers), FIRST
        while not stopped():
            with self._lock:
                given = list(enumerate(islice(self._rows, self._batch), number * BATCH))
                placed = [each for seat, row in given for each in self._begin(seat, row)]
            if not given:
                return
            for seat, _, run, one in placed:
                ticks = self._keep.ticks if one.ticks is None else min(one.ticks, self._keep.ticks)
                block = self._run_lane(number, block, seat, run, ticks, stopped)
            with self._lock:
                for each in placed:
                    self._end(*each)

    def _run_lane(
        self, number: int, block: int, seat: int, run: LaneRun, ticks: int, stopped: Callable[[], bool]
    ) -> int:
        """Run a lane to its last tick or its failure, in calls of `block` ticks. Returns the ticks of the next call."""
        now = 0
        while now < ticks and not stopped():
            count, begun = min(block, ticks - now), time.perf_counter()
            run.lanes.run(seat, 1, count)
            reached, took = int(run.lanes.ticks[seat]), time.perf_counter() - begun
            self.ran[number] += reached - now
            if reached < now + count:
                break
            if count == block:
                block = adapt_block(block, took)
            now = reached
        return block

    def _begin(self, seat: int, row: int) -> list[tuple[int, int, LaneRun, Prepared]]:
        """Place the lane of a row; empty: it has failed."""
        try:
            one = self._prepare(row)
            run = self._runner.start(one, self._columns)
            run.place(seat, one, row)
        except PalpateError as error:
            self._fail(row, 0, error)
            return []
        return [(seat, row, run, one)]

    def _end(self, seat: int, row: int, run: LaneRun, one: Prepared) -> None:
        if (error := run.lanes.failure(seat)) is not None:
            self._fail(row, -(-int(run.lanes.ticks[seat]) // self._keep.every), error)
            return
        try:
            notes = [("", text) for text in one.notes] + run.lanes.notes(seat)
        except NodeError as fault:
            self._fail(row, self._keep.rows, fault)
            return
        if notes:
            self.found.notes[row] = notes

    def _fail(self, row: int, reached: int, error: Exception) -> None:
        """Results of a failed lane are NaN from the failed tick on."""
        self.found.failures[row] = error
        for column in self._columns:
            column[row, reached:] = np.nan if column.dtype.kind == "f" else 0
