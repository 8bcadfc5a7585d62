"""Where a run is recorded: the logger of its graph."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from palpate.engine.faults import Faults, choices
from palpate.engine.graph import Graph, NodeSpec
from palpate.nodes.logger import Mcap


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
            spec.off = spec.off or "no recording was requested (--record FILE)"
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
