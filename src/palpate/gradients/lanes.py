"""Lanes for differences: which lane has which value, and the derivatives from their results."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from palpate.gradients.differences import STEP, STEPS, Derivative, central, one_sided
from palpate.gradients.parameters import Parameter
from palpate.messages import Contact, Friction, Message
from palpate.physics.errors import ArgumentError

REDUCTIONS: Mapping[str, Callable[[np.ndarray], np.ndarray]] = {
    "max": lambda values: values.max(axis=0), "min": lambda values: values.min(axis=0),
    "mean": lambda values: values.mean(axis=0), "last": lambda values: values[-1],
    "rms": lambda values: np.sqrt(np.mean(values**2, axis=0)),
}  # fmt: skip
EVENTS: Mapping[tuple[type[Message], str], str] = {
    (Contact, "force"): "contact made or lost", (Friction, "stick"): "stick to slip",
}  # fmt: skip
"""Fields whose change from 0 is an event after which results may have a kink."""
UNLIKE = 0.618  # [1] By how much moves of numbers without effect differ, so that none cancels another
NEAR = 2  # rows between an event in one of the lanes and a point that does not settle


@dataclass(frozen=True)
class Row:
    """One lane: the parameter that it moves, None: none; number of the step; direction; whether it moves all parameters
    that the touch cannot reach."""

    parameter: int | None
    step: int = 0
    sign: int = 0
    check: bool = False


@dataclass
class Differences:
    """The lanes of one touch that the derivatives by some parameters need.

    values   (parameters) [their unit] where the derivatives are taken
    without  parameters that the touch cannot reach (`reach`), so that they have no lane but one that moves all of them
    rows     what each lane moves; the first moves nothing
    """

    parameters: Sequence[Parameter]
    values: Sequence[float]
    count: int = len(STEPS)
    without: frozenset[int] = frozenset()
    rows: list[Row] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.rows = [Row(None)] + [Row(None, check=True)] * bool(self.without)
        for place, (parameter, value) in enumerate(zip(self.parameters, self.values, strict=True)):
            if place in self.without:
                continue
            side = parameter.side(self.step(place), value)
            signs = (side,) if side else (1, -1)
            self.rows += [Row(place, step, sign) for sign in signs for step in range(self.count)]

    def step(self, place: int) -> float:
        """The largest step of a parameter [its unit]."""
        return STEP * self.parameters[place].scale

    def value(self, row: Row, place: int) -> float:
        """The value of a parameter in a lane."""
        if row.check and place in self.without:
            side = self.parameters[place].side(self.step(place), self.values[place]) or (-1) ** place
            return self.values[place] + side * self.step(place) * (1.0 + UNLIKE * place) / (
                1.0 + UNLIKE * len(self.values)
            )
        move = row.sign * STEPS[row.step] * self.step(place) if row.parameter == place else 0.0
        return self.values[place] + move

    def derivative(self, results: np.ndarray, place: int, tolerance: float) -> Derivative:
        """The derivative of results (lanes, n, ...) by a parameter."""
        if place in self.without:
            nothing = np.zeros(results.shape[1:])
            return Derivative(nothing, nothing, np.ones(nothing.shape, bool))
        mine = [number for number, row in enumerate(self.rows) if row.parameter == place]
        signs = [self.rows[number].sign for number in mine]
        step, scale, base = self.step(place), self.parameters[place].scale, results[0]
        if len(mine) == self.count:
            return one_sided(base, results[mine], signs[0] * step, scale, tolerance)
        return central(base, results[mine[: self.count]], results[mine[self.count :]], step, scale, tolerance)

    def why(self, settled: np.ndarray, place: int, events: Mapping[str, np.ndarray], time: np.ndarray) -> str:
        """Why the derivative by a parameter does not settle at some of the times; "": it settles at all.

        settled  (rows) at which times
        events   by what happens, (lanes, rows) whether it is so
        """
        left = np.flatnonzero(~settled)
        if not left.size:
            return ""
        mine = [0, *(number for number, row in enumerate(self.rows) if row.parameter == place)]
        found: dict[str, list[int]] = {}
        for at in left:
            causes = {}
            for what, states in events.items():
                some = states[mine, max(at - NEAR, 0) : at + NEAR + 1]
                unlike = np.flatnonzero((states[mine, : at + 1] != states[0, : at + 1]).any(axis=0))
                if (some != some[:1, :1]).any():
                    causes[what] = int(at)
                elif unlike.size:
                    causes[f"after {what}"] = int(unlike[-1])
            cause = max(causes, key=lambda what: causes[what]) if causes else "the steps disagree"
            found.setdefault(cause, []).append(int(at))
        parts = [f"{what} ({len(at)}, first at {time[at[0]]:.4g} s)" for what, at in found.items()]
        return f"{left.size} of {settled.size} times do not settle: {', '.join(parts)}"


def reduction_of(name: str, given: Any, fields: Sequence[str]) -> tuple[int, Callable[[np.ndarray], Any]]:
    """Place of the field and the function of a reduction. ArgumentError: it is not valid."""
    if not (isinstance(given, Sequence) and len(given) == 2 and given[0] in fields):
        cure = f"expected a kept field and a function, such as ({fields[0]!r}, 'max')"
        raise ArgumentError(f"reduce {name!r}: found {given!r}, {cure}; kept: {', '.join(fields)}")
    function = REDUCTIONS.get(given[1]) if isinstance(given[1], str) else given[1]
    if not callable(function):
        known = f"{', '.join(REDUCTIONS)}, or a function of an array (times, ...)"
        raise ArgumentError(f"reduce {name!r}: found {given[1]!r}, expected {known}")
    return list(fields).index(given[0]), function


def events_of(streams: Mapping[str, type[Message]]) -> dict[str, str]:
    """What happens when a field "stream.field" of these streams changes from 0 or to 0."""
    return {
        f"{stream}.{name}": what
        for stream, kind in streams.items()
        for (message, name), what in EVENTS.items()
        if issubclass(kind, message)
    }


def reduce(function: Callable[[np.ndarray], Any], results: np.ndarray, name: str) -> np.ndarray:
    """A reduction of results (lanes, rows, ...), as (lanes, 1, ...). ArgumentError: it gives no numbers."""
    found = np.stack([np.asarray(function(each), float) for each in results])
    if found.ndim > results.ndim - 1 or not math.prod(found.shape):
        raise ArgumentError(f"reduce {name!r}: found a result of shape {found.shape[1:]}, expected one number")
    return found[:, None]
