"""One run from its launch file to its result: plan, place, start, watch, record."""

from __future__ import annotations

import contextlib
import json
import signal
import socket
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
from rich.console import Console

from palpate.compiler.cores import usable_cores
from palpate.engine.faults import Fault, GraphError
from palpate.engine.graph import Graph
from palpate.engine.job import Job
from palpate.engine.plan import Plan, force_path
from palpate.engine.provenance import about
from palpate.launch.load.dependencies import data_files
from palpate.launch.load.launchfile import SOURCES, LaunchFile
from palpate.launch.load.placement import APART, AUTO, Placement, auto
from palpate.launch.load.plan import plan
from palpate.launch.load.recording import record_sources, set_recording
from palpate.launch.run.assign import jobs, spared_nodes
from palpate.launch.run.notes import RunNote
from palpate.launch.run.result import Result, Verdict, verdict
from palpate.launch.run.screen import Screen, print_death
from palpate.launch.run.wire import keys
from palpate.launch.run.wire.addresses import LOOPBACK, has_unix_sockets
from palpate.launch.run.work.fused import run_fused
from palpate.physics.errors import RunError
from palpate.physics.writable import check_file
from palpate.records.format.claim import claim_file
from palpate.records.format.mcap_append import NOTES, append_metadata
from palpate.records.format.mcap_file import lacking

if TYPE_CHECKING:  # these modules need POSIX and are imported only for runs with several processes
    from palpate.launch.run.forkserver import ForkServer
    from palpate.launch.run.launcher import Launcher
    from palpate.launch.run.work.spawner import Spawner

PATIENCE = 5.0  # [s] after which a silent worker counts as hung
NOTABLE = 1.0  # [s] of a run from which on a faster placement is worth a note
FILES, FILES_EACH = 64, 6
"""Limit of open files: a base value plus a share per group. With 9 groups the launcher opens 33, a worker up to 60."""


@dataclass
class RunOutcome:
    """A finished run.

    recording  None: not recorded
    verdict    whether it kept its rate; None: simulated clock, or no paced node
    placed     the placement, as for `--place`
    """

    plan: Plan
    result: Result
    recording: Path | None
    verdict: Verdict | None = None
    placed: str = APART

    @property
    def notes(self) -> list[RunNote]:
        """All lines for the user, about the graph and then about the run."""
        given = (*self.plan.graph.notes, *self.result.notes)
        return [note if isinstance(note, RunNote) else RunNote(note) for note in given]

    @property
    def ok(self) -> bool:
        """Whether no node failed and the recording is complete."""
        return self.result.ok and not self.lacking

    @cached_property
    def lacking(self) -> str:
        """The missing part of the recording: its end, if the disk was full, or messages; empty if complete."""
        return lacking(self.recording) if self.recording is not None and self.result.ticks else ""

    def raise_signal(self) -> None:
        """Raise the signal that ended the run again, for its handler in this process (Ctrl-C: KeyboardInterrupt)."""
        if self.result.signal:
            signal.raise_signal(self.result.signal)


@dataclass(frozen=True)
class Network:
    """TCP settings of a run.

    address      `tcp://host:port` of the launcher, for workers on other machines
    unencrypted  do not encrypt TCP connections
    key_name     name of the key for a run with groups on other machines
    """

    address: str | None = None
    unencrypted: bool = False
    key_name: str = "rig"


def execute(
    launch: LaunchFile,
    graph: Graph | None = None,
    *,
    console: Console | None = None,
    forkserver: ForkServer | Spawner | None = None,
    patience: float = PATIENCE,
    network: Network = Network(),
    leave_out: Sequence[str] = (),
    thin: Mapping[str, int] | None = None,
    fit_cores: bool = False,
    step_times: Callable[[Plan], Mapping[str, float]] = lambda _: {},
    watch: Callable[[Launcher], None] = lambda _: None,
    force: bool = False,
) -> RunOutcome:
    """Run a launch file to its end.

    graph       the graph of the launch file, if already read
    console     for the live view; None: silent
    forkserver  what starts the workers, if it was made before
    patience    [s] without a heartbeat after which a node counts as hung
    network     TCP settings
    leave_out, thin  streams not to record, or to record every n-th message of
    fit_cores   on the real clock, without a placement: use `auto` if there are fewer cores than nodes on the force path
    step_times  returns the step time of each node [s], for `auto`
    watch       called about ten times a second with the launcher, if the run has one
    force       overwrite a file that is not a recording

    GraphError: faults of the graph; nothing was started. OSError: the address is in use, or the recording cannot be
    written. ArgumentError: the file of the recording has other content. RunError: another run writes it, or the key is
    missing.
    """
    # Load and plan the graph, with the logger that the launch file asks for.
    graph = graph or launch.load()
    set_recording(graph, launch.record, leave_out, thin)
    recorded = planned = plan(graph)
    clock = _clock(launch, planned)
    if launch.only == SOURCES and launch.record is not None:
        planned = record_sources(graph, clock)
    # More processes on the force path than cores wait for one another: 9 processes on 2 cores do not keep 1 kHz.
    crowded = fit_cores and launch.place is None and clock == "real"
    crowded = crowded and len(force_path(planned)) > len(usable_cores())
    times = step_times(planned) if crowded or launch.place == AUTO else {}
    place = auto(planned, times) if crowded else launch.placement(planned, times)
    ticks = None if launch.duration is None else max(1, round(launch.duration * graph.rate))
    joined = frozenset(group.name for group in place.groups if group.join or not _is_here(group.host))
    fused = len(place.groups) == 1 and clock == "simulated" and not joined
    work = _jobs(launch, recorded, planned, place, clock, ticks, fused, joined)
    if joined:
        work = _reachable(work, joined, network)
    elif not (fused or has_unix_sockets()):
        work = [msgspec.structs.replace(job, host=job.host or LOOPBACK) for job in work]
    # TCP is encrypted with the key of the rig if workers run on other machines, otherwise with a new one.
    key = _key(network, bool(joined))
    # Run in this process or in several.
    title = (launch.path or launch.graph).stem
    names = [*planned.order, *planned.observers]
    screen = Screen(console, title, graph.rate, ticks, names) if console is not None else None
    with _file(launch.record, force) as fresh, screen or contextlib.nullcontext():
        if fused:
            if forkserver is not None:
                forkserver.close()
            result = _in_this_process(work[0], screen, patience)
        else:
            address = network.address if joined else None
            result = _in_processes(work, planned, screen, forkserver, patience, watch, joined, address, key)
        if fresh and launch.record is not None and not result.ticks:
            launch.record.unlink(missing_ok=True)
    if crowded:
        result.notes.append(_crowded(place))
    result.health = {name: result.health[name] for name in names if name in result.health}
    if clock == "simulated" and not (fused or joined or launch.pace or result.interrupted) and result.ok:
        result.notes += faster_fused(result)
    kept = verdict(result, planned, ticks) if clock == "real" else None
    outcome = RunOutcome(planned, result, launch.record, kept, AUTO if crowded else str(launch.place or APART))
    if launch.record is not None and result.ticks and outcome.notes:
        _store_notes(launch.record, outcome.notes)
    return outcome


def _jobs(
    launch: LaunchFile, recorded: Plan, planned: Plan, place: Placement, clock: str, ticks: int | None, fused: bool,
    joined: frozenset[str],
) -> list[Job]:  # fmt: skip
    """The jobs of the workers, with the provenance for the recording.

    recorded, planned  the plan before and after the nodes were removed whose messages a replay computes
    """
    groups = {group.name: group.nodes for group in place.groups}
    more: dict[str, Any] = {}
    if planned is not recorded:
        more["checked"] = {s: sorted(names) for s, names in planned.wanted.items()}
    if files := data_files(recorded.graph):
        more["files"] = files
    provenance = about(recorded, here=fused, clock=clock, pace=launch.pace, ticks=ticks, groups=groups, **more)
    return jobs(planned, place, clock=clock, ticks=ticks, pace=launch.pace, about=provenance, joined=joined)


def _crowded(place: Placement) -> str:
    groups_by = "; ".join(f"{group.name}: {group.why}" for group in place.groups)
    return (
        f"placed as --place {AUTO} ({groups_by}), as there are fewer cores than nodes on the force path; "
        f"--place {APART}: a process for each"
    )


def _store_notes(recording: Path, notes: Sequence[RunNote]) -> None:
    """Add the notes to a recording, unless it lacks its end."""
    with contextlib.suppress(OSError, ValueError):
        append_metadata(recording, NOTES, {"notes": json.dumps([[n.text, n.node, n.time] for n in notes])})


def faster_fused(result: Result) -> list[str]:
    """A note if a run on simulated time in several processes would take less than half the time in one process, which
    needs only the steps of the nodes and observers."""
    seconds = sum(health["steps"] * health["step"]["mean"] for health in result.health.values())
    if result.wall < NOTABLE or seconds > 0.5 * result.wall:
        return []
    return [f"--fused gives the same bytes in about {max(seconds, 0.1):.1f} s instead of {result.wall:.1f} s"]


def _in_this_process(work: Job, screen: Screen | None, patience: float) -> Result:
    numba = sys.modules.get("numba")  # not imported by nodes in Python
    interpreted = numba is not None and numba.config.DISABLE_JIT
    limit = None if interpreted else patience  # kernels in Python are slow, and may stop at a breakpoint
    if screen is None:
        return run_fused(work, patience=limit)

    def starting(node: str, kernels: int) -> None:
        screen.show(Result(), "starting", {"": node}, kernels)

    return run_fused(work, screen.show, limit, starting, screen.print)


def _in_processes(
    work: list[Job],
    planned: Plan,
    screen: Screen | None,
    forkserver: ForkServer | Spawner | None,
    patience: float,
    watch: Callable[[Launcher], None],
    joined: frozenset[str],
    address: str | None,
    key: keys.Key | None,
) -> Result:
    from palpate.launch.run.launcher import Launcher, silent

    _open_files(len(work))

    def show(launcher: Launcher) -> None:
        watch(launcher)
        if screen:
            screen.show(launcher.result, launcher.phase, launcher.busy, launcher.kernels)

    launcher = Launcher(
        work,
        forkserver,
        joined=joined,
        address=address,
        key=key,
        patience=patience,
        restart=frozenset(name for name in planned.order if planned.graph.nodes[name].restart),
        spared=spared_nodes(planned),
        show=show,
        printed=screen.print if screen else silent,
        died=lambda death: print_death(death, screen.console) if screen else None,
    )
    return launcher.run()


def _key(network: Network, joined: bool) -> keys.Key | None:
    """The key that encrypts the TCP connections of a run; None: no encryption. RunError: it is missing or needed."""
    if not network.unencrypted:
        return keys.load(network.key_name) if joined else keys.Key.make()
    if not has_unix_sockets():
        raise RunError(
            f"--unencrypted: found {sys.platform}, where the processes of a run are connected by TCP, expected Linux; "
            "a run without --unencrypted makes a key, or uses that of `palpate remote keys`"
        )
    return None


def _reachable(work: list[Job], joined: frozenset[str], network: Network) -> list[Job]:
    """The jobs here with this machine's address, for groups on other machines. GraphError: no address was given."""
    if network.address is None:
        name = min(joined)
        cure = f"Give this machine's, --address tcp://HOST:PORT; there: palpate remote join tcp://HOST:PORT {name}"
        raise GraphError([Fault(f"group {name!r} joins from another machine, and the run has no address", cure)])
    here = network.address.removeprefix("tcp://").rpartition(":")[0]
    return [job if job.host or job.group in joined else msgspec.structs.replace(job, host=here) for job in work]


def _clock(launch: LaunchFile, planned: Plan) -> str:
    """The clock of a run: the real one with hardware. GraphError: hardware on the simulated one."""
    hardware = [name for name in planned.order if planned.graph.nodes[name].cls.hardware]
    if hardware and launch.clock == "simulated":
        text = "clock: found 'simulated', but it drives a device, which needs real time"
        raise GraphError([Fault(text, "Use `clock: real` or --clock real.", node=hardware[0])])
    return launch.clock or ("real" if hardware else "simulated")


def _open_files(groups: int) -> None:
    """Raise the limit of open files for this process and its children. RunError: the hard limit is too low; ZeroMQ
    aborts the process without a message if it cannot open more files. Windows has no such limit."""
    try:
        import resource
    except ImportError:
        return

    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    needed = FILES + FILES_EACH * groups
    most = needed if hard == resource.RLIM_INFINITY else min(needed, hard)
    if soft != resource.RLIM_INFINITY and soft < most:
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))
    if most < needed:
        raise RunError(f"a run of {groups} processes opens up to {needed} files in one, and the system permits "
                          f"{hard}: `ulimit -n {needed}`, or --fused")  # fmt: skip


@contextlib.contextmanager
def _file(file: Path | None, force: bool) -> Iterator[bool]:
    """Create the recording, which no other run may write meanwhile, and its folders; yields whether it is new. A folder
    that stays empty is removed. ArgumentError, RunError, OSError: it cannot be written."""
    if file is None:
        yield False
        return
    made = [folder for folder in file.parents if not folder.exists()]
    try:
        with contextlib.ExitStack() as stack:
            try:
                check_file(file)
                fresh = stack.enter_context(claim_file(file, force))
            except OSError as error:  # with the name of a file it is wrong input: exit code 2
                what = f"{error.strerror}; choose another file with --record FILE"
                raise OSError(error.errno, what, f"recording {file}") from None
            yield fresh
    finally:
        for folder in made:
            with contextlib.suppress(OSError):
                folder.rmdir()


def _is_here(host: str | None) -> bool:
    if host is None:
        return True
    name = host.removeprefix("tcp://").partition(":")[0]
    if name in ("localhost", socket.gethostname()) or name.startswith("127."):
        return True
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind((name, 0))  # only an address of this machine can be bound
        return True
    except OSError:
        return False
