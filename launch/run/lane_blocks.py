"""Runs any number of lanes in blocks, so that their memory is bounded."""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from palpate.launch.run.lanes import LaneRun, Prepared
from palpate.physics.errors import PalpateError

LANES = 2048
"""Maximum number of lanes in a block: with 25 to 240 kB a lane, at most 0.5 GB."""
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


class LaneBlocks:
    """Lanes of one structure.

    prepared  prepares a lane by its number; PalpateError: it is refused
    lanes     number of lanes;  row  [bytes] of the kept fields of one lane
    keep, rows, every  as for `LaneRun`
    """

    def __init__(
        self,
        prepared: Callable[[int], Prepared],
        lanes: int,
        row: int,
        keep: list[tuple[str, str]],
        rows: int,
        every: int,
    ) -> None:
        self._prepared, self.lanes, self._keep, self._rows, self._every = prepared, lanes, keep, rows, every
        count = -(-lanes // max(1, min(LANES, RESULTS // max(row, 1))))
        self.size = -(-lanes // count)
        """Number of lanes in a block; the last one may be smaller."""

    def run(self, ticks: int, threads: int | None, done: Callable[[float], None], begin: int = 0) -> Iterator[Block]:
        """Run all lanes from lane `begin` on for this number of ticks; `done` takes the share of all lanes that is
        done. NodeError: a node of the first lane does not start."""
        total = self.lanes * ticks

        def report(first: int) -> Callable[[int], None]:
            return lambda ran: done((first * ticks + ran) / total)

        run: LaneRun | None = None
        try:
            for first in range(begin, self.lanes, self.size):
                count = min(self.size, self.lanes - first)
                prepared, refused = self._take(first, count)
                if run is None:
                    run = LaneRun(prepared, self._keep, self._rows, self._every)
                else:
                    run.restart(prepared)
                run.failures.update(refused)
                run.run(ticks, threads, report(first))
                yield self._block(run, first, count)
        finally:
            if run is not None:
                run.close()

    def _take(self, first: int, count: int) -> tuple[list[Prepared], dict[int, Exception]]:
        """The lanes of a block, and why lanes are refused. Refused lanes, and those that a last block lacks, have the
        settings of another one."""
        prepared: list[Prepared | None] = []
        refused: dict[int, Exception] = {}
        for lane in range(count):
            try:
                prepared.append(self._prepared(first + lane))
            except PalpateError as error:
                prepared.append(None)
                refused[lane] = error
        spare = next((one for one in prepared if one is not None), None) or self._prepared(0)
        missing = (self.size if first else count) - count
        refused |= {count + n: PalpateError("not a lane") for n in range(missing)}
        return [one or spare for one in (*prepared, *[None] * missing)], refused

    def _block(self, run: LaneRun, first: int, count: int) -> Block:
        failures = {first + lane: str(error) for lane, error in sorted(run.failures.items()) if lane < count}
        notes = [
            (first + lane, node, text)
            for lane in range(count)
            if lane not in run.failures
            for node, text in run.lanes.notes(lane)
        ]
        return Block(first, [column[:count] for column in run.lanes.columns], failures, notes, run.lanes.memory)
