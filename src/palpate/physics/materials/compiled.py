"""Material laws as compiled functions: an argument of a kernel, or an address that a kernel calls, so that one cached
loop serves every law."""

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numba.experimental.function_type  # noqa: F401  # registers functions as a type of argument
from numba import types

from palpate.compiler import interpreted
from palpate.compiler.entry_point import address, caller, compiled

VECTOR, MATRIX = types.float64[::1], types.float64[:, ::1]
LAW = types.UniTuple(types.float64, 4)(MATRIX, types.float64, VECTOR, MATRIX, MATRIX)
call_law: Any = caller(LAW)
"""`call_law(address, F, J, p, P, A)` in a kernel: the law at an address (`law_address`)."""


@lru_cache(maxsize=128)
def compile_law(function: Callable[..., Any], signature: Any) -> Any:
    """The function compiled for a signature such as `LAW`, in the form that a kernel accepts. TypeError: neither a
    kernel nor a `numba.njit` function, or it does not match the signature."""
    return function if interpreted.ENABLED else types.CompileResultWAP(compiled(function, signature))


@lru_cache(maxsize=128)
def law_address(function: Callable[..., Any]) -> int:
    """The address of a law for `call_law`. TypeError: see `compile_law`."""
    return address(function, LAW)
