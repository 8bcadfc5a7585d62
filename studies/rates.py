"""The lowest rate of each effect that keeps what comes of it to a stated error, found on one touch.

An effect that is a node of its own may run at each n-th tick (`every: n`); others read its last message until then.
How often it has to run follows from its own time constant: the time in which its output, as fast as it changes in the
mean (rms) over the touch, goes through its own peak. Held for n ticks of dt, it is off by n dt/(sqrt(3) constant) of
its peak (rms). That says where to begin; what is chosen was measured, by the touch computed again at several rates.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from palpate.launch.loading.force_path import force_path
from palpate.launch.loading.plan import Plan
from palpate.launch.recording.changed import changed
from palpate.launch.recording.compare import Variant, apart, compare
from palpate.launch.recording.player import Player
from palpate.launch.recording.reader import Recording
from palpate.messages import Field, Message, fields
from palpate.nodes.base import inputs
from palpate.physics.errors import MISUSE, PalpateError

LADDER = (1, 2, 5, 10, 20, 50, 100, 200, 500)
"""Divisors of the graph's rate that are tried."""


class RateError(PalpateError, ValueError):
    """A graph whose effects all run as often as they must; an error that is none."""

    exit_code = MISUSE


@dataclass(frozen=True)
class Rate:
    """One effect: its node, the divisor of its rate as the graph has it and as it may be, its time constant [s], and
    what it is off by at the latter: its own output, and the force on the hand, rms over the peak. Of a node that the
    force waits for, the fields that the force is made of are told by the force.

    felt  whether the force waits for it
    """

    node: str
    effect: str
    before: int
    felt: bool
    constant: float = math.inf
    every: int = 1
    own: float = 0.0
    force: float = 0.0

    @property
    def idle(self) -> bool:
        """Whether nothing of it changed on the touch, so that its rate is left."""
        return math.isinf(self.constant)

    @property
    def error(self) -> float:
        """The larger of both."""
        return max(self.own, self.force)

    def override(self, every: int | None = None) -> str:
        """As `--set` takes it."""
        return f"{self.node}.every={self.every if every is None else every}"


def read_error(text: str) -> float:
    """[1] of '1 %'. RateError: it is none."""
    number, sign, rest = text.partition("%")
    try:
        share = float(number) / 100.0
    except ValueError:
        share = math.nan
    if not 0.0 < share < 1.0 or not sign or rest.strip():
        raise RateError(f"error: found {text!r}, expected a share of a peak, above 0 and below 100, such as '1 %'")
    return share


def effects_of(plan: Plan) -> list[Rate]:
    """Each running node that is an effect as a whole. RateError: there is none."""
    path = force_path(plan)
    nodes = [plan.graph.nodes[name] for name in plan.order]
    found = [
        Rate(spec.name, spec.cls.effect, spec.every, spec.name in path)
        for spec in nodes
        if spec.cls.effect and not (spec.cls.paced or spec.cls.hardware)
    ]
    if not found:
        raise RateError(
            f"{plan.graph.path}: no effect is a node of its own here, so there is no rate to choose; `palpate plan` "
            "shows the effects of a graph"
        )
    return found


def chosen(recording: Recording, error: float, show: Callable[[str], None] = lambda node: None) -> Iterator[Rate]:
    """Each effect of the recorded graph at the lowest rate that keeps `error` [1]; the others run at each tick."""
    plan = changed(recording)
    found = effects_of(plan)
    full = [rate.override(1) for rate in found]
    constants = _constants(recording, plan, found, full)
    for rate in found:
        show(rate.node)
        yield _lowest(recording, plan, replace(rate, constant=constants[rate.node]), full, error)


def together(recording: Recording, rates: Sequence[Rate], error: float) -> tuple[list[Rate], Variant, Variant]:
    """All of them at once: where the force is then off by more than `error` [1], the one that has most part in it runs
    more often, until it is not. The touch at full rates and with these."""
    picked = list(rates)
    full = [rate.override(1) for rate in picked]
    while True:
        base, variant = compare(recording, [[rate.override() for rate in picked]], reference=full)
        finer = None if force_error(variant) <= error else oftener(picked)
        if finer is None:
            return picked, base, variant
        picked = finer


def oftener(rates: Sequence[Rate]) -> list[Rate] | None:
    """The same, but that the one with the most part in the force's error runs more often; None where all of them do so
    at each tick."""
    slow = [k for k, rate in enumerate(rates) if rate.every > 1 and rate.force > 0.0]
    if not slow:
        return None
    worst = max(slow, key=lambda k: rates[k].force)
    every = LADDER[LADDER.index(rates[worst].every) - 1]
    return [replace(rate, every=every) if k == worst else rate for k, rate in enumerate(rates)]


def came(recording: Recording, rates: Sequence[Rate]) -> tuple[Variant, Variant]:
    """Of a run at these rates, its motion with each effect at each tick, and as it was."""
    base, variant = compare(recording, [[]], reference=[rate.override(1) for rate in rates])
    return base, variant


def force_error(variant: Variant) -> float:
    """[1] by what the force is off, rms over the peak; 0 where there is none."""
    report = variant.force.report()
    return report["rms"] / report["reference_peak"] if report["reference_peak"] > 0.0 else 0.0


def mean(variant: Variant) -> float:
    """Duration [s] of a tick in the mean; a rate that is lower does not show in the median."""
    return variant.whole.total * 1e-9 / max(variant.whole.count, 1)


def _constants(recording: Recording, plan: Plan, found: list[Rate], full: list[str]) -> dict[str, float]:
    """Time constant [s] of each, from a touch in which it runs at each tick."""
    watched = [_Outputs(plan, rate, without=set()) for rate in found]
    before: list[list[Any]] = [own.seen(None) for own in watched]

    def look(players: Sequence[Player]) -> None:
        for k, own in enumerate(watched):
            now = own.seen(players[0])
            own.add(now, before[k])
            before[k] = now

    compare(recording, [], reference=full, look=look)
    dt = 1.0 / plan.graph.rate
    return {
        rate.node: (dt / own.error if own.error > 0.0 else math.inf) for rate, own in zip(found, watched, strict=True)
    }


def _lowest(recording: Recording, plan: Plan, rate: Rate, full: list[str], error: float) -> Rate:
    """At the lowest rate of the ladder that keeps the error: three at a time, around what its time constant says."""
    if rate.idle:
        return replace(rate, every=rate.before)
    asked = error * math.sqrt(3.0) * rate.constant * plan.graph.rate
    at = max(k for k, every in enumerate(LADDER) if every <= max(asked, 1.0))
    best = replace(rate, every=1)
    tried: set[int] = {0}
    while todo := [k for k in (at, at + 1, at + 2) if k < len(LADDER) and k not in tried]:
        tried.update(todo)
        kept = [one for one in _at_rates(recording, plan, rate, full, [LADDER[k] for k in todo]) if one.error <= error]
        best = max([best, *kept], key=lambda one: one.every)
        if len(kept) == len(todo):
            at = max(todo) + 1
        elif kept:
            break
        else:
            at = max(min(todo) - 3, 0)
    return best


def _at_rates(recording: Recording, plan: Plan, rate: Rate, full: list[str], divisors: list[int]) -> list[Rate]:
    """What comes of the touch with the node at these divisors, and all others at each tick."""
    path = force_path(plan)
    watched = [_Outputs(plan, rate, without=path if rate.felt else set()) for _ in divisors]

    def look(players: Sequence[Player]) -> None:
        base = watched[0].seen(players[0])
        for own, player in zip(watched, players[1:], strict=True):
            own.add(own.seen(player), base)

    sets = [[*(o for o in full if o != rate.override(1)), rate.override(every)] for every in divisors]
    _, *variants = compare(recording, sets, reference=full, look=look)
    return [
        replace(rate, every=every, own=own.error, force=force_error(variant))
        for every, own, variant in zip(divisors, watched, variants, strict=True)
    ]


class _Outputs:
    """The numbers in a node's messages that somebody reads, `without` those that these nodes read, and how far two runs
    are apart in them."""

    def __init__(self, plan: Plan, rate: Rate, without: set[str]) -> None:
        self.node = rate.node
        self.shown: list[tuple[int, Field]] = []
        for index, (stream, kind) in enumerate(plan.graph.nodes[rate.node].streams.items()):
            left: set[str] = set()
            for reader in without:
                ports = {port.name: port for port in inputs(plan.graph.nodes[reader].cls)}
                left.update(*(ports[e.port].wants for e in plan.edges[reader] if e.stream == stream))
            shown = plan.wanted[stream] - left
            self.shown += [(index, f) for f in fields(kind) if f.name in shown and _measured(f)]
        self.squares, self.peaks, self.count = [0.0] * len(self.shown), [0.0] * len(self.shown), 0

    def seen(self, player: Player | None) -> list[Any]:
        """What others read of it now; None for each where there is nothing yet."""
        part = next((p for p in player.parts if p.name == self.node), None) if player else None
        last = [output.last for output in part.slot.outputs] if part else []
        return [_values(last[index], f) if last else None for index, f in self.shown]

    def add(self, now: list[Any], base: list[Any]) -> None:
        """One tick of both."""
        self.count += 1
        for k, (own, other) in enumerate(zip(now, base, strict=True)):
            off, size = _apart(own, other)
            self.squares[k] += off * off
            self.peaks[k] = max(self.peaks[k], size)

    @property
    def error(self) -> float:
        """[1] rms over the touch of what is furthest off, over its own peak."""
        shares = [math.sqrt(s / self.count) / p for s, p in zip(self.squares, self.peaks, strict=True) if p > 0.0]
        return max(shares, default=0.0)


def _measured(field: Field) -> bool:
    """Whether it is a quantity that changes bit by bit: no count, index or word."""
    if field.dtype is not None:
        return field.dtype.kind == "f"
    return field.type is float or float in getattr(field.type, "__args__", ())


def _values(message: Message | None, field: Field) -> tuple[np.ndarray, np.ndarray | None] | None:
    """Rows of numbers, and the vertices that they are of, where the message names them."""
    if message is None:
        return None
    values = np.array(getattr(message, field.name), dtype=float)
    nodes = getattr(message, "nodes", None)
    of_nodes = nodes is not None and values.ndim > 0 and len(values) == len(nodes)
    rows = (values[:, None] if values.ndim == 1 else values) if of_nodes else values.reshape(1, -1)
    return rows, np.array(nodes) if of_nodes else None


def _apart(own: Any, other: Any) -> tuple[float, float]:
    """How far one is from another: of a number or a vector its length, of many vertices the rms of those in one of
    both; and the size of the other, of vertices the largest."""
    if other is None:
        return 0.0, 0.0
    rows, nodes = other
    size = float(np.sqrt((rows**2).sum(axis=1)).max()) if rows.size else 0.0
    if own is None:
        return size, size
    if nodes is None or own[1] is None:
        fits = own[0].shape == rows.shape
        return (float(np.linalg.norm(own[0] - rows)) if fits else size), size
    return apart(own[1], own[0], nodes, rows), size
