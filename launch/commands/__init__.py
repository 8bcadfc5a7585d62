"""The verbs of the command line, one file each: the file `x.py` is a verb if it has a function or a group `x`.

A class `Command` in it takes the place of typer's own. The verbs stand in the help in this order, others after them.
"""

from __future__ import annotations

import importlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ORDER = [
    "run",
    "touch",
    "check",
    "replay",
    "compare",
    "info",
    "echo",
    "top",
    "export",
    "recover",
    "plan",
    "rates",
    "nodes",
    "messages",
    "effects",
    "pictures",
    "plot",
    "picture",
    "film",
    "view",
    "doctor",
    "devices",
    "reduce",
    "fit",
    "record_indentation",
    "join",
    "keys",
    "fingertip",
    "new",
    "fe",
]


def verbs() -> Iterator[tuple[str, Any, Any]]:
    """Name, function or group, and class of each verb. Files that are none are not imported: help answers at once."""
    files = {file.stem: file for folder in __path__ for file in sorted(Path(folder).glob("[!_]*.py"))}
    for name in (*ORDER, *sorted(files.keys() - set(ORDER))):
        if re.search(rf"^(def {name}\(|{name} = )", files[name].read_text(encoding="utf-8"), re.MULTILINE):
            file = importlib.import_module(f"{__name__}.{name}")
            yield name, getattr(file, name), getattr(file, "Command", None)
