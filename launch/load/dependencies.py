"""Files and sources of custom classes that a result depends on, with hashes of their content."""

import hashlib
import inspect
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from palpate.engine.graph import Graph
from palpate.launch.load.classes import ClassError, find_class


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
    path = Path(name)
    try:
        if not path.is_file():
            cls = find_class(name)
            path = Path("" if cls.__module__.startswith("palpate.") else inspect.getsourcefile(cls) or "")
        if not path.is_file():
            return ""
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()[:16]
    except (OSError, ValueError, ClassError):
        return ""


def digest(data: Any) -> str:
    return hashlib.sha256(json.dumps(data, sort_keys=True, default=str).encode()).hexdigest()[:16]
