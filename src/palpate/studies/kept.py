"""Results of a search, one JSON value per line, which are added one by one so that an interrupted search resumes."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


def kept_lines(path: Path) -> Iterator[Any]:
    """The values of a file. A line at which a search was interrupted is left out. OSError: it cannot be read."""
    if not path.exists():
        return
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        try:
            yield json.loads(line)
        except ValueError:
            continue


@contextmanager
def adding_lines(path: Path) -> Iterator[Callable[[Any], None]]:
    """A function that adds a value to the file, at once. OSError: it cannot be written."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a+b") as file:
        if file.tell():
            file.seek(-1, 2)
            if file.read(1) != b"\n":  # the line at which a search was interrupted
                file.write(b"\n")

        def add(value: Any) -> None:
            file.write(json.dumps(value).encode() + b"\n")
            file.flush()

        yield add
