"""Haptics on soft tissue: run graphs, and read and compare recordings from Python.

    import palpate

    run = palpate.run("kidney", tissue="deformation.ReducedFE", duration=2.0)
    run.contact.force.max()                    # [N]; a numpy array with its unit and times
    for tick in palpate.steps("kidney"): ...   # the same, tick by tick
    palpate.open("run.mcap").plot("contact.force", "tissue.indentation")
    palpate.Study("kidney", over={"tissue.stiffness": [2e3, 4e3]}).run("out/").table()      # many runs on all cores
    palpate.Ensemble("kidney", 256, {"tissue.stiffness": stiffness}).run()      # many runs in parallel in this process
    palpate.gradient("kidney", ["tissue.stiffness"], sets=["scene.hand.ideal=true"])    # d(force)/d(stiffness)

The public API is `__all__` here and in the packages `palpate.messages` and `palpate.nodes` (for custom nodes),
`palpate.physics` (laws), `palpate.models.fe` (finite elements) and `palpate.gym`. Everything else is internal and may
change. Each name is imported on first use.
"""

from __future__ import annotations

import os as _os
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from palpate.calling import run
    from palpate.ensemble import Ensemble, gradient
    from palpate.physics.errors import PalpateError, PalpateWarning
    from palpate.records.samples import RecordedStream, Samples
    from palpate.stepping import Tick
    from palpate.studies.sweeps.study import Study
    from palpate.views.run import Comparison, Run

# A checkout without symbolic links, as on Windows, has text files in place of the links to folders at the top.
if _os.path.isfile(_os.path.join(__path__[0], "nodes")):
    __path__.append(_os.path.dirname(_os.path.dirname(__path__[0])))

__all__ = [
    "Comparison", "Ensemble", "PalpateError", "PalpateWarning", "RecordedStream", "Run", "Samples", "Study", "Tick",
    "compare", "gradient", "open", "run", "steps",
]  # fmt: skip

_HOMES = {
    "Comparison": "palpate.views.run",
    "Ensemble": "palpate.ensemble",
    "gradient": "palpate.ensemble",
    "PalpateError": "palpate.physics.errors",
    "PalpateWarning": "palpate.physics.errors",
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
    organ: str | Path | Mapping[str, Any] | None = None,
    sets: Sequence[str] = (),
    **nodes: str | Mapping[str, Any],
) -> Iterator[Tick]:
    """Run a graph tick by tick in this process on simulated time. The arguments are those of `run`.

    for tick in palpate.steps("kidney"):
        if tick.contact.force > 1.0:            # [N]; field of the last message of node `contact`
            tick.set("tissue", stiffness=1e3)   # restarts the node with the new setting
            break

    Nothing is recorded. `break` ends the run.

    PalpateError: the graph is invalid, or a node failed.
    """
    from palpate.launch.load.arguments import describe_run
    from palpate.stepping import Stepper, ticks

    return ticks(Stepper(describe_run(graph, duration=duration, scene=scene, sets=sets, nodes=nodes, organ=organ)))


def compare(file: str | Path | Run, *variants: Any, reference: Any = None) -> Comparison:
    """Recompute a recording with other models or settings: `compare("run.mcap", {"tissue": "deformation.Rigid"},
    "tissue.stiffness=2e3")`. See `Run.compare`."""
    from palpate.views.run import Run

    return (file if isinstance(file, Run) else Run(file)).compare(*variants, reference=reference)


def open(file: str | Path, *, trust: Sequence[str] = ()) -> Run:
    """Open a recording. Files are untrusted: one may use palpate's classes, classes that this program has imported, and
    modules of the packages in `trust`, which are imported.

    PalpateError: the file is missing or is not a recording.
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
