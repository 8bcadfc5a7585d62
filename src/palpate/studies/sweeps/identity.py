"""Identity of points: hashes of their dependencies, and the changes between two studies."""

import hashlib
import inspect
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from palpate.engine.graph import Graph
from palpate.launch.load.classes import ClassError, find_class
from palpate.studies.sweeps.axes import Space

LONG = 200  # Maximum length of the values of a path in `study.json`
SHOWN = 12  # Maximum number of listed changes


def files_of(base: Graph) -> Iterator[tuple[str, str]]:
    """Files that a graph depends on, with hashes of their content: files in settings, and sources of custom classes."""
    for spec in base.nodes.values():
        if not spec.cls.__module__.startswith("palpate."):
            yield from ((file, content(file)) for file in (inspect.getsourcefile(spec.cls),) if file)
        for value in () if spec.observer else _texts(spec.settings):  # observers write files: a recording is a result
            if content(value):
                yield value, content(value)


def _texts(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping | list | tuple):
        for part in value.values() if isinstance(value, Mapping) else value:
            yield from _texts(part)


def content(name: str) -> str:
    """Hash of the file at a path, or of the source of a custom class; "" for other texts."""
    path = Path(name)
    try:
        if not path.is_file():
            cls = find_class(name)
            path = Path("" if cls.__module__.startswith("palpate.") else inspect.getsourcefile(cls) or "")
        return hashlib.sha256(path.read_bytes()).hexdigest()[:16] if path.is_file() else ""
    except (OSError, ValueError, ClassError):
        return ""


def digest(data: Any) -> str:
    return hashlib.sha256(json.dumps(data, sort_keys=True, default=str).encode()).hexdigest()[:16]


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


def described(space: Space) -> dict[str, str]:
    """Summary of the values of each path, as text."""
    words = {}
    for name, values in space.columns("labels").items():
        numbers = all(isinstance(value, int | float) for value in values)
        which = f"{min(values):g} to {max(values):g}" if numbers else ", ".join(map(str, values))
        words[name] = f"{len(set(values))} values, {which[:LONG]}"
    return words
