"""What a fingertip feels on soft tissue, from Python.

    import palpate

    run = palpate.run("kidney", tissue="deformation.ReducedFE", duration=2.0)
    run.contact.force.max()                    # [N]; a numpy array that knows its unit and its times
    palpate.open("run.mcap").plot("contact.force", "tissue.indentation")

Public are the names in `__all__` here, and the packages `palpate.physics` (formulas), `palpate.fe` (finite elements),
`palpate.messages` and `palpate.nodes` (for nodes of one's own). This file imports nothing before it is needed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from palpate.launch.recording.samples import Run, Samples, Stream
    from palpate.physics.errors import PalpateError

__all__ = ["PalpateError", "Run", "Samples", "Stream", "open", "run"]

_HOMES = {
    "PalpateError": "palpate.physics.errors",
    "Run": "palpate.launch.recording.samples",
    "Samples": "palpate.launch.recording.samples",
    "Stream": "palpate.launch.recording.samples",
}


def run(
    graph: str | Path = "kidney",
    *,
    record: str | Path | None = None,
    duration: float | str | None = None,
    scene: str | None = None,
    clock: str | None = None,
    sets: Sequence[str] = (),
    **nodes: str | Mapping[str, Any],
) -> Run:
    """Run a graph to its end and open its recording; `palpate run` does the same from the shell.

    graph     launch file or graph: one that ships, or a path
    record    file of the recording; left out: a new one below runs/
    duration  [s] of the graph's clock, or a text with a unit
    scene     in place of the graph's own
    clock     simulated or real
    sets      single values as after `--set`: "tissue.stiffness=2e3"
    nodes     what a node is: a model, tissue="deformation.ReducedFE", or settings, tissue={"stiffness": 2e3}

    PalpateError: what is wrong with the graph, or which node failed. OSError: the recording cannot be written.
    """
    from palpate.launch.calling import run_and_open

    return run_and_open(graph, record=record, duration=duration, scene=scene, clock=clock, sets=sets, nodes=nodes)


def open(file: str | Path) -> Run:
    """Open a recording. PalpateError: it is none, or there is no such file."""
    from palpate.launch.recording.samples import Run

    return Run(file)


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        from importlib import import_module

        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'palpate' has no attribute {name!r}; public: {', '.join(__all__)}")


def __dir__() -> list[str]:
    return sorted({*__all__, "physics", "fe", "messages", "nodes"})
