"""Import of classes by their full name: any class for a graph or a job, only trusted code for a recording."""

import importlib
import os
import sys
from collections.abc import Iterable
from typing import Any

PALPATE = __name__.partition(".")[0]
_trusted: set[str] = set()


class UntrustedError(ImportError):
    """A recording names code that is not trusted."""


def trust(*packages: str) -> None:
    """Let recordings import modules of these packages, which may be in the working directory."""
    _trusted.update(packages)


def trust_only(packages: Iterable[str]) -> None:
    """Let recordings import modules of these packages only."""
    _trusted.clear()
    trust(*packages)


def search_here() -> str:
    """Append the working directory to the search path of modules. Returns the directory."""
    here = os.getcwd()
    if here not in sys.path:
        sys.path.append(here)
    return here


def load_class(name: str) -> Any:
    """The class of this full dotted name, or of `Carrier[Message]`, also from the working directory.

    ImportError, AttributeError: the module or the class does not exist.
    """
    carrier, bracket, carried = name.removesuffix("]").partition("[")
    if bracket:
        return load_class(carrier).of(load_class(carried))
    module, _, cls = name.rpartition(".")
    if not _within(module, PALPATE):
        search_here()
    return getattr(importlib.import_module(module), cls)


def recorded_class(name: str, kind: type) -> Any:
    """The subclass of `kind` with this full dotted name in a recording. A file is data: it may name palpate's modules,
    modules of trusted packages, and modules that the program has already imported.

    UntrustedError: the module is none of these. ImportError, AttributeError: the module or the class does not exist,
    or is no subclass.
    """
    check_trusted(*(part.rpartition(".")[0] for part in name.removesuffix("]").split("[")))
    cls = load_class(name)
    if not (isinstance(cls, type) and issubclass(cls, kind)):
        raise ImportError(f"{name} is not a {kind.__name__}")
    return cls


def check_trusted(*modules: str) -> None:
    """UntrustedError: a recording may not import these modules; the text explains how to allow it."""
    others = [m for m in modules if m not in sys.modules and not any(_within(m, p) for p in (PALPATE, *_trusted))]
    if others:
        packages = sorted({module.partition(".")[0] for module in others})
        names = ", ".join(map(repr, packages))
        options = " ".join(f"--trust {package}" for package in packages)
        raise UntrustedError(
            f"{names}: not part of palpate, and a recording imports no other code by itself. If you trust it: "
            f"{options} (in Python: import {', '.join(sorted(set(others)))} first)"
        )


def _within(module: str, package: str) -> bool:
    return module == package or module.startswith(package + ".")


def full_name(cls: type) -> str:
    """The name of a class for `load_class`."""
    return f"{cls.__module__}.{cls.__qualname__}"
