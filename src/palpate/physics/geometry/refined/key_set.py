"""A set of integers in a kernel: a hash table with linear probing."""

import numpy as np

from palpate.compiler.kernel import kernel
from palpate.physics.arrays import Indices

EMPTY, REMOVED = -1, -2


def set_of_keys(keys: np.ndarray) -> np.ndarray:
    """The table (n,) of a set with these keys, at least 0, and room for as many more."""
    table = np.full(1 << max(4, int(4 * len(keys) - 1).bit_length()), EMPTY)
    _add_all(table, np.ascontiguousarray(keys, np.int64))
    return table


@kernel
def has_key(table: Indices, key: int):
    return table[_place(table, key)] == key


@kernel
def add_key(table: Indices, key: int):
    table[_place(table, key)] = key


@kernel
def remove_key(table: Indices, key: int):
    at = _place(table, key)
    if table[at] == key:
        table[at] = REMOVED


@kernel
def _add_all(table: Indices, keys: Indices):
    for key in keys:
        add_key(table, key)


@kernel
def _place(table: Indices, key: int):
    """Where a key is, or else where it can be added."""
    mask, free = len(table) - 1, -1
    at = (key * 0x9E3779B1 >> 15) & mask  # Knuth's multiplicative hash, with the fraction of the golden ratio
    for _ in range(len(table)):
        if table[at] == key:
            return at
        if table[at] == REMOVED and free < 0:
            free = at
        if table[at] == EMPTY:
            return at if free < 0 else free
        at = (at + 1) & mask
    return free
