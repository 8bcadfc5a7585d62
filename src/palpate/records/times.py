"""Step times of the nodes of a graph, from a recording of it."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from palpate.engine.imports import full_name
from palpate.engine.plan import Plan
from palpate.records.reader import Recording
from palpate.records.stored import RecordingError

NEWEST = 3  # recordings that are searched for the times of a graph


def step_times(planned: Plan, given: Path | None) -> tuple[dict[str, float], Path | None]:
    """Median step time of each node [s], and the recording that it is from: the given one, or the newest with the
    graph's name and the same node classes. Reading one takes time, so only the newest `NEWEST` are tried."""
    named = Path("runs").glob(f"*/{planned.graph.path.stem}.mcap")
    newest = sorted(named, key=lambda file: -file.stat().st_mtime)
    classes = {name: full_name(node.cls) for name, node in planned.graph.nodes.items()}
    for file in [given] if given else newest[:NEWEST]:
        try:
            recording = Recording(file)
        except RecordingError:
            if given:
                raise
            continue
        if recording.times and (given or _same(recording.about.get("plan", {}), planned, classes)):
            return {name: quantiles["median"] for name, quantiles in recording.times.items()}, file
    return {}, None


def _same(spec: Mapping[str, Any], planned: Plan, classes: Mapping[str, str]) -> bool:
    """Whether a recorded plan is of this graph, with the same class for each common node; the recorded plan may have an
    additional logger."""
    named = {node.get("name"): node.get("class") for node in spec.get("nodes", ())}
    both = named.keys() & classes.keys()
    return Path(spec.get("path", "")).name == planned.graph.path.name and all(named[n] == classes[n] for n in both)
