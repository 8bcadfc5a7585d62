"""The score of an invariant in one touch."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Score:
    """Value over bound of an invariant in a touch, and where it was largest.

    least  lower bound, if any
    """

    score: float
    time: float
    value: float
    bound: float
    least: float | None = None

    @property
    def broken(self) -> bool:
        return not self.score <= 1.0
