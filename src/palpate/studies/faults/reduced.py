"""The fewest faults that still break an invariant."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

F = TypeVar("F")
O = TypeVar("O")


def reduce_faults(faults: Sequence[F], outcome: O, breaks: Callable[[list[F]], O | None]) -> tuple[list[F], O]:
    """The fewest of the faults that still break an invariant, by leaving out one after the other, and the outcome.

    breaks  the outcome of a run with these faults; None: it does not break the invariant
    """
    left = list(faults)
    for fault in faults:
        fewer = [one for one in left if one is not fault]
        found = breaks(fewer)
        if found is not None:
            left, outcome = fewer, found
    return left, outcome
