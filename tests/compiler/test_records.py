"""A NamedTuple of arrays in a record, as an argument of a kernel."""

import copy
import pickle
import sys
from typing import Annotated, NamedTuple

import numpy as np
import pytest

from palpate.compiler import interpreted
from palpate.compiler.fields import blank_record, element_type, form
from palpate.compiler.generators.in_record import type_of
from palpate.compiler.kernel import kernel
from palpate.compiler.records import floats, lend, lend_first, unpacking
from palpate.nodes.base import CompiledNode


class Inner(NamedTuple):
    table: Annotated[np.ndarray, "<f4", 2]
    marks: Annotated[np.ndarray, "|b1", 1]
    sign: bool


class Outer(NamedTuple):
    stiff: float
    inner: Inner
    cube: Annotated[np.ndarray, "<f8", 3]
    bend: tuple[float, float, float]
    count: int


VALUE = Outer(
    2.5,
    Inner(np.arange(6, dtype=np.float32).reshape(2, 3), np.array([True, False, True]), True),
    np.arange(24.0).reshape(2, 3, 4),
    (1.0, 2.0, 4.0),
    -7,
)
outer_of = unpacking(Outer)


@kernel
def described(own):
    """Numbers from every member; doubles the cube."""
    outer = outer_of(own.outer)
    inner, cube = outer.inner, outer.cube
    for i in range(cube.shape[0]):
        cube[i] *= 2.0
    marks = inner.marks[0] and not inner.marks[1] and inner.sign
    return outer.stiff, outer.bend[0] + outer.bend[2], outer.count, inner.table[1, 2], marks, cube[1, 2, 3]


@kernel
def summed(outer, scale):
    """The same sum for a NamedTuple in a record and for one of Python; scales the cube."""
    total = outer.stiff + outer.count + outer.bend[1] + outer.inner.table[1, 2] + outer.inner.marks.sum()
    for layer in outer.cube:
        for row in layer:
            for i in range(len(row)):
                row[i] *= scale
                total += outer.cube[0, 0, 1] + row[i]
    return total if outer.inner.sign else -total


@kernel
def summed_in_a_record(own, scale):
    return summed(outer_of(own.outer), scale)


@kernel
def lent(own):
    lend(own.whole, own.outer.cube)
    lend_first(own.rows, own.outer.cube, 1)
    return floats(own.whole).sum(), floats(own.rows).sum()


class Held(CompiledNode):
    State = {"outer": form(Outer), "whole": form(Outer)["cube"], "rows": form(Inner)["table"]}


def held():
    node = Held()
    node.own = np.zeros(1, np.dtype([(n, d) for n, d in Held.State.items()], align=True))[0]
    node._held = {}
    node.hold("outer", VALUE._replace(cube=VALUE.cube.copy()))
    return node


def test_a_kernel_gets_all_members_and_writes_to_the_original_arrays():
    node = held()
    assert described(node.own) == (2.5, 5.0, -7, 5.0, True, 46.0)
    assert (node._held["outer.cube"] == 2.0 * VALUE.cube).all()


def test_an_output_field_can_refer_to_all_or_the_first_rows_of_an_array():
    node = held()
    assert lent(node.own) == (VALUE.cube.sum(), VALUE.cube[0, :1].sum())


def test_an_array_of_another_form_is_an_error():
    node = held()
    wrong = VALUE.inner._replace(table=VALUE.inner.table.astype(float))
    try:
        node.hold("outer", VALUE._replace(inner=wrong))
    except AssertionError as error:
        assert "outer.inner" in str(error) and "table" in str(error)
    else:
        raise AssertionError("taken")


def expected(outer, scale):
    """`summed` in Python, in the same order."""
    total = outer.stiff + outer.count + outer.bend[1] + float(outer.inner.table[1, 2]) + outer.inner.marks.sum()
    flat, later = outer.cube.ravel(), outer.cube.ravel().copy()
    for k, value in enumerate(flat):
        later[k] = value * scale
        total += later[1] + later[k]
    return total if outer.inner.sign else -total


def of_python(**changes):
    inner = VALUE.inner._replace(table=VALUE.inner.table.copy(), marks=VALUE.inner.marks.copy())
    return VALUE._replace(inner=inner, cube=VALUE.cube.copy())._replace(**changes)


needs_numba = pytest.mark.skipif(interpreted.ENABLED, reason="types of numba")


@needs_numba
def test_a_call_from_python_uses_the_code_for_records_and_writes_to_its_arrays():
    node, own = held(), of_python()
    wanted = expected(own, 3.0)
    assert summed_in_a_record(node.own, 3.0) == wanted
    assert summed(own, 3.0) == wanted and (own.cube == 3.0 * VALUE.cube).all()
    assert summed.typeof_pyval(own) is type_of(Outer)
    assert summed(own, 0.5) == expected(of_python(cube=3.0 * VALUE.cube), 0.5)  # reads what the first call has written
    assert summed(of_python(count=4, cube=own.cube), 1.0) == expected(of_python(count=4, cube=own.cube), 1.0)


@needs_numba
@pytest.mark.parametrize(
    "changes",
    [{"cube": VALUE.cube.copy("F")}, {"stiff": 2}, {"bend": (1, 2, 4)}, {"cube": np.ones((4, 3, 4))[::2]}],
    ids=["other order", "an integer for a number", "integers for numbers", "a view"],
)
def test_members_of_another_form_are_taken_as_they_are(changes):
    own = of_python(**changes)
    assert summed.typeof_pyval(own) is not type_of(Outer)
    wanted = expected(own._replace(cube=np.ascontiguousarray(own.cube)), 2.0)
    assert summed(own, 2.0) == wanted


def test_calls_keep_no_reference_to_an_array_and_arrays_without_rows_have_none():
    own = of_python(cube=np.zeros((0, 3, 4)))
    counts = [sys.getrefcount(each) for each in (own.cube, own.inner.table)]
    for _ in range(100):
        assert summed(own, 2.0) == expected(own, 2.0)
    assert [sys.getrefcount(each) for each in (own.cube, own.inner.table)] == counts


class WithUnits(NamedTuple):
    stiff: Annotated[float, "N/m"]
    places: Annotated[np.ndarray, "m"]
    later: "Undefined"  # noqa: F821


@kernel
def third(given):
    return given.stiff + given.places[1] + given.later


@needs_numba
def test_hints_of_another_kind_are_none():
    assert third(WithUnits(1.0, np.arange(3.0), 4)) == 6.0


def test_arrays_and_records_can_be_sent_to_another_process():
    fields = {"way": (3,), "count": int, "group": {"length": ()}}
    state = blank_record(fields, count=3)
    state.group.length = 2.0
    rows = np.zeros(4, element_type(fields))
    rows["count"] = range(4)
    for again in (pickle.loads(pickle.dumps(state)), copy.deepcopy(state)):
        assert again["count"] == 3 and again["group"]["length"] == 2.0
    again = pickle.loads(pickle.dumps(rows))
    assert np.array_equal(again, rows) and again[2].count == 2 and again[2].group.length == 0.0
