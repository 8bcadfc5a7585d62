"""Computes what the nodes of several processes use, once, in the process from which these are forked."""

import contextlib
import sys

from palpate.engine.graph import Graph


def share_surfaces(graph: Graph) -> None:
    """Make the meshes of a graph and the surfaces that a finger can touch, which later calls in this process and its
    forks return. A fault is reported by the worker, which meets it too."""
    if "palpate.nodes.base.surface" not in sys.modules:  # imports the compiler, and no node of the graph needs it
        return
    from palpate.nodes.base.felt import WithWidth, felt_part, felt_surface
    from palpate.nodes.base.surface import OnSurface

    for spec in graph.nodes.values():
        if issubclass(spec.cls, OnSurface):
            with contextlib.suppress(Exception):
                node = spec.cls(**spec.settings)
                node.mesh()
                if isinstance(node, WithWidth):
                    felt_surface(node, node.width)
                    felt_part(node)
