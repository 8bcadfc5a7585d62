"""The compiled form of kernels: numba's dispatchers, with code on disk (`code_cache`)."""

from functools import cached_property
from pathlib import Path
from types import FunctionType
from typing import Any

from numba import types
from numba.core import event
from numba.core.registry import cpu_target
from numba.core.target_extension import current_target, target_override

from palpate.compiler import generators
from palpate.compiler.code_cache import CodeCache
from palpate.compiler.generators.in_record import type_of_value
from palpate.compiler.target.deferred import make_all
from palpate.compiler.target.target import PINNED, TARGET, Pinned
from palpate.registry import collection_suspended, modules, with_room

COMPILING = "palpate:compile"  # Name of numba's event while a kernel is compiled, or awaited from another process


def prepare() -> None:
    """Import all that the first kernel needs, with numba's implementations, and make the declared kernels: each of ten
    workers would make a hundred of them."""
    modules(generators)
    PINNED.target_context.refresh()
    make_all()


class CachedFunction(Pinned):
    """A pinned function that is cached on disk. If another process is compiling it, wait and load the result."""

    def __init__(self, py_func: Any, targetoptions: Any = None, *, machine_code: bool = False, **more: Any) -> None:
        super().__init__(py_func, targetoptions=targetoptions, **more)
        self._cache: CodeCache = CodeCache(self, machine_code)
        self._tag = ""

    def file(self, sig: Any) -> Path | None:
        """The cache file for these types; None: not cached."""
        return self._cache.file(sig)

    def tag(self) -> str:
        return self._tag or super().tag()

    def compile(self, sig: Any) -> Any:
        """The code for these types, compiled or loaded."""
        if tuple(getattr(sig, "args", sig)) in self.overloads:
            return super().compile(sig)
        return with_room(self._compile, sig)

    def _compile(self, sig: Any) -> Any:
        self._cache.forget(sig)
        with target_override(TARGET), collection_suspended():
            self._tag = self._cache.names(sig).tag
            if self._cache.file(sig) is not None:
                return super().compile(sig)
            with event.trigger_event(COMPILING), self._cache.lock_compilation(sig):
                return super().compile(sig)


class KernelDispatcher(CachedFunction):
    """A compiled function for Python and for other kernels.

    numba inlines each function into a wrapper for Python and one for C, which takes 20 % of the time of a first start.
    A function called by kernels needs neither; the wrapper for Python is made when Python calls it.
    """

    def typeof_pyval(self, val: Any) -> Any:
        """numba's type of an argument; NamedTuples of arrays are in memory, as for nodes."""
        if isinstance(val, tuple) and hasattr(val, "_fields") and (found := type_of_value(val)) is not None:
            return found
        return super().typeof_pyval(val)

    @cached_property
    def bare(self) -> CachedFunction:
        """For other kernels, which include its code."""
        return self._without_wrapper("bare")

    @cached_property
    def entry(self) -> CachedFunction:
        """For callers by address."""
        return self._without_wrapper("entry", machine_code=True)

    def _without_wrapper(self, name: str, machine_code: bool = False) -> CachedFunction:
        function = self.py_func
        bare = FunctionType(
            function.__code__, function.__globals__, function.__name__, function.__defaults__, function.__closure__
        )
        bare.__module__, bare.__qualname__ = function.__module__, f"{function.__qualname__}.{name}"
        options = {**self.targetoptions, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
        return CachedFunction(bare, options, machine_code=machine_code)

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """The types of a call from a kernel, in which constants count as any other number. numba would compile the
        function for each constant argument; LLVM propagates constants anyway when it inlines the function."""
        args, kws = [types.unliteral(one) for one in args], {name: types.unliteral(one) for name, one in kws.items()}
        return self.bare.get_call_template(args, kws)  # type: ignore[attr-defined]

    def get_overload(self, sig: Any) -> Any:
        """The code for a call from a kernel; registered in numba's CPU target for a call from `numba.njit`."""
        entry = self.bare.get_overload(sig)  # type: ignore[attr-defined]
        if current_target() == cpu_target._target_name:
            code = self.bare.overloads[tuple(sig)]  # type: ignore[attr-defined]
            cpu_target.target_context.insert_user_function(entry, code.fndesc, [code.library])
        return entry
