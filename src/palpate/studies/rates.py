"""Find the lowest update rate of each effect that keeps the error of its output within a limit.

An effect that is a separate node may run at every n-th tick (`every: n`); its readers hold its last message. The
required rate follows from the time constant of the effect: the peak of its output over the RMS rate of change. Held for
n ticks of dt, the output has an RMS error of n dt/(sqrt(3) constant) of its peak. The choice itself is measured: the
touch is computed again with the effect at several rates. Outputs change faster if the hand is faster, so this is done
at several speeds and on other motions through the same region, up to the fastest of these speeds; the worst case
counts. Predictions come from motions that the search has not used.
"""

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from palpate.engine.plan import Plan, force_path
from palpate.launch.load.launchfile import LaunchFile
from palpate.physics.errors import ArgumentError
from palpate.physics.scratch import ScratchFolder
from palpate.records.changed import change_plan
from palpate.records.compare import Variant, compare
from palpate.records.player import Player
from palpate.records.reader import Recording
from palpate.studies.motions import at_speeds, others, peak_speeds
from palpate.studies.outputs import Outputs
from palpate.studies.search import Evaluation, SearchResult, Show, record_touch, relative_error, write

SPEEDS = (0.5, 1.0, 2.0)
"""[1] Speeds of the hand, relative to the path in the graph."""
DIVISORS = (1, 2, 5, 10, 20, 50, 100, 200, 500)
"""Candidate divisors of the rate of the graph."""
SEARCHED, ACCEPTED, HELD_OUT = 2, 6, 12
"""Numbers of other motions for the search, for accepting its rates, and for predictions only."""
MARGIN = 0.8
"""[1] Share of the error that motions for acceptance may reach, because other motions can have a larger one."""


@dataclass(frozen=True)
class Rate:
    """The update rate of one effect.

    before, every  divisor of the rate in the graph, and the chosen one
    in_loop        whether the node is on the force path; the terminal law of a body there counts in the force error
    constant       [s] time constant of the output
    output_error   [1] RMS error of the output at `every`, over its peak;  force_error [1] of the force on the hand
    """

    node: str
    effect: str
    before: int
    in_loop: bool
    constant: float = math.inf
    every: int = 1
    output_error: float = 0.0
    force_error: float = 0.0

    @property
    def idle(self) -> bool:
        """Whether the output is constant on the touch; the rate is then kept."""
        return math.isinf(self.constant)

    def override(self, every: int | None = None) -> str:
        """As `--set` takes it."""
        return f"{self.node}.every={self.every if every is None else every}"


@dataclass(frozen=True)
class RatesResult(SearchResult):
    """Adds the measurements at each speed and those of motions outside the search.

    reach  [m/s] slowest and fastest move of the hand in all motions; 0: no hand follows a path
    """

    at: dict[float, Evaluation] = field(default_factory=dict)
    unseen: tuple[Evaluation, ...] = ()
    reach: tuple[float, float] = (0.0, 0.0)


def rates(
    launch: LaunchFile, error: float, file: Path, show: Show = lambda what: None, speeds: Sequence[float] = SPEEDS
) -> RatesResult:
    """Find the lowest rates within an error [1] and write a launch file if the rates meet it.

    The search uses the fastest path and a few other motions. Rates are then raised until runs of the path at each speed
    and of new motions are within the error. 12 more motions give the prediction and can only reject the rates.
    """
    effects_of(launch.plan())  # fails before the first run if the graph has no effects
    motions, drawn, reach = at_speeds(launch, speeds), itertools.count(), peak_speeds(launch, speeds)

    def fresh(count: int) -> Iterator[LaunchFile]:
        return others(launch, reach, itertools.islice(drawn, count))

    with ScratchFolder("rates") as name:
        folder = Path(name)
        # Search on recordings of the fastest path and of random motions.
        searched = [motions[max(motions)], *fresh(SEARCHED)]
        recordings = [record_touch(motion, folder / f"{number}.mcap") for number, motion in enumerate(searched)]
        show("the touch")
        picked, _ = together(recordings, lowest_rates(recordings[0], error), error)
        show("the search")
        # Raise the rates until runs of new motions, then of the path at each speed, are within the error.
        for motion in fresh(ACCEPTED):
            picked, _ = search_rates(motion, picked, MARGIN * error, folder)
        at = dict[float, Evaluation]()
        while missing := motions.keys() - at.keys():
            before, speed = picked, max(missing)  # the fastest hand has the largest error
            picked, one = search_rates(motions[speed], picked, error, folder)
            at = {**(at if picked == before else {}), speed: one}
        show("runs that accept the rates")
        # Predict from motions that have not been used so far.
        measured = worst_of(list(at.values()))
        unseen = [ran(motion, picked, folder) for motion in fresh(HELD_OUT)] if measured.most <= error else []
        predicted = worst_of(unseen) if unseen else together(recordings, picked, math.inf)[1]
        show("runs that predict")
    worst = worst_of([measured, *unseen]).outputs
    picked = [replace(rate, output_error=output) for rate, output in zip(picked, worst, strict=True)]
    met = max(one.most for one in (measured, *unseen)) <= error
    if met:
        factors = ", ".join(f"{speed:g}" for speed in sorted(at))
        comments = [
            f"Chosen by palpate rates: the lowest update rates for an error of {100 * error:.2g} %.",
            f"Measured on the path of this graph at {factors} times its speed:",
            *(f"  {speed:g} times its speed: {errors_text(picked, one)}" for speed, one in sorted(at.items())),
        ]
        if unseen:
            comments.append(f"Predicted from {len(unseen)} other motions: {errors_text(picked, predicted)}")
        write(launch, predicted.overrides, [*comments, valid(reach)], file)
    return RatesResult(picked, predicted, measured, met, dict(sorted(at.items())), tuple(unseen), reach)


def search_rates(motion: LaunchFile, rates: list[Rate], error: float, folder: Path) -> tuple[list[Rate], Evaluation]:
    """The rates, raised until a run of this motion is within the error [1], and that run."""
    while True:
        one = ran(motion, rates, folder)
        finer = raise_rate(rates, one, error)
        if finer is None:
            return rates, one
        rates = finer


def ran(motion: LaunchFile, rates: Sequence[Rate], folder: Path) -> Evaluation:
    """Errors of a run at these rates, compared with the same device motion with all effects at every tick."""
    return try_rates(
        record_touch(motion.but(overrides=[rate.override() for rate in rates]), folder / "slow.mcap"), rates
    )


def worst_of(runs: Sequence[Evaluation]) -> Evaluation:
    """The run with the largest error, with the largest peak error and output errors of all runs."""
    outputs = tuple(max(each) for each in zip(*(one.outputs for one in runs), strict=True))
    return replace(max(runs, key=lambda one: one.error), worst=max(one.worst for one in runs), outputs=outputs)


def valid(reach: tuple[float, float]) -> str:
    """A sentence on the range of hand speeds for which the rates are valid."""
    if not reach[1]:
        return "Valid for this motion only: the error of a faster one may be larger."
    low, high = (1e3 * speed for speed in reach)
    return (
        f"Valid for moves of the hand at {low:.3g} to {high:.3g} mm/s in the region of this graph's path: the error of "
        "a faster hand may be larger."
    )


def errors_text(rates: Sequence[Rate], one: Evaluation) -> str:
    """Errors of the force and of the outputs in words."""
    pairs = zip(rates, one.outputs, strict=True)
    outputs = ", ".join(f"{rate.node} {100 * output:.2g} %" for rate, output in pairs)
    force = f"force error {100 * one.error:.2g} % of peak (RMS), {100 * one.worst:.2g} % at worst"
    return f"{force}; output errors {outputs}"


def effects_of(plan: Plan) -> list[Rate]:
    """Each running node that computes one effect and nothing else. ArgumentError: the graph has none."""
    path = force_path(plan)
    found = [
        Rate(spec.name, spec.cls.effect, spec.every, spec.name in path)
        for spec in (plan.graph.nodes[name] for name in plan.order)
        if spec.cls.effect and not (spec.cls.paced or spec.cls.hardware)
    ]
    if not found:
        raise ArgumentError(
            f"{plan.graph.path}: no effect of this graph is a separate node, so there is no rate to choose; "
            "`palpate plan` shows the effects of a graph"
        )
    return found


def lowest_rates(recording: Recording, error: float) -> Iterator[Rate]:
    """Each effect of the recorded graph at its lowest rate within `error` [1], with the others at every tick.

    The error grows with the divisor, so the divisors are bisected; one pass over the recording serves all effects.
    """
    plan = change_plan(recording)
    found = [replace(rate, every=1) for rate in effects_of(plan)]
    change = [Outputs(plan, rate.node, without=set()) for rate in found]
    missed, watched = [len(DIVISORS)] * len(found), change
    while True:
        middle = [(DIVISORS.index(rate.every) + limit) // 2 for rate, limit in zip(found, missed, strict=True)]
        slower = {k: replace(found[k], every=DIVISORS[m]) for k, m in enumerate(middle) if DIVISORS[m] > found[k].every}
        if not slower:
            break
        tries = [
            ([rate.override(), *(other.override(1) for other in found if other.node != rate.node)], [rate])
            for rate in slower.values()
        ]
        (_, *variants), outputs = _compute_touch(recording, found, tries, watched)
        watched = []  # the reference is the same in each pass
        for (k, rate), variant, (output,) in zip(slower.items(), variants, outputs, strict=True):
            one = replace(rate, output_error=output.error, force_error=relative_error(variant))
            if max(one.output_error, one.force_error) <= error:
                found[k] = one
            else:
                missed[k] = middle[k]
    for rate, output in zip(found, change, strict=True):
        constant = 1.0 / (plan.graph.rate * output.error) if output.error > 0.0 else math.inf
        yield replace(rate, constant=constant, every=rate.before if math.isinf(constant) else rate.every)


def together(recordings: Sequence[Recording], rates: Iterable[Rate], error: float) -> tuple[list[Rate], Evaluation]:
    """Apply all rates at once, and raise the rate of one effect while any touch exceeds `error` [1].

    Returns the rates and the errors of the worst touch.
    """
    picked, done = list(rates), list[Evaluation]()
    while len(done) < len(recordings):
        done.append(try_rates(recordings[len(done)], picked, [rate.override() for rate in picked]))
        finer = raise_rate(picked, done[-1], error)
        if finer:
            picked, done = finer, []
    return picked, worst_of(done)


def raise_rate(rates: Sequence[Rate], one: Evaluation, error: float) -> list[Rate] | None:
    """The rates with the next higher rate for the effect that contributes most to exceeding an error [1].

    That is the effect whose output exceeds it most, or else the one with the largest force error. None: the run is
    within the error, or all effects run at every tick.
    """
    slow = [k for k, rate in enumerate(rates) if rate.every > 1]
    if one.most <= error or not slow:
        return None
    output = one.outputs
    worst = max(slow, key=lambda k: (output[k] if output[k] > error else 0.0, rates[k].force_error, output[k]))
    every = max(n for n in DIVISORS if n < rates[worst].every)
    force = rates[worst].force_error * every / rates[worst].every
    return [replace(rate, every=every, force_error=force) if k == worst else rate for k, rate in enumerate(rates)]


def try_rates(recording: Recording, rates: Sequence[Rate], texts: Sequence[str] = ()) -> Evaluation:
    """Errors of a recorded touch with these overrides, compared with all effects at every tick."""
    (base, variant), (outputs,) = _compute_touch(recording, rates, [(texts, rates)])
    overrides = {f"{rate.node}.every": rate.every for rate in rates}
    return Evaluation(overrides, outputs=tuple(output.error for output in outputs)).with_errors(base, variant)


def _compute_touch(
    recording: Recording,
    effects: Sequence[Rate],
    tries: Sequence[tuple[Sequence[str], Sequence[Rate]]],
    change: Sequence[Outputs] = (),
) -> tuple[list[Variant], list[list[Outputs]]]:
    """Compute the touch with all effects at every tick, and with the overrides of each of `tries`.

    Returns the variants, and for each the errors in the outputs of its effects. `change` accumulates the changes of the
    first variant from tick to tick.
    """
    plan = change_plan(recording)
    path = force_path(plan)
    outputs = [
        [Outputs(plan, rate.node, without=path if rate.in_loop else set()) for rate in watched] for _, watched in tries
    ]
    before = [one.values(None) for one in change]

    def on_tick(players: Sequence[Player]) -> None:
        for k, one in enumerate(change):
            now = one.values(players[0])
            one.add(now, before[k])
            before[k] = now
        for watched, player in zip(outputs, players[1:], strict=True):
            for one in watched:
                one.add(one.values(player), one.values(players[0]))

    full = [rate.override(1) for rate in effects]
    return compare(recording, [texts for texts, _ in tries], reference=full, on_tick=on_tick), outputs


def read_speeds(text: str) -> tuple[float, ...]:
    """Speeds of '0.5, 1, 2'. ArgumentError: another form."""
    try:
        speeds = tuple(float(part) for part in text.split(","))
    except ValueError:
        speeds = ()
    if not speeds or not all(0.0 < speed <= 100.0 for speed in speeds):
        raise ArgumentError(f"speeds: found {text!r}, expected numbers above 0, up to 100, such as '0.5, 1, 2'")
    return tuple(dict.fromkeys(speeds))
