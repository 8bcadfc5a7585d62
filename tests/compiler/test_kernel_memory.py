"""Memory of kernels: arrays on the stack, and the references to arrays that kernels allocate, keep or return."""

import numba
import numpy as np
import pytest
from numba.core.runtime import _nrt_python, rtsys

from palpate.compiler.kernel import kernel
from palpate.compiler.memory import stack_zeros
from palpate.compiler.records import address, call, floats


@kernel
def turned(x, out):
    matrix, sums = stack_zeros((2, 3)), stack_zeros((2,))
    for i in range(2):
        for k in range(3):
            matrix[i, k] += (i + 1) * x[k]
            sums[i] += matrix[i, k]
    out[0], out[1] = sums[0], sums[1]


@kernel
def turned_often(x, out):
    for _ in range(3):
        turned(x, out)
    return out.sum()


def test_an_array_on_the_stack_is_zero_at_each_call():
    out = np.zeros(2)
    assert turned_often(np.array([1.0, 2.0, 4.0]), out) == 21.0
    assert out.tolist() == [7.0, 14.0]


@kernel
def view_of(x):
    return x[1:]


@kernel
def larger(x, limit):
    made = np.zeros(len(x))
    for k in range(len(x)):
        made[k] = max(x[k], limit)
    return made if limit > 0.0 else view_of(x)


@kernel
def step(record, dt):
    values, total = floats(record.values), 0.0
    for limit in range(3):
        total += larger(values, 1.0 * limit).sum() + view_of(values)[0]
    values[0] = total * dt
    return True


@pytest.fixture
def unreleased():
    """The number of arrays that were allocated and not released since the start of the test."""

    def count() -> int:
        stats = rtsys.get_allocation_stats()
        return stats.mi_alloc - stats.mi_free - before

    before = 0
    _nrt_python.memsys_enable_stats()
    before = count()
    yield count
    _nrt_python.memsys_disable_stats()


@pytest.mark.parametrize("limit", [0.0, 2.0])
def test_arrays_that_a_kernel_allocates_or_returns_are_released_once(limit, unreleased):
    x = np.arange(1000.0)
    larger(x, limit)
    before = unreleased()
    for _ in range(100):
        found = larger(x, limit)
    assert found[-1] == 999.0 and found[0] == max(limit, 1.0 - (limit > 0.0))
    del found
    assert unreleased() == before
    assert x.tolist() == list(range(1000))


@kernel
def called(function, records, dt):
    return call(function, records, 1, dt)


def test_a_record_owns_its_arrays(unreleased):
    values = np.arange(1.0, 5.0)
    form = np.dtype([("values", np.dtype([("address", "<i8"), ("shape", "<i8", (1,))], align=True))], align=True)
    record = np.zeros(1, form)
    record["values"]["address"], record["values"]["shape"] = values.ctypes.data, len(values)
    where = np.array([record.ctypes.data])
    compute = address(step, form)
    called(compute, where.ctypes.data, 0.0)
    before = unreleased()
    for _ in range(100):
        values[:] = [1.0, 2.0, 3.0, 4.0]
        assert called(compute, where.ctypes.data, 0.5) == (False, True)
        expected = 0.5 * ((9.0 + 2.0) + (10.0 + 2.0) + (11.0 + 2.0))
        assert values.tolist() == [expected, 2.0, 3.0, 4.0]
    assert unreleased() == before


def test_a_user_function_may_call_kernels_that_allocate():
    @numba.njit
    def user(x):
        return larger(x, 1.5)

    assert user(np.array([1.0, 2.0])).tolist() == [1.5, 2.0]
