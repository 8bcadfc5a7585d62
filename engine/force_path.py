"""What the hand has to wait for: the nodes between the outputs of what keeps the time and its inputs."""

from __future__ import annotations

from collections.abc import Iterable

from palpate.engine.plan import Plan


def force_path(plan: Plan) -> set[str]:
    """The nodes between the paced nodes' outputs and their inputs: what the hand has to wait for."""
    after: dict[str, set[str]] = {name: set() for name in plan.order}
    for name in plan.order:
        for edge in plan.edges[name]:
            after[edge.producer].add(name)
    before = {name: {edge.producer for edge in plan.edges[name]} for name in plan.order}
    paced = [name for name in plan.order if plan.graph.nodes[name].cls.paced]
    return _reach(paced, after) & _reach(paced, before) | set(paced)


def _reach(start: Iterable[str], ways: dict[str, set[str]]) -> set[str]:
    reached: set[str] = set()
    left = list(start)
    while left:
        for name in ways[left.pop()] - reached:
            reached.add(name)
            left.append(name)
    return reached
