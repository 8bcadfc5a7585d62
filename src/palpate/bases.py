"""Builds the bases of ReducedFE that a graph lacks, before it runs from the shell or from Python."""

import contextlib
from typing import Any

from palpate.engine.graph import Graph
from palpate.physics.errors import PalpateError


def build_missing(graph: Graph, quiet: bool = False) -> None:
    """Build and store each condensed basis that a running node of the graph needs and that is not stored, with progress
    on standard error. Bases of `model: sampled` and of the fingertip take minutes and remain `palpate build basis`.

    SettingError: a basis cannot be built.
    """
    wanted = {}
    for spec in graph.nodes.values():
        made: Any = spec.cls(**spec.settings) if spec.off is None and hasattr(spec.cls, "bases") else None
        if made is None:
            continue
        from palpate.nodes.deformation.basis_store import SHIPPED, cache

        with contextlib.suppress(PalpateError):  # the plan reports it with its place
            for node in made.bases():
                short = node.model != "sampled" and node.surface != "fingertip"
                if short and node.stored(SHIPPED, cache()) is None:
                    wanted[node.key()] = node
    if not wanted:
        return
    from palpate.launch.run.progress import StageBars
    from palpate.models.build.on_demand import build

    with StageBars(quiet) as bars:
        for node in wanted.values():
            build(node, bars.begin)
