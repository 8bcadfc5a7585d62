"""Sets what the logger of a graph records: the file, left out and thinned streams, or only the sources."""

import contextlib
import datetime
import errno
import itertools
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from palpate.engine.faults import Fault, Faults, GraphError, choices
from palpate.engine.graph import Graph, NodeSpec
from palpate.engine.imports import full_name
from palpate.engine.plan import Plan
from palpate.launch.load.launchfile import SOURCES
from palpate.launch.load.plan import plan
from palpate.nodes.logger import Mcap
from palpate.physics.errors import ArgumentError

_ELSEWHERE = "choose another folder with -o FOLDER, or another file with --record FILE"


@contextlib.contextmanager
def new_folder(name: str) -> Iterator[Path]:
    """Make the folder of a new run, `runs/NAME-DATE`, with a number if it exists: no other program has it. It is
    removed at the end if it stays empty. OSError: it cannot be made."""
    begun = Path("runs") / f"{name}-{datetime.datetime.now():%Y%m%d-%H%M%S}"
    folder = begun
    for number in itertools.count(2):
        try:
            begun.parent.mkdir(exist_ok=True)
            folder.mkdir()
            break
        except FileExistsError:
            if not begun.parent.is_dir():
                raise OSError(errno.ENOTDIR, f"a file of this name exists; {_ELSEWHERE}", str(begun.parent)) from None
            folder = begun.with_name(f"{begun.name}-{number}")
        except FileNotFoundError:
            continue  # another run has removed the empty folder `runs`
        except OSError as error:
            raise OSError(error.errno, f"{error.strerror}; {_ELSEWHERE}", f"recording {folder}") from None
    try:
        yield folder
    finally:
        for made in (folder, folder.parent):
            with contextlib.suppress(OSError):
                made.rmdir()


def recording_name(file: Path, place: str) -> Path:
    """The file itself. ArgumentError: its name does not end in `.mcap`."""
    if file.suffix != ".mcap" and not file.is_dir():
        raise ArgumentError(
            f"{place}: found {str(file)!r}, expected a name that ends in .mcap, such as {file.stem}.mcap"
        )
    return file


def set_recording(
    graph: Graph, file: Path | None, leave_out: Sequence[str] = (), thin: Mapping[str, int] | None = None
) -> None:
    """Make the graph's logger write to this file; add a logger if it has none. Without a file no logger runs.

    leave_out, thin  streams not to record, or to record every n-th message of, in addition to those of the graph

    GraphError: a stream that the graph does not have.
    """
    loggers = [spec for spec in graph.nodes.values() if issubclass(spec.cls, Mcap)]
    if file is None:
        for spec in loggers:
            spec.off = spec.off or "no recording was requested (--record FILE)"
        return
    if not loggers:
        name = next(n for n in ("log", "palpate-log", "palpate-log-2") if n not in graph.nodes)
        loggers = [NodeSpec(name=name, use="logger.Mcap", cls=Mcap, settings={}, listen=None)]
        graph.nodes[name] = loggers[0]
    for spec in loggers[1:]:
        spec.off = spec.off or f"{loggers[0].name!r} writes the recording"
    before = loggers[0].settings
    left_out = [*before.get("leave_out", ()), *leave_out]
    given = {"leave_out": left_out, "thin": {**before.get("thin", {}), **(thin or {})}}
    faults = Faults()
    for key, names in given.items():
        for stream in names:
            if stream not in graph.streams:
                faults.add(f"{key}: there is no stream {stream!r}", choices("Streams", stream, graph.streams),
                           loggers[0].place, node=loggers[0].name)  # fmt: skip
    faults.done()
    loggers[0].settings = {**before, **given, "path": str(file.absolute())}
    loggers[0].off = None


def record_sources(graph: Graph, clock: str) -> Plan:
    """The plan of a run whose logger records only the sources. On the simulated clock nothing is computed only for the
    recording. On the real clock all fields are computed: a node that computes less comes to rest earlier, which changes
    the ages of its messages.

    GraphError: nodes that cannot be recomputed, and why.
    """
    whole = plan(graph)
    spec = next(spec for spec in graph.nodes.values() if issubclass(spec.cls, Mcap) and spec.off is None)
    faults = list(_faults(graph, whole, clock, spec))
    if faults:
        raise GraphError(faults)
    sources = [s for name in whole.order if _is_source(graph.nodes[name]) for s in graph.nodes[name].streams]
    fields: dict[str, list[str]] = {"fields": []} if clock == "simulated" else {}
    logger = replace(spec, settings={**spec.settings, "sources": sources, **fields})
    return plan(replace(graph, nodes={**graph.nodes, spec.name: logger}))


def _is_source(spec: NodeSpec) -> bool:
    """Whether its messages are not a function of other messages."""
    return spec.cls.paced or spec.cls.hardware


def _faults(graph: Graph, whole: Plan, clock: str, logger: NodeSpec) -> Iterator[Fault]:
    thin: Mapping[str, int] = logger.settings.get("thin", {})
    left_out: Collection[str] = logger.settings.get("leave_out", ())
    cure = "Record all messages: `record: all`, or --record-only all."
    if thin:
        yield Fault(f"thin: {', '.join(thin)}: with {SOURCES!r} the other streams are computed, none is thinned out",
                    cure, logger.place, node=logger.name)  # fmt: skip
    for name in whole.order:
        spec = graph.nodes[name]
        why = ""
        if _is_source(spec):
            missing = [stream for stream in spec.streams if stream in left_out]
            why = f"its stream {missing[0]!r} is left out, and everything is computed from it" if missing else ""
        elif spec.cls.__module__ == "__main__" or "<locals>" in full_name(spec.cls):
            why = f"its class {full_name(spec.cls)} cannot be imported by this name"
        elif spec.restart and clock == "simulated":
            why = "it may be restarted, and the behaviour of the other nodes meanwhile is not a function of the sources"
        if why:
            yield Fault(f"record {SOURCES}: the node cannot be computed again: {why}", cure, spec.place, node=name)
