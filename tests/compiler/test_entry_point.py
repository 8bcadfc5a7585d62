"""The entry point of a kernel computes the same as the kernel."""

from typing import NamedTuple

import numba
import numpy as np
import pytest

from palpate.compiler.entry_point import NO_VECTORS, entry_point


class Law(NamedTuple):
    stiffness: float
    offset: float


@numba.njit
def pull(law, forces, place, count):
    total = law.offset
    for i in range(count):
        total += law.stiffness * (forces[i, 0] * place[0] + forces[i, 1] * place[1] + forces[i, 2] * place[2])
    return total, place


def test_the_entry_point_computes_the_same_as_the_kernel():
    law, forces, place = Law(2.0, 0.5), np.arange(12.0).reshape(4, 3), (1.0, 2.0, 3.0)
    direct = entry_point(pull, law, NO_VECTORS, place, 0)
    assert direct(law, forces, place, 4) == pull(law, forces, place, 4)
    assert direct(Law(3, 0), forces, place, 1) == pull(
        Law(3.0, 0.0), forces, place, 1
    )  # integers are accepted as floats
    with pytest.raises((TypeError, ValueError)):
        direct(law, forces, (1.0, 2.0), 1)


def test_a_plain_function_is_returned_unchanged():
    def plain(x):
        return x

    assert entry_point(plain, 1.0) is plain


def test_the_empty_arrays_are_read_only():
    assert not NO_VECTORS.flags.writeable
