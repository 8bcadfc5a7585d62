"""One point of a study: its run, its kept results, and the process that computes points one after another.

The separate process computes with pinned arithmetic, independent of the imports of the calling program. It can be
killed if a point takes too long, and the study survives if a point crashes it.
"""

import contextlib
import hashlib
import os
import platform
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from palpate.compiler import arithmetic, kernel_cache
from palpate.engine.faults import GraphError, Location
from palpate.engine.graph import Graph
from palpate.engine.imports import full_name
from palpate.launch.load.classes import catalogue
from palpate.launch.load.files import Override
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.load.placement import FUSED
from palpate.launch.load.recording import set_recording
from palpate.launch.load.values.source import YamlSource
from palpate.launch.run.descendants import die_with_parent
from palpate.launch.run.execute import execute
from palpate.launch.run.lanes import Preparation
from palpate.launch.run.notes import RunNote, first_of_each_kind
from palpate.launch.run.work.compiling import compiling
from palpate.nodes.logger import Mcap
from palpate.physics.errors import ArgumentError, PalpateError
from palpate.physics.writable import locked
from palpate.studies.sweeps import lane as lanes
from palpate.studies.sweeps.keep import Kept, Streams
from palpate.views.run import Run

ROOMS = ("palpate.physics", "palpate.models.fe", "palpate.messages", "palpate.nodes", "palpate.engine")
"""Packages whose code determines the results: an edit to one of them changes the keys of all points."""
IDLE = 600.0  # [s] The process ends after this time without a point


@dataclass(frozen=True)
class Point:
    """A point to compute.

    slot       number of its row and of its curves
    key        hash of everything that its results depend on
    values     value of each path of `over`
    labels     the same for tables
    recording  file of the recording; None: not kept
    """

    slot: int
    key: str
    values: dict[str, Any]
    labels: dict[str, Any]
    recording: Path | None = None


@dataclass(frozen=True)
class Task:
    """The part that all points of a study share.

    launch    the run without the variations
    keep      kept results
    about     versions and arithmetic, see `fingerprint`
    limit     timeout of a point [s]; None: no timeout
    extremes  of the values of each path, see `launch.run.lanes.extremes`
    """

    launch: LaunchFile
    keep: tuple[Kept, ...]
    about: dict[str, str]
    limit: float | None
    extremes: Mapping[str, tuple[float, ...]] = field(default_factory=dict)

    def run(self, values: Mapping[str, Any], record: Path | None = None) -> LaunchFile:
        """The run with these values by path, in one process."""
        return self.launch.but(overrides=overrides(values), place=FUSED, clock="simulated", record=record)

    @cached_property
    def preparation(self) -> Preparation:
        """Prepares its points for a lane."""
        return lanes.preparation(self.run, self.keep, self.extremes)


@dataclass
class Computed:
    """Results of a point.

    numbers  numbers by the text of the kept result
    curves   times [s] and values by the text of the kept result
    notes    lines for the user, the first of each kind
    error    why the point has no results; "" if it has
    seconds  duration [s], without compilation
    lost     why the study must stop, such as a full disk; "" if it can continue
    """

    numbers: dict[str, float] = field(default_factory=dict)
    curves: dict[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)
    notes: list[RunNote] = field(default_factory=list)
    error: str = ""
    seconds: float = 0.0
    lost: str = ""


def fingerprint() -> dict[str, str]:
    """Versions and arithmetic: together with the graph they determine the bytes of the results."""
    sources = {"sources of palpate": kernel_cache.key(ROOMS), "python": platform.python_version()}
    return sources | arithmetic.in_force(here=False)


def overrides(values: Mapping[str, Any], key: str = "over") -> list[Override]:
    """The overrides of a point; faults in them are attributed to this key of the study."""
    return [
        Override(tuple(path.split(".")), YamlSource(value, {(): Location(f"{key} {path}")}))
        for path, value in values.items()
    ]


def compute(task: Task, point: Point, begins: Callable[[], None] = lambda: None) -> Computed:
    """Run a point in this process.

    `begins` is called repeatedly while this or another process compiles kernels, and once more when all are compiled;
    the time before that call does not count.
    """
    since = time.monotonic()

    def ready() -> None:
        nonlocal since
        begins()
        since = time.monotonic()

    try:
        done = _as_lane(task, point, ready) or _recorded(task, point, ready)
    except OSError as error:
        return Computed(lost=f"{error.filename or point.recording}: {error.strerror or error}")
    except GraphError as error:
        done = Computed(error=" ".join(str(error).split()))
    except PalpateError as error:
        done = Computed(error=str(error))
    except Exception as error:
        done = Computed(error=f"{type(error).__name__}: {error}")
    return replace(done, seconds=time.monotonic() - since)


def _as_lane(task: Task, point: Point, ready: Callable[[], None]) -> Computed | None:
    """Run a point as a lane. None: it keeps a recording, or not all its nodes are compiled, or it fails."""
    if point.recording is not None or not task.keep or task.launch.duration is None:
        return None
    try:
        lane = task.preparation(point.values)
    except ArgumentError:
        return None
    _warm(task.run(point.values), lane.graph, ready)
    ran = lanes.run(lane, max(1, round(task.launch.duration * lane.job.rate)), task.keep, ready)
    return None if ran is None else _kept(task, *ran)


def _recorded(task: Task, point: Point, ready: Callable[[], None]) -> Computed:
    """Run a point with a recording."""
    with tempfile.TemporaryDirectory(prefix="palpate-point-") as folder:
        file = Path(folder) / "point.mcap" if point.recording is None else point.recording.with_suffix(".part")
        launch = task.run(point.values, file)
        graph = launch.load()
        if point.recording is None:
            _only(graph, file, {one.stream for one in task.keep})
        _warm(launch, graph, ready)
        ready()
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
        done = _kept(task, Run(file), outcome.notes)
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


def _kept(task: Task, run: Run | Streams, notes: Sequence[RunNote]) -> Computed:
    done = Computed(notes=list(first_of_each_kind(notes)))
    for one in task.keep:
        if one.how == "curve":
            done.curves[one.text] = one.values(run)
        else:
            done.numbers[one.text] = one.number(run)
    return done


_warmed: set[str] = set()  # Sets of classes whose kernels this process has loaded


def _warm(launch: LaunchFile, graph: Graph, begins: Callable[[], None]) -> None:
    """Compile the kernels of the graph once per machine: the other processes wait for the first."""
    classes = hashlib.sha256(" ".join(sorted(full_name(spec.cls) for spec in graph.nodes.values())).encode())
    name = f"warm-{classes.hexdigest()[:16]}"
    folder = kernel_cache.folder()
    if name in _warmed:
        return
    _warmed.add(name)
    process = os.getpid()  # a forked child also compiles, but must not call `begins`
    with open(folder / "warm.lock", "a") as lock:
        while not locked(lock):
            begins()
            time.sleep(0.1)
        if not (folder / name).exists():
            first = launch.load()
            with compiling(lambda count: begins() if os.getpid() == process else None):
                execute(replace(launch, record=None, duration=1.0 / first.rate), first)
            (folder / name).touch()


def main() -> None:
    """Serve points on the connection whose file descriptor is in `argv`, until it closes or is idle for `IDLE`. A
    message is a task, or None for the last one, and a point."""
    die_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    task: Any = None
    with Connection(int(sys.argv[1])) as link:
        with contextlib.suppress(Exception):
            catalogue()  # imports all shipped nodes while the study is still being loaded
        link.send(fingerprint())
        try:
            while link.poll(IDLE):
                given, point = link.recv()
                task = given or task
                link.send(compute(task, point, lambda: link.send(None)))
        except EOFError:
            pass
