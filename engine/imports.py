"""Classes by their full name, the user's own included: of a graph or job all of them, of a recording those that are
trusted."""

import importlib
import os
import sys
from collections.abc import Iterable
from typing import Any

PALPATE = __name__.partition(".")[0]
_trusted: set[str] = set()


class UntrustedError(ImportError):
    """Code that a recording names and that is not imported for its sake."""


def trust(*packages: str) -> None:
    """Let recordings import modules of these packages from now on, the working directory included."""
    _trusted.update(packages)


def trust_only(packages: Iterable[str]) -> None:
    """Let recordings import modules of these packages and of no others."""
    _trusted.clear()
    trust(*packages)


def search_here() -> str:
    """Let modules of the working directory be found, after all others; gives that directory."""
    here = os.getcwd()
    if here not in sys.path:
        sys.path.append(here)
    return here


def load_class(name: str) -> Any:
    """The class of this full dotted name, or of `Carrier[Message]`, both full names; the working directory is searched,
    too.

    ImportError, AttributeError: no such module, no such class.
    """
    carrier, bracket, carried = name.removesuffix("]").partition("[")
    if bracket:
        return load_class(carrier).of(load_class(carried))
    module, _, cls = name.rpartition(".")
    if not _within(module, PALPATE):
        search_here()
    return getattr(importlib.import_module(module), cls)


def recorded_class(name: str, kind: type) -> Any:
    """The class of this full dotted name, a subclass of `kind`, that a recording names. A file is data: it imports
    palpate's own modules, those of packages that the user trusts, and finds what this program has imported already,
    which is what a graph given next to it names.

    UntrustedError: another module. ImportError, AttributeError: no such module, no such class, or of another kind.
    """
    check_trusted(*(part.rpartition(".")[0] for part in name.removesuffix("]").split("[")))
    cls = load_class(name)
    if not (isinstance(cls, type) and issubclass(cls, kind)):
        raise ImportError(f"{name} is no {kind.__name__}")
    return cls


def check_trusted(*modules: str) -> None:
    """UntrustedError: modules that a recording may not import; says how the user allows it."""
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
    """The name by which `load_class` finds a class."""
    return f"{cls.__module__}.{cls.__qualname__}"
