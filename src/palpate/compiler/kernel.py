"""Kernels: functions that numba compiles at their first call and caches on disk (`code_cache`).

Kernels are compiled for x86-64-v3, or on 64-bit ARM for ARMv8-A, in any process (`arithmetic.kernel_processor`),
independent of the processor for which numba compiles the user's functions (`target`). Functions of `numba.njit` may
call kernels, but not the reverse. The decorator does not import numba (`target.deferred`).
"""

from collections.abc import Callable
from functools import partial
from typing import Any

from palpate.compiler import interpreted
from palpate.compiler.target.deferred import Deferred
from palpate.compiler.target.replaced import replacement


class CompiledKernel(Deferred):
    """A compiled function for Python and for other kernels. It has the attributes of numba's dispatchers, and those of
    `target.dispatcher.KernelDispatcher`.

    py_func  the function in Python
    """

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        super().__init__(function, lambda: _dispatcher(function, options))
        self.py_func = function


def _dispatcher(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    from palpate.compiler.target.dispatcher import KernelDispatcher  # with numba

    return KernelDispatcher(function, options)


def kernel(
    function: Callable[..., Any] | None = None,
    *,
    error_model: str = "python",
    pointer: bool = False,
    nogil: bool = False,
    inline: bool = False,
) -> Any:
    """Decorator of a function to compile.

    error_model  a division by 0 raises ("python"), or returns inf or nan ("numpy")
    pointer      also for use as an argument of kernels (`materials.compile_law`)
    nogil        release the global interpreter lock during calls
    inline       copy it into the kernels that call it, independent of its size
    """
    if function is None:
        return partial(kernel, error_model=error_model, pointer=pointer, nogil=nogil, inline=inline)
    if interpreted.ENABLED:
        plain: Any = interpreted.with_functions(function, replacement)
        plain.py_func = plain  # as in a compiled one
        return plain
    # all that numba would take from the caller for which it first compiles the function
    options = {"nopython": True, "error_model": error_model, "fastmath": False, "forceinline": inline, "_nrt": True}
    more = {"boundscheck": None, "no_cfunc_wrapper": not pointer} | ({"nogil": True} if nogil else {})
    return CompiledKernel(function, options | more)


ieee_kernel = kernel(error_model="numpy")
"""The same; a division by 0 returns inf or nan, as IEEE 754 defines it."""


def inlined(function: Callable[..., Any]) -> Any:
    """Decorator of a function whose statements numba copies into each kernel that calls it, before it infers types: so
    equal expressions of several of them are computed once. A function of `numba.njit` may call it too."""
    if interpreted.ENABLED:
        return interpreted.with_functions(function, replacement)
    return Deferred(function, lambda: _inlined(function))


def _inlined(function: Callable[..., Any]) -> Any:
    import numba

    return numba.njit(inline="always")(function)
