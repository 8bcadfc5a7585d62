"""One run from its launch file to its result: plan, place, start, watch, record."""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
from rich.console import Console

from palpate.launch.loading.faults import Faults, choices
from palpate.launch.loading.graph import Graph, NodeSpec
from palpate.launch.loading.launchfile import LaunchFile
from palpate.launch.loading.plan import Plan, plan
from palpate.launch.running.about import about
from palpate.launch.running.fused import run_fused
from palpate.launch.running.jobs import is_here, jobs
from palpate.launch.running.launcher import Launcher
from palpate.launch.running.nursery import Nursery
from palpate.launch.running.result import Result
from palpate.launch.running.screen import Screen
from palpate.nodes.logger import Mcap

PATIENCE = 5.0  # [s] after which a silent worker counts as hung


@dataclass
class Outcome:
    """A run that has ended: its plan, its result and its recording (None: not recorded)."""

    plan: Plan
    result: Result
    recording: Path | None


def execute(
    launch: LaunchFile,
    *,
    console: Console | None = None,
    nursery: Nursery | None = None,
    patience: float = PATIENCE,
    address: str | None = None,
    leave_out: Sequence[str] = (),
    thin: Mapping[str, int] | None = None,
) -> Outcome:
    """Run a launch file to its end.

    console   draws the live view there; None: silent
    nursery   a fork server that is starting already
    patience  [s] without a sign of life after which a node counts as hung
    address   `tcp://host:port` where workers of other machines find the launcher
    leave_out, thin  streams not to record, or only each n-th message of

    GraphError: what is wrong with the graph; nothing was started. OSError: an address that is taken.
    """
    graph = launch.load()
    set_recording(graph, launch.record, leave_out, thin)
    found = plan(graph)
    place = launch.placement(found)
    clock = launch.clock or "simulated"
    ticks = None if launch.duration is None else max(1, round(launch.duration * graph.rate))
    told = about(found, clock=clock, pace=launch.pace, ticks=ticks, groups={g.name: g.nodes for g in place.groups})
    work = jobs(found, place, clock=clock, ticks=ticks, pace=launch.pace, about=told)
    if launch.record is not None:
        _check_writable(launch.record)
    joined = frozenset(group.name for group in place.groups if group.join or not is_here(group.host))
    if joined:
        if address is None:
            raise OSError(
                f"group {min(joined)!r} is started by hand: say where it finds this launcher, --address tcp://HOST:PORT"
            )
        here = address.removeprefix("tcp://").rpartition(":")[0]
        work = [job if job.host else msgspec.structs.replace(job, host=here) for job in work]
    title = (launch.path or launch.graph).stem
    names = [*found.order, *found.observers]
    screen = Screen(console, title, graph.rate, ticks, names) if console is not None else None
    with screen or contextlib.nullcontext():
        if len(work) == 1 and clock == "simulated" and not joined:
            if nursery is not None:
                nursery.close()
            result = run_fused(work[0], screen.show if screen else lambda _: None, patience)
        else:
            launcher = Launcher(
                work,
                nursery,
                joined=joined,
                address=address,
                patience=patience,
                restart=frozenset(name for name in found.order if graph.nodes[name].restart),
                show=(lambda it: screen.show(it.result, it.phase, it.busy)) if screen else lambda _: None,
                printed=screen.print if screen else lambda _: None,
                died=screen.died if screen else lambda _: None,
            )
            result = launcher.run()
    result.health = {name: result.health[name] for name in names if name in result.health}
    return Outcome(found, result, launch.record)


def _check_writable(file: Path) -> None:
    """OSError: the recording cannot be written there."""
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        if file.is_dir():
            raise IsADirectoryError(errno.EISDIR, "this is a folder, expected the name of a file")
        if not os.access(file if file.exists() else file.parent, os.W_OK):
            raise PermissionError(errno.EACCES, "no permission to write there")
    except OSError as error:
        raise OSError(f"recording {file}: {error.strerror}; --record FILE takes another place") from None


def set_recording(
    graph: Graph, file: Path | None, leave_out: Sequence[str] = (), thin: Mapping[str, int] | None = None
) -> None:
    """The graph's logger writes to this file, with its own settings otherwise; one is added where there is none.
    Without a file the loggers are left out.

    leave_out, thin  streams not to record, or only each n-th message of; they come on top of what the graph says

    GraphError: a stream that the graph does not have.
    """
    loggers = [spec for spec in graph.nodes.values() if issubclass(spec.cls, Mcap)]
    if file is None:
        for spec in loggers:
            spec.off = spec.off or "no recording was asked for (--record FILE)"
        return
    if not loggers:
        name = next(n for n in ("log", "palpate-log", "palpate-log-2") if n not in graph.nodes)
        loggers = [NodeSpec(name=name, use="logger.Mcap", cls=Mcap, settings={}, listen=None)]
        graph.nodes[name] = loggers[0]
    for spec in loggers[1:]:
        spec.off = spec.off or f"{loggers[0].name!r} writes the recording"
    own = loggers[0].settings
    given = {"leave_out": [*own.get("leave_out", ()), *leave_out], "thin": {**own.get("thin", {}), **(thin or {})}}
    faults = Faults()
    for key, names in given.items():
        for stream in names:
            if stream not in graph.streams:
                faults.add(f"{key}: there is no stream {stream!r}", choices("Streams", stream, graph.streams),
                           loggers[0].place, node=loggers[0].name)  # fmt: skip
    faults.done()
    loggers[0].settings = {**own, **given, "path": str(file.absolute())}
    loggers[0].off = None
