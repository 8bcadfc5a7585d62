"""Files and sources of custom classes that a result depends on, with hashes of their content."""

import hashlib
import inspect
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from palpate.engine.graph import Graph
from palpate.launch.load.classes import ClassError, find_class
from palpate.physics.readable import DATA, hash_of_file


def files_of(base: Graph) -> Iterator[tuple[str, str]]:
    """Files that a graph depends on, with hashes of their content: files in settings, and sources of custom classes."""
    for spec in base.nodes.values():
        if not spec.cls.__module__.startswith("palpate."):
            yield from ((file, content(file)) for file in (inspect.getsourcefile(spec.cls),) if file)
        for value in () if spec.observer else texts(spec.settings):  # observers write files: a recording is a result
            if content(value):
                yield value, content(value)


def texts(value: Any) -> Iterator[str]:
    """All texts in plain data."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping | list | tuple):
        for part in value.values() if isinstance(value, Mapping) else value:
            yield from texts(part)


def content(name: str) -> str:
    """Hash of the file at a path, or of the source of a custom class; "" for other texts."""
    if found := hash_of_file(name):
        return found
    try:
        cls = find_class(name)
    except (OSError, ValueError, ClassError):
        return ""
    return hash_of_file("" if cls.__module__.startswith("palpate.") else inspect.getsourcefile(cls) or "")


def data_files(graph: Graph) -> dict[str, str]:
    """The data files in the settings of a graph, with hashes of their content: those that its recording contains."""
    named = {text for spec in graph.nodes.values() if not spec.observer for text in texts(spec.settings)}
    files = {text: hash_of_file(text) for text in sorted(named) if Path(text).suffix.lower() in DATA}
    return {name: found for name, found in files.items() if found}


def digest(data: Any) -> str:
    return hashlib.sha256(json.dumps(data, sort_keys=True, default=str).encode()).hexdigest()[:16]
