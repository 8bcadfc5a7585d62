"""The body for a budget: a touch of this graph, felt by every model that comes with palpate at several fidelities.

The touch is recorded once as the graph stands; each candidate then computes it again (`compare`), one at a time beside
the reference: deformation.ReducedFE, nearest to full elements of what can run, or else the finest other model. It is no
truth: what it is known to be off by is added to every error.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import yaml

from palpate.engine.graph import Graph
from palpate.engine.slot import NodeFault
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.load.placement import FUSED
from palpate.launch.run.busy import busy
from palpate.launch.run.execute import execute
from palpate.messages import Surface
from palpate.nodes.base import SettingError
from palpate.nodes.deformation import ReducedFE
from palpate.nodes.deformation.basis_store import shipped
from palpate.physics.errors import MISUSE, PalpateError
from palpate.records.compare import Variant, compare
from palpate.records.reader import Recording

MODELS = ("deformation.ReducedFE", "deformation.BeamBundle", "deformation.MassSpring")
"""The nearest to full elements first."""
COARSER = (1, 3, 10)
"""By what the number of the surface's vertices is divided."""
EVERY = (1, 2, 5)
"""Divisors of the body's rate."""
KNOWN = 0.01
"""[1] Force error (RMS) of ReducedFE against two full solvers on meshes that follow the patch, on the test cases of
`palpate bench accuracy` but the tap and the nodule (docs/accuracy.md)."""
QUANTITIES = ("force", "indentation", "shape")


class TuneError(PalpateError, ValueError):
    """A budget that cannot be read, or a graph without a body; says what would do."""

    exit_code = MISUSE


@dataclass(frozen=True)
class Goal:
    """What is to be kept: p99 of all steps of a tick [s], error [1] of a quantity over its peak; None: no matter."""

    budget: float | None
    error: float | None
    quantity: str = "force"


@dataclass(frozen=True)
class Candidate:
    """A body at a fidelity: overrides, and what they gave. Error [1] with that of the reference added; p50 and p99 [s]
    of a tick; why says what went wrong, if something did; slowest is the node beside the body that takes longest of
    those that run in at least one tick of a hundred, and the p50 [s] of its steps."""

    overrides: dict[str, Any]
    error: float = float("inf")
    p50: float = float("inf")
    p99: float = float("inf")
    why: str = ""
    slowest: tuple[str, float] = ("", 0.0)

    @property
    def title(self) -> str:
        """Model and fidelity in words."""
        words = {"use": "{}", "vertices": "{} vertices", "every": "every {}"}
        told = [words[key.rpartition(".")[2]].format(value) for key, value in self.overrides.items()]
        return ", ".join(word.removeprefix("deformation.") for word in told)

    @property
    def texts(self) -> list[str]:
        """Overrides as `--set` takes them."""
        return [f"{key}={value}" for key, value in self.overrides.items()]


def read_error(text: str) -> tuple[float, str]:
    """Share and quantity of '2 % force'. TuneError: it is none."""
    number, _, rest = text.partition("%")
    quantity = rest.strip() or "force"
    try:
        share = float(number) / 100.0
    except ValueError:
        share = -1.0
    if not share > 0.0 or "%" not in text or quantity not in QUANTITIES:
        raise TuneError(
            f"error: found {text!r}, expected a share of a peak such as '2 % force'; of {', '.join(QUANTITIES)}"
        )
    return share, quantity


def body_of(graph: Graph) -> str:
    """Name of the node that sends `Surface`. TuneError: there is none."""
    names = [name for name, spec in graph.nodes.items() if Surface in spec.streams.values()]
    if len(names) != 1:
        raise TuneError(
            f"{graph.path}: {len(names)} nodes send Surface, expected one deformable body; kidney, nodule and "
            "fingertip have one"
        )
    return names[0]


def candidates(graph: Graph) -> list[dict[str, Any]]:
    """Overrides of every model at every fidelity."""
    body = body_of(graph)
    vertices = graph.nodes[body].settings.get("vertices")
    counts = [max(int(vertices) // n, 100) for n in COARSER] if vertices else [None]
    return [
        {f"{body}.use": model}
        | ({} if count in (None, vertices) else {"scene.surface.vertices": count})
        | ({} if every == 1 else {f"{body}.every": every})
        for model in MODELS
        for count in counts
        for every in EVERY
    ]


def touched(launch: LaunchFile, file: Path) -> Recording:
    """One run of the graph, in this process, recorded. TuneError: it failed, or it would move a device."""
    graph = launch.load()
    devices = [name for name, spec in graph.nodes.items() if spec.cls.hardware]
    if devices:
        raise TuneError(
            f"{launch.path or launch.graph}: node {devices[0]!r} talks to a device, and the touch is computed many "
            f"times here; expected a simulated one: --set {devices[0]}.use=device.Simulated, or the graph kidney"
        )
    outcome = execute(replace(launch, record=file, place=FUSED, clock="simulated"))
    if not outcome.result.ok or outcome.recording is None:
        why = outcome.result.deaths[0] if outcome.result.deaths else "it was interrupted"
        raise TuneError(f"{launch.path or launch.graph}: the run to tune on failed: {why}")
    return Recording(file)


def measured(
    recording: Recording, wanted: list[dict[str, Any]], base: dict[str, Any], goal: Goal
) -> Iterator[Candidate]:
    """Each candidate with what it gave beside the reference."""
    claimed = claim(recording, base)
    for overrides in wanted:
        one = Candidate(overrides)
        try:
            _, variant = compare(recording, [one.texts], reference=Candidate(base).texts)
        except (PalpateError, NodeFault) as error:
            yield replace(one, why=str(error))
            continue
        yield judged(one, variant, goal, claimed)


def judged(one: Candidate, variant: Variant, goal: Goal, claimed: float) -> Candidate:
    """With error and times of what it gave. TuneError: nothing was touched, so that no error can be told."""
    spread = {"force": variant.force, "indentation": variant.indentation, "shape": variant.shape}[
        goal.quantity
    ].report()
    peak = spread["reference_peak"]
    if not peak > 0.0:
        raise TuneError(
            f"the touch has no {goal.quantity} from its begin to its end, expected one that presses the body; a longer "
            "one may: --duration '3 s'"
        )
    whole, body = variant.whole.report(), body_of(variant.plan.graph)
    often = [(n, h.report()["p50"]) for n, h in variant.nodes.items() if 100 * h.count >= variant.whole.count]
    slowest = max((own for own in often if own[0] != body), key=lambda own: own[1], default=("", 0.0))
    return replace(one, error=spread["rms"] / peak + claimed, p50=whole["p50"], p99=whole["p99"], slowest=slowest)


def reference(recording: Recording, wanted: list[dict[str, Any]]) -> dict[str, Any]:
    """Overrides of the first candidate that computes at all: candidates come the nearest to full elements first."""
    for overrides in wanted:
        texts = Candidate(overrides).texts
        try:
            _startable(recording, texts)
        except (PalpateError, NodeFault):
            continue
        return overrides
    raise TuneError(f"{recording.path}: none of the models fits this graph")


def _startable(recording: Recording, texts: list[str]) -> None:
    """Whether a body starts with these settings: what is missing is told then, not at its first step."""
    from palpate.records.changed import changed

    graph = changed(recording, texts).graph
    spec = graph.nodes[body_of(graph)]
    spec.cls(**spec.settings).start()


def claim(recording: Recording, base: dict[str, Any]) -> float:
    """What the reference is off by [1]: `KNOWN`, and what its stored basis says of itself, its dents against the full
    model; 0 where nothing is known."""
    from palpate.records.changed import changed

    graph = changed(recording, Candidate(base).texts).graph
    spec = graph.nodes[body_of(graph)]
    if spec.cls is not ReducedFE:
        return 0.0
    try:
        node = ReducedFE(**spec.settings)
        key = node.key()
    except SettingError:
        return 0.0
    told = [about["error"] for about in shipped().values() if about["key"] == key]
    known = 0.0 if node.model == "sampled" else KNOWN
    return known + (float(told[0].get("mean", 0.0)) if told else 0.0)


def pick(measured: list[Candidate], goal: Goal) -> Candidate | None:
    """The most accurate that keeps the budget, or the cheapest that keeps the error; of both, the most accurate that
    keeps both. None: nothing does."""
    kept = [
        c
        for c in measured
        if not c.why and (goal.budget is None or c.p99 <= goal.budget) and (goal.error is None or c.error <= goal.error)
    ]
    if not kept:
        return None
    if goal.budget is None:
        return min(kept, key=lambda c: (c.p99, c.error))
    return min(kept, key=lambda c: (c.error, c.p99))


def cause(measured: list[Candidate], goal: Goal) -> str:
    """Why nothing keeps the budget, in words: another node that takes longer than it, or a machine on which more runs
    than it has cores. Empty where it is the error that nothing keeps, or nothing is known."""
    late = [c for c in measured if not c.why and (goal.error is None or c.error <= goal.error)]
    if goal.budget is None or not late:
        return ""
    name, took = min((c.slowest for c in late), key=lambda own: own[1])
    if took > goal.budget:
        return (
            f"Node {name!r} alone takes {1e6 * took:.0f} us (p50 of its steps), whatever the body is: give a larger "
            "budget, or tune the graph without it."
        )
    why = busy(own=1.0)
    return f"{why}, which is the likely cause. Tune again when it is quiet." if why else ""


def write(launch: LaunchFile, chosen: dict[str, Any], told: list[str], path: Path) -> None:
    """A launch file of the choice, its reasons as comments at its head."""
    content: dict[str, Any] = {"graph": str(launch.graph.resolve())}
    if isinstance(launch.scene, Path):
        content["scene"] = str(launch.scene.resolve())
    elif launch.scene is not None:
        content["scene"] = launch.scene
    for name in ("clock", "duration"):
        if getattr(launch, name) is not None:
            content[name] = getattr(launch, name)
    own = [str(o) for o in launch.overrides if isinstance(o, str)]
    content["set"] = {k: yaml.safe_load(v) for k, _, v in (o.partition("=") for o in own)} | chosen
    head = "".join(f"# {line}\n" for line in told)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(head + yaml.safe_dump(content, sort_keys=False, allow_unicode=True), encoding="utf-8")


def kept(
    launch: LaunchFile, chosen: Candidate, base: dict[str, Any], goal: Goal, folder: Path, report: Callable[[], None]
) -> Candidate:
    """The choice, run: what came of it, measured on the touch as it is felt with it."""
    graph = launch.load()
    body = body_of(graph)
    usual = {f"{body}.every": 1, "scene.surface.vertices": graph.nodes[body].settings.get("vertices")}
    back = {key: value for key, value in usual.items() if key in chosen.overrides} | base
    recording = touched(launch.but(overrides=chosen.texts), folder / "tuned.mcap")
    report()
    _, variant = compare(recording, [[]], reference=Candidate(back).texts)
    return judged(chosen, variant, goal, claim(recording, back))
