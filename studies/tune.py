"""The body for a budget: a touch of this graph, felt by every model that comes with palpate at several fidelities.

Each candidate computes the touch again (`studies.search`), one at a time next to the reference: the model nearest to
full elements of those that can run. It is no truth: what it is known to be off by is added to every error.
"""

import tempfile
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path

from palpate.engine.graph import Graph
from palpate.launch.load.launchfile import LaunchFile
from palpate.nodes.deformation import bodies
from palpate.physics.errors import ArgumentError, PalpateError
from palpate.records.changed import changed
from palpate.records.compare import Variant
from palpate.records.reader import Recording
from palpate.studies.known import body_of, known_error
from palpate.studies.search import Found, Show, Trial, compared, touched, write

COARSER = (1, 3, 10)
"""By what the number of the surface's vertices is divided."""
EVERY = (1, 2, 5)
"""Divisors of the body's rate."""
QUANTITIES = ("force", "indentation", "shape")


@dataclass(frozen=True)
class Goal:
    """What is to be kept: p99 of the processor time of a tick [s], error [1] of a quantity over its peak; None: no
    matter."""

    budget: float | None
    error: float | None
    quantity: str = "force"

    def keeps(self, one: Trial) -> bool:
        """Whether a trial does."""
        return (
            not one.why
            and (self.budget is None or one.p99 <= self.budget)
            and (self.error is None or one.error <= self.error)
        )

    def __str__(self) -> str:
        asked = [] if self.budget is None else [f"{1e3 * self.budget:g} ms at p99"]
        asked += [] if self.error is None else [f"{100 * self.error:g} % of the {self.quantity}"]
        return " and ".join(asked)


@dataclass(frozen=True)
class Tuned(Found):
    """With the overrides of the reference, what it is known to be off by [1], and why nothing keeps the budget."""

    reference: Trial = field(default_factory=lambda: Trial({}))
    estimated_error: float = 0.0
    why: str = ""


def tune(launch: LaunchFile, goal: Goal, file: Path, show: Show = lambda what: None) -> Tuned:
    """The best candidate for a goal, written as a launch file and run."""
    wanted = candidates(launch.load())
    with tempfile.TemporaryDirectory() as folder:
        recording = touched(launch, Path(folder) / "touch.mcap")
        show("the touch")
        base = reference(recording, wanted)
        estimated_error, ranked = known_error(changed(recording, base.texts).graph), []
        for one in wanted:
            ranked.append(measured(recording, one, base, goal, estimated_error))
            show(title(one))
        best = pick(ranked, goal)
        if best is None:
            return Tuned(ranked, reference=base, estimated_error=estimated_error, why=cause(ranked, goal))
        told = (
            f"Chosen by palpate tune: {goal.quantity} error {100 * best.error:.2g} % of peak (RMS),",
            f"a tick {times(best)}, on the machine where it was tuned.",
        )
        write(launch, best.overrides, told, file)
        came = _came(launch, best, base, goal, Path(folder) / "tuned.mcap")
        show("a run of the choice")
    return Tuned(ranked, best, came, goal.keeps(came), base, estimated_error)


def title(one: Trial) -> str:
    """Model and fidelity in words."""
    words = {"use": "{}", "vertices": "{} vertices", "every": "every {}"}
    told = [words[key.rpartition(".")[2]].format(value) for key, value in one.overrides.items()]
    return ", ".join(word.removeprefix("deformation.") for word in told)


def times(one: Trial) -> str:
    """Processor time and duration of a tick in words."""
    (p50, p99), (wall50, wall99) = (one.p50, one.p99), one.wall
    return (
        f"{1e6 * p50:.0f} us p50, {1e6 * p99:.0f} us p99 of processor time "
        f"({1e6 * wall50:.0f} and {1e6 * wall99:.0f} us by the clock)"
    )


def candidates(graph: Graph) -> list[Trial]:
    """Every model at every fidelity, the nearest to full elements first."""
    body = body_of(graph)
    vertices = graph.nodes[body].settings.get("vertices")
    counts = [max(int(vertices) // n, 100) for n in COARSER] if vertices else [vertices]
    usual = {"scene.surface.vertices": vertices, f"{body}.every": 1}
    tried = (dict(zip(usual, own, strict=True)) for own in product(counts, EVERY))
    changes = [{key: value for key, value in own.items() if value != usual[key]} for own in tried]
    return [Trial({f"{body}.use": model} | change) for model in bodies() for change in changes]


def reference(recording: Recording, wanted: list[Trial]) -> Trial:
    """The first candidate whose body starts: what is missing is told then, not at its first step."""
    for one in wanted:
        try:
            graph = changed(recording, one.texts).graph
            spec = graph.nodes[body_of(graph)]
            spec.cls(**spec.settings).start()
        except PalpateError:
            continue
        return one
    raise ArgumentError(f"{recording.path}: none of the models fits this graph")


def measured(recording: Recording, one: Trial, base: Trial, goal: Goal, estimated_error: float) -> Trial:
    """A candidate with what it gave next to the reference."""
    both = compared(recording, one.texts, base.texts)
    return replace(one, why=both) if isinstance(both, str) else judged(one, *both, goal, estimated_error)


def judged(one: Trial, base: Variant, variant: Variant, goal: Goal, estimated_error: float) -> Trial:
    """With error and times of what it gave. ArgumentError: nothing was touched, so that no error can be told."""
    if not getattr(variant, goal.quantity).scale > 0.0:
        raise ArgumentError(
            f"the touch has no {goal.quantity} from its begin to its end, expected one that presses the body; a longer "
            "one may: --duration '3 s'"
        )
    body = body_of(variant.plan.graph)
    often = [
        (name, steps.report()["p50"])
        for name, steps in variant.nodes_cpu.items()
        if name != body and 100 * steps.count >= variant.whole.count
    ]
    told = one.measured(base, variant, goal.quantity)
    return replace(
        told, error=told.error + estimated_error, slowest=max(often, key=lambda own: own[1], default=("", 0.0))
    )


def pick(ranked: list[Trial], goal: Goal) -> Trial | None:
    """The most accurate that keeps the budget, or the cheapest that keeps the error; of both, the most accurate that
    keeps both. None: nothing does."""
    kept = [one for one in ranked if goal.keeps(one)]
    if goal.budget is None:
        return min(kept, key=lambda one: (one.p99, one.error), default=None)
    return min(kept, key=lambda one: (one.error, one.p99), default=None)


def cause(ranked: list[Trial], goal: Goal) -> str:
    """Why nothing keeps the budget, in words: another node takes longer than it. Empty where it is the error that
    nothing keeps, or nothing is known."""
    late = [one for one in ranked if replace(goal, budget=None).keeps(one)]
    if goal.budget is None or not late:
        return ""
    name, took = min((one.slowest for one in late), key=lambda own: own[1])
    if took > goal.budget:
        return (
            f"Node {name!r} alone takes {1e6 * took:.0f} us (p50 of its steps), with any tissue model: allow a larger "
            "budget, or tune the graph without it."
        )
    return ""


def _came(launch: LaunchFile, chosen: Trial, base: Trial, goal: Goal, file: Path) -> Trial:
    """The choice, run: what came of it, measured on the touch as it is felt with it."""
    graph = launch.load()
    body = body_of(graph)
    usual = {f"{body}.every": 1, "scene.surface.vertices": graph.nodes[body].settings.get("vertices")}
    back = Trial({key: value for key, value in usual.items() if key in chosen.overrides} | base.overrides)
    recording = touched(launch.but(overrides=chosen.texts), file)
    both = compared(recording, [], back.texts)
    if isinstance(both, str):
        raise ArgumentError(f"{launch.path or launch.graph}: the run of the choice cannot be computed again: {both}")
    return judged(chosen, *both, goal, known_error(changed(recording, back.texts).graph))
