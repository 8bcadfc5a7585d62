"""Choose the tissue model for a budget: compute a touch of the graph with every shipped model at several fidelities.

Each candidate computes the touch again (`studies.search`), in parallel with the reference: of the models that can run,
the one closest to full finite elements. The known error of the reference is added to every error.
"""

from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path

from palpate.engine.graph import Graph
from palpate.launch.load.launchfile import LaunchFile
from palpate.nodes.deformation import bodies
from palpate.physics.errors import ArgumentError, PalpateError
from palpate.physics.scratch import ScratchFolder
from palpate.records.changed import change_plan
from palpate.records.compare import Variant
from palpate.records.reader import Recording
from palpate.studies.model_error import body_of, known_error
from palpate.studies.search import Evaluation, SearchResult, Show, compare_settings, record_touch, write

COARSER = (1, 3, 10)
"""Divisors of the number of surface vertices."""
EVERY = (1, 2, 5)
"""Divisors of the rate of the body."""
QUANTITIES = ("force", "indentation", "shape")


@dataclass(frozen=True)
class Goal:
    """Limits of the p99 [s] of the processor time per tick and of the error [1] of a quantity; None: no limit."""

    budget: float | None
    error: float | None
    quantity: str = "force"

    def met_by(self, one: Evaluation) -> bool:
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
class TuneResult(SearchResult):
    """Adds the reference, its known error [1], and the reason why no candidate meets the budget."""

    reference: Evaluation = field(default_factory=lambda: Evaluation({}))
    estimated_error: float = 0.0
    why: str = ""


def tune(launch: LaunchFile, goal: Goal, file: Path, show: Show = lambda what: None) -> TuneResult:
    """Find the best candidate for a goal, write its launch file and run it."""
    wanted = candidates(launch.load())
    with ScratchFolder("tune") as folder:
        recording = record_touch(launch, Path(folder) / "touch.mcap")
        show("the touch")
        base = reference(recording, wanted)
        estimated_error, ranked = known_error(change_plan(recording, base.texts).graph), []
        for one in wanted:
            ranked.append(evaluate_candidate(recording, one, base, goal, estimated_error))
            show(title(one))
        best = pick(ranked, goal)
        if best is None:
            return TuneResult(ranked, reference=base, estimated_error=estimated_error, why=cause(ranked, goal))
        comments = (
            f"Chosen by palpate tune: {goal.quantity} error {100 * best.error:.2g} % of peak (RMS),",
            f"a tick {times(best)}, on the machine where it was tuned.",
        )
        write(launch, best.overrides, comments, file)
        measured = _run(launch, best, base, goal, Path(folder) / "tuned.mcap")
        show("a run of the choice")
    return TuneResult(ranked, best, measured, goal.met_by(measured), base, estimated_error)


def title(one: Evaluation) -> str:
    """Model and fidelity in words."""
    words = {"use": "{}", "vertices": "{} vertices", "every": "every {}"}
    texts = [words[key.rpartition(".")[2]].format(value) for key, value in one.overrides.items()]
    return ", ".join(text.removeprefix("deformation.") for text in texts)


def times(one: Evaluation) -> str:
    """Processor time and wall time per tick in words."""
    (p50, p99), (wall50, wall99) = (one.p50, one.p99), one.wall
    return (
        f"{1e6 * p50:.0f} us p50, {1e6 * p99:.0f} us p99 of processor time "
        f"({1e6 * wall50:.0f} and {1e6 * wall99:.0f} us by the clock)"
    )


def candidates(graph: Graph) -> list[Evaluation]:
    """Every model at every fidelity, the closest to full finite elements first."""
    body = body_of(graph)
    vertices = graph.nodes[body].settings.get("vertices")
    counts = [max(int(vertices) // n, 100) for n in COARSER] if vertices else [vertices]
    usual = {"scene.surface.vertices": vertices, f"{body}.every": 1}
    tried = (dict(zip(usual, values, strict=True)) for values in product(counts, EVERY))
    changes = [{key: value for key, value in each.items() if value != usual[key]} for each in tried]
    return [Evaluation({f"{body}.use": model} | change) for model in bodies() for change in changes]


def reference(recording: Recording, wanted: list[Evaluation]) -> Evaluation:
    """The first candidate whose body starts; a body whose basis is missing fails at its start."""
    for one in wanted:
        try:
            graph = change_plan(recording, one.texts).graph
            spec = graph.nodes[body_of(graph)]
            spec.cls(**spec.settings).start()
        except PalpateError:
            continue
        return one
    raise ArgumentError(f"{recording.path}: none of the models fits this graph")


def evaluate_candidate(
    recording: Recording, one: Evaluation, base: Evaluation, goal: Goal, estimated_error: float
) -> Evaluation:
    """A candidate with its error and times."""
    both = compare_settings(recording, one.texts, base.texts)
    return replace(one, why=both) if isinstance(both, str) else judge_variants(one, *both, goal, estimated_error)


def judge_variants(one: Evaluation, base: Variant, variant: Variant, goal: Goal, estimated_error: float) -> Evaluation:
    """A candidate with the error and times of these variants. ArgumentError: no contact, so the error is undefined."""
    if not getattr(variant, goal.quantity).scale > 0.0:
        raise ArgumentError(
            f"found a touch without {goal.quantity}, expected one that presses the body; try a longer touch: "
            "--duration '3 s'"
        )
    body = body_of(variant.plan.graph)
    most = max(steps.count for steps in variant.nodes_cpu.values())
    others = [
        (name, steps.report()["p50"])
        for name, steps in variant.nodes_cpu.items()
        if name != body and 100 * steps.count >= most
    ]
    one = one.with_errors(base, variant, goal.quantity)
    slowest = max(others, key=lambda node: node[1], default=("", 0.0))
    return replace(one, error=one.error + estimated_error, slowest=slowest)


def pick(ranked: list[Evaluation], goal: Goal) -> Evaluation | None:
    """The most accurate candidate within the budget, or the fastest within the error; None if no candidate is."""
    able = [one for one in ranked if goal.met_by(one)]
    if goal.budget is None:
        return min(able, key=lambda one: (one.p99, one.error), default=None)
    return min(able, key=lambda one: (one.error, one.p99), default=None)


def cause(ranked: list[Evaluation], goal: Goal) -> str:
    """Names the node that alone exceeds the budget; "" if no node does, or if the error is the limit that fails."""
    late = [one for one in ranked if replace(goal, budget=None).met_by(one)]
    if goal.budget is None or not late:
        return ""
    name, took = min((one.slowest for one in late), key=lambda node: node[1])
    if took > goal.budget:
        return (
            f"Node {name!r} alone takes {1e6 * took:.0f} us (p50 of its steps), with any tissue model: allow a larger "
            "budget, or tune the graph without it."
        )
    return ""


def _run(launch: LaunchFile, chosen: Evaluation, base: Evaluation, goal: Goal, file: Path) -> Evaluation:
    """Run the choice and measure its error and times on the touch that results with it."""
    graph = launch.load()
    body = body_of(graph)
    usual = {f"{body}.every": 1, "scene.surface.vertices": graph.nodes[body].settings.get("vertices")}
    back = Evaluation({key: value for key, value in usual.items() if key in chosen.overrides} | base.overrides)
    recording = record_touch(launch.but(overrides=chosen.texts), file)
    both = compare_settings(recording, [], back.texts)
    if isinstance(both, str):
        raise ArgumentError(f"{launch.path or launch.graph}: the run of the choice cannot be replayed: {both}")
    return judge_variants(chosen, *both, goal, known_error(change_plan(recording, back.texts).graph))
