"""Records in kernels: the form of nodes and messages in compiled code.

A record is a numpy structure of fixed size with fields that kernels read and write by name. An array of any length is
represented by its address and shape, without ownership: `floats`, `integers` and `longs` return the array. A record may
also contain a NamedTuple of arrays and numbers, such as the state of a body in `physics`: `fields.form`, `unpacking`.
"""

from typing import Any

import numpy as np

from palpate.compiler import interpreted
from palpate.compiler.kernel import CompiledKernel, kernel
from palpate.compiler.target.intrinsic import intrinsic

MOST = 20  # Maximum number of records of a kernel
RAISED = 1  # Status of a kernel that raised


def address(function: CompiledKernel, *dtypes: np.dtype) -> int:
    """Address of the machine code of a kernel for these records and dt [s], for `call`; compiled or loaded if
    necessary. TypeError: numba cannot compile it for these types."""
    if interpreted.ENABLED:
        return interpreted.address(function, *dtypes)
    from numba import from_dtype, types

    given = (*map(from_dtype, dtypes), types.float64)
    entry: Any = function.entry
    if given not in entry.overloads:
        entry.compile(given)
    code = entry.overloads[given]
    return code.library.get_pointer_to_function(code.fndesc.llvm_func_name)


_invoke = intrinsic(interpreted.invoke, "records.invoke")
"""Call machine code at an address with `count` addresses of records and dt: (status, returned boolean)."""


@kernel
def call(function, records, count, dt):
    """Call machine code (`address`) with `count` records, whose addresses are at the address `records`. Returns whether
    it raised, and the boolean that it returned."""
    status, result = _invoke(function, records, count, dt)
    return status != 0, result != 0


def array_of(element: str | np.dtype) -> Any:
    """An intrinsic for the array (n,) or (n,m) that a field of a record refers to."""
    return intrinsic(interpreted.array_of(element), "records.array_of", element)


floats, integers, longs = map(array_of, ("<f8", "<i4", "<i8"))


def unpacking(kind: type) -> Any:
    """An intrinsic for kernels that returns the NamedTuple in a record. One with arrays stays in the record: kernels
    read its members by name and cannot take it apart (`generators.in_record`); so do those that Python calls."""
    return intrinsic(interpreted.unpacking(kind), "records.unpacking", kind)


nth = intrinsic(interpreted.nth, "records.nth")
"""The message with this index of an input that takes several: `nth(several, place)`."""

clear = intrinsic(interpreted.clear, "records.clear")
"""Set all fields of a record to zero."""


@kernel
def vector(values):
    """Three numbers of a record as a tuple."""
    return values[0], values[1], values[2]


@kernel
def put(values, given):
    """Write three numbers into a record."""
    values[0], values[1], values[2] = given


@kernel
def one(values, number):
    """Set a vector of variable length to a single number."""
    values.count = 1
    values.values[0] = number


@kernel
def lend(handle, array):
    """Let a field of an output refer to an array of the state."""
    handle.address = array.address
    for axis in range(len(handle.shape)):
        handle.shape[axis] = array.shape[axis]


@kernel
def lend_first(handle, array, count):
    """The same for the first `count` rows of an array, or of the first of several arrays."""
    handle.address, handle.shape[0] = array.address, count
    for axis in range(1, len(handle.shape)):
        handle.shape[axis] = array.shape[len(array.shape) - len(handle.shape) + axis]
