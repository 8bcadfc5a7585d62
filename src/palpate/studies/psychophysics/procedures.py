"""Procedures that choose the next level: constant stimuli, up-down staircases, QUEST+."""

import re

import numpy as np

from palpate.physics.errors import ArgumentError
from palpate.studies.psychophysics.file import ConstantBlock, QuestBlock, StaircaseBlock, TrialBlock
from palpate.studies.psychophysics.questplus import QuestPlus
from palpate.studies.psychophysics.stimuli import Stimuli

RULE = re.compile(r"([1-9])-down-([1-9])-up")


class Constant:
    """All levels, each repeated, in one random order."""

    def __init__(self, levels: list[float], repeats: int, random: np.random.Generator) -> None:
        self._left = random.permutation(np.repeat(levels, repeats)).tolist()
        self.most = len(self._left)

    @property
    def level(self) -> float | None:
        return self._left[0] if self._left else None

    def take(self, hit: bool) -> None:
        self._left.pop(0)


class Staircase:
    """A transformed up-down staircase: after `down` hits in a row the next level is harder, after `up` misses in a row
    easier (Levitt, J. Acoust. Soc. Am. 49, 467, 1971). N-down-1-up converges to ψ^N = 1/2.

    Steps change x, the distance of the level from the reference, or the level itself without a reference: x ∓ step, or
    x/step and x·step. The k-th step applies until the k-th reversal, the last one to the end. A step that would reach
    or cross x = 0 is skipped.

    start, least, greatest  first, smallest and largest level
    origin                  the reference, or 0
    sign                    -1 if a smaller x is easier
    reversals, trials       the staircase ends after this number of reversals or trials; 0: no limit
    """

    def __init__(
        self,
        start: float,
        *,
        steps: list[float],
        ratio: bool,
        rule: str,
        reversals: int,
        trials: int,
        origin: float = 0.0,
        sign: int = 1,
        least: float = -np.inf,
        greatest: float = np.inf,
    ) -> None:
        found = RULE.fullmatch(rule)
        if found is None:
            raise ArgumentError(f"rule: found {rule!r}, expected such as 2-down-1-up, with numbers from 1 to 9")
        self.down, self.up = int(found[1]), int(found[2])
        self._level, self._side = start, 1.0 if start >= origin else -1.0
        self._steps, self._ratio, self._origin, self._sign = steps, ratio, origin, sign
        self._limits, self._stop, self.most = (least, greatest), reversals, trials
        self.reversals: list[float] = []
        self._row = self._trials = self._last = 0

    @property
    def level(self) -> float | None:
        over = (self.most and self._trials >= self.most) or (self._stop and len(self.reversals) >= self._stop)
        return None if over else self._level

    def take(self, hit: bool) -> None:
        self._trials += 1
        self._row = max(self._row, 0) + 1 if hit else min(self._row, 0) - 1
        turn = -1 if self._row == self.down else 1 if self._row == -self.up else 0  # harder, easier, neither
        if not turn:
            return
        self._row = 0
        if self._last == -turn:
            self.reversals.append(self._level)
        self._last, way = turn, turn * self._sign  # to a larger x (1) or a smaller one (-1)
        step, x = self._steps[min(len(self.reversals), len(self._steps) - 1)], self._side * (self._level - self._origin)
        x = x * step**way if self._ratio else x + way * step
        level = float(f"{self._origin + self._side * x:.10g}")
        if x > 0.0 and self._limits[0] <= level <= self._limits[1]:
            self._level = level


class Quest:
    """QUEST+ in x, which is that of the staircase."""

    def __init__(self, block: QuestBlock, x: list[float], levels: list[float], grids: list[list[float]], guess: float):
        self._quest = QuestPlus(block.function, x, grids[0], grids[1], block.lapse, guess)
        self._levels, self._x, self.most, self._trials = levels, x, block.trials, 0

    @property
    def level(self) -> float | None:
        return self._levels[self._best()] if self._trials < self.most else None

    def take(self, hit: bool) -> None:
        self._trials += 1
        self._quest.update(self._x[self._best()], hit)

    def _best(self) -> int:
        return int(np.argmax(self._quest.information()))


Procedure = Constant | Staircase | Quest
"""`level`: next level, None at the end; `take` receives the answer; `most`: maximum number of trials, 0: unknown."""


def procedures(name: str, block: TrialBlock, stimuli: Stimuli, random: np.random.Generator) -> list[Procedure]:
    """The interleaved procedures of a block. ArgumentError, GraphError: invalid rule, steps or limits."""
    levels, at, origin = stimuli.levels[name], f"blocks.{name}.", stimuli.reference
    if isinstance(block, ConstantBlock):
        return [Constant(levels, block.repeats, random)]
    if isinstance(block, StaircaseBlock):
        given = block.steps if isinstance(block.steps, list) else [block.steps]
        ratio = block.scale == "ratio"
        steps = [float(step) for step in given] if ratio else [stimuli.number(f"{at}steps", step) for step in given]
        if not steps or not all(step > (1.0 if ratio else 0.0) for step in steps):
            least = "ratios above 1" if ratio else "numbers above 0"
            raise ArgumentError(f"block {name!r}, steps: found {block.steps!r}, expected {least}")
        limits = [
            end if value is None else stimuli.number(f"{at}{key}", value)
            for key, value, end in (("least", block.least, -np.inf), ("most", block.most, np.inf))
        ]
        stimuli.faults.done()
        return [
            Staircase(start, steps=steps, ratio=ratio, rule=block.rule, reversals=block.reversals, trials=block.trials,
                      origin=origin or 0.0, sign=stimuli.sign, least=limits[0], greatest=limits[1])
            for start in levels
        ]  # fmt: skip
    assert isinstance(block, QuestBlock)
    x = [stimuli.x(level) for level in levels]
    grids = [stimuli.grid(f"{at}{key}", getattr(block, key)) for key in ("threshold", "spread")]
    if stimuli.sign < 0:
        grids[0] = [-value for value in grids[0]]
    stimuli.faults.done()
    guess = 0.5 if stimuli.experiment.response == "2afc" else 0.0
    return [Quest(block, x, levels, grids, guess)]
