"""A NamedTuple of arrays in a record, as an argument of a kernel."""

from typing import Annotated, NamedTuple

import numpy as np

from palpate.compiler.kernel import kernel
from palpate.compiler.records import floats, form, lend, lend_first, unpacking
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
