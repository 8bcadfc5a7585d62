"""Builds the bases of ReducedFE that a graph lacks, before it runs from the shell or from Python."""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any

from palpate.engine.graph import Graph
from palpate.launch.load.launchfile import LaunchFile
from palpate.nodes.base import SettingError
from palpate.physics.errors import PalpateError

if TYPE_CHECKING:
    from palpate.models.build.basis import Begin

PARTS = ("surface", "organ", "nodule", "capsule")
"""Parts of a scene that a basis depends on."""


def build_missing(graph: Graph, quiet: bool = False, begin: Begin | None = None) -> None:
    """Build and store each condensed basis that a running node of the graph needs and that is not stored, with progress
    on standard error, or with `begin`. Bases of `model: sampled` and of the fingertip take minutes and remain `palpate
    build basis`.

    SettingError: a basis cannot be built.
    """
    wanted = _missing(graph)
    if not wanted:
        return
    from palpate.launch.run.progress import StageBars
    from palpate.models.build.on_demand import build

    with StageBars(quiet or begin is not None) as bars:
        for node in wanted:
            build(node, begin or bars.begin)


def build_for_each(
    launched: Callable[[Mapping[str, Any]], LaunchFile],
    points: Iterable[Mapping[str, Any]],
    quiet: bool,
    report: Callable[[str], None] | None = None,
) -> None:
    """`build_missing` for the graphs of many points. A point whose graph is invalid reports it when it is loaded again.

    launched  the run with values by path
    points    values of each point by path
    report    called with the reason why a basis cannot be built; None: SettingError
    """
    kept: Callable[[str], bool] | None = None
    seen: set[str] = set()
    for values in points:
        # load only the first of the points whose values agree in all that a basis depends on
        if kept is not None:
            key = repr([values[path] for path in values if kept(path)])
            if key in seen:
                continue
            seen.add(key)
        graph = None
        with contextlib.suppress(PalpateError):
            graph = launched(values).load()
        if kept is None and graph is not None:
            kept = _depends(graph, values)
            seen.add(repr([values[path] for path in values if kept(path)]))
        try:
            if graph is not None:
                build_missing(graph, quiet)
        except SettingError as error:
            if report is None:
                raise
            report(str(error))


@functools.cache
def depends(path: str) -> bool:
    """Whether a basis may depend on a path of an override."""
    from palpate.nodes.deformation.reduced_fe import BUILT_FROM, NODULE

    parts = path.split(".")
    return parts[-1] in {"use", *BUILT_FROM, *NODULE} or any(part in PARTS for part in parts)


def _depends(graph: Graph, paths: Iterable[str]) -> Callable[[str], bool]:
    """Whether a basis of this graph, or of one that differs in the values of these paths, depends on a path. Place and
    turn of an organ matter only with a nodule."""
    bodies = [spec for spec in graph.nodes.values() if hasattr(spec.cls, "bases")]
    if not bodies and not any(path.endswith(".use") for path in paths):
        return lambda path: False
    if not bodies or any("nodule" in path for path in paths) or any(b.settings.get("nodule_radius") for b in bodies):
        return depends
    return lambda path: path.split(".")[-1] not in ("position", "rotation") and depends(path)


def _missing(graph: Graph) -> list[Any]:
    """The bodies of a graph whose bases are not stored, one for each basis."""
    wanted = {}
    for spec in graph.nodes.values():
        made: Any = spec.cls(**spec.settings) if spec.off is None and hasattr(spec.cls, "bases") else None
        if made is None:
            continue
        from palpate.nodes.deformation.basis_store import SHIPPED, cache, find

        with contextlib.suppress(PalpateError):  # the plan reports it with its place
            for node in made.bases():
                short, key = node.model != "sampled" and node.surface != "fingertip", node.key()
                if short and not any(find(folder, key) for folder in (SHIPPED, cache())):
                    wanted[key] = node
    return list(wanted.values())
