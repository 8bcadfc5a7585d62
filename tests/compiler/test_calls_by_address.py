"""Kernels that call functions by their addresses."""

import os
import subprocess
import sys

import numba
import numpy as np
import pytest
from numba import types

from palpate.compiler.entry_point import address, caller, compiled, is_compiled
from palpate.compiler.kernel import kernel

NUMBERS = types.float64[::1]
FORM = types.UniTuple(types.float64, 2)(types.float64, NUMBERS)
call = caller(lambda: FORM)


@kernel
def product(x, numbers):
    """Two results, and one in an array; it raises for a negative number."""
    if x < 0.0:
        raise ValueError("negative")
    numbers[0] = 2.0 * x
    return x * numbers[1], numbers[2]


@numba.njit
def count(x, numbers):
    return x + 1.0, len(numbers)  # an integer, which the signature makes a number


@kernel
def call_each(places, x, numbers, found):
    for i in range(len(places)):
        found[i, 0], found[i, 1] = call(places[i], x, numbers)


def test_one_kernel_calls_all_functions_of_a_signature():
    numbers, found = np.array([0.0, 5.0, 7.0]), np.zeros((3, 2))
    places = np.array([address(each, FORM) for each in (product, count, product)])
    call_each(places, 3.0, numbers, found)
    assert found.tolist() == [[15.0, 7.0], [4.0, 3.0], [15.0, 7.0]] and numbers[0] == 6.0
    assert places[0] == places[2] == address(product, FORM) != places[1]


def test_an_exception_of_the_function_is_that_of_the_kernel():
    found = np.zeros((1, 2))
    with pytest.raises(ValueError, match="negative"):
        call_each(np.array([address(product, FORM)]), -1.0, np.ones(3), found)
    assert found.tolist() == [[0.0, 0.0]]


def test_a_call_with_another_number_of_arguments_does_not_compile():
    @kernel
    def wrong(place):
        return call(place, 1.0)

    with pytest.raises(numba.TypingError):
        wrong(0)


def test_functions_that_do_not_match_are_errors_with_their_names():
    @numba.njit
    def three(x, numbers):
        return x, x, x

    @numba.njit
    def typed(x, numbers):
        return x, 1

    with pytest.raises(TypeError, match=r"expected a function compiled with numba\.njit"):
        address(len, FORM)
    with pytest.raises(TypeError, match="three does not compile for"):
        compiled(three, FORM)
    typed(1.0, np.ones(2))  # compiled with the types of this call: the second result is an integer
    with pytest.raises(TypeError, match=r"typed returns .*int.*, expected"):
        compiled(typed, FORM)
    assert is_compiled(product) and is_compiled(count) and not is_compiled(len)


PLAIN = """
import numpy as np
from numba import njit
from test_calls_by_address import address, call_each, is_compiled, product, FORM
numbers, found = np.array([0.0, 5.0, 7.0]), np.zeros((1, 2))
call_each(np.array([address(product, FORM)]), 3.0, numbers, found)
print(found.tolist(), numbers[0], is_compiled(product), is_compiled(njit(lambda x: x)))
"""


def test_functions_are_called_without_the_compiler():
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1", "PYTHONPATH": os.path.dirname(__file__)}
    done = subprocess.run([sys.executable, "-c", PLAIN], env=environment, capture_output=True, text=True)
    assert done.stdout == "[[15.0, 7.0]] 6.0 True False\n", done.stderr
