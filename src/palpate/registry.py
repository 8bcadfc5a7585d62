"""What lies in folders and is listed nowhere: nodes, messages, laws, materials and commands, each by its file.

This file imports nothing of ours, so that every room may use it.
"""

import importlib
import os
import pkgutil
import re
from collections.abc import Iterator
from functools import lru_cache
from types import ModuleType
from typing import TypeVar

T = TypeVar("T")


def files(package: ModuleType) -> list[str]:
    """Full names of the files and folders of a package, sorted, which are not imported for that."""
    changed = tuple(os.stat(folder).st_mtime_ns for folder in package.__path__)
    return list(_files(package.__name__, tuple(package.__path__), changed))


@lru_cache(maxsize=256)
def _files(name: str, folders: tuple[str, ...], changed: tuple[int, ...]) -> list[str]:
    """What lay in the folders when they were last `changed` [ns]: a graph asks for each some ten times."""
    return sorted(file.name for file in pkgutil.iter_modules(folders, f"{name}."))


def modules(package: ModuleType) -> dict[str, ModuleType]:
    """The files of a package by their short names, imported."""
    return {name.rpartition(".")[2]: importlib.import_module(name) for name in files(package)}


def classes(package: ModuleType, base: type[T]) -> dict[str, type[T]]:
    """The subclasses of a class that the files of a package declare, by name; all files are imported."""
    found = {kind.__name__: kind for module in modules(package).values() for kind in declared(module, base)}
    return dict(sorted(found.items()))


def find(package: ModuleType, name: str, base: type[T]) -> type[T] | None:
    """The subclass of this name, None where there is none. The file that is called like it is looked into first, so
    that others are imported only where a file is called otherwise. ImportError: none was found, and of those that
    cannot be imported the first."""
    likely = f"{package.__name__}.{snake(name)}"
    unread = []
    for file in sorted(files(package), key=lambda file: file != likely):
        try:
            module = importlib.import_module(file)
        except ImportError as error:  # of a package that perhaps another file needs, not the one that is looked for
            unread.append(error)
            continue
        for kind in declared(module, base):
            if kind.__name__ == name:
                return kind
    if unread:
        raise unread[0]
    return None


def declared(module: ModuleType, base: type[T]) -> Iterator[type[T]]:
    """The public subclasses of a class that a file declares, not those that it imports."""
    for name, kind in vars(module).items():
        public = isinstance(kind, type) and issubclass(kind, base) and not name.startswith("_")
        if public and kind.__module__ == module.__name__:
            yield kind


def registered(group: str) -> tuple[dict[str, ModuleType], dict[str, str]]:
    """Modules that other distributions register: those of their entry points of this group, by full name, and why
    others cannot be imported. Only what lists things calls this: it imports the code of these distributions."""
    from importlib.metadata import entry_points

    there: dict[str, ModuleType] = {}
    missing: dict[str, str] = {}
    for name in sorted({point.module for point in entry_points(group=group)}):
        try:
            there[name] = importlib.import_module(name)
        except (Exception, SystemExit) as error:  # whatever another distribution does wrong: the others are listed
            missing[name] = f"{type(error).__name__}: {error}"
    return there, missing


def snake(name: str) -> str:
    """The name of a file for a class: MassSpring -> mass_spring, ReducedFE -> reduced_fe."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", name).lower()
