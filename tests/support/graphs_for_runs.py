"""A small graph of processes for the tests of the launcher: five nodes in a loop, one logger."""

import os
import signal
from collections.abc import Callable
from pathlib import Path

import nodes_for_runs  # noqa: F401  a recording of these graphs imports nothing that is not imported already

from palpate.launch.run.launcher import Launcher

GRAPH = """
nodes:
  source: {use: nodes_for_runs.Source, in: {torque: sum}}
  spring: {use: nodes_for_runs.Spring, in: {pose: source}}
  drag:   {use: nodes_for_runs.Drag, in: {pose: source, force: spring}}
  spread: {use: nodes_for_runs.Spread, in: {force: spring, friction: drag}}
  sum:    {use: nodes_for_runs.Sum, in: {load: spread, friction: drag}}
  log:    {use: logger.Mcap, in: all}
"""
NODES = ("source", "spring", "drag", "spread", "sum")


def write_graph(folder: Path, text: str = GRAPH) -> Path:
    """The graph as a file."""
    path = folder / "loop.yaml"
    path.write_text(text)
    return path


def write_place(folder: Path, groups: list[list[str]]) -> Path:
    """A placement with these groups; the logger runs apart."""
    path = folder / "place.yaml"
    path.write_text("\n".join(f"g{i}: {{nodes: [{', '.join(g)}]}}" for i, g in enumerate(groups)))
    return path


def until_it_is_back(node: str, steps: int = 60) -> Callable[[Launcher], None]:
    """A `watch` that interrupts a run so many steps after a node has died and was started again."""
    died: list[int] = []
    asked: list[int] = []

    def watch(running: Launcher) -> None:
        health = running.result.health
        if running.result.deaths and not died:
            died.append(max(told["tick"] for told in health.values()))
        if died and not asked and health[node]["tick"] > died[0] and health[node]["steps"] >= steps:
            asked.append(health[node]["tick"])
            os.kill(os.getpid(), signal.SIGINT)

    return watch
