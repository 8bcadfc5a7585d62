"""A folder of node files as one room: `device.Falcon` is the class Falcon of any file of nodes/device."""

from __future__ import annotations

import importlib
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

_CLASS = re.compile(r"^class ([A-Z]\w*)", re.MULTILINE)


def offered(folders: Iterable[str]) -> dict[str, str]:
    """The file that has a class, by the name of the class. Nothing is imported."""
    files = sorted(file for folder in folders for file in Path(folder).glob("[!_]*.py"))
    return {name: file.stem for file in files for name in _CLASS.findall(file.read_text(encoding="utf-8"))}


def class_of(room: str, folders: Iterable[str], name: str) -> Any:
    """A class of a room, whose file is read when it is asked for: a graph with one device needs no other.

    AttributeError: no file of the room has such a class.
    """
    file = offered(folders).get(name)
    if file is None:
        raise AttributeError(f"module {room!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{room}.{file}"), name)
