"""Kernels: functions that numba compiles when they are first called, and keeps on disk (`kernel_cache`)."""

import contextlib
import fcntl
import gc
import signal
import threading
from collections.abc import Callable, Iterator
from functools import cached_property, partial
from pathlib import Path
from types import FunctionType
from typing import Any

import numba
from numba import types
from numba.core.caching import FunctionCache
from numba.core.registry import CPUDispatcher


class Kept(CPUDispatcher):
    """numba's compiled function, on disk. What another process compiles right now is waited for, and loaded.

    Meanwhile no garbage is collected: the compiler makes millions of objects and keeps them, and looking through them
    takes 6 % of its time.
    """

    def __init__(self, py_func: Any, targetoptions: Any = None, **more: Any) -> None:
        super().__init__(py_func, targetoptions=targetoptions, **more)
        self._cache = _Cache(py_func)

    def compile(self, sig: Any) -> Any:
        """Its code for these types, compiled or loaded."""
        with contextlib.ExitStack() as stack:
            if gc.isenabled():  # a kernel compiles those that it calls
                stack.callback(gc.enable)
                gc.disable()
            with contextlib.suppress(OSError):  # where nobody can write, each process compiles for itself
                folder = Path(self.stats.cache_path or "")
                folder.mkdir(parents=True, exist_ok=True)
                file = stack.enter_context((folder / f"{self.py_func.__qualname__}.lock").open("w"))
                fcntl.lockf(file, fcntl.LOCK_EX)
            return super().compile(sig)


class _Cache(FunctionCache):
    """Code on disk. LLVM asks Python for it in a callback, in which the exception of Ctrl-C would be dropped, and then
    runs code that is not there: signals wait until a function is loaded, some milliseconds."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        with _signals_later():
            return super().load_overload(sig, target_context)


@contextlib.contextmanager
def _signals_later() -> Iterator[None]:
    """Call Python's handlers of signals by which users end a program when the block is over."""
    came: list[int] = []
    here = threading.current_thread() is threading.main_thread()
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP) if here}
    handlers = {number: handler for number, handler in handlers.items() if callable(handler)}
    try:
        for number in handlers:
            signal.signal(number, lambda number, _: came.append(number))
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        for late in came:
            signal.raise_signal(late)


class Kernel(Kept):
    """A compiled function for Python, and for other kernels.

    numba gives each function a wrapper for Python and one for C, with its code inlined into both, which takes a fifth
    of the time of a first start. Who is called by another kernel needs neither, and gets that for Python when Python
    calls it, too.
    """

    @cached_property
    def bare(self) -> Kept:
        """For other kernels, whose own code holds it then."""
        function = self.py_func
        bare = FunctionType(function.__code__, function.__globals__, function.__name__, function.__defaults__)
        bare.__module__, bare.__qualname__ = function.__module__, f"{function.__qualname__}.bare"
        return Kept(bare, {**self.targetoptions, "no_cpython_wrapper": True})

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """How a kernel calls it: its types, for which a constant is a number like others. numba would compile it for
        each constant that it is called with, and the code of the caller, which holds it, knows the constant anyway."""
        args, kws = [types.unliteral(one) for one in args], {name: types.unliteral(one) for name, one in kws.items()}
        return self.bare.get_call_template(args, kws)  # type: ignore[attr-defined]

    def get_overload(self, sig: Any) -> Any:
        """How a kernel calls it: its code."""
        return self.bare.get_overload(sig)  # type: ignore[attr-defined]


def kernel(function: Callable[..., Any] | None = None, *, error_model: str = "python") -> Any:
    """Decorator of a function to compile. `error_model`: a division by 0 raises ("python"), or gives inf or nan
    ("numpy")."""
    if function is None:
        return partial(kernel, error_model=error_model)
    if numba.config.DISABLE_JIT:  # type: ignore[attr-defined]
        return function
    return Kernel(
        function, {"nopython": True, "boundscheck": None, "no_cfunc_wrapper": True, "error_model": error_model}
    )
