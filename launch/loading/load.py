"""Classes by their full name, the user's own included."""

from __future__ import annotations

import importlib
import os
import sys
from typing import Any


def search_here() -> str:
    """Let modules of the working directory be found, after all others; gives that directory."""
    here = os.getcwd()
    if here not in sys.path:
        sys.path.append(here)
    return here


def load_class(name: str) -> Any:
    """The class of this full dotted name; the working directory is searched, too.

    ImportError, AttributeError: no such module, no such class.
    """
    search_here()
    module, _, cls = name.rpartition(".")
    return getattr(importlib.import_module(module), cls)


def full_name(cls: type) -> str:
    """The name by which `load_class` finds a class."""
    return f"{cls.__module__}.{cls.__qualname__}"
