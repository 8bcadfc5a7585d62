"""Material laws as compiled functions: an argument of a kernel, or an address that a kernel calls, so that one cached
loop serves every law."""

from collections.abc import Callable
from functools import cache, lru_cache
from typing import Any

from palpate.compiler import interpreted
from palpate.compiler.entry_point import address, caller, compiled


@cache
def law_signature() -> Any:
    """The signature of a law in kernels: (W, U, U', U'') of F, J, the parameters, and room for P and A."""
    from numba import types

    vector, matrix = types.float64[::1], types.float64[:, ::1]
    return types.UniTuple(types.float64, 4)(matrix, types.float64, vector, matrix, matrix)


call_law: Any = caller(law_signature)
"""`call_law(address, F, J, p, P, A)` in a kernel: the law at an address (`law_address`)."""


@lru_cache(maxsize=128)
def compile_law(function: Callable[..., Any], signature: Any) -> Any:
    """The function compiled for a signature such as `law_signature()`, in the form that a kernel accepts. TypeError:
    neither a kernel nor a `numba.njit` function, or it does not match the signature."""
    if interpreted.ENABLED:
        return function
    import numba.experimental.function_type  # noqa: F401  # registers functions as a type of argument
    from numba import types

    return types.CompileResultWAP(compiled(function, signature))


@lru_cache(maxsize=128)
def law_address(function: Callable[..., Any]) -> int:
    """The address of a law for `call_law`. TypeError: see `compile_law`."""
    return address(function, law_signature())
