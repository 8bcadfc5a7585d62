"""Kernels compile to the same IR with all passes of numba, and to the same numbers."""

import functools
import re

import numpy as np
import pytest
from numba import types
from numba.core.compiler import Compiler, Flags
from numba.core.target_extension import target_override

from palpate.compiler.target import passes
from palpate.compiler.target.code_library import Library
from palpate.compiler.target.target import TARGET, Pinned

VARIABLE = re.compile(
    r"0x[0-9a-f]+|(?<=B)\d*v\d+|(?<=__v)\d+|(?<=\bB)\d+(?=[.\":])|(?<=[._$])\d+|\[\d+ x i8\]|[0-9a-f]{40}"
)
"""Numbers in IR that differ with each compilation."""


def loops(x, n):
    total = 0.0
    for i in range(n):
        if i % 3 == 1:
            continue
        total = total + x[i] ** 2 if i > 2 else total - x[0]
        while total > 50.0:
            total -= 7.0
    return total


def closure(x, n):
    def add(a, b):
        return a + b * n

    return add(x[0], x[1])


def comprehension(x, n):
    return sum([value * n for value in x])


def array_of_list(x, n):
    made = np.array([x[0], 2.0, x[1]])
    return made[2] + n


def array_of_loop(x, n):
    return np.array([x[i] + i for i in range(n)]).sum()


def array_expression(x, n):
    y = np.sqrt(x * x + 1.0) - n
    return y[0] + y[-1]


def reduction(x, n):
    return functools.reduce(lambda a, b: a * b, x) + n


def raises(x, n):
    if n > 100:
        raise ValueError("too many")
    return x[n - 1]


def unpacked(x, n):
    a, b = (x[0], n), (1.0, 2)
    return a[0] * b[0] + a[1] * b[1]


def generated(x, n):
    total = 0.0
    for value in numbers(n):
        total += x[value]
    return total


def constant_branch(x, n, more=None):
    if more is None:
        return x[0]
    return more + n


@Pinned
def numbers(n):
    for i in range(n):
        yield 2 * i % n


FUNCTIONS = [
    loops, closure, comprehension, array_of_list, array_of_loop, array_expression, raises, unpacked, generated,
    constant_branch,
]  # fmt: skip


def compiled(function, pipeline, monkeypatch):
    """A function, compiled with a pipeline, and the lines of its IR."""
    texts = {}
    add = Library.add_ir_module

    def note(self, module):
        texts.setdefault(self.name, str(module))
        add(self, module)

    with monkeypatch.context() as patch:
        patch.setattr(Library, "add_ir_module", note)
        made = Pinned(function, targetoptions={"nopython": True}, pipeline_class=pipeline)
        with target_override(TARGET):
            more = (types.Omitted(None),) * (function.__code__.co_argcount - 2)
            made.compile((types.Array(types.float64, 1, "C"), types.int64, *more))
    text = next(text for name, text in texts.items() if name.endswith(function.__name__))
    lines = VARIABLE.sub("", text).split("\n")
    return made, sorted(line for line in lines if "pickle" not in line)


@pytest.mark.parametrize("function", FUNCTIONS, ids=lambda each: each.__name__)
def test_the_ir_is_that_of_all_passes(function, monkeypatch):
    ours, text = compiled(function, passes.KernelCompiler, monkeypatch)
    _, expected = compiled(function, Compiler, monkeypatch)
    assert text == expected
    x = np.array([1.5, -2.0, 0.25, 4.0, 3.0, 9.0])
    assert ours(x, 5) == pytest.approx(function(x, 5), rel=1e-15)


@pytest.mark.parametrize("left", [passes.Closures, passes.EarlyRewrites, passes.Assignments, passes.LateRewrites])
def test_a_pass_that_is_left_out_is_noticed(left, monkeypatch):
    """The comparison is able to fail: without one of the passes some function has other IR, or none."""

    def differs(function):
        try:
            return compiled(function, passes.KernelCompiler, monkeypatch)[1] != expected[function]
        except Exception:
            return True

    expected = {function: compiled(function, Compiler, monkeypatch)[1] for function in FUNCTIONS}
    monkeypatch.setattr(left, "run_pass", lambda self, state: False)
    assert any(map(differs, FUNCTIONS))


def test_no_pass_of_numba_is_lost():
    """Each of numba's passes runs, in numba's order, replaced or not, but those that write texts."""
    flags = Pinned(loops)._tagged(Flags())
    ours = [kind for kind, _ in passes._passes(flags).passes]
    theirs = [kind for kind, _ in passes.DefaultPassBuilder.define_nopython_pipeline(
        passes.StateDict(flags=flags, func_ir=None)).passes]  # fmt: skip
    assert ours == [passes.REPLACED.get(kind, kind) for kind in theirs if kind not in passes.LEFT_OUT]
    assert all(issubclass(new, old) for old, new in passes.REPLACED.items())
