"""Passes compiled functions to compiled functions, so that one cached loop serves every law."""

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numba
import numba.experimental.function_type  # registers functions as a type of argument
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

VECTOR, MATRIX = types.float64[::1], types.float64[:, ::1]
LAW = types.UniTuple(types.float64, 4)(MATRIX, types.float64, VECTOR, MATRIX, MATRIX)


@lru_cache(maxsize=128)
def compile_law(function: Callable[..., Any], signature: Any) -> types.CompileResultWAP:
    """The function compiled for a signature such as `LAW`, in the form that a kernel accepts. TypeError: neither a
    kernel nor a `numba.njit` function, or it does not match the signature."""
    if not hasattr(function, "compile"):
        raise TypeError(f"{function!r}: expected a function compiled with numba.njit")
    name = getattr(function, "__name__", "function")
    try:
        function.compile(signature)
    except numba.NumbaError as error:
        raise TypeError(f"{name} does not compile for {signature}: {error}") from None
    return types.CompileResultWAP(function.overloads[signature.args])  # type: ignore[attr-defined]


def _law_at(typingctx, address):  # type: ignore[no-untyped-def]
    law = types.FunctionType(LAW)

    def build(context, builder, signature, args):  # type: ignore[no-untyped-def]
        proxy = cgutils.create_struct_proxy(law)(context, builder)
        for name in context.data_model_manager[law]._fields:
            setattr(proxy, name, cgutils.get_null_value(cgutils.voidptr_t))
        proxy.c_addr = builder.inttoptr(args[0], cgutils.voidptr_t)
        return proxy._getvalue()

    return law(types.int64), build


law_at: Any = intrinsic(_law_at)
"""The law at an address, in a kernel. Passing an address is cheap; passing a function costs 40 us."""
