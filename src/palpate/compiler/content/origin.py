"""Which code belongs to a library whose version is part of the name of a cache, and the text of other files."""

import hashlib
import sys
from functools import cache
from types import FunctionType, ModuleType
from typing import Any

LIBRARIES = frozenset({"numba", "llvmlite", "numpy", "builtins"}) | sys.stdlib_module_names - {"__main__"}
"""Top packages that the versions of Python, numba, llvmlite and numpy determine (`kernel_cache.versions`)."""


class UnnamedError(ValueError):
    """A kernel refers to an object that only this process has, so its code has no name."""


def is_library(module: Any) -> bool:
    """Whether the module of this name is part of a library."""
    return isinstance(module, str) and module.partition(".")[0] in LIBRARIES


def is_library_function(function: Any) -> bool:
    """Whether a function is code of a library. A decorator of a library may enclose foreign code; a function without
    module is one that the library has generated."""
    if not isinstance(function, FunctionType):
        return is_library(getattr(function, "__module__", None))
    inside = [cell.cell_contents for cell in function.__closure__ or ()]
    return is_library(function.__globals__.get("__name__")) and all(
        each.__module__ is None or is_library_function(each) for each in inside if isinstance(each, FunctionType)
    )


@cache
def text_of(module: str) -> str:
    """A hash of the file of a module, for what cannot be analysed. UnnamedError: it has none."""
    file = getattr(sys.modules.get(module), "__file__", None)
    if file is None:
        raise UnnamedError(f"module {module!r} has no file")
    try:
        with open(file, "rb") as opened:
            return hashlib.sha256(opened.read()).hexdigest()
    except OSError as error:
        raise UnnamedError(f"{file}: {error.strerror}") from None


def name_of(value: Any) -> tuple[str, str]:
    """Module and qualified name of a function or class."""
    module = getattr(value, "__module__", None)
    name = getattr(value, "__qualname__", None) or getattr(value, "__name__", None) or type(value).__qualname__
    owner = getattr(value, "__objclass__", None) or getattr(value, "__self__", None)
    if module is None and owner is not None and not isinstance(owner, ModuleType):
        module = (owner if isinstance(owner, type) else type(owner)).__module__
    return str(module or "builtins"), name
