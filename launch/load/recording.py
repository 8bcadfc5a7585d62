"""Sets the file that the logger of a graph writes."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from palpate.engine.faults import Faults, choices
from palpate.engine.graph import Graph, NodeSpec
from palpate.nodes.logger import Mcap


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
