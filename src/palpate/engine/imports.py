"""Import of classes by their full name: of any module for a job of this machine, only of trusted modules for a
recording or for the job of a launcher elsewhere."""

import importlib
import os
import sys
from collections.abc import Iterable
from typing import Any, TypeVar

T = TypeVar("T")
PALPATE = __name__.partition(".")[0]
_trusted: set[str] = set()


class UntrustedError(ImportError):
    """A recording or a launcher elsewhere names code that is not trusted."""


def trust(*packages: str) -> None:
    """Let recordings, and launchers elsewhere, import modules of these packages, also from the working directory."""
    _trusted.update(packages)


def trust_only(packages: Iterable[str]) -> None:
    """Let recordings and launchers elsewhere import modules of these packages only."""
    _trusted.clear()
    trust(*packages)


def search_here() -> str:
    """Append the working directory to the search path of modules. Returns the directory."""
    here = os.getcwd()
    if here not in sys.path:
        sys.path.append(here)
    return here


def load_class(name: str, kind: type[T]) -> type[T]:
    """The subclass of `kind` with this full dotted name, or of `Carrier[Message]`, also from the working directory.

    This is the gate for every name of code in a job, recording or plan: its module is imported, but the object is
    never called before it is known to be of this kind. The caller decides whether the module may be imported.

    ImportError, AttributeError: the module or the class does not exist, or is no subclass.
    """
    carrier, bracket, carried = name.removesuffix("]").partition("[")
    if bracket:
        from palpate.messages import Message
        from palpate.nodes.base.carrier import Carrier  # only carriers need it, and commands that read no graph do not

        cls: Any = load_class(carrier, Carrier).of(load_class(carried, Message))
    else:
        module, _, last = name.rpartition(".")
        if not module or not all(part.isidentifier() for part in name.split(".")):
            raise ImportError(f"{name!r} is no full name of a class")
        if module not in sys.modules and not _within(module, PALPATE):
            search_here()
        cls = getattr(importlib.import_module(module), last)
    if not (isinstance(cls, type) and issubclass(cls, kind)):
        raise ImportError(f"{name} is not {_article(kind.__name__)} {kind.__name__}")
    return cls


def recorded_class(name: str, kind: type[T]) -> type[T]:
    """The subclass of `kind` with this full dotted name in a recording. A file is data: it may name palpate's modules,
    modules of trusted packages, and modules that the program has already imported.

    UntrustedError: the module is none of these. ImportError, AttributeError: the module or the class does not exist,
    or is no subclass.
    """
    check_trusted(*modules_of(name))
    return load_class(name, kind)


def modules_of(*names: str) -> list[str]:
    """The modules of classes with these full names, also of both classes in `Carrier[Message]`."""
    return [module for name in names for part in name.split("[") if (module := part.rstrip("]").rpartition(".")[0])]


def check_trusted(*modules: str, source: str = "a recording") -> None:
    """UntrustedError: a recording, or another `source` of names, may not import these modules; the text explains how to
    allow it."""
    others = [m for m in modules if m not in sys.modules and not any(_within(m, p) for p in (PALPATE, *_trusted))]
    if others:
        packages = sorted({module.partition(".")[0] for module in others})
        names = ", ".join(map(repr, packages))
        options = " ".join(f"--trust {package}" for package in packages)
        raise UntrustedError(
            f"{names}: not part of palpate, and {source} imports no other code by itself. If you trust it: "
            f"{options} (in Python: import {', '.join(sorted(set(others)))} first)"
        )


def _article(noun: str) -> str:
    return "an" if noun[:1] in "AEIOU" else "a"


def _within(module: str, package: str) -> bool:
    return module == package or module.startswith(package + ".")


def full_name(cls: type) -> str:
    """The name of a class for `load_class`."""
    return f"{cls.__module__}.{cls.__qualname__}"
