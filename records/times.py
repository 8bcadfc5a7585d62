"""Step times of the nodes of a graph, from a recording of it."""

from pathlib import Path

from palpate.engine.imports import full_name
from palpate.engine.plan import Plan
from palpate.records.reader import Recording
from palpate.records.stored import RecordingError

NEWEST = 3  # recordings that are looked through for the times of a graph


def step_times(planned: Plan, given: Path | None) -> tuple[dict[str, float], Path | None]:
    """Median duration [s] of a step of each node, and the recording that says so: each is read whole, so that only the
    newest few with the graph's name and with the same class of each node are tried."""
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
        spec = recording.about["plan"]
        same = Path(spec["path"]).name == planned.graph.path.name and all(
            classes.get(node["name"]) == node["class"] for node in spec["nodes"]
        )
        if recording.times and (given or same):
            return {name: quantiles["median"] for name, quantiles in recording.times.items()}, file
    return {}, None
