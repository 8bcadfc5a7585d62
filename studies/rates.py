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
import math
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from palpate.engine.plan import Plan, force_path
from palpate.launch.load.launchfile import LaunchFile
from palpate.physics.errors import ArgumentError
from palpate.records.changed import changed
from palpate.records.compare import Variant, compare
from palpate.records.player import Player
from palpate.records.reader import Recording
from palpate.studies.motions import at_speeds, others, reached
from palpate.studies.outputs import Outputs
from palpate.studies.search import Found, Show, Trial, off_by, touched, write

SPEEDS = (0.5, 1.0, 2.0)
"""Of the hand, over that of the graph's own path."""
DIVISORS = (1, 2, 5, 10, 20, 50, 100, 200, 500)
"""Divisors of the graph's rate that are tried."""
SEARCHED, ACCEPTED, HELD_OUT = 2, 6, 12
"""Other motions that the search uses, those that accept its rates, and those that only the predictions come from."""
MARGIN = 0.8
"""[1] Share of the error that other motions may reach for the rates to be accepted: more motions have a worse worst."""


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
    """The lowest rates that keep an error [1] on the fastest path and some motions, raised until runs of the path at
    each speed and of new motions keep it. Twelve others then give the prediction and decide nothing but whether the
    error is kept; if so, a launch file is written."""
    effects_of(launch.plan())  # reports a graph without any before anything runs
    motions, drawn, reach = at_speeds(launch, speeds), itertools.count(), reached(launch, speeds)

    def fresh(count: int) -> Iterator[LaunchFile]:
        return others(launch, reach, itertools.islice(drawn, count))

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        searched = [motions[max(motions)], *fresh(SEARCHED)]
        recordings = [touched(motion, folder / f"{number}.mcap") for number, motion in enumerate(searched)]
        show("the touch")
        picked, _ = together(recordings, chosen(recordings[0], error), error)
        show("the search")
        for motion in fresh(ACCEPTED):
            picked, _ = accepted(motion, picked, MARGIN * error, folder)
        at = dict[float, Trial]()
        while missing := motions.keys() - at.keys():
            before, speed = picked, max(missing)  # the fastest hand misses first
            picked, one = accepted(motions[speed], picked, error, folder)
            at = {**(at if picked == before else {}), speed: one}
        show("runs that accept the rates")
        came = worst_of(list(at.values()))
        unseen = [ran(motion, picked, folder) for motion in fresh(HELD_OUT)] if came.most <= error else []
        promised = worst_of(unseen) if unseen else together(recordings, picked, math.inf)[1]
        show("runs that predict")
    picked = [replace(rate, own=own) for rate, own in zip(picked, worst_of([came, *unseen]).own, strict=True)]
    kept = max(one.most for one in (came, *unseen)) <= error
    if kept:
        told = [
            f"Chosen by palpate rates: the lowest update rates for an error of {100 * error:.2g} %.",
            f"Measured on the path of this graph at {spread(at)}:",
            *(f"  {speed:g} times its speed: {percents(picked, one)}" for speed, one in sorted(at.items())),
        ]
        if unseen:
            told.append(f"Predicted from {len(unseen)} other motions: {percents(picked, promised)}")
        write(launch, promised.overrides, [*told, valid(reach)], file)
    return Slowed(picked, promised, came, kept, dict(sorted(at.items())), tuple(unseen), reach)


def accepted(motion: LaunchFile, rates: list[Rate], error: float, folder: Path) -> tuple[list[Rate], Trial]:
    """The rates, raised until a run of this motion keeps the error [1], and that run."""
    while True:
        one = ran(motion, rates, folder)
        finer = oftener(rates, one, error)
        if finer is None:
            return rates, one
        rates = finer


def ran(motion: LaunchFile, rates: Sequence[Rate], folder: Path) -> Trial:
    """Errors of a run at these rates, compared with the same motion of the device with each effect at each tick."""
    return tried(touched(motion.but(overrides=[rate.override() for rate in rates]), folder / "slow.mcap"), rates)


def worst_of(trials: Sequence[Trial]) -> Trial:
    """The one with the greatest error, with the greatest peak error and the greatest of each output of all."""
    own = tuple(max(each) for each in zip(*(one.own for one in trials), strict=True))
    return replace(max(trials, key=lambda one: one.error), worst=max(one.worst for one in trials), own=own)


def valid(reach: tuple[float, float]) -> str:
    """The range of speeds of the hand for which the rates hold."""
    if not reach[1]:
        return "Holds for this motion alone: a faster one may be off by more."
    low, high = (1e3 * speed for speed in reach)
    return (
        f"Holds for moves of the hand at {low:.3g} to {high:.3g} mm/s through the region of this graph's path: a "
        "faster hand may be off by more."
    )


def percents(rates: Sequence[Rate], one: Trial) -> str:
    """Errors of the force and of the outputs in words."""
    own = ", ".join(f"{rate.node} {100 * own:.2g} %" for rate, own in zip(rates, one.own, strict=True))
    return f"force error {100 * one.error:.2g} % of peak (RMS), {100 * one.worst:.2g} % at worst; output errors {own}"


def spread(speeds: Iterable[float]) -> str:
    """Speeds in words."""
    return f"{', '.join(f'{speed:g}' for speed in sorted(speeds))} times its speed"


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


def chosen(recording: Recording, error: float) -> Iterator[Rate]:
    """Each effect of the recorded graph at the lowest rate that keeps `error` [1], while the others run at each tick.

    The error grows with the divisor, so the divisors are bisected; a pass over the recording serves all effects.
    """
    plan = changed(recording)
    kept = [replace(rate, every=1) for rate in effects_of(plan)]
    change = [Outputs(plan, rate.node, without=set()) for rate in kept]
    missed, watched = [len(DIVISORS)] * len(kept), change
    while True:
        middle = [(DIVISORS.index(rate.every) + limit) // 2 for rate, limit in zip(kept, missed, strict=True)]
        trials = {k: replace(kept[k], every=DIVISORS[m]) for k, m in enumerate(middle) if DIVISORS[m] > kept[k].every}
        if not trials:
            break
        tries = [
            ([rate.override(), *(other.override(1) for other in kept if other.node != rate.node)], [rate])
            for rate in trials.values()
        ]
        (_, *variants), own = _computed(recording, kept, tries, watched)
        watched = []  # the reference is the same in each pass
        for (k, rate), variant, (off,) in zip(trials.items(), variants, own, strict=True):
            one = replace(rate, own=off.error, force=off_by(variant))
            if max(one.own, one.force) <= error:
                kept[k] = one
            else:
                missed[k] = middle[k]
    for rate, output in zip(kept, change, strict=True):
        constant = 1.0 / (plan.graph.rate * output.error) if output.error > 0.0 else math.inf
        yield replace(rate, constant=constant, every=rate.before if math.isinf(constant) else rate.every)


def together(recordings: Sequence[Recording], rates: Iterable[Rate], error: float) -> tuple[list[Rate], Trial]:
    """All of them at once: while one of the touches misses `error` [1], an effect runs more often. Returns the rates
    and the touch with the greatest error."""
    picked, done = list(rates), list[Trial]()
    while len(done) < len(recordings):
        done.append(tried(recordings[len(done)], picked, [rate.override() for rate in picked]))
        finer = oftener(picked, done[-1], error)
        if finer:
            picked, done = finer, []
    return picked, worst_of(done)


def oftener(rates: Sequence[Rate], one: Trial, error: float) -> list[Rate] | None:
    """The next higher rate for the effect with the largest share in an error [1] that a trial misses: one whose output
    misses it, or else that with the largest part in the force. None: the trial keeps it, or all run at each tick."""
    slow = [k for k, rate in enumerate(rates) if rate.every > 1]
    if one.most <= error or not slow:
        return None
    worst = max(slow, key=lambda k: (one.own[k] if one.own[k] > error else 0.0, rates[k].force, one.own[k]))
    every = max(n for n in DIVISORS if n < rates[worst].every)
    force = rates[worst].force * every / rates[worst].every
    return [replace(rate, every=every, force=force) if k == worst else rate for k, rate in enumerate(rates)]


def tried(recording: Recording, rates: Sequence[Rate], texts: Sequence[str] = ()) -> Trial:
    """Errors of a touch compared with itself with each effect at each tick, with these overrides of the run; without
    any, as it was run at these rates."""
    (base, variant), (own,) = _computed(recording, rates, [(texts, rates)])
    overrides = {f"{rate.node}.every": rate.every for rate in rates}
    return Trial(overrides, own=tuple(output.error for output in own)).measured(base, variant)


def _computed(
    recording: Recording,
    effects: Sequence[Rate],
    tries: Sequence[tuple[Sequence[str], Sequence[Rate]]],
    change: Sequence[Outputs] = (),
) -> tuple[list[Variant], list[list[Outputs]]]:
    """The touch with all effects at each tick and with the overrides of each of `tries`: the variants, and of each the
    error in the outputs of its effects. `change` receives the change of the former from tick to tick."""
    plan = changed(recording)
    path = force_path(plan)
    own = [[Outputs(plan, rate.node, without=path if rate.felt else set()) for rate in watched] for _, watched in tries]
    before = [one.seen(None) for one in change]

    def on_tick(players: Sequence[Player]) -> None:
        for k, one in enumerate(change):
            now = one.seen(players[0])
            one.add(now, before[k])
            before[k] = now
        for watched, player in zip(own, players[1:], strict=True):
            for one in watched:
                one.add(one.seen(player), one.seen(players[0]))

    full = [rate.override(1) for rate in effects]
    return compare(recording, [texts for texts, _ in tries], reference=full, on_tick=on_tick), own


def read_speeds(text: str) -> tuple[float, ...]:
    """Speeds of '0.5, 1, 2'. ArgumentError: they are none."""
    try:
        speeds = tuple(float(part) for part in text.split(","))
    except ValueError:
        speeds = ()
    if not speeds or not all(0.0 < speed <= 100.0 for speed in speeds):
        raise ArgumentError(f"speeds: found {text!r}, expected numbers above 0, up to 100, such as '0.5, 1, 2'")
    return tuple(dict.fromkeys(speeds))
