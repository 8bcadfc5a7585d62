"""What a study depends on; its values as text, and the changes between two studies."""

from collections.abc import Iterator, Mapping
from typing import Any

from palpate.engine.graph import Graph
from palpate.launch.load.dependencies import files_of
from palpate.launch.load.launchfile import LaunchFile
from palpate.studies.sweeps.axes import Space

LONG = 200  # Maximum length of the values of a path in `study.json`
SHOWN = 12  # Maximum number of listed changes


def origin(launch: LaunchFile, base: Graph) -> dict[str, Any]:
    """Everything that determines the results of all points, except the versions and the arithmetic. `base`: the graph
    of the launch file."""
    return {
        "graph": base.source, "scene": base.scene, "rate": base.rate, "duration": launch.duration,
        "effects": {name: choice.word for name, choice in base.effects.items()}, "files": dict(files_of(base)),
    }  # fmt: skip


def changes(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """One line per change."""
    old, new = dict(_flat(before)), dict(_flat(now))
    changed = [name for name in {**new, **old} if old.get(name) != new.get(name)]
    lines = [f"changed: {name}: {new.get(name, 'nothing')}, was {old.get(name, 'nothing')}" for name in changed]
    return lines[:SHOWN] + ([f"... and {len(lines) - SHOWN} more"] if len(lines) > SHOWN else [])


def _flat(data: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    if isinstance(data, Mapping) and data:
        for key, value in data.items():
            yield from _flat(value, f"{name}.{key}" if name else str(key))
    else:
        yield name, data


def describe_space(space: Space) -> dict[str, str]:
    """Summary of the values of each path, as text."""
    words = {}
    for name, values in space.columns("labels").items():
        numbers = all(isinstance(value, int | float) for value in values)
        which = f"{min(values):g} to {max(values):g}" if numbers else ", ".join(map(str, values))
        words[name] = f"{len(set(values))} values, {which[:LONG]}"
    return words
