"""Memory in kernels: reads and writes by address, for tables and bytes, and small arrays on the stack."""

from typing import Any

import numpy as np

from palpate.compiler import interpreted
from palpate.compiler.target.intrinsic import intrinsic


def pointer(dtype: np.dtype) -> Any:
    """An intrinsic for kernels that returns the record of this dtype at an address."""
    return intrinsic(interpreted.record_at(dtype), "memory.pointer", dtype)


word = intrinsic(interpreted.word, "memory.word")
"""The 64-bit integer at an address."""

number = intrinsic(interpreted.number, "memory.number")
"""The double at an address."""

stack_zeros = intrinsic(np.zeros, "memory.stack_zeros", prefer_literal=True)
"""An array of zeros of a constant shape on the stack of the calling kernel, which must not return it. `np.zeros` would
allocate memory at each call."""

set_word = intrinsic(interpreted.set_word, "memory.set_word")
"""Write a 64-bit integer to an address."""

copy = intrinsic(interpreted.copy, "memory.copy")
"""Copy `count` bytes from one address to another; returns the address after the copy: `copy(to, source, count)`."""

set_big = intrinsic(interpreted.set_big, "memory.set_big")
"""Write a 64-bit integer to an address in big-endian order; returns the address after it: `set_big(to, value)`."""

big = intrinsic(interpreted.big, "memory.big")
"""The 64-bit integer in big-endian order at an address, which need not be aligned."""
