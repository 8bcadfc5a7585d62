"""What a fingertip feels on soft tissue, from Python.

    import palpate

    run = palpate.run("kidney", tissue="deformation.ReducedFE", duration=2.0)
    run.contact.force.max()                    # [N]; a numpy array that knows its unit and its times
    for tick in palpate.steps("kidney"): ...   # the same, tick by tick
    palpate.open("run.mcap").plot("contact.force", "tissue.indentation")
    palpate.Study("kidney", over={"tissue.stiffness": [2e3, 4e3]}).run("out/").table()      # many runs, on many cores
    palpate.Ensemble("kidney", 256, {"tissue.stiffness": stiffness}).run()      # many runs at once in this process

Public are the names in `__all__` here, and the packages `palpate.physics` (formulas), `palpate.models.fe` (finite
elements), `palpate.messages` and `palpate.nodes` (for nodes of one's own). This file imports nothing before it is
needed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from palpate.calling import run
    from palpate.ensemble import Ensemble
    from palpate.physics.errors import PalpateError
    from palpate.records.samples import RecordedStream, Samples
    from palpate.stepping import Tick
    from palpate.studies.sweeps.study import Study
    from palpate.views.run import Comparison, Run

__all__ = [
    "Comparison", "Ensemble", "PalpateError", "RecordedStream", "Run", "Samples", "Study", "Tick", "compare", "open",
    "run", "steps",
]  # fmt: skip

_HOMES = {
    "Comparison": "palpate.views.run",
    "Ensemble": "palpate.ensemble",
    "PalpateError": "palpate.physics.errors",
    "Run": "palpate.views.run",
    "Samples": "palpate.records.samples",
    "RecordedStream": "palpate.records.samples",
    "Study": "palpate.studies.sweeps.study",
    "Tick": "palpate.stepping",
    "run": "palpate.calling",
}


def steps(
    graph: str | Path = "kidney",
    *,
    duration: float | str | None = None,
    scene: str | None = None,
    sets: Sequence[str] = (),
    **nodes: str | Mapping[str, Any],
) -> Iterator[Tick]:
    """Run a graph tick by tick in this process, on simulated time; what it takes is what `run` takes.

    for tick in palpate.steps("kidney"):
        if tick.contact.force > 1.0:                  # [N] the last message of a node, by its name
            tick.set("tissue", stiffness=1e3)   # the node is started anew with other settings
            break

    Nothing is recorded. `break` ends the run.

    PalpateError: what is wrong with the graph, or which node failed.
    """
    from palpate.calling import described
    from palpate.stepping import Stepper, ticks

    return ticks(Stepper(described(graph, duration=duration, scene=scene, sets=sets, nodes=nodes)))


def compare(file: str | Path | Run, *variants: Any, reference: Any = None) -> Comparison:
    """Compute a recorded touch again with other models or settings: `compare("run.mcap", {"tissue":
    "deformation.Rigid"}, "tissue.stiffness=2e3")`. See `Run.compare`."""
    from palpate.views.run import Run

    return (file if isinstance(file, Run) else Run(file)).compare(*variants, reference=reference)


def open(file: str | Path, *, trust: Sequence[str] = ()) -> Run:
    """Open a recording. A file is data: besides palpate's classes it may use those that this program has imported,
    and modules of the packages in `trust`, which are imported.

    PalpateError: it is none, or there is no such file.
    """
    from palpate.engine import imports
    from palpate.views.run import Run

    imports.trust(*trust)
    return Run(file)


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        from importlib import import_module

        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'palpate' has no attribute {name!r}; public: {', '.join(__all__)}")


def __dir__() -> list[str]:
    return sorted({*__all__, "physics", "models", "messages", "nodes"})
