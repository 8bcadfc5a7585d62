"""Functions for numba, which are handed to it when they are first needed.

The import of numba and the creation of all kernels take 0.3 s, and many commands compute nothing. So a kernel or an
intrinsic remembers its function; numba is imported when Python calls it, when a kernel that calls it is compiled or
looked for on disk, or when its address or another property of the compiled function is asked for.
"""

from collections.abc import Callable
from functools import partial, update_wrapper
from types import MethodType
from typing import Any
from weakref import WeakSet

DISPATCHER = frozenset({
    "add_overload", "bare", "compile", "disable_compile", "doc", "dump", "enable_caching", "entry", "file",
    "fold_argument_types", "func_code", "get_annotation_info", "get_call_template", "get_compile_result",
    "get_function_type", "get_metadata", "get_overload", "inspect_asm", "inspect_cfg", "inspect_disasm_cfg",
    "inspect_llvm", "inspect_types", "is_compiling", "locals", "nopython_signatures", "overloads",
    "parallel_diagnostics", "py_func", "recompile", "signatures", "stats", "tag", "targetctx", "targetdescr",
    "targetoptions", "typeof_pyval", "typingctx",
})  # fmt: skip
"""Attributes of a compiled function of numba, for which it is made."""
_EVERY: "WeakSet[Deferred]" = WeakSet()


class Deferred(partial[Any]):
    """A function for numba. A `partial` calls what it holds without a step in Python: after the first call that is
    numba's function itself.

    plain  the function in Python
    make   returns the dispatcher or the intrinsic of numba
    """

    def __new__(cls, plain: Callable[..., Any], *_: Any, **__: Any) -> "Deferred":
        return super().__new__(cls, plain)

    def __init__(self, plain: Callable[..., Any], make: Callable[[], Any]) -> None:
        update_wrapper(self, plain)
        self._make = make
        _EVERY.add(self)
        self._hold(self._first)

    def _hold(self, function: Callable[..., Any]) -> None:
        self.__setstate__((function, (), {}, vars(self)))

    def _first(self, *given: Any, **named: Any) -> Any:
        return self.made(*given, **named)

    @property
    def made(self) -> Any:
        """The dispatcher or the intrinsic of numba, the same one for all threads."""
        found = vars(self).get("_made")
        if found is None:
            found = vars(self).setdefault("_made", self._make())
            self._hold(found)
        return found

    @property
    def _numba_type_(self) -> Any:
        """numba asks for it where a function names this one, or passes it."""
        return self.made._numba_type_

    def __getattr__(self, name: str) -> Any:
        if name in DISPATCHER:
            return getattr(self.made, name)
        # a question, such as `getattr(kernel, "part", None)`, which must not import numba
        raise AttributeError(f"{type(self).__name__} {vars(self).get('__qualname__')} has no attribute {name!r}")

    def __get__(self, instance: Any, owner: Any = None) -> Any:
        return self if instance is None else MethodType(self, instance)  # as a function

    def __copy__(self) -> "Deferred":
        return self

    def __deepcopy__(self, memo: Any) -> "Deferred":
        return self

    def __reduce__(self) -> Any:
        return self.__qualname__  # pickled by its name, as a function

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.__module__}.{self.__qualname__})"


def make_all() -> None:
    """Make all functions that exist, before a process forks others that need many of them."""
    for each in list(_EVERY):
        _ = each.made


def made(value: Any) -> Any:
    """The dispatcher or the intrinsic of a deferred function; any other value itself."""
    return value.made if isinstance(value, Deferred) else value
