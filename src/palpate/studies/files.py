"""Files of studies and experiments: YAML descriptions, and results that are written atomically."""

import os
from pathlib import Path
from typing import Annotated, Any

import msgspec

from palpate.engine.faults import Faults
from palpate.launch.load.files import find_file
from palpate.launch.load.values.lines import Line, fill
from palpate.launch.load.values.source import YamlSource
from palpate.physics.archive import replacing
from palpate.physics.errors import ArgumentError

Text = Annotated[str, msgspec.Meta(description="a text")]
Whole = Annotated[int, msgspec.Meta(ge=0, description="a whole number from 0")]


def locate_file(name: str, shipped: Path, what: str) -> Path:
    """The shipped file of this name, or the file at this path. GraphError: it does not exist."""
    file = shipped / f"{name}.yaml"
    return file if "/" not in name and file.is_file() else find_file(name, shipped, what=what)


def fill_struct(kind: type[Line], source: YamlSource, keys: str) -> Line:
    """Content of a file as a struct; `keys` names the required keys.

    GraphError: lists all faults.
    """
    faults = Faults()
    if not isinstance(source.data, dict):
        faults.add(f"expected a mapping with {keys}", "", source.place())
        faults.done()
    given = fill(kind, source, faults)
    faults.done()
    assert given is not None
    return given


def graph_of(path: Path, name: str) -> str:
    """The graph that a file names: a path relative to the file, or a shipped graph."""
    file = path.parent / name
    return str(file) if file.is_file() else name


def replace(file: Path, content: Any) -> None:
    """Replace a file atomically and durably: after a crash or power failure it has the old or the new content."""
    with replacing(file) as part, part.open("wb") as out:
        out.write(content)
        out.flush()
        os.fsync(out.fileno())


def refuse(folder: Path, mark: str, what: str) -> None:
    """ArgumentError: the folder contains data of another kind, recognised by the file `mark`."""
    if (folder / mark).exists():
        raise ArgumentError(f"{folder}: found {what} ({mark}), expected a separate folder; name one with --out")
