"""Files of studies and experiments: YAML that describes one, and results that are whole at any time."""

import contextlib
import os
from pathlib import Path
from typing import IO, Annotated, Any

import msgspec

from palpate.engine.faults import Faults
from palpate.launch.load.files import find_file
from palpate.launch.load.values.lines import Line, fill
from palpate.launch.load.values.source import YamlSource, read
from palpate.physics.archive import replacing
from palpate.physics.errors import ArgumentError

Text = Annotated[str, msgspec.Meta(description="a text")]
Whole = Annotated[int, msgspec.Meta(ge=0, description="a whole number from 0")]


def found(name: str, shipped: Path, what: str) -> Path:
    """The file of this name that ships in a folder, or that of a path. GraphError: there is none."""
    file = shipped / f"{name}.yaml"
    return file if "/" not in name and file.is_file() else find_file(name, shipped, what=what)


def filled(kind: type[Line], path: Path, keys: str) -> tuple[Line, YamlSource]:
    """What a file says, and where each thing stands; `keys` it has at least. GraphError: all that is wrong with it."""
    source, faults = read(path), Faults()
    if not isinstance(source.data, dict):
        faults.add(f"expected a mapping with {keys}", "", source.place())
        faults.done()
    given = fill(kind, source, faults)
    faults.done()
    assert given is not None
    return given, source


def graph_of(path: Path, name: str) -> str:
    """The graph that a file names: one beside it, or one that ships."""
    beside = path.parent / name
    return str(beside) if beside.is_file() else name


def locked(file: IO[Any]) -> bool:
    """Lock a file for this process alone, until it is closed; False where another process has it."""
    import fcntl  # POSIX

    with contextlib.suppress(BlockingIOError):
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return True
    return False


def replace(file: Path, content: Any) -> None:
    """Write a file so that it is the old or the new one at any time, whatever becomes of the machine."""
    with replacing(file) as part, part.open("wb") as out:
        out.write(content)
        out.flush()
        os.fsync(out.fileno())


def refuse(folder: Path, mark: str, what: str) -> None:
    """ArgumentError: the folder holds data of another kind, known by the file `mark`."""
    if (folder / mark).exists():
        raise ArgumentError(f"{folder}: found {what} ({mark}), expected a folder of its own; name one with --out")
