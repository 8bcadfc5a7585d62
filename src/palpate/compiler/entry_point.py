"""Calls a compiled kernel without numba's dispatcher."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import typeof
from numba.extending import is_jitted

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
    if not is_jitted(kernel):
        return kernel
    function: Any = kernel
    types = tuple(map(typeof, example))
    known = function.overloads.get(types)
    return function.compile(types) if known is None else known.entry_point
