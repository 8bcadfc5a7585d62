"""Compute a point of a study as `palpate run` does, with a recording."""

import hashlib
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from palpate.compiler import kernel_cache
from palpate.engine.graph import Graph
from palpate.engine.imports import full_name
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.load.recording import set_recording
from palpate.launch.run.execute import execute
from palpate.launch.run.tasks.task import Beat
from palpate.launch.run.work.compiling import compiling
from palpate.nodes.logger import Mcap
from palpate.physics.scratch import ScratchFolder
from palpate.physics.writable import lock_file
from palpate.studies.sweeps.keep import Kept
from palpate.studies.sweeps.point import Computed, Point, kept_of
from palpate.views.run import Run


def record_point(
    launched: Callable[[Mapping[str, Any], Path], LaunchFile], keep: Sequence[Kept], point: Point, beat: Beat
) -> Computed:
    """Run a point with a recording.

    launched  the run with values by path, and its recording
    beat      called while kernels are compiled, and at the start
    """
    with ScratchFolder("point") as folder:
        file = Path(folder) / "point.mcap" if point.recording is None else point.recording.with_suffix(".part")
        launch = launched(point.values, file)
        graph = launch.load()
        if point.recording is None:
            _only(graph, file, {one.stream for one in keep})
        warm(launch, graph, beat)
        beat()
        outcome = execute(launch, graph)
        # A failed logger stops the study; a failure of another node is the error of the point.
        died = {death.node: str(death) for death in outcome.result.deaths}
        loggers = {name for name in died if issubclass(graph.nodes[name].cls, Mcap)}
        if died and not loggers:
            return Computed(error=next(iter(died.values())))
        if loggers:
            return Computed(lost=died[loggers.pop()])
        if not outcome.ok:
            return Computed(lost="; ".join(outcome.result.notes) or f"{file}: the recording is not whole")
        done = kept_of(keep, Run(file), outcome.notes)
        if point.recording is not None:
            file.replace(point.recording)
        return done


def _only(graph: Graph, file: Path, streams: set[str]) -> None:
    """Record only these streams, completely; nodes that they do not depend on do not run."""
    set_recording(graph, file)
    graph.wanted = tuple(sorted(streams))
    for spec in graph.nodes.values():
        if issubclass(spec.cls, Mcap) and spec.off is None:
            spec.listen = graph.wanted


_warmed: set[str] = set()  # Sets of classes whose kernels this process has loaded


def warm(launch: LaunchFile, graph: Graph, beat: Beat) -> None:
    """Compile the kernels of the graph once per machine: the other processes wait for the first."""
    classes = hashlib.sha256(" ".join(sorted(full_name(spec.cls) for spec in graph.nodes.values())).encode())
    name = f"warm-{classes.hexdigest()[:16]}-{kernel_cache.key()}"
    folder = kernel_cache.folder()
    if name in _warmed:
        return
    _warmed.add(name)
    process = os.getpid()  # a forked child also compiles, but must not call `beat`
    with open(folder / "warm.lock", "a") as lock:
        while not lock_file(lock):
            beat()
            time.sleep(0.1)
        if not (folder / name).exists():
            first = launch.load()
            with compiling(lambda count: beat() if os.getpid() == process else None):
                execute(replace(launch, record=None, duration=1.0 / first.rate), first)
            (folder / name).touch()
