"""Calls compiled functions without numba's dispatcher: from Python (`entry_point`), and from kernels by the address of
their machine code (`caller`), so that one cached kernel serves every function of a signature.

An address is passed without cost; a function as an argument takes 40 us. In WebAssembly the number of a function in its
table is its address.
"""

import sys
from collections.abc import Callable
from typing import Any

import numpy as np

from palpate.compiler import interpreted
from palpate.compiler.target.deferred import Deferred, made
from palpate.compiler.target.intrinsic import intrinsic

NO_NODES, NO_VECTORS, NO_FLOATS = np.zeros(0, np.int32), np.zeros((0, 3)), np.zeros(0)
"""Empty arrays as in messages: read-only, which is a separate type for the compiler."""
for _empty in (NO_NODES, NO_VECTORS, NO_FLOATS):
    _empty.setflags(write=False)


def entry_point(kernel: Callable[..., Any], *example: Any) -> Callable[..., Any]:
    """The machine code of `kernel` for arguments of the types of `example`, as a function.

    numba's dispatcher inspects the type of each argument, which takes 0.3 to 1.3 µs, longer than many kernels run.
    Without the inspection an array of another dtype, number of axes or memory order is misread: use this only for
    arguments of fixed types, such as those of a message. A function that is not compiled is returned unchanged.
    """
    if not is_compiled(kernel) or interpreted.ENABLED:
        return kernel
    function: Any = made(kernel)
    given = tuple(map(function.typeof_pyval, example))
    known = function.overloads.get(given)
    return function.compile(given) if known is None else known.entry_point


def is_compiled(value: Any) -> bool:
    """Whether a value is a kernel or a `numba.njit` function; without the compiler only a kernel can be recognised."""
    if interpreted.ENABLED and getattr(value, "py_func", None) is value:
        return True
    return isinstance(value, Deferred) or ("numba" in sys.modules and _is_jitted(value))


def _is_jitted(value: Any) -> bool:
    from numba.extending import is_jitted

    return is_jitted(value)


def compiled(function: Callable[..., Any], signature: Any) -> Any:
    """The code of a kernel or `numba.njit` function for a signature. TypeError: another object, or it does not match
    the signature."""
    if not hasattr(function, "compile"):
        raise TypeError(f"{function!r}: expected a function compiled with numba.njit")
    import numba

    name = getattr(function, "__name__", "function")
    try:
        function.compile(signature)
    except numba.NumbaError as error:
        raise TypeError(f"{name} does not compile for {signature}: {error}") from None
    code = function.overloads[signature.args]  # type: ignore[attr-defined]
    if code.signature.return_type != signature.return_type:  # it was compiled earlier, with the types of a call
        raise TypeError(f"{name} returns {code.signature.return_type}, expected {signature.return_type}")
    return code


def address(function: Callable[..., Any], signature: Any) -> int:
    """Address of the machine code of a kernel or `numba.njit` function for a signature, for a `caller` of it; compiled
    or loaded if necessary. TypeError: see `compiled`."""
    if interpreted.ENABLED:
        return interpreted.address(function)
    code = compiled(getattr(function, "entry", function), signature)
    return code.library.get_pointer_to_function(code.fndesc.llvm_func_name)


def caller(signature: Callable[[], Any]) -> Any:
    """An intrinsic for kernels, `call(address, *arguments)`: calls the function at an address, in numba's convention.
    An exception of the function is that of the kernel.

    signature  returns the signature of the function; called when a kernel is compiled
    """
    return intrinsic(interpreted.called, "entry_point.called", signature)
