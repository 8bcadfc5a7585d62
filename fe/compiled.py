"""Compiled functions as arguments of compiled functions: one loop serves every law and shape, and is cached on disk."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numba
import numba.experimental.function_type  # registers functions as a type of argument
from numba import types

VECTOR, MATRIX = types.float64[::1], types.float64[:, ::1]
LAW = types.UniTuple(types.float64, 4)(MATRIX, types.float64, VECTOR, MATRIX, MATRIX)
SHAPE = types.float64(VECTOR, VECTOR, VECTOR, MATRIX)


@lru_cache(maxsize=128)
def compiled(function: Callable[..., Any], signature: Any) -> types.CompileResultWAP:
    """The function compiled for a signature (`LAW` or `SHAPE`), in the form that a kernel takes.

    TypeError: it is not a `numba.njit` function, or does not fit the signature.
    """
    if not hasattr(function, "compile"):
        raise TypeError(f"{function!r}: expected a function compiled with numba.njit")
    name = getattr(function, "__name__", "function")
    try:
        function.compile(signature)
    except numba.core.errors.NumbaError as error:
        raise TypeError(f"{name} does not compile for {signature}: {error}") from None
    return types.CompileResultWAP(function.overloads[signature.args])  # type: ignore[attr-defined]
