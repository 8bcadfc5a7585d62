"""Imports the module of typer that formats help, without the two libraries that palpate's help does not use."""

import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from importlib import import_module
from types import ModuleType
from typing import Any

UNUSED = {"rich.markdown": "Markdown", "rich.traceback": "Traceback"}
"""Modules and classes: help in Markdown, tracebacks in colour. Their imports take 20 % of `palpate --help`."""


def import_formatter() -> None:
    """Import `typer.rich_utils`, so that the modules of UNUSED are imported when their classes are used."""
    with ExitStack() as stack:
        for module, name in UNUSED.items():
            stack.enter_context(_deferred(module, name))
        import_module("typer.rich_utils")


@contextmanager
def _deferred(module: str, name: str) -> Iterator[None]:
    """While the context is open, importing `name` from `module` gives a deferred class, unless it is imported."""
    if module in sys.modules:
        yield
        return
    stand_in = ModuleType(module)
    setattr(stand_in, name, _Deferred(name, (), {"_module": module}))
    sys.modules[module] = stand_in
    try:
        yield
    finally:
        del sys.modules[module]


class _Deferred(type):
    """A class that another module declares under the same name, which is imported when the class is first used."""

    _module: str

    def _imported(cls) -> Any:
        return getattr(import_module(cls._module), cls.__name__)

    def __call__(cls, *given: Any, **named: Any) -> Any:
        return cls._imported()(*given, **named)

    def __getattr__(cls, name: str) -> Any:
        return getattr(cls._imported(), name)
