"""Discovery by file: nodes, messages, laws, materials and commands are found in their folders, without a list. Also
what makes long imports and compilations cheaper (`collection_suspended`, `with_room`).

This file imports no other part of palpate, so every part may use it.
"""

import gc
import importlib
import os
import pkgutil
import re
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from types import ModuleType
from typing import Any, TypeVar

T = TypeVar("T")

SLOTS = 1 << 16
"""Values in the frame that `with_room` declares: CPython doubles the size of a piece of memory until the frame fits, so
that more than a third of a megabyte remains, for a thousand calls."""

_state = threading.local()


@contextmanager
def collection_suspended() -> Iterator[None]:
    """Suspend garbage collection, which takes 20 % of the time of imports and 10 % of that of compilations: both make
    little garbage and many objects that stay."""
    if not gc.isenabled():
        yield
        return
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


def with_room(call: Callable[..., T], *given: Any, **named: Any) -> T:
    """The result of a call, whose calls find their frames in one piece of memory. No effect inside another one.

    CPython keeps frames in pieces of 16 kB. A call that does not fit gets a piece from the system, and returns it when
    it ends: a call at the edge of a piece that is repeated a million times maps, faults in and unmaps memory a million
    times. This takes 15 % of the time of a compilation, whose calls are nested deeply. A call whose frame is larger
    than a piece gets a larger one, and the calls inside it use the rest: a large frame is declared, and not touched.
    """
    if getattr(_state, "inside", False):
        return call(*given, **named)
    _state.inside = True
    try:
        return _with_large_frame(call, *given, **named)
    finally:
        _state.inside = False


def _with_large_frame(call: Callable[..., T], *given: Any, **named: Any) -> T:
    return call(*given, **named)


_with_large_frame.__code__ = _with_large_frame.__code__.replace(co_stacksize=SLOTS)


def files(package: ModuleType) -> list[str]:
    """Full names of the files and folders of a package, sorted, without importing them."""
    changed = tuple(os.stat(folder).st_mtime_ns for folder in package.__path__)
    return list(_files(package.__name__, tuple(package.__path__), changed))


@lru_cache(maxsize=256)
def _files(name: str, folders: tuple[str, ...], changed: tuple[int, ...]) -> list[str]:
    """Contents of the folders, cached while their modification times `changed` [ns] stay the same, because loading a
    graph lists each folder about 10 times."""
    return sorted(file.name for file in pkgutil.iter_modules(folders, f"{name}."))


def modules(package: ModuleType) -> dict[str, ModuleType]:
    """The imported files of a package by their short names."""
    return {name.rpartition(".")[2]: importlib.import_module(name) for name in files(package)}


def classes(package: ModuleType, base: type[T]) -> dict[str, type[T]]:
    """The subclasses of `base` that the files of a package declare, by name. Imports all files."""
    found = {kind.__name__: kind for module in modules(package).values() for kind in declared_classes(module, base)}
    return dict(sorted(found.items()))


def find(package: ModuleType, name: str, base: type[T]) -> type[T] | None:
    """The subclass of this name, or None. The file with the matching name is searched first; other files are imported
    only if it lacks the class. ImportError: no class was found, and a file could not be imported (the first error)."""
    likely = f"{package.__name__}.{snake(name)}"
    unread = []
    for file in sorted(files(package), key=lambda file: file != likely):
        try:
            module = importlib.import_module(file)
        except ImportError as error:  # this file needs a missing package; the wanted class may be in another file
            unread.append(error)
            continue
        for kind in declared_classes(module, base):
            if kind.__name__ == name:
                return kind
    if unread:
        raise unread[0]
    return None


def declared_classes(module: ModuleType, base: type[T]) -> Iterator[type[T]]:
    """The public subclasses of `base` that a file declares, without those that it imports."""
    for name, kind in vars(module).items():
        public = isinstance(kind, type) and issubclass(kind, base) and not name.startswith("_")
        if public and kind.__module__ == module.__name__:
            yield kind


def registered_modules(group: str) -> tuple[dict[str, ModuleType], dict[str, str]]:
    """Modules that other distributions register as entry points of this group, by full name, and by the same names the
    errors of those that cannot be imported. Only listings call this, because it imports the distributions' code."""
    from importlib.metadata import entry_points

    there: dict[str, ModuleType] = {}
    missing: dict[str, str] = {}
    for name in sorted({point.module for point in entry_points(group=group)}):
        try:
            there[name] = importlib.import_module(name)
        except (Exception, SystemExit) as error:  # a faulty distribution does not hide the others
            missing[name] = f"{type(error).__name__}: {error}"
    return there, missing


def snake(name: str) -> str:
    """The file name for a class: MassSpring -> mass_spring, ReducedFE -> reduced_fe."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", name).lower()
