"""Calling a compiled kernel at its entry point."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import typeof
from numba.core.dispatcher import Dispatcher

NO_NODES, NO_VECTORS, NO_FLOATS = np.zeros(0, np.int32), np.zeros((0, 3)), np.zeros(0)
"""Empty arrays as messages hold theirs: not to be written to, which to a compiler is a type of its own."""
for _empty in (NO_NODES, NO_VECTORS, NO_FLOATS):
    _empty.setflags(write=False)


def entry_point(kernel: Callable[..., Any], *example: Any) -> Callable[..., Any]:
    """The machine code of `kernel` for arguments of the types of `example`, as a function.

    numba's own call looks at each argument to find the code for its types: 0.3 to 1.3 µs, more than many kernels
    compute. Here nobody looks: an array of another dtype, number of axes or order would be read as if it were like the
    example's. So this is for arguments whose types are settled, like a message's. What is not compiled is returned as
    it is.
    """
    if not isinstance(kernel, Dispatcher):
        return kernel
    types = tuple(map(typeof, example))
    known: Any = kernel.overloads.get(types)
    return kernel.compile(types) if known is None else known.entry_point
