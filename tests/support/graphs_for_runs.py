"""A small graph of processes for the tests of the launcher: five nodes in a loop, one logger."""

import os
import signal
import time
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
    """A placement with these groups; the logger has a separate process."""
    path = folder / "place.yaml"
    path.write_text("\n".join(f"g{i}: {{nodes: [{', '.join(g)}]}}" for i, g in enumerate(groups)))
    return path


def until_it_has(limit: float = 120.0, **counts: tuple[str, int]) -> Callable[[Launcher], None]:
    """A `watch` that ends a run gracefully when these counters of the nodes have reached their values, at the latest
    after `limit` [s] of running time; the test then reports what is missing."""
    left, looked = limit, time.monotonic()

    def watch(running: Launcher) -> None:
        nonlocal left, looked
        moment = time.monotonic()
        left, looked = left - min(moment - looked, 0.2), moment
        health = running.result.health
        if left < 0.0 or all(health.get(node, {}).get(name, 0) >= count for node, (name, count) in counts.items()):
            running.stop()

    return watch


def until_it_is_back(node: str, steps: int = 60) -> Callable[[Launcher], None]:
    """A `watch` that interrupts a run when a node that died and was restarted has made this number of steps."""
    printed = [0]
    began_anew: list[bool] = []
    asked: list[int] = []

    def watch(running: Launcher) -> None:
        printed.append(running.result.health.get(node, {}).get("steps", 0))
        if printed[-1] < printed[-2]:
            began_anew.append(True)
        if began_anew and not asked and printed[-1] >= steps:
            asked.append(printed[-1])
            os.kill(os.getpid(), signal.SIGINT)

    return watch
