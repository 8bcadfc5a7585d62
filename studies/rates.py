"""The lowest rate of each effect that keeps what comes of it to a stated error, on a touch at several speeds.

An effect that is a node of its own may run at each n-th tick (`every: n`); others read its last message until then.
How often it has to run follows from its own time constant: the time in which its output, as fast as it changes in the
mean (rms) over the touch, goes through its own peak. Held for n ticks of dt, it is off by n dt/(sqrt(3) constant) of
its peak (rms). What is chosen was measured: the touch is computed again with the effect at each of several rates.
A faster hand goes through the peak sooner, so that this is done at a spread of speeds and on other motions through the
same region, up to the fastest of these speeds; the worst counts. What is predicted comes from motions that the search
has not seen.
"""

import itertools
import json
import math
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from palpate.engine.plan import Plan, force_path
from palpate.launch.load.files import Override
from palpate.launch.load.launchfile import LaunchFile
from palpate.messages import Field, Message, Surface, fields
from palpate.nodes.base import inputs
from palpate.nodes.device.hand import SimulatedOperator
from palpate.physics.errors import ArgumentError
from palpate.records.changed import changed
from palpate.records.compare import apart, compare
from palpate.records.player import Player
from palpate.records.reader import Recording
from palpate.studies.search import Found, Show, Trial, off_by, touched, write

SPEEDS = (0.5, 1.0, 2.0)
"""Of the hand, over that of the graph's own path."""
DIVISORS = (1, 2, 5, 10, 20, 50, 100, 200, 500)
"""Divisors of the graph's rate that are tried."""
SEARCHED, HELD_OUT = 2, 12
"""Other motions that the search uses, and others that only the predictions come from."""
STROKES = 8  # of another motion
SLOWEST = 0.2
"""[1] Speed of the slowest of these, over that of the fastest."""
PEAK = 1.875
"""[1] Greatest over mean speed of a minimum-jerk move."""
AFTER = 0.1  # [s] of another motion, after its last stroke


@dataclass(frozen=True)
class Rate:
    """One effect: its node, the divisor of its rate as the graph has it and as it may be, its time constant [s], and
    what it is off by at the latter: its own output, and the force on the hand, rms over the peak. The law of a body
    that the force waits for is told by the force.

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

    def override(self, every: int | None = None) -> str:
        """As `--set` takes it."""
        return f"{self.node}.every={self.every if every is None else every}"


@dataclass(frozen=True)
class Slowed(Found):
    """With what came of the run at each speed, and of the motions that the search has not seen.

    reach  [m/s] slowest and fastest move of the hand in all of them; 0: no hand follows a path
    """

    at: dict[float, Trial] = field(default_factory=dict)
    unseen: tuple[Trial, ...] = ()
    reach: tuple[float, float] = (0.0, 0.0)


def rates(
    launch: LaunchFile, error: float, file: Path, show: Show = lambda what: None, speeds: Sequence[float] = SPEEDS
) -> Slowed:
    """Each effect as seldom as an error [1] allows at each speed, more often until a run at each keeps it; then written
    as a launch file."""
    effects_of(launch.plan())  # tells what has none before anything runs
    motions, drawn, reach = at_speeds(launch, speeds), itertools.count(), reached(launch, speeds)
    seen = [*motions.values(), *others(launch, reach, itertools.islice(drawn, SEARCHED))]
    with tempfile.TemporaryDirectory() as folder:
        recordings = [touched(motion, Path(folder) / f"{number}.mcap") for number, motion in enumerate(seen)]
        show("the touch")
        found = [list(chosen(recording, error, show)) for recording in recordings]
        picked, promised = together(recordings, strictest(found), error)
        while True:
            at = {speed: ran(motion, picked, Path(folder)) for speed, motion in motions.items()}
            came = worst_of(list(at.values()))
            unseen: list[Trial] = []
            if came.error <= error:  # each time on motions that nothing was chosen by
                fresh = others(launch, reach, itertools.islice(drawn, HELD_OUT))
                unseen = [ran(motion, picked, Path(folder)) for motion in fresh]
            show("a run at these rates")
            most = max(one.error for one in (came, *unseen))
            finer = None if most <= error else oftener(picked)
            if finer is None:
                break
            picked, promised = together(recordings, finer, error)
    if unseen:
        promised = worst_of(unseen)
    if most <= error:
        told = [
            f"Chosen by palpate rates: the lowest update rates for an error of {100 * error:.2g} %.",
            f"Measured on the path of this graph at {spread(at)}:",
            *(f"  {speed:g} times its speed: force error {percents(one)}" for speed, one in at.items()),
        ]
        if unseen:
            told.append(f"Predicted from {len(unseen)} other motions: force error {percents(promised)}")
        write(launch, promised.overrides, [*told, valid(reach)], file)
    return Slowed(picked, promised, came, most <= error, at, tuple(unseen), reach)


def ran(motion: LaunchFile, rates: Sequence[Rate], folder: Path) -> Trial:
    """What a run at these rates is off by, from the same motion with each effect at each tick."""
    return tried(touched(motion.but(overrides=[rate.override() for rate in rates]), folder / "slow.mcap"), rates)


def worst_of(trials: Sequence[Trial]) -> Trial:
    """The one with the greatest error, and the greatest peak error of all."""
    return replace(max(trials, key=lambda one: one.error), worst=max(one.worst for one in trials))


def valid(reach: tuple[float, float]) -> str:
    """The range of speeds of the hand for which the rates hold."""
    if not reach[1]:
        return "Holds for this motion alone: a faster one may be off by more."
    low, high = (1e3 * speed for speed in reach)
    return (
        f"Holds for moves of the hand at {low:.3g} to {high:.3g} mm/s through the region of this graph's path: a "
        "faster hand may be off by more."
    )


def percents(one: Trial) -> str:
    """Its error in words."""
    return f"{100 * one.error:.2g} % of peak (RMS), {100 * one.worst:.2g} % at worst"


def spread(speeds: Iterable[float]) -> str:
    """Speeds in words."""
    return f"{', '.join(f'{speed:g}' for speed in sorted(speeds))} times its speed"


def at_speeds(launch: LaunchFile, speeds: Sequence[float]) -> dict[float, LaunchFile]:
    """The run with its hand at each of these speeds, as long as its path then takes; as it is where no hand follows a
    path."""
    hands = hands_of(launch)
    if not hands:
        return {1.0: launch}
    return {
        speed: launch.but(
            overrides=[f"{name}.speed_factor={hand.speed_factor * speed}" for name, hand in hands.items()],
            duration=launch.duration and launch.duration / speed,
        )
        for speed in speeds
    }


def hands_of(launch: LaunchFile) -> dict[str, SimulatedOperator]:
    """The simulated hands that follow a path."""
    return {
        name: spec.cls(**spec.settings)
        for name, spec in launch.load().nodes.items()
        if issubclass(spec.cls, SimulatedOperator) and not spec.cls.hardware and spec.settings.get("path")
    }


def reached(launch: LaunchFile, speeds: Sequence[float]) -> tuple[float, float]:
    """[m/s] Speed of the slowest and of the fastest move of the hands at these speeds, each at its fastest moment."""
    found = list[float]()
    for hand in hands_of(launch).values():
        lengths = np.linalg.norm(np.diff(hand.points(), axis=0), axis=1)
        peaks = [1.0 if segment.shape == "linear" else PEAK for segment in hand.path]
        own = lengths / np.diff(hand.ends(), prepend=0.0) * peaks
        found += own[_moves(hand, launch.duration)].tolist()
    return min(found, default=0.0) * min(speeds), max(found, default=0.0) * max(speeds)


def others(launch: LaunchFile, reach: tuple[float, float], seeds: Iterable[int]) -> Iterator[LaunchFile]:
    """The run with other motions of its hands: straight strokes between random places on its path. The first and the
    last have the fastest speed of `reach` [m/s]. None where no hand moves."""
    hands = hands_of(launch) if reach[1] else {}
    free = replace(launch, overrides=tuple(each for each in launch.overrides if not _sets_path(each)))
    for seed in seeds if hands else ():
        draw, texts, longest = np.random.default_rng(seed), list[str](), 0.0
        for name, hand in hands.items():
            path = _strokes(hand, _moves(hand, launch.duration), reach[1], draw)
            texts += [f"{name}.path={json.dumps(path)}", f"{name}.speed_factor=1"]
            longest = max(longest, sum(step.get("time", 0.0) + step.get("hold", 0.0) for step in path))
        yield free.but(overrides=texts, duration=longest + AFTER)


def _sets_path(override: str | Override) -> bool:
    """Whether it sets a path of the scene, which reaches no node once the node's path is set."""
    keys = override.keys if isinstance(override, Override) else override.partition("=")[0].split(".")
    return keys[0] == "scene" and keys[-1] == "path"


def _moves(hand: SimulatedOperator, duration: float | None) -> np.ndarray:
    """Segments of a path that move the hand and begin within a time [s]."""
    begins = hand.ends() - np.diff(hand.ends(), prepend=0.0)
    return np.flatnonzero(np.diff(hand.points(), axis=0).any(axis=1) & (begins < (duration or math.inf)))


def _strokes(
    hand: SimulatedOperator, moves: np.ndarray, fastest: float, draw: np.random.Generator
) -> list[dict[str, Any]]:
    """A path of one hand, between places on these segments of its own path; at rest where it has none."""
    points = hand.points() + np.array(hand.origin)
    here, path = points[0], list[dict[str, Any]]()
    for number in range(STROKES if len(moves) else 0):
        k, share = draw.choice(moves), draw.uniform()
        there = points[k] + share * (points[k + 1] - points[k])
        speed = fastest * (1.0 if number in (0, STROKES - 1) else SLOWEST ** draw.uniform())
        straight = bool(draw.integers(2))
        time = float(np.linalg.norm(there - here)) / speed * (1.0 if straight else PEAK)
        if time > 1e-3:
            shape = "linear" if straight else "minimum-jerk"
            path += [{"to": there.tolist(), "time": time, "shape": shape}, {"hold": float(draw.uniform(0.01, 0.1))}]
            here = there
    return path or [{"hold": AFTER}]


def strictest(found: Sequence[Sequence[Rate]]) -> list[Rate]:
    """Of each effect the rate that it needs at all speeds: the shortest time constant, the most frequent, the largest
    errors at the rates of each. What nowhere changes keeps its rate."""
    picked = []
    for same in zip(*found, strict=True):
        busy = [rate for rate in same if not rate.idle]
        if not busy:
            picked.append(same[0])
            continue
        worst = {name: max(getattr(rate, name) for rate in busy) for name in ("own", "force")}
        least = {name: min(getattr(rate, name) for rate in busy) for name in ("constant", "every")}
        picked.append(replace(busy[0], **worst, **least))
    return picked


def effects_of(plan: Plan) -> list[Rate]:
    """Each running node that is an effect as a whole. ArgumentError: there is none."""
    path = force_path(plan)
    nodes = [plan.graph.nodes[name] for name in plan.order]
    told = [
        Rate(spec.name, spec.cls.effect, spec.every, spec.name in path)
        for spec in nodes
        if spec.cls.effect and not (spec.cls.paced or spec.cls.hardware)
    ]
    if not told:
        raise ArgumentError(
            f"{plan.graph.path}: no effect of this graph is a node of its own, so there is no rate to choose; "
            "`palpate plan` shows the effects of a graph"
        )
    return told


def chosen(recording: Recording, error: float, show: Show = lambda what: None) -> Iterator[Rate]:
    """Each effect of the recorded graph at the lowest rate that keeps `error` [1]; the others run at each tick."""
    plan = changed(recording)
    effects = effects_of(plan)
    for rate in effects:
        yield _lowest(recording, plan, rate, [other.override(1) for other in effects], error)
        show(rate.node)


def together(recordings: Sequence[Recording], rates: Sequence[Rate], error: float) -> tuple[list[Rate], Trial]:
    """All of them at once: where the force is then off by more than `error` [1] on one of the touches, the one that has
    most part in it runs more often, until it is not; and what the worst touch is with these, against that at full
    rates."""
    picked = list(rates)
    while True:
        overrides = [rate.override() for rate in picked]
        one = max((tried(recording, picked, overrides) for recording in recordings), key=lambda one: one.error)
        finer = None if one.error <= error else oftener(picked)
        if finer is None:
            return picked, one
        picked = finer


def oftener(rates: Sequence[Rate]) -> list[Rate] | None:
    """The same, but that the one with the most part in the force's error runs more often; None where all of them do so
    at each tick."""
    slow = [k for k, rate in enumerate(rates) if rate.every > 1 and rate.force > 0.0]
    if not slow:
        return None
    worst = max(slow, key=lambda k: rates[k].force)
    every = DIVISORS[DIVISORS.index(rates[worst].every) - 1]
    return [replace(rate, every=every) if k == worst else rate for k, rate in enumerate(rates)]


def tried(recording: Recording, rates: Sequence[Rate], texts: Sequence[str] = ()) -> Trial:
    """What a touch is off by, from itself with each effect at each tick, with these overrides of the run; without any,
    as it was run at these rates."""
    base, variant = compare(recording, [texts], reference=[rate.override(1) for rate in rates])
    return Trial({f"{rate.node}.every": rate.every for rate in rates}).measured(base, variant)


def _lowest(recording: Recording, plan: Plan, rate: Rate, full: list[str], error: float) -> Rate:
    """At the lowest rate that keeps the error, all others at each tick; with its time constant."""
    path = force_path(plan)
    slower = DIVISORS[1:]
    watched = [_Outputs(plan, rate, without=path if rate.felt else set()) for _ in slower]
    change = _Outputs(plan, rate, without=set())
    before = change.seen(None)

    def on_tick(players: Sequence[Player]) -> None:
        nonlocal before
        now = change.seen(players[0])
        change.add(now, before)
        before = now
        base = watched[0].seen(players[0])
        for own, player in zip(watched, players[1:], strict=True):
            own.add(own.seen(player), base)

    sets = [[*(text for text in full if text != rate.override(1)), rate.override(every)] for every in slower]
    _, *variants = compare(recording, sets, reference=full, on_tick=on_tick)
    if not change.error > 0.0:
        return replace(rate, every=rate.before)
    rate = replace(rate, constant=1.0 / (plan.graph.rate * change.error))
    kept = [rate] + [
        replace(rate, every=every, own=own.error, force=off_by(variant))
        for every, own, variant in zip(slower, watched, variants, strict=True)
        if max(own.error, off_by(variant)) <= error
    ]
    return kept[-1]


class _Outputs:
    """The numbers in a node's messages that somebody reads, of a body's law `without` those that these nodes read, and
    how far two runs are apart in them."""

    def __init__(self, plan: Plan, rate: Rate, without: set[str]) -> None:
        self.node = rate.node
        self.shown: list[tuple[int, Field]] = []
        for index, (stream, kind) in enumerate(plan.graph.nodes[rate.node].streams.items()):
            left: set[str] = set()
            for reader in without:
                ports = {port.name: port for port in inputs(plan.graph.nodes[reader].cls)}
                if kind is Surface:
                    left.update(*(ports[e.port].wants for e in plan.edges[reader] if e.stream == stream))
            shown = plan.wanted[stream] - left
            self.shown += [(index, f) for f in fields(kind) if f.name in shown and _measured(f)]
        self.squares, self.peaks, self.count = [0.0] * len(self.shown), [0.0] * len(self.shown), 0

    def seen(self, player: Player | None) -> list[Any]:
        """What others read of it now; None for each where there is nothing yet."""
        last = player.last(self.node) if player else []
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


def read_speeds(text: str) -> tuple[float, ...]:
    """Speeds of '0.5, 1, 2'. ArgumentError: they are none."""
    try:
        speeds = tuple(float(part) for part in text.split(","))
    except ValueError:
        speeds = ()
    if not speeds or not all(0.0 < speed <= 100.0 for speed in speeds):
        raise ArgumentError(f"speeds: found {text!r}, expected numbers above 0, up to 100, such as '0.5, 1, 2'")
    return tuple(dict.fromkeys(speeds))
